"""Scans registered to one another: matching in order of time, and the adjustment of all poses together.

Every scan's points are matched with the nearest of the scans seen from the most alike directions, and all poses move together
(Gauss-Newton on point-to-plane distances). Scans registered one by one keep the errors of those before in what scans of alike
directions hardly determine, a common distance above all, and their covariances are those for an exact map.

Normals are noisy: where all surfaces seen lie along one direction, their errors alone give J' J information about a slide along it.
Products of the normals of a point and of its match, whose errors are independent, have none of it on average. These make up the
covariance. Such directions of the map, as the distance between two faces that no scan sees together, follow from the motion: under
no force a point of the body, its centre of mass, drifts uniformly. Directions that the matches determine are left to them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.absolute_orientation import nearest_rotation
from spinfilters.core.attitude_conversions import angle_from_matrix, cross_matrix, matrix_from_rotation_vector
from spinfilters.core.errors import InputError
from spinfilters.lidar.adjustment_covariance import (
    LARGEST,
    AdjustedScans,
    ScanNormalEquations,
    covariance_root,
    information_alone,
    significant_information,
    with_covariances,
)
from spinfilters.lidar.face_map import STRICTEST
from spinfilters.lidar.registration import (
    Cloud,
    Registration,
    ScanMatches,
    closest_points,
    cloud_of,
    coarse_pose,
    distinct_rows,
    registered,
)
from spinfilters.lidar.scan_pose import (
    LEAST_DEPARTURE,
    ROTATION_PRIOR,
    UNDETERMINED,
    ScanPose,
    angles_from,
    largest_departure,
    pose_covariance,
    predicted_pose,
    prior_stds,
    shares_of_span,
)

HELD: Final = 1e-3
"""Share of a predicted attitude's deviation by which a drift may turn scans without noise.

