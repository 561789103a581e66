"""Rates and moments of a tumbling body from scans alone.

The noise not stated: filtered and smoothed.
    python -m experiments.lidar_tumble [--seeds 10] [--mesh FILE] [--rate-rpm 1.43 1.91 1.15] [-o lidar-tumble.png]
                                       [--disturbances FORCE TORQUE]

The figure shows the first seed. Without disturbances in the motion their densities cannot be told from zero, and a covariance that
does not know so is too wide; with some that the data tell NEES is the test that it should be.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.stats import chi2

from experiments.command_line import run_study
from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.conventions import RPM
from spinfilters.evaluation.consistency import true_states
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.io.dataset import Dataset, DatasetOptions
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.truth import Truth
from spinfilters.lidar.mesh import TriangleMesh, box, read_mesh
from spinfilters.lidar.scan import RayPattern, rvs_noise
from spinfilters.lidar.scan_poses import scan_poses
from spinfilters.lidar.scan_streams import in_frame_of, pose_stream
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.plots.style import BLUE, GREY, RED, save_figure
from spinfilters.run.estimation import compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.lidar_scanner import LidarSettings, Scanner
from spinfilters.simulation.lidar_sequence import Initial, scan_times, truth_of, tumble_of
from spinfilters.simulation.scenario import Motion, simulate_motion

PLACE, VELOCITY = np.array([30.0, 0.0, 0.0]), np.array([2e-3, 1e-3, -1e-3])
LARGEST_RATE_ERROR = 0.1
"""Deg/s, asked for."""
DOF = 14
"""Of a state of 20, as the frame g of the truth is fitted."""


def main() -> None:
    """Print a line per seed and estimator, and the NEES of all."""
    options = parser().parse_args()
    mesh = read_mesh(options.mesh) if options.mesh else box((1.0, 1.3, 0.8))
    scanner = Scanner.of(
        mesh, LidarSettings(RayPattern((options.field,) * 2, (options.rays,) * 2), rvs_noise())
    )
    last: dict[str, list[float]] = {}
    noise = ProcessNoise(*options.disturbances)
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        dataset = scans_of(mesh, scanner, np.array(options.rate_rpm) * RPM, seed, noise)
        settings = Settings(estimators=("mekf", "smoother"))
        found = compare_estimators(prepare(dataset, settings), settings, lambda *_: None).evaluations
        for each in found:
            tell(seed, each, last)
        if seed == options.first_seed:
            save_figure(figure(found, dataset), options.output)
    for name, values in last.items():
        low, high = chi2.ppf([0.025, 0.975], DOF * len(values)) / DOF / len(values)
        print(
            f"{name}: mean NEES per dof of the last epochs {np.mean(values):.2f}, band {low:.2f} to {high:.2f}"
        )


def parser() -> argparse.ArgumentParser:
    """Options of the command."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("--seeds", type=int, default=10)
    made.add_argument("--mesh", type=Path, help="default: a box of 1 x 1.3 x 0.8 m")
    made.add_argument("--rate-rpm", type=float, nargs=3, default=(1.43, 1.91, 1.15))
    made.add_argument("--field", type=float, default=4.0, help="of view, deg")
    made.add_argument("--rays", type=int, default=121)
    made.add_argument("--first-seed", type=int, default=0)
    made.add_argument(
        "--disturbances", type=float, nargs=2, default=(0.0, 0.0), help="densities of force and torque"
    )
    made.add_argument("-o", "--output", type=Path, default=Path("lidar-tumble.png"))
    return made


