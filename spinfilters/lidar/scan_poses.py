"""Poses of the body in a sequence of scans: by its faces, tracked from scan to scan, or by registration of points."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from spinfilters.core.absolute_orientation import nearest_rotation
from spinfilters.core.attitude_conversions import angle_from_matrix, matrix_from_rotation_vector
from spinfilters.core.errors import InputError
from spinfilters.core.gauss_newton import gauss_newton
from spinfilters.core.robust_losses import median_deviation
from spinfilters.lidar.adjustment_covariance import shared_inflation
from spinfilters.lidar.edge_adjustment import edge_adjusted
from spinfilters.lidar.face_map import (
    FEWEST_FOR_DRIFT,
    MOST_CONTRADICTED,
    Face,
    MatchedFace,
    PlaneEvidence,
    TrackedFaces,
    adjusted_faces,
    consistent_faces,
    face_jacobian,
    merged_faces,
    pose_equations,
    residual_and_jacobian,
    uniform_drift,
    with_map_errors,
)
from spinfilters.lidar.planes import (
    CLEAR,
    FEWEST,
    FLATNESS,
    FittedPlane,
    PointNoise,
    extent_of,
    extract_planes,
    identified_noise,
)
from spinfilters.lidar.scan import Scan, without_isolated, without_repeats
from spinfilters.lidar.scan_adjustment import MOST_POINTS, SURE_OVERLAP, match_scans
from spinfilters.lidar.scan_pose import (
    MOST_SCANS,
    ScanPose,
    drifted_origin,
    interpolated_rotation,
    move_placement,
    pose_covariance,
    predicted_pose,
    rates_of_steps,
    rotation_vector,
)

WIDEST_MATCH: Final = np.deg2rad(40.0)
"""Angle between a predicted and a seen normal, at most: faces of a box are 90 deg apart."""
_STEPS, _SWEEPS = 4, 2
_HUGE = 1e6
_RIDGE = 1e-9


def track_faces(
    times: Sequence[float],
    planes: Sequence[Sequence[FittedPlane]],
    middle: Float[np.ndarray, "3"],
    size: float,
) -> TrackedFaces:
    """Poses and faces from the planes of every scan.

    Tracked twice: where one face is in view, a rotation about its normal comes from the rate alone, which is known better from the
    scans before and after than from the first few.
    Frame g has the lidar's axes at the first scan and its origin at ``middle``.

    Parameters
    ----------
    size : float
        Of the body, m: how far a predicted position may be wrong.
    """
    poses, faces, matches = _follow_faces(times, planes, middle, size, ())
    poses, faces, matches = _follow_faces(times, planes, middle, size, poses)
    return _adjust_map(poses, faces, matches, planes, size)


def _follow_faces(
    times: Sequence[float],
    planes: Sequence[Sequence[FittedPlane]],
    middle: Float[np.ndarray, "3"],
    size: float,
    before: Sequence[ScanPose],
) -> tuple[list[ScanPose], list[Face], list[tuple[int, ...]]]:
    """Poses, faces and matches in the order of time; ``before`` holds the poses of an earlier pass, or none."""
    poses: list[ScanPose] = []
    faces: list[Face] = []
    matches: list[tuple[int, ...]] = []
    rates = rates_of_steps(before)
    for number, (time, seen) in enumerate(zip(times, planes, strict=True)):
        R, t = predicted_pose(poses, time, size) if poses else (np.eye(3), middle)
        if number and rates is not None:
            R = matrix_from_rotation_vector((time - poses[-1].time) * rates[number - 1]) @ poses[-1].rotation
            if len(poses) > 1:
                t = drifted_origin(poses[-MOST_SCANS:], time, R, size)
        pairs: list[tuple[int, int]] = []
        for gate in (0.5 * size, 0.15 * size):
            pairs = _match_planes(seen, faces, R, t, gate)
            R, t = _align_pose([MatchedFace(seen[i], faces[j]) for i, j in pairs], R, t, size)
        of_plane = dict(pairs)
        for plane_number, plane in enumerate(seen):
            if plane_number not in of_plane:
                of_plane[plane_number] = len(faces)
                faces.append(Face(R.T @ plane.normal, float(plane.normal @ (plane.centroid - t))))
        matches.append(tuple(of_plane[each] for each in range(len(seen))))
        known = pose_equations([MatchedFace(seen[i], faces[j]) for i, j in pairs], R, t).information
        poses.append(ScanPose(time, R, t, pose_covariance(known, R, size)[0]))
    return poses, faces, matches


def _match_planes(
    seen: Sequence[FittedPlane],
    faces: Sequence[Face],
    R: Float[np.ndarray, "3 3"],
    t: Float[np.ndarray, "3"],
    gate: float,
) -> list[tuple[int, int]]:
    """Pairs (plane, face) of least total disagreement with a predicted pose."""
    if not seen or not faces:
        return []
    angle = np.array([[np.arccos(np.clip(p.normal @ R @ f.normal, -1, 1)) for f in faces] for p in seen])
    shift = np.array([[abs(p.normal @ (p.centroid - t) - f.offset) for f in faces] for p in seen])
    cost = angle / WIDEST_MATCH + shift / gate
    cost[(angle > WIDEST_MATCH) | (shift > gate)] = _HUGE
    rows, columns = linear_sum_assignment(cost)
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if cost[i, j] < _HUGE]


def _align_pose(
    pairs: Sequence[MatchedFace],
    R: Float[np.ndarray, "3 3"],
    t: Float[np.ndarray, "3"],
    size: float,
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Pose of the matched faces.

    Wahba's attitude first, then Gauss-Newton with the planes' covariances and the predicted pose.
    """
    if len(pairs) >= 2:
        weights = [1 / max(np.trace(p.covariance[:2, :2]), 1e-30) for p, _ in pairs]
        weights = np.array(weights) / max(weights)
        prior = 1e-3 * R  # the predicted attitude decides what fewer than two directions leave open
        M = prior + sum(w * np.outer(p.normal, f.normal) for w, (p, f) in zip(weights, pairs, strict=True))
        R = nearest_rotation(M)
    weak = np.repeat([1e-6, 1e-6 / size**2], 3)
    return gauss_newton(
        (R, t),
        lambda placement: pose_equations(pairs, *placement),
        move_placement,
        lambda step, _: bool(np.linalg.norm(step[:3]) < 1e-13),
        _STEPS if pairs else 0,
        lambda H: weak * np.trace(H) / 6 * 1e-6 + 1e-12,
    ).state