A place does not separate a rotation about it from a slide, and what little a drift does not explain turned panels by 15 deg."""

HELD_SURE: Final = 1e-6
"""The same of a scan that matches determine: open scans, which pull at a drift, would turn it by more than its deviation."""

MAP_SCANS: Final = 12
"""Scans that one is matched with, those seen from most alike directions: distant views share no surface."""
MOST_TOGETHER: Final = 400
"""Scans whose poses move together; those of longer sequences in groups, with all others fixed."""
FEWEST_ON_DRIFT: Final = 12
"""Scans from which a drift is fitted: three places to every number of it."""
PATCHES: Final = (0.15, 0.3, 0.6)
"""Sides of patches of like residuals, in sizes of the body."""
LEAST_RESPONSE: Final = 0.2
"""Share of a shift that residuals follow, at least."""
_ITERATIONS, _SHRINKING = 12, 0.6
_SHIFT = 0.5  # robust standard deviations of a residual
_SETTLED = 0.04  # mean square of a step in standard deviations
_DRIFTS, _DRIFT_STEPS, _DRIFT_SWEEPS = 2, 12, 8
_DRIFT_SCATTER = 3.0  # standard deviations of a place from matches alone


def adjusted_scans(
    clouds: Sequence[Cloud], poses: Sequence[ScanPose], size: float, reach: float
) -> AdjustedScans:
    """Poses of all scans with their covariances.

    Parameters
    ----------
    clouds : Sequence[Cloud]
        In L.
    poses : Sequence[ScanPose]
        About which the matches begin.
    size : float
        Of the body, m.
    reach : float
        Of the first matches, m.
    """
    found, inflation = list(poses), 1.0
    for begin in range(0, len(poses), MOST_TOGETHER):
        group = range(begin, min(begin + MOST_TOGETHER, len(poses)))
        normal = _match_group(clouds, found, group, size, reach)
        share = _residual_response(clouds, found, group, normal.reach)
        normal = replace(normal, variance=normal.variance / share**2)
        common, differing = None, np.zeros((len(group), 6))
        # what slid is matched again where the drift leads
        for _ in range(_DRIFTS if len(group) >= FEWEST_ON_DRIFT else 0):
            found[begin : group.stop] = _on_drift([found[k] for k in group], normal, size)
            matched = _match_group(clouds, found, group, size, normal.reach)
            normal = replace(matched, variance=matched.variance / share**2)
        if len(group) >= FEWEST_ON_DRIFT and normal.is_exact:
            # residuals of scans without noise do not show the errors of poses: their places do, and matches let them slide
            drift, matched = _drift_of([found[k] for k in group], size), [found[k] for k in group]
            found[begin : group.stop] = _on_drift(matched, normal, size)
            # what it moves a pose by, matches and drift differ about
            differing = np.array(
                [_squared_changes(*each) for each in zip(matched, found[begin : group.stop], strict=True)]
            )
            usual, variance = (max(normal.variance, each**2) for each in (drift.scatter, drift.deviation))
            common, normal = min(max(variance / usual, 1.0), LARGEST), replace(normal, variance=variance)
        of_drift = _drift_information([found[k] for k in group], normal, size)
        adjusted = with_covariances([found[k] for k in group], normal, size, common, of_drift, differing)
        found[begin : group.stop], inflation = adjusted.poses, max(inflation, adjusted.inflation)
    return AdjustedScans(tuple(found), inflation)


def _match_group(
    clouds: Sequence[Cloud], poses: list[ScanPose], group: range, size: float, reach: float
) -> ScanNormalEquations:
    """Normal equations at the poses of a group, which are moved there (Gauss-Newton)."""
    normal = _normal_equations(clouds, poses, group, size, reach)
    for _ in range(_ITERATIONS):
        if not normal.matched.any():
            break
        step = normal.step()
        for k, by in zip(group, step.reshape(-1, 6), strict=True):
            poses[k] = _apply_step(poses[k], by)
        small = normal.gradient @ step < _SETTLED * normal.variance * len(step)
        reach = max(_SHRINKING * normal.reach, normal.asked_reach)
        normal = _normal_equations(clouds, poses, group, size, reach)
        if small and normal.reach <= normal.asked_reach / _SHRINKING:
            break
    return normal


def _normal_equations(
    clouds: Sequence[Cloud], poses: Sequence[ScanPose], group: range, size: float, reach: float
) -> ScanNormalEquations:
    k = len(group)
    H, b, certain = np.zeros((k, 6, k, 6)), np.zeros((k, 6)), np.zeros((k, 6, k, 6))
    moved = [_in_body_frame(*each) for each in zip(clouds, poses, strict=True)]
    patches = [_Patches(side * size, k) for side in PATCHES]
    matched, squares, std = np.zeros(k, dtype=int), 0.0, 0.0
    for row, number in enumerate(group):
        # planes of other scans that the points of this one are matched with, and the row of the scan that owns each
        among = _most_similar_views(poses, number)
        near = _match_cloud(clouds[number], poses[number], _join_clouds(moved, among), reach)
        owner = np.repeat(among, [len(moved[j].points) for j in among])[near.targets] - group.start
        jacobian = np.concatenate([np.cross(near.moved, near.normals), near.normals], axis=1)
        normals = moved[number].normals[near.rows]
        of_points = np.concatenate([np.cross(near.moved, normals), normals], axis=1)
        for other in np.unique(owner):
            # a residual depends on the difference of both poses: +A on the two diagonal blocks, -A between them
            at = owner == other
            A, g = jacobian[at].T @ jacobian[at], jacobian[at].T @ near.residual[at]
            product = of_points[at].T @ jacobian[at]
            b[row] -= g
            if 0 <= other < k:  # scans outside the group are fixed
                b[other] += g
            for whole, block in ((H, A), (certain, (product + product.T) / 2)):
                whole[row, :, row] += block
                if 0 <= other < k:
                    whole[other, :, other] += block
                    whole[row, :, other] -= block
                    whole[other, :, row] -= block
        for each in patches:
            each.add(row, owner, near)
        matched[row] = len(near.rows)
        squares, std = squares + float(near.residual @ near.residual), max(std, near.std)
    variance = max(squares / max(matched.sum(), 1), 1e-24) * max(each.dependence for each in patches)
    asked = max(6 * std, *(clouds[number].least_reach for number in group))
    whole = (H.reshape(6 * k, 6 * k), b.ravel(), certain.reshape(6 * k, 6 * k))
    is_exact = variance < (STRICTEST * size) ** 2
    return ScanNormalEquations(*whole, matched, variance, reach, asked, k == len(poses), is_exact)


def _in_body_frame(cloud: Cloud, pose: ScanPose) -> Cloud:
    """A scan in g; its tree is the one in L."""
    return replace(
        cloud,
        points=(cloud.points - pose.translation) @ pose.rotation,
        normals=cloud.normals @ pose.rotation,
    )


def _most_similar_views(poses: Sequence[ScanPose], number: int) -> Int[np.ndarray, " m"]:
    """Scans of the directions most like those of one, without itself."""
    order = np.argsort(angles_from(poses, poses[number].rotation), kind="stable")
    return order[order != number][:MAP_SCANS]


def _join_clouds(moved: Sequence[Cloud], among: Int[np.ndarray, " m"]) -> Cloud:
    """Points in g of some scans."""
    return Cloud.of(
        np.concatenate([moved[j].points for j in among]), np.concatenate([moved[j].normals for j in among])
    )


def _match_cloud(cloud: Cloud, pose: ScanPose, target: Cloud, reach: float) -> ScanMatches:
    """Points of a scan in its pose with the nearest of others."""
    return closest_points(cloud, target, pose.rotation.T, -pose.rotation.T @ pose.translation, reach)


def _residual_response(
    clouds: Sequence[Cloud], poses: Sequence[ScanPose], group: range, reach: float
) -> float:
    """Share of a shift along the normals that residuals follow.

    Below 1, as nearest points change with the shift: those of small residuals are chosen among noisy ones. Sums of residuals are
    that much less steep in the poses than the normal equations have it.
    """
    moved, steep, counted = [_in_body_frame(*each) for each in zip(clouds, poses, strict=True)], 0.0, 0
    for number in group:
        target = _join_clouds(moved, _most_similar_views(poses, number))
        by = _SHIFT * _match_cloud(clouds[number], poses[number], target, reach).std
        for sign in (-1, 1):
            shifted = replace(
                clouds[number], points=clouds[number].points + sign * by * clouds[number].normals
            )
            near = _match_cloud(shifted, poses[number], target, reach)
            if by > 0 and len(near.rows):
                steep, counted = steep + sign * float(near.residual.mean()) / by, counted + 1
    return float(np.clip(steep / counted, LEAST_RESPONSE, 1.0)) if counted else 1.0


class _Patches:
    """Sums of residuals over patches of the surface, for every scan."""

    def __init__(self, side: float, scans: int) -> None:
        self._side, self._scans = side, scans
        self._cells, self._sums = [], []
        self._squares = 0.0

    def add(self, scan: int, owner: Int[np.ndarray, " m"], near: ScanMatches) -> None:
        """ScanMatches of one scan with points of others."""
        cells = np.floor(near.moved / self._side).astype(np.int64)
        inside = (owner >= 0) & (owner < self._scans)
        for scans, rows, residual in (
            (np.full(len(owner), scan), cells, near.residual),
            (owner[inside], cells[inside], -near.residual[inside]),
        ):
            keys, patch = distinct_rows(np.column_stack([scans, rows]))
            self._cells.append(keys)
            self._sums.append(np.bincount(patch, weights=residual, minlength=len(keys)))
            self._squares += float(residual @ residual)

    @property
    def dependence(self) -> float:
        """Variance of the sums in terms of that of independent residuals, at least 1."""
        if not self._squares:
            return 1.0
        _, patch = distinct_rows(np.concatenate(self._cells))
        total = np.bincount(patch, weights=np.concatenate(self._sums))
        return max(1.0, float(total @ total) / self._squares)


def _apply_step(pose: ScanPose, step: Float[np.ndarray, "6"]) -> ScanPose:
    """The pose after its scan is turned by d and shifted by e in g."""
    turn = matrix_from_rotation_vector(step[:3])
    R = pose.rotation @ turn.T
    return replace(pose, rotation=R, translation=pose.translation - R @ step[3:])


@dataclass(frozen=True, eq=False)
class _Drift:
    """Places of the centre of mass of k scans about a drift, linear in steps of the poses.

    With the columns A of the drift and its numbers x, places depart from it by D step + off - A x.

    Attributes
    ----------
    change : ndarray of shape (3k, 6k)
        D, over (rotation, shift) in g.
    columns : ndarray of shape (3k, m)
        A.
    off : ndarray of shape (3k,)
        Present departures from a robust fit, L axes, m.
    """

    change: Float[np.ndarray, "b a"]
    columns: Float[np.ndarray, "b m"]
    off: Float[np.ndarray, " b"]

    @property
    def scatter(self) -> float:
        """Median departure, m."""
        return float(np.median(np.linalg.norm(self.off.reshape(-1, 3), axis=1)))

    @property
    def deviation(self) -> float:
        """Root-mean-square departure, m: that of scans which slid, above all."""
        return float(np.sqrt(3 * np.mean(self.off**2)))

    def information(self, scatter: float) -> Float[np.ndarray, "a a"]:
        """Of the poses, without what the numbers of the drift take."""
        Q = np.linalg.qr(self.columns)[0]
        left = self.change - Q @ (Q.T @ self.change)
        return self.change.T @ left / scatter**2

    def step(
        self, joint: Float[np.ndarray, "a a"], scatter: float, done: Float[np.ndarray, " a"]
    ) -> Float[np.ndarray, " a"]:
        """Likeliest step from matched poses of covariance ``joint``, of which ``done`` has been taken."""
        off = self.off - self.change @ done
        W = np.linalg.inv(self.change @ joint @ self.change.T + scatter**2 * np.eye(len(self.off)))
        A = self.columns
        x = np.linalg.lstsq(A.T @ W @ A, A.T @ W @ off, rcond=None)[0]
        return -joint @ self.change.T @ W @ (off - A @ x)


def _drift_of(poses: Sequence[ScanPose], size: float) -> _Drift:
    """The drift R c + t = r + v time + a time^2 of a point c of the body, by all poses but those that slid (Cauchy weights).

    A constant force is in it, so that it is no matter of the matches.
    """
    k = len(poses)
    R, t = np.array([pose.rotation for pose in poses]), np.array([pose.translation for pose in poses])
    late = shares_of_span(poses)[:, None, None]
    fixed = np.broadcast_to(np.eye(3), (k, 3, 3))
    # columns: c in g, then r at the first scan, v and a over the whole span, all three in L
    columns = np.concatenate([-R, fixed, late * fixed, late**2 * fixed], axis=2)
    weights, x = np.ones(k), np.zeros(12)
    off = np.zeros((k, 3))
    for _ in range(_DRIFT_SWEEPS):
        A, b = (weights[:, None, None] * columns).reshape(3 * k, -1), (weights[:, None] * t).reshape(-1)
        x = np.linalg.lstsq(A, b, rcond=None)[0]
        off = t - columns @ x
        apart = np.linalg.norm(off, axis=1)
        scatter = max(float(np.median(apart)), STRICTEST * size)
        weights = 1 / np.sqrt(1 + (apart / (3 * scatter)) ** 2)
    change = np.zeros((k, 3, k, 6))
    # a rotation d and a shift e of a scan in g change R c + t by R (c x d - e)
    arm = np.broadcast_to(cross_matrix(x[:3]), (k, 3, 3))
    change[range(k), :, range(k)] = R @ np.concatenate([arm, -fixed], axis=2)
    return _Drift(change.reshape(3 * k, 6 * k), columns.reshape(3 * k, -1), off.reshape(-1))


def _least_scatter(drift: _Drift, normal: ScanNormalEquations, size: float) -> float:
    """Scatter about a drift, m, below which it would say more of the places than the matches do that determine them."""
    k = len(normal.matched)
    alone = np.array([covariance_root(each, size) for each in information_alone(normal)])
    change = np.einsum("kikj->kij", drift.change.reshape(k, 3, k, 6))
    std = np.linalg.svd(change @ alone, compute_uv=False)
    return max(_DRIFT_SCATTER * float(np.median(std)), STRICTEST * size)


def _drift_information(
    poses: Sequence[ScanPose], normal: ScanNormalEquations, size: float
) -> Float[np.ndarray, "a a"] | float:
    """Information of all poses from the drift of the centre of mass; 0 of too few scans for one."""
    if len(poses) < FEWEST_ON_DRIFT:
        return 0.0
    drift = _drift_of(poses, size)
    return drift.information(max(drift.scatter, _least_scatter(drift, normal, size)))


def _squared_changes(before: ScanPose, after: ScanPose) -> Float[np.ndarray, "6"]:
    """Squares of the shift (m) and of the rotation (rad) between two poses of a scan, on each of their three axes."""
    shift = float(np.sum((after.translation - before.translation) ** 2))
    return np.repeat([shift, _turn_between(after.rotation, before.rotation) ** 2], 3)


def _determines_pose(information: Float[np.ndarray, "6 6"], size: float) -> bool:
    """Whether an information over (rotation, shift) in g leaves no direction of a pose to its prediction."""
    scale = prior_stds(size)
    return bool(np.linalg.eigvalsh(scale[:, None] * information * scale)[0] > 1.0 / UNDETERMINED)


def _on_drift(poses: Sequence[ScanPose], normal: ScanNormalEquations, size: float) -> list[ScanPose]:
    """Poses on a drift in the directions that the matches leave open."""
    found, done = list(poses), np.zeros(6 * len(poses))
    whole = significant_information(normal.certain, normal.information, normal.is_exact) / normal.variance
    turn: float | Float[np.ndarray, " k"] = ROTATION_PRIOR
    if normal.is_exact:
        sure = [_determines_pose(each, size) for each in information_alone(normal)]
        turn = ROTATION_PRIOR * np.where(sure, HELD_SURE, HELD)
    root = covariance_root(normal.constrained(whole, 0.0), size, turn)
    joint = root @ root.T
    for _ in range(_DRIFT_STEPS):
        drift = _drift_of(found, size)
        least = _least_scatter(drift, normal, size)
        # what slid spoils the first drifts, so that the scatter falls from step to step
        step = drift.step(joint, max(drift.scatter, least), done)
        by_scan = (step - done).reshape(-1, 6)
        found, done = [_apply_step(pose, by) for pose, by in zip(found, by_scan, strict=True)], step
        if drift.scatter <= least:
            break
    return found


MOST_POINTS: Final = 3000
"""Points of a scan that are registered."""
WIDEST_TURN: Final = 1.8
"""Largest rotation between the first scans that is searched, rad."""
SMALLEST: Final = 1e-9
"""Size of a body that can be registered, in distances, at least."""
SURE_OVERLAP: Final = 0.5
FIRST_PAIRS: Final = 12
"""Pairs of scans from the first on, of which one that is sure begins the registration."""
_REACH = 0.25  # of the body's size: how far a prediction may be wrong


def match_scans(
    times: Sequence[float],
    scans: Sequence[Float[np.ndarray, "n 3"]],
    middle: Float[np.ndarray, "3"],
    viewpoint: Float[np.ndarray, "3"] | None = None,
) -> AdjustedScans:
    """Poses of scans in frame g.

    It has the lidar's axes at the first scan and its origin at ``middle`` (m, in L).

    Parameters
    ----------
    scans : Sequence[ndarray of shape (n, 3)]
        Points in L, m.
    viewpoint : ndarray of shape (3,) or None
        Of the lidar in L, its origin where None.

    Raises
    ------
    InputError
        Points that all lie in one place.
    """
    eye = np.zeros(3) if viewpoint is None else viewpoint
    clouds = [cloud_of(points, eye, MOST_POINTS) for points in scans]
    size = max(cloud.size for cloud in clouds)
    if not size > SMALLEST * float(np.linalg.norm(middle - eye)):
        raise InputError("the points of every scan lie in one place; give scans that resolve the body")
    first, second = _first_sure_pair(clouds, middle, size)
    poses = [ScanPose(times[first], np.eye(3), middle, np.zeros((6, 6)), matched=len(clouds[first].points))]
    if second is not None:
        poses.append(_scan_pose_of(second, times[first + 1], size))
    for time in times[first + 2 :]:
        poses.append(_next_pose(clouds[first:], poses, time, size))
    # then from the last scan backwards to those before the first one
    poses, backwards = poses[::-1], clouds[::-1]
    for time in reversed(times[:first]):
        poses.append(_next_pose(backwards, poses, time, size))
    return adjusted_scans(clouds, _in_frame_of_first(poses[::-1], middle), size, 0.3 * _REACH * size)


def _first_sure_pair(
    clouds: Sequence[Cloud], middle: Float[np.ndarray, "3"], size: float
) -> tuple[int, Registration | None]:
    """The scan from which all others are registered, and the registration of the next one to it; None of a single scan.

    It is the first scan whose pose to the next one is sure: where refining from rest and a search over rotations end in one pose,
    in which both scans share most of their surface. A thin side that is seen alone shares hardly a surface with the next scan, and
    a symmetric one fits in several attitudes: a wrong first rotation predicts wrong ones for all others. The first scan, where
    none of the first `FIRST_PAIRS` pairs is sure. The map of the registration has its origin at ``middle``, as frame g.
    """
    first = None
    for k in range(min(len(clouds) - 1, FIRST_PAIRS)):
        source, target = clouds[k + 1], Cloud.of(clouds[k].points - middle, clouds[k].normals)
        start = coarse_pose(source, target, np.eye(3), WIDEST_TURN)
        near = registered(source, target, np.eye(3), -middle, _REACH * size)
        searched = registered(source, target, *start, _REACH * size)
        better = max(near, searched, key=_fit_quality)
        first = better if first is None else first
        apart = _turn_between(near.rotation, searched.rotation)
        if apart < LEAST_DEPARTURE and min(near.overlap, searched.overlap) >= SURE_OVERLAP:
            return k, better
    return 0, first


def _in_frame_of_first(poses: Sequence[ScanPose], middle: Float[np.ndarray, "3"]) -> list[ScanPose]:
    """Poses of the frame g with the lidar's axes at the first scan, and its origin at ``middle`` there."""
    turn, shift = poses[0].rotation.T, middle - poses[0].translation
    return [
        replace(
            pose, rotation=pose.rotation @ turn, translation=pose.translation + pose.rotation @ turn @ shift
        )
        for pose in poses
    ]


