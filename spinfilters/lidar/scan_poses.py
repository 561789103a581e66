"""Poses of a body from a sequence of scans, by faces or by registration."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.lidar.common_errors import shared_inflation
from spinfilters.lidar.edge_adjustment import edge_adjusted
from spinfilters.lidar.face_consistency import MOST_CONTRADICTED
from spinfilters.lidar.face_map import TrackedFaces
from spinfilters.lidar.face_tracking import track_faces
from spinfilters.lidar.planes import FEWEST, FittedPlane, extent_of, extract_planes
from spinfilters.lidar.point_noise import PointNoise, identified_noise
from spinfilters.lidar.registration import RegistrationEngine
from spinfilters.lidar.scan import Scan, without_isolated, without_repeats
from spinfilters.lidar.scan_matching import MOST_POINTS, SURE_OVERLAP, match_scans
from spinfilters.lidar.scan_pose import ScanPose, rotation_vector

PLANE_SHARE: Final = 0.75
"""Share of the points on planes, of the median scan, from which a body counts as one with faces."""
SMEAR: Final = 0.01
"""Range noise that stands for the motion during a scan in the first pass, in extents of the body."""
DESKEWED: Final = 3
"""Passes that take the motion during the scans out, each with the rates of the one before."""
DOUBTED: Final = 0.05
"""Share of the scans, beyond which planes that contradict the drift are a reason to doubt all poses."""
TOLD_ISOLATED: Final = 0.002
"""Share of isolated points that is told of."""
MOST_EXCESS: Final = 1.25
"""Mean reduced chi-square of the planes' points, of the median scan, at most.

Patches of a curved surface exceed the noise: plane faces have 0.8 to 1.0, a bumpy sphere of a metre at 30 m 1.2 to 2.5."""
LOOKED_AT: Final = 9
"""Scans that tell whether a body has faces."""


@dataclass(frozen=True, eq=False)
class ScanPoses:
    """Poses of all usable scans.

    Attributes
    ----------
    poses: in order of time; frame g has the lidar's axes at the first scan.
    scans: that the poses are of.   faces: the map, of a body with faces.
    noise: of the points, given or identified.   remarks: what was left out or not determined, in words.
    doubts: reasons why these poses are not to be trusted.
    inflation: for errors that poses share, of their own covariances where they have such, else within their covariances.
    """

    poses: tuple[ScanPose, ...]
    scans: tuple[Scan, ...]
    faces: TrackedFaces | None
    noise: PointNoise
    remarks: tuple[str, ...]
    doubts: tuple[str, ...] = ()
    inflation: float = 1.0

    @property
    def by_faces(self) -> bool:
        """Whether the body's faces were followed, rather than scans registered."""
        return self.faces is not None

    def points(self, number: int) -> Float[np.ndarray, "n 3"]:
        """Points of a scan where they were at its epoch, frame L, m."""
        return _deskewed(self.scans[number], self.poses, number)


def scan_poses(
    scans: Sequence[Scan],
    noise: PointNoise | None = None,
    engine: RegistrationEngine | None = None,
    seed: int = 0,
) -> ScanPoses:
    """Poses at the scans' epochs; motion during a scan is taken out in a second pass.

    Parameters
    ----------
    noise: of the points; None identifies it.   engine: of registration, see `match_scans`.

    Raises
    ------
    InputError: fewer than two scans with points.
    """
    solid = [without_isolated(without_repeats(scan)) for scan in scans]
    usable = _usable([scan for scan, _ in solid])
    noise = noise or identified_noise(usable)
    times = [scan.epoch for scan in usable]
    clouds = [scan.points for scan in usable]
    moving = any(np.ptp(scan.point_times) > 0 for scan in usable)
    smeared = replace(noise, range_std=noise.range_std + SMEAR * extent_of(clouds[0])) if moving else noise
    by_faces = _has_faces(clouds, smeared, seed)
    planes = _planes(clouds, smeared, seed) if by_faces else None
    poses, faces, inflation = _poses(times, clouds, planes, engine)
    for _ in range(DESKEWED if moving else 0):
        clouds = [_deskewed(scan, poses, k) for k, scan in enumerate(usable)]
        planes = _planes(clouds, noise, seed) if by_faces else None
        poses, faces, inflation = _poses(times, clouds, planes, engine)
    if faces is not None:
        faces = edge_adjusted(faces, clouds, noise, extent_of(clouds[0]))
        poses, inflation = faces.poses, shared_inflation(faces.poses, faces.common)
    isolated = sum(count for _, count in solid) / sum(np.count_nonzero(scan.is_return) for scan in scans)
    remarks = _remarks(len(scans) - len(usable), isolated, poses, faces)
    doubts = _doubts(poses, faces, clouds)
    return ScanPoses(tuple(poses), tuple(usable), faces, noise, remarks, doubts, inflation)