def _adjust_map(
    poses: list[ScanPose],
    faces: list[Face],
    matches: list[tuple[int, ...]],
    planes: Sequence[Sequence[FittedPlane]],
    size: float,
) -> TrackedFaces:
    """All poses and faces, adjusted by turns.

    Each face from all scans that see it, each pose from all faces that it sees.
    """
    for sweep in range(2 * _SWEEPS):
        faces = [_refit_face(k, face, poses, matches, planes) for k, face in enumerate(faces)]
        if sweep >= _SWEEPS and len(poses) >= FEWEST_FOR_DRIFT:
            faces, poses = _fit_uniform_drift(faces, poses, matches, planes)
        poses = _fit_poses(TrackedFaces(tuple(poses), tuple(faces), tuple(matches)), planes, size)
    tracked = adjusted_faces(
        TrackedFaces(tuple(poses), tuple(faces), tuple(matches)), PlaneEvidence(planes), size
    )
    merged = merged_faces(tracked, size)
    if len(merged.faces) < len(tracked.faces):
        tracked = adjusted_faces(merged, PlaneEvidence(planes), size)
    found = consistent_faces(_fit_all_poses(tracked, planes, size), planes, size)
    tracked, planes = adjusted_faces(found.tracked, PlaneEvidence(found.planes), size), found.planes
    tracked = _fit_all_poses(
        _interpolate_undetermined(_fit_all_poses(tracked, planes, size), size), planes, size
    )
    tracked = with_map_errors(tracked, PlaneEvidence(planes), size)
    return replace(tracked, contradicted=found.contradicted)


def _interpolate_undetermined(tracked: TrackedFaces, size: float) -> TrackedFaces:
    """Scans that do not determine their pose begin from where those before and after lead."""
    drift, poses = uniform_drift(tracked, size), list(tracked.poses)
    for k, pose in enumerate(tracked.poses):
        if pose.undetermined:
            place = drift.place(k) if np.isfinite(drift.scatter) else pose.translation
            poses[k] = replace(pose, rotation=interpolated_rotation(tracked.poses, k), translation=place)
    return replace(tracked, poses=tuple(poses))