def _next_pose(clouds: Sequence[Cloud], poses: list[ScanPose], time: float, size: float) -> ScanPose:
    """The pose of the next scan: registered from the prediction, or searched where that leads to little overlap.

    Symmetric bodies fit in several attitudes. Of those the motion explains one, and what it does not explain is left out: the scan
    then has the prediction, with the covariance of a pose that no point determines.
    """
    number = len(poses)
    R, t = predicted_pose(poses, time, size)
    target = _scan_matching_map(clouds, poses, R, list(range(number)))
    found = registered(clouds[number], target, R.T, -R.T @ t, _REACH * size)
    widest = largest_departure(poses, time)
    if found.overlap < SURE_OVERLAP:
        start = coarse_pose(clouds[number], target, R.T, widest)
        other = registered(clouds[number], target, *start, _REACH * size)
        fits = [each for each in (found, other) if _turn_between(each.rotation, R.T) <= widest]
        found = max(fits, key=_fit_quality, default=found)
    if _turn_between(found.rotation, R.T) > widest:
        covariance, lacking = pose_covariance(np.zeros((6, 6)), R, size)
        return ScanPose(time, R, t, covariance, lacking)
    return _scan_pose_of(found, time, size)


def _fit_quality(found: Registration) -> float:
    """Large where many points match closely."""
    return found.overlap / max(found.residual_std, 1e-12) ** 0.5