@dataclass(frozen=True, eq=False)
class RecordedTumble:
    """A body in the poses of a truth, at its own epochs."""

    truth: Truth

    def poses(
        self, time: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"]]:
        """See `BodyMotion`."""
        assert self.truth.center_of_mass_g is not None
        rows = np.searchsorted(self.truth.time, time)
        R = matrix_from_quaternion(self.truth.q_ig[rows])
        return R, self.truth.center_of_mass[rows] - R @ self.truth.center_of_mass_g


def scans_of(
    mesh: TriangleMesh, scanner: Scanner, rate: np.ndarray, seed: int, noise: ProcessNoise
) -> Dataset:
    """Sixty scans at 1 Hz, from an attitude of this seed, as poses."""
    q = np.random.default_rng(seed).standard_normal(4)
    attitude = matrix_from_quaternion(q / np.linalg.norm(q))
    begin, epochs = scan_times(60, 1.0, 0.0)
    truth = truth_of(tumble_of(mesh, Initial(attitude, PLACE, rate, VELOCITY)), epochs)
    truth = disturbed(truth, noise, seed)
    generator = np.random.default_rng(seed)
    scans = [scanner.scan(RecordedTumble(truth), float(time), generator) for time in begin]
    found = scan_poses(scans)
    stream, told = pose_stream(found), "; ".join(found.remarks)
    return Dataset(
        kind="lidar-poses",
        log=MeasurementLog((stream,)),
        truth=in_frame_of(stream, truth),
        description=told,
        options=DatasetOptions(covariance_inflation=found.inflation),
        doubts=found.doubts,
    )


def disturbed(truth: Truth, noise: ProcessNoise, seed: int) -> Truth:
    """The motion from its first epoch on with white disturbances."""
    if not noise.force_psd + noise.torque_psd > 0:
        return truth
    process = TorqueFreeProcess(StateLayout(FULL_BLOCKS), noise)
    first = true_states(truth, process.layout)[0]
    states = simulate_motion(process, first, truth.time, np.random.default_rng([seed, 1]))
    motion = Motion(process.layout, truth.time, states)
    place = motion.block("t") + motion.rotations @ np.asarray(truth.center_of_mass_g)
    rate = np.einsum("kij,kj->ki", motion.rotations, motion.block("w"))
    return replace(
        truth, center_of_mass=place, q_ig=motion.block("a"), velocity=motion.block("v"), rate_i=rate
    )


def tell(seed: int, found: Evaluation, last: dict[str, list[float]]) -> None:
    """Print one run, and append its NEES at the last epoch to ``last``."""
    assert found.errors is not None
    assert found.errors.rate is not None
    assert found.body_errors is not None
    assert found.body_errors.principal_moments is not None
    assert found.nees is not None
    rate = np.rad2deg(np.sqrt(np.mean(np.sum(found.errors.rate**2, axis=1))))
    moments = np.abs(found.body_errors.principal_moments).max()
    per_dof = found.nees.total[-1] / found.nees.dof
    last.setdefault(found.name, []).append(float(per_dof))
    print(
        f"seed {seed}, {found.name}: {found.history.status.verdict}, rate {rate:.4f} deg/s RMS (asked "
        f"{LARGEST_RATE_ERROR}), moments within {100 * moments:.2f} % (asked 2), NEES per dof at the end {per_dof:.2f}"
        f"{''.join(f'; {reason}' for reason in found.history.status.reasons)}",
        flush=True,
    )


def figure(found: Sequence[Evaluation], dataset: Dataset) -> Figure:
    """Rate errors over time, and moments beside the true ones with their standard deviations."""
    drawn = Figure(figsize=(10, 4), layout="constrained")
    rates, moments = drawn.subplots(1, 2)
    for number, (each, colour) in enumerate(zip(found, (BLUE, RED), strict=True)):
        assert each.errors is not None
        assert each.errors.rate is not None
        size = np.rad2deg(np.linalg.norm(each.errors.rate, axis=1))
        rates.semilogy(each.errors.time, size, color=colour, label=each.name)
        moments.errorbar(
            np.arange(3) + 0.1 * number,
            each.body.principal_moments,
            3 * each.body.principal_moments_std,
            fmt="o",
            capsize=3,
            color=colour,
            label=f"{each.name}, 3 sigma",
        )
    rates.axhline(LARGEST_RATE_ERROR, color=GREY, linestyle="--", label="asked for")
    rates.set(xlabel="time (s)", ylabel="rate error (deg/s)")
    assert dataset.truth is not None
    moments.plot(np.arange(3), np.asarray(dataset.truth.principal_moments), "kx", label="true")
    moments.set(xticks=range(3), xticklabels=("minor", "middle", "major"), ylabel="moment / largest")
    rates.legend()
    moments.legend()
    return drawn


if __name__ == "__main__":
    run_study(main)