def _fit_all_poses(
    tracked: TrackedFaces, planes: Sequence[Sequence[FittedPlane]], size: float
) -> TrackedFaces:
    """Tracked faces with every pose fitted to those that its scan sees."""
    return replace(tracked, poses=tuple(_fit_poses(tracked, planes, size)))


def _fit_poses(tracked: TrackedFaces, planes: Sequence[Sequence[FittedPlane]], size: float) -> list[ScanPose]:
    """Every pose from the faces that its scan sees."""
    return [
        _fit_pose(pose, tracked.faces, match, seen, size)
        for pose, match, seen in zip(tracked.poses, tracked.matches, planes, strict=True)
    ]


def _fit_uniform_drift(
    faces: list[Face],
    poses: list[ScanPose],
    matches: list[tuple[int, ...]],
    planes: Sequence[Sequence[FittedPlane]],
) -> tuple[list[Face], list[ScanPose]]:
    """Face offsets and poses under a uniform drift of the origin of g.

    The drift makes that origin the centre of rotation. Planes alone do not determine how far apart faces are that no scan sees
    together. With attitudes given, n.(r + v time) + d = n.c of every plane is linear in r, v and the offsets d.
    """
    start, rows, values = poses[0].time, [], []
    span = poses[-1].time - start
    for pose, match, seen in zip(poses, matches, planes, strict=True):
        for plane, k in zip(seen, match, strict=True):
            # columns: place r at the start (3), drift v over the whole span (3), offset of every face
            n, row = pose.rotation @ faces[k].normal, np.zeros(6 + len(faces))
            row[:3], row[3:6], row[6 + k] = n, n * (pose.time - start) / span, 1.0
            rows.append(row)
            values.append(n @ plane.centroid)
    A, b = np.array(rows), np.array(values)
    before = np.array(
        [*poses[0].translation, *(poses[-1].translation - poses[0].translation), *(f.offset for f in faces)]
    )
    residual, step = b - A @ before, np.zeros(len(before))
    for _ in range(_STEPS):  # Cauchy weights at three robust standard deviations
        scatter = median_deviation(residual - A @ step) + 1e-12
        weights = 1 / (1 + ((residual - A @ step) / (3 * scatter)) ** 2)
        H = (A * weights[:, None]).T @ A
        step = np.linalg.solve(H + _RIDGE * np.trace(H) / len(H) * np.eye(len(H)), A.T @ (weights * residual))
    x = before + step
    moved = [replace(pose, translation=x[:3] + x[3:6] * (pose.time - start) / span) for pose in poses]
    return [Face(face.normal, float(offset)) for face, offset in zip(faces, x[6:], strict=True)], moved


def _fit_pose(
    pose: ScanPose, faces: Sequence[Face], match: tuple[int, ...], seen: Sequence[FittedPlane], size: float
) -> ScanPose:
    pairs = [MatchedFace(plane, faces[k]) for plane, k in zip(seen, match, strict=True)]
    R, t = (
        _align_pose(pairs, pose.rotation, pose.translation, size)
        if pairs
        else (pose.rotation, pose.translation)
    )
    covariance, lacking = pose_covariance(pose_equations(pairs, R, t).information, R, size)
    return ScanPose(pose.time, R, t, covariance, lacking, len(pairs))


def _refit_face(
    number: int,
    face: Face,
    poses: list[ScanPose],
    matches: list[tuple[int, ...]],
    planes: Sequence[Sequence[FittedPlane]],
) -> Face:
    """A face from every scan that sees it: three numbers, linear about the present ones."""
    H, b = 1e-12 * np.eye(3), np.zeros(3)
    for pose, match, seen in zip(poses, matches, planes, strict=True):
        for plane, k in zip(seen, match, strict=True):
            if k != number:
                continue
            residual, _ = residual_and_jacobian(plane, face, pose.rotation, pose.translation)
            J = face_jacobian(plane, face, pose.rotation, pose.translation)
            W = np.linalg.inv(plane.covariance)
            H += J.T @ W @ J
            b -= J.T @ W @ residual
    return face.moved(np.linalg.solve(H, b))


