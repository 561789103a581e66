"""A sequence of scans of a tumbling body, written as a data set of kind ``lidar-scans``."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import continuous_quaternions, quaternion_from_matrix
from spinfilters.data.atomic_write import make_folder, write_toml
from spinfilters.data.consider_parameter import exact_calibration
from spinfilters.data.dataset import DATASET_FILE
from spinfilters.data.truth import Truth, write_truth
from spinfilters.errors import InputError
from spinfilters.lidar.body_motion import TorqueFreeTumble
from spinfilters.lidar.mass_properties import mass_properties
from spinfilters.lidar.mesh import TriangleMesh
from spinfilters.lidar.scan import Scan
from spinfilters.lidar.scan_files import write_scan
from spinfilters.lidar.scan_streams import KIND, SCAN_FOLDER
from spinfilters.lidar.scanner import Scanner

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Initial:
    """Initial pose and rates of a body at t = 0.

    Attributes
    ----------
    rotation: R_Lg.   translation: origin of g in L, m.   rate: about the principal axes in the order of ascending moments, rad/s.
    velocity: of the centre of mass in L, m/s.
    """

    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, "3"]
    rate: Float[np.ndarray, "3"]
    velocity: Float[np.ndarray, "3"]


def tumble_of(mesh: TriangleMesh, initial: Initial) -> TorqueFreeTumble:
    """The torque-free motion of a body of uniform density. InputError: a mesh without a volume."""
    body = mass_properties(mesh)
    centre = initial.rotation @ body.center_of_mass + initial.translation
    return TorqueFreeTumble(
        body.principal_moments / body.principal_moments[-1],
        body.principal_axes,
        body.center_of_mass,
        initial.rate,
        initial.rotation,
        centre,
        initial.velocity,
    )


def scan_times(
    count: int, interval: float, duration: float
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Begin of every scan and the epoch of its pose, its middle.

    InputError: scans that overlap.
    """
    if duration > interval and count > 1:
        raise InputError(
            f"scans of {duration} s every {interval} s overlap; give a longer interval or faster scans"
        )
    start = interval * np.arange(count)
    return start, start + duration / 2


def scan_sequence(
    scanner: Scanner, motion: TorqueFreeTumble, start: Float[np.ndarray, " n"], seed: int, progress: Progress
) -> list[Scan]:
    """One scan from every begin."""
    generator, scans = np.random.default_rng(seed), []
    for time in start:
        scans.append(scanner.scan(motion, float(time), generator))
        progress(len(scans), len(start))
    return scans


def truth_of(motion: TorqueFreeTumble, time: Float[np.ndarray, " n"]) -> Truth:
    """The true motion at epochs, frame i that of the lidar."""
    R, t = motion.poses(time)
    return Truth(
        time=time,
        center_of_mass=t + R @ motion.center_of_mass,
        q_ig=continuous_quaternions(quaternion_from_matrix(R)),
        velocity=np.broadcast_to(motion.velocity, (len(time), 3)),
        rate_i=motion.rates(time),
        principal_moments=motion.principal_moments / motion.principal_moments.max(),
        principal_axes_g=motion.principal_axes,
        center_of_mass_g=motion.center_of_mass,
    )


def write_sequence(folder: Path, scans: list[Scan], truth: Truth, description: str, kind: str = KIND) -> None:
    """Write dataset.toml, the scans that hold a point, and the truth.

    InputError: disk full, no permission, nothing returned in any scan.
    """
    if not any(scan.is_return.any() for scan in scans):
        raise InputError("no ray of any scan met the body; aim at it, or give a wider field of view")
    make_folder(folder / SCAN_FOLDER)
    digits = len(str(len(scans)))
    for number, scan in enumerate(scans):
        if not scan.is_return.any():
            continue  # there is nothing to read of it
        write_scan(folder / SCAN_FOLDER / f"{number:0{digits}d}.ply", scan)
    write_truth(truth, folder)
    exact = exact_calibration(("lidar",))
    write_toml(folder / DATASET_FILE, {"kind": kind, "description": description, "calibration": exact})