def _turn_between(R: Float[np.ndarray, "3 3"], Q: Float[np.ndarray, "3 3"]) -> float:
    """Angle of the rotation between two attitudes, rad."""
    return float(angle_from_matrix(nearest_rotation(R @ Q.T)))


def _scan_matching_map(
    clouds: Sequence[Cloud], poses: list[ScanPose], R: Float[np.ndarray, "3 3"], among: list[int]
) -> Cloud:
    """Points in g of the scans seen from the directions most like that of a pose."""
    order = np.argsort(angles_from([poses[k] for k in among], R), kind="stable")
    chosen = [among[k] for k in order[:MAP_SCANS]]
    points = [(clouds[k].points - poses[k].translation) @ poses[k].rotation for k in chosen]
    normals = [clouds[k].normals @ poses[k].rotation for k in chosen]
    return Cloud.of(np.concatenate(points), np.concatenate(normals))


def _scan_pose_of(found: Registration, time: float, size: float) -> ScanPose:
    """The pose of g in L from that of the cloud in g.

    p_g = R p_L + t.
    An error of the registration in map axes, rotation d and shift e, is a rotation a = -R' d of g in L, and a shift s of its origin
    with -R' e = s + t x a: the registration rotates about the lidar.
    """
    R = found.rotation.T
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = -R
    information = turn @ found.information @ turn.T
    translation = -R @ found.translation
    K = np.eye(6)
    K[3:, :3] = cross_matrix(translation)
    information = K.T @ information @ K
    covariance, lacking = pose_covariance(information, R, size)
    return ScanPose(time, R, translation, covariance, lacking, found.matched)