PLANE_SHARE: Final = 0.75
"""Share of the points on planes, of the median scan, from which a body counts as one with faces."""
SMEAR: Final = 0.01
"""Range noise that accounts for the motion during a scan in the first pass, in extents of the body."""
DESKEWED: Final = 3
"""Passes that take the motion during the scans out, each with the rates of the one before."""
DOUBTED: Final = 0.05
"""Share of the scans, beyond which planes that contradict the drift are a reason to doubt all poses."""
TOLD_ISOLATED: Final = 0.002
"""Share of isolated points from which a remark names it."""
MOST_EXCESS: Final = 1.25
"""Mean reduced chi-square of the planes' points, of the median scan, at most.

Patches of a curved surface exceed the noise: plane faces have 0.8 to 1.0, a bumpy sphere of a metre at 30 m 1.2 to 2.5."""
CONFIRMED: Final = np.deg2rad(2.0)
"""Angle between attitudes that were found in two ways, up to which they are the same one.

Panels that are taken for one another can turn a scan by less than 5 deg."""
FEWEST_CONFIRMED: Final = 2
"""Scans with such an attitude, of fewer of which nothing is estimated."""
MOST_FRAMES: Final = 50
"""Scans whose rotation between both frames g is tried."""
LOOKED_AT: Final = 9
"""Scans from which it is decided whether a body has faces."""
MOST_IN_FRONT: Final = 0.1
"""Share of a scan's points in front of one of its planes, of the median scan, up to which a body counts as convex.

A box has none, a spacecraft with panels 0.4 to 0.9."""
FEWEST_REGISTERED: Final = 600
"""Points of the median scan from which such a body is registered: of fewer, 500 on a spacecraft, attitudes were 5 deg off."""

FEWEST_OF_ANY: Final = 150
"""Points of the median scan, of fewer of which such a body is refused.

On a spacecraft, 16 of 40 attitudes that two ways confirmed were off by more than 1 deg (7.5 at most) of 106 points, 5 of 50
(1.9 at most) of 134, none of 310."""