def _usable(scans: Sequence[Scan]) -> list[Scan]:
    """Scans with points enough; InputError of fewer than two."""
    usable = [scan for scan in scans if np.count_nonzero(scan.is_return) >= FEWEST]
    if len(usable) < 2:
        raise InputError(
            f"{len(usable)} of {len(scans)} scans hold {FEWEST} points or more; give at least two that see the body"
        )
    return usable


def _remarks(
    left_out: int, isolated: float, poses: Sequence[ScanPose], faces: TrackedFaces | None
) -> tuple[str, ...]:
    """Remarks on scans and points left out; ``isolated`` is the share of such points."""
    remarks = [f"{left_out} scans with fewer than {FEWEST} points are left out"] if left_out else []
    if isolated > TOLD_ISOLATED:
        remarks.append(
            f"{100 * isolated:.2g} % of the points stand apart from those beside them (dust, clutter) and are left out"
        )
    if faces is not None and faces.contradicted:
        remarks.append(_contradicted(faces.contradicted, len(poses)))
    blind = [pose for pose in poses if pose.undetermined]
    if blind:
        remarks.append(
            f"{len(blind)} scans do not determine the whole pose; the first lacks {', '.join(blind[0].undetermined)}"
        )
    return tuple(remarks)


def _doubts(
    poses: Sequence[ScanPose], faces: TrackedFaces | None, clouds: Sequence[Float[np.ndarray, "n 3"]]
) -> tuple[str, ...]:
    """Reasons to trust no pose."""
    most = DOUBTED * len(poses)
    if faces is not None:
        return (_contradicted(faces.contradicted, len(poses)),) if faces.contradicted > most else ()
    apart = [p.matched < SURE_OVERLAP * min(len(c), MOST_POINTS) for p, c in zip(poses, clouds, strict=True)]
    if not sum(apart) > most:
        return ()
    return (
        f"{sum(apart)} of {len(poses)} scans share less than half of their surface with the others and may be turned wrongly; scan "
        "more often",
    )


def _has_faces(clouds: Sequence[Float[np.ndarray, "n 3"]], noise: PointNoise, seed: int) -> bool:
    """Whether most points of some scans lie on planes."""
    generator = np.random.default_rng(seed)
    looked_at = clouds[:: max(1, len(clouds) // LOOKED_AT)][:LOOKED_AT]
    found = [extract_planes(points, noise, generator) for points in looked_at]
    flat = np.median([_excess(planes) for planes, _ in found]) < MOST_EXCESS
    return bool(np.median([share for _, share in found]) >= PLANE_SHARE and flat)


def _planes(
    clouds: Sequence[Float[np.ndarray, "n 3"]], noise: PointNoise, seed: int
) -> list[list[FittedPlane]]:
    """Planes of every scan."""
    generator = np.random.default_rng(seed)
    return [extract_planes(points, noise, generator)[0] for points in clouds]


def _excess(planes: Sequence[FittedPlane]) -> float:
    """Reduced chi-square of all points on planes; infinite without any."""
    counts = [plane.count for plane in planes]
    return float(np.average([plane.spread**2 for plane in planes], weights=counts)) if planes else np.inf


def _poses(
    times: Sequence[float],
    clouds: Sequence[Float[np.ndarray, "n 3"]],
    planes: list[list[FittedPlane]] | None,
    engine: RegistrationEngine | None,
) -> tuple[Sequence[ScanPose], TrackedFaces | None, float]:
    """Poses, the map of faces, and the inflation of the poses' own covariances."""
    middle = clouds[0].mean(axis=0)
    if planes is None:
        matched = match_scans(times, clouds, middle, engine)
        return matched.poses, None, matched.inflation
    faces = track_faces(times, planes, middle, extent_of(clouds[0]))
    return faces.poses, faces, 1.0


def _contradicted(count: int, total: int) -> str:
    if count > MOST_CONTRADICTED * total:
        return f"{count} of {total} scans put the body where no uniform drift leads: forces act, or faces are taken for one another"
    return f"{count} scans lose a plane that no face of the drifting body explains"


def _deskewed(scan: Scan, poses: Sequence[ScanPose], number: int) -> Float[np.ndarray, "n 3"]:
    """Points where they were at the scan's epoch, with the mean rates between the neighbouring scans."""
    before, after = poses[max(number - 1, 0)], poses[min(number + 1, len(poses) - 1)]
    span = after.time - before.time
    rate = rotation_vector(after.rotation @ before.rotation.T) / span
    velocity = (after.translation - before.translation) / span
    here, late = poses[number], scan.point_times - poses[number].time
    arm = scan.points - here.translation - late[:, None] * velocity
    speed = float(np.linalg.norm(rate))
    if speed == 0:
        return arm + here.translation
    axis, angle = rate / speed, -speed * late[:, None]
    turned = (
        arm * np.cos(angle)
        + np.cross(axis, arm) * np.sin(angle)
        + axis * (arm @ axis)[:, None] * (1 - np.cos(angle))
    )
    return turned + here.translation