@dataclass(frozen=True, eq=False)
class ScanPoses:
    """Poses of all usable scans.

    Attributes
    ----------
    poses : tuple[ScanPose, ...]
        In order of time; frame g has the lidar's axes at the first scan.
    scans : tuple[Scan, ...]
        That the poses are of.
    faces : TrackedFaces or None
        The map, of a body with faces.
    noise : PointNoise
        Of the points, given or identified.
    remarks : tuple[str, ...]
        What was left out or not determined, in words.
    doubts : tuple[str, ...]
        Reasons why these poses are not to be trusted.
    inflation : float
        For errors that poses share, of their own covariances where they have such, else within their
        covariances.
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
        return _deskew_points(self.scans[number], self.poses, number)


def scan_poses(scans: Sequence[Scan], noise: PointNoise | None = None, seed: int = 0) -> ScanPoses:
    """Poses at the scans' epochs; motion during a scan is taken out in a second pass.

    Parameters
    ----------
    noise : PointNoise or None
        Of the points; None identifies it.
    seed : int
        Of the samples among which planes are looked for.

    Raises
    ------
    InputError
        Fewer than two scans with points.
    """
    solid = [without_isolated(without_repeats(scan)) for scan in scans]
    usable = _require_usable([scan for scan, _ in solid])
    noise = noise or identified_noise(usable)
    times = [scan.epoch for scan in usable]
    clouds = [scan.points for scan in usable]
    moving = any(np.ptp(scan.point_times) > 0 for scan in usable)
    smeared = replace(noise, range_std=noise.range_std + SMEAR * extent_of(clouds[0])) if moving else noise
    by_faces = _has_faces(clouds, smeared, seed)
    planes = _extract_all_planes(clouds, smeared, seed) if by_faces else None
    poses, faces, inflation = _poses(times, clouds, planes)
    for _ in range(DESKEWED if moving else 0):
        clouds = [_deskew_points(scan, poses, k) for k, scan in enumerate(usable)]
        planes = _extract_all_planes(clouds, noise, seed) if by_faces else None
        poses, faces, inflation = _poses(times, clouds, planes)
    if faces is not None:
        faces = edge_adjusted(faces, clouds, noise, extent_of(clouds[0]))
        poses, inflation = faces.poses, shared_inflation(faces.poses, faces.common)
    coarse: tuple[str, ...] = ()
    if _are_few(clouds) and (planes is None or not _is_convex(clouds, planes, noise)):
        _require_points(clouds)
        kept = _confirmed_scans(poses, _poses_found_otherwise(times, clouds, by_faces))
        sentence = _describe_coarse_scans(clouds, len(clouds) - len(kept), by_faces)
        if len(kept) < FEWEST_CONFIRMED:
            raise InputError(sentence)
        coarse = (sentence,) if len(kept) < len(clouds) else ()
        faces = None if faces is None else _faces_of_scans(faces, kept)
        poses = [poses[k] for k in kept] if faces is None else faces.poses
        usable, clouds = [usable[k] for k in kept], [clouds[k] for k in kept]
    isolated = sum(count for _, count in solid) / sum(np.count_nonzero(scan.is_return) for scan in scans)
    remarks = _remarks(len(scans) - len(usable), isolated, poses, faces)
    doubts = (*_doubts(poses, faces, clouds), *coarse)
    return ScanPoses(tuple(poses), tuple(usable), faces, noise, remarks, doubts, inflation)


def _poses_found_otherwise(
    times: Sequence[float], clouds: Sequence[Float[np.ndarray, "n 3"]], by_faces: bool
) -> Sequence[ScanPose]:
    """Poses by the points where they were found by faces; where they were by points, from the last scan back to the first."""
    if by_faces:
        return match_scans(times, clouds, clouds[0].mean(axis=0)).poses
    backwards = [-time for time in reversed(times)]
    return match_scans(backwards, clouds[::-1], clouds[-1].mean(axis=0)).poses[::-1]


def _confirmed_scans(poses: Sequence[ScanPose], others: Sequence[ScanPose]) -> list[int]:
    """Scans whose attitude is found in two ways; none where these are not most of them.

    Few points leave several attitudes that fit nearly alike, and faces that hide one another are confused, but two ways that
    fail differently hardly find the same wrong attitude. Either has a frame g of its own; the rotation between both is the one
    that most scans agree with.
    """
    between = np.array([a.rotation.T @ b.rotation for a, b in zip(poses, others, strict=True)])
    tried = between[:: max(1, len(between) // MOST_FRAMES)]
    apart = angle_from_matrix(nearest_rotation(np.swapaxes(tried, 1, 2)[:, None] @ between[None]))
    confirmed = np.flatnonzero(apart[np.argmax(np.count_nonzero(apart < CONFIRMED, axis=1))] < CONFIRMED)
    return confirmed.tolist() if len(confirmed) > len(between) / 2 else []


def _faces_of_scans(faces: TrackedFaces, kept: Sequence[int]) -> TrackedFaces:
    """The map with the poses and matches of some scans."""
    return replace(
        faces,
        poses=tuple(faces.poses[k] for k in kept),
        matches=tuple(faces.matches[k] for k in kept),
        common=tuple(faces.common[k] for k in kept),
    )


def _require_usable(scans: Sequence[Scan]) -> list[Scan]:
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
        remarks.append(f"{100 * isolated:.2g} % of the points are isolated (dust, clutter) and are left out")
    if faces is not None and faces.contradicted:
        remarks.append(_describe_contradictions(faces.contradicted, len(poses)))
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
        return (
            (_describe_contradictions(faces.contradicted, len(poses)),) if faces.contradicted > most else ()
        )
    apart = [p.matched < SURE_OVERLAP * min(len(c), MOST_POINTS) for p, c in zip(poses, clouds, strict=True)]
    if not sum(apart) > most:
        return ()
    return (
        f"{sum(apart)} of {len(poses)} scans share less than half of their surface with the others and may be turned wrongly; scan "
        "more often",
    )


def _has_faces(clouds: Sequence[Float[np.ndarray, "n 3"]], noise: PointNoise, seed: int) -> bool:
    """Whether most points of some scans lie on the plane faces of a convex body.

    Faces are recognised by their normals. Of a convex body no two seen at once are parallel; of others, a hidden face and the one
    in front of it differ by an offset only, and are taken for one another.
    """
    generator = np.random.default_rng(seed)
    looked_at = clouds[:: max(1, len(clouds) // LOOKED_AT)][:LOOKED_AT]
    found = [extract_planes(points, noise, generator) for points in looked_at]
    if np.median([share for _, share in found]) < PLANE_SHARE:
        return False
    if not np.median([_reduced_chi_square(planes) for planes, _ in found]) < MOST_EXCESS:
        return False
    if _are_few(looked_at):
        return True
    return _is_convex(looked_at, [planes for planes, _ in found], noise)


def _are_few(clouds: Sequence[Float[np.ndarray, "n 3"]]) -> bool:
    """Whether the median scan has too few points to be registered."""
    return bool(np.median([len(points) for points in clouds]) < FEWEST_REGISTERED)


def _is_convex(
    clouds: Sequence[Float[np.ndarray, "n 3"]], planes: Sequence[Sequence[FittedPlane]], noise: PointNoise
) -> bool:
    """Whether few points of the median scan lie in front of one of its planes."""
    before = [_share_in_front(points, seen, noise) for points, seen in zip(clouds, planes, strict=True)]
    return bool(np.median(before) <= MOST_IN_FRONT)


def _share_in_front(
    points: Float[np.ndarray, "n 3"], planes: Sequence[FittedPlane], noise: PointNoise
) -> float:
    """Largest share of a scan's points that are clearly in front of one of its planes."""
    clear = FLATNESS * extent_of(points)
    return max(
        (
            float(np.mean(plane.distances(points) > CLEAR * noise.across(points, plane.normal) + clear))
            for plane in planes
        ),
        default=0.0,
    )


def _extract_all_planes(
    clouds: Sequence[Float[np.ndarray, "n 3"]], noise: PointNoise, seed: int
) -> list[list[FittedPlane]]:
    """Planes of every scan."""
    generator = np.random.default_rng(seed)
    return [extract_planes(points, noise, generator)[0] for points in clouds]


def _reduced_chi_square(planes: Sequence[FittedPlane]) -> float:
    """Reduced chi-square of all points on planes; infinite without any."""
    counts = [plane.count for plane in planes]
    return float(np.average([plane.spread**2 for plane in planes], weights=counts)) if planes else np.inf


def _poses(
    times: Sequence[float],
    clouds: Sequence[Float[np.ndarray, "n 3"]],
    planes: list[list[FittedPlane]] | None,
) -> tuple[Sequence[ScanPose], TrackedFaces | None, float]:
    """Poses, the map of faces, and the inflation of the poses' own covariances."""
    middle = clouds[0].mean(axis=0)
    if planes is None:
        matched = match_scans(times, clouds, middle)
        return matched.poses, None, matched.inflation
    faces = track_faces(times, planes, middle, extent_of(clouds[0]))
    return faces.poses, faces, 1.0


def _describe_coarse_scans(clouds: Sequence[Float[np.ndarray, "n 3"]], unused: int, by_faces: bool) -> str:
    """Why scans are not used, and the cure: with more points they would be registered."""
    ways = "faces and points" if by_faces else "the scans before and those after"
    return (
        f"{np.median([len(points) for points in clouds]):.0f} points a scan leave several attitudes of this body; {unused} of "
        f"{len(clouds)} scans are not used, because {ways} give different ones; give scans of {FEWEST_REGISTERED} points or more"
    )


def _require_points(clouds: Sequence[Float[np.ndarray, "n 3"]]) -> None:
    """InputError: too few points to register a body by."""
    count = np.median([len(points) for points in clouds])
    if count < FEWEST_OF_ANY:
        raise InputError(
            f"{count:.0f} points a scan are too few to register a body of this shape, its attitudes would be off by degrees; give "
            f"scans of {FEWEST_OF_ANY} points or more, better {FEWEST_REGISTERED} (more rays, or a narrower field)"
        )


def _describe_contradictions(count: int, total: int) -> str:
    if count > MOST_CONTRADICTED * total:
        return f"{count} of {total} scans put the body where no uniform drift leads: forces act, or faces are taken for one another"
    return f"{count} scans lose a plane that no face of the drifting body explains"


def _deskew_points(scan: Scan, poses: Sequence[ScanPose], number: int) -> Float[np.ndarray, "n 3"]:
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
