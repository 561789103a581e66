"""Scans registered to one another: matching in order of time, and the adjustment of all poses with errors in common.

Poses that were adjusted together have errors that are alike from scan to scan. A motion that is fitted to poses of covariances
W^-1 each has the covariance N^-1 S N^-1 for the poses' joint covariance C, N = B' W B, S = B' W C W B, with B what the poses
change by with the motion. Covariances s W^-1 carry as much information on average where s = tr(N^-1 S) / dim.

The columns of B span any smooth motion: places, velocities and attitudes at the start, drifts of the attitude in the
lidar's frame and in that of the body. A rotation and a shift of frame g are none, for nothing but the poses defines it.

Every scan's points are matched with the nearest of the scans seen from the most alike directions, and all poses move together
(Gauss-Newton on point-to-plane distances). Scans registered one by one keep the errors of those before in what scans of alike
directions hardly determine, a common distance above all, and their covariances are those for an exact map.

Normals are noisy: where all surfaces seen lie along one direction, their errors alone give J' J information about a slide along it.
Products of the normals of a point and of its match, whose errors are independent, have none of it on average. These make up the
covariance. Such directions of the map, as the distance between two faces that no scan sees together, follow from the motion: under
no force a point of the body, its centre of mass, drifts uniformly. Directions that the matches determine are left to them.

Frame g has no place of its own: the sums of all rotations and shifts of a step are zero, and so are those of the errors that the
covariance describes (inner constraints; Blaha 1971).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.absolute_orientation import nearest_rotation
from spinfilters.core.attitude_conversions import angle_from_matrix, cross_matrix, matrix_from_rotation_vector
from spinfilters.core.errors import InputError
from spinfilters.lidar.face_map import STRICTEST
from spinfilters.lidar.registration import (
    Cloud,
    Registration,
    ScanMatches,
    closest_points,
    cloud_of,
    coarse_pose,
    registered,
)
from spinfilters.lidar.scan_pose import (
    LEAST_VARIANCE,
    ROTATION_PRIOR,
    ScanPose,
    angles_from,
    described_covariance,
    largest_departure,
    pose_covariance,
    predicted_pose,
)

NEGLIGIBLE: Final = 1e-9
"""Share of the largest information, below which a direction counts as not determined."""

CHANCE: Final = 10.0
"""Largest positive eigenvalues by chance, in terms of the most negative one."""

LARGEST: Final = 1e6
"""Inflation, at most."""

HELD: Final = 1e-3
"""Share of a predicted attitude's deviation by which a drift may turn scans without noise.

A place does not separate a rotation about it from a slide, and what little a drift does not explain turned panels by 15 deg."""

Product = Callable[[Float[np.ndarray, "a m"]], Float[np.ndarray, "a m"]]
"""A matrix times columns."""


def shared_inflation(poses: Sequence[ScanPose], common: Sequence[Float[np.ndarray, "6 6"]]) -> float:
    """Mean ratio of the poses' variances to those without what they share with others.

    Parameters
    ----------
    common : Sequence[ndarray of shape (6, 6)]
        Part of every pose's covariance that it shares.
    """
    ratios = [
        np.trace(np.linalg.pinv(pose.covariance - C, hermitian=True) @ pose.covariance) / 6
        for pose, C in zip(poses, common, strict=True)
    ]
    good = [ratio for ratio in ratios if ratio >= 1]
    return min(float(np.median(good)), LARGEST) if good else 1.0


def smooth_inflation(
    poses: Sequence[ScanPose], own: Float[np.ndarray, "k 6 6"], covariance: Product
) -> float:
    """Factor on the poses' own covariances, at least 1.

    Parameters
    ----------
    own : ndarray of shape (k, 6, 6)
        Information of every pose, over (rotation, shift) in g.
    covariance : Product
        Joint, likewise.
    """
    frame, smooth = _changes_of_poses(poses)
    weighted_frame, weighted = (_weigh_columns(own, each) for each in (frame, smooth))
    held = np.linalg.pinv(frame.T @ weighted_frame, hermitian=True) @ weighted_frame.T @ smooth
    smooth, weighted = smooth - frame @ held, weighted - weighted_frame @ held
    values, vectors = np.linalg.eigh(smooth.T @ weighted)
    known = values > NEGLIGIBLE * values[-1]
    if not known.any():
        return 1.0
    whitened = weighted @ (vectors[:, known] / np.sqrt(values[known]))
    return float(np.clip(np.vdot(whitened, covariance(whitened)) / np.count_nonzero(known), 1.0, LARGEST))


def _changes_of_poses(poses: Sequence[ScanPose]) -> tuple[Float[np.ndarray, "a 6"], Float[np.ndarray, "a m"]]:
    """Changes of all poses with the frame g, and with a smooth motion."""
    times = np.array([pose.time for pose in poses])
    late = (2 * times - times[0] - times[-1]) / max(float(np.ptp(times)), 1e-300)
    body, lidar = (
        np.broadcast_to(np.eye(3), (len(poses), 3, 3)),
        np.array([pose.rotation.T for pose in poses]),
    )

    def column(axes: Float[np.ndarray, "k 3 3"], power: int, first: int) -> Float[np.ndarray, "a 3"]:
        """Changes along three axes that grow with a power of time."""
        found = np.zeros((len(poses), 6, 3))
        found[:, first : first + 3] = axes * late[:, None, None] ** power
        return found.reshape(-1, 3)

    frame = [column(body, 0, 0), column(body, 0, 3)]
    turns = [column(lidar, 0, 0), column(lidar, 1, 0), column(body, 1, 0), column(body, 2, 0)]
    return np.hstack(frame), np.hstack([*turns, column(lidar, 0, 3), column(lidar, 1, 3)])


def _weigh_columns(
    own: Float[np.ndarray, "k 6 6"], columns: Float[np.ndarray, "a m"]
) -> Float[np.ndarray, "a m"]:
    return np.einsum("kij,kjc->kic", own, columns.reshape(len(own), 6, -1)).reshape(columns.shape)


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
_DAMPING, _GAUGE = 1e-9, 1e3  # in terms of the mean diagonal
_GAUGE_SWEEPS = 8


@dataclass(frozen=True, eq=False)
class AdjustedScans:
    """Poses of all scans with covariances.

    Attributes
    ----------
    inflation : float
        Of the poses' own covariances, for the errors that scans share (`smooth_inflation`).
    """

    poses: tuple[ScanPose, ...]
    inflation: float = 1.0


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
        common = None
        # what slid is matched again where the drift leads
        for _ in range(_DRIFTS if len(group) >= FEWEST_ON_DRIFT else 0):
            found[begin : group.stop] = _on_drift([found[k] for k in group], normal, size)
            matched = _match_group(clouds, found, group, size, normal.reach)
            normal = replace(matched, variance=matched.variance / share**2)
        if len(group) >= FEWEST_ON_DRIFT and normal.is_exact:
            # residuals of scans without noise do not show the errors of poses: their places do, and matches let them slide
            drift = _drift_of([found[k] for k in group], size)
            found[begin : group.stop] = _on_drift([found[k] for k in group], normal, size)
            usual, variance = (max(normal.variance, each**2) for each in (drift.scatter, drift.deviation))
            common, normal = min(max(variance / usual, 1.0), LARGEST), replace(normal, variance=variance)
        adjusted = _with_covariances([found[k] for k in group], normal, size, common)
        found[begin : group.stop], inflation = adjusted.poses, max(inflation, adjusted.inflation)
    return AdjustedScans(tuple(found), inflation)


def _match_group(
    clouds: Sequence[Cloud], poses: list[ScanPose], group: range, size: float, reach: float
) -> "_Normal":
    """Normal equations at the poses of a group, which are moved there (Gauss-Newton)."""
    normal = _normal_equations(clouds, poses, group, size, reach)
    for _ in range(_ITERATIONS):
        if not normal.matched.any():
            break
        step = normal.step()
        for k, by in zip(group, step.reshape(-1, 6), strict=True):
            poses[k] = _apply_step(poses[k], by)
        small = normal.gradient @ step < _SETTLED * normal.variance * len(step)
        normal = _normal_equations(clouds, poses, group, size, normal.following_reach)
        if small and normal.reach <= normal.asked_reach / _SHRINKING:
            break
    return normal


@dataclass(frozen=True, eq=False)
class _Normal:
    """Normal equations of the poses of k scans over (rotation, shift), both in g.

    Attributes
    ----------
    information : ndarray of shape (a, a)
        (6k, 6k), of unit variance.
    gradient : ndarray of shape (a,)
        (6k,).
    certain : ndarray of shape (a, a)
        The information without that of the normals' errors.
    matched : ndarray of shape (k,)
        Points of every scan.
    variance : float
        Of a residual, m^2, times the dependence of neighbouring ones.
    reach : float
        Of the matches, m.
    asked_reach : float
        What the residuals ask for, m.
    is_free : bool
        Whether no pose is held.
    is_exact : bool
        Whether residuals are rounding alone, so that the points have no noise.
    """

    information: Float[np.ndarray, "a a"]
    gradient: Float[np.ndarray, " a"]
    certain: Float[np.ndarray, "a a"]
    matched: Int[np.ndarray, " k"]
    variance: float
    reach: float
    asked_reach: float
    is_free: bool
    is_exact: bool

    @property
    def following_reach(self) -> float:
        """Reach of the next matches, m."""
        return max(_SHRINKING * self.reach, self.asked_reach)

    def step(self) -> Float[np.ndarray, " a"]:
        """Gauss-Newton step."""
        diagonal = float(np.trace(self.information)) / len(self.gradient)
        return np.linalg.solve(self.constrained(self.information, _DAMPING * diagonal), self.gradient)

    def constrained(
        self, information: Float[np.ndarray, "a a"], damping: Float[np.ndarray, " a"] | float
    ) -> Float[np.ndarray, "a a"]:
        """Information with damping, and with the sums of all errors held at zero."""
        held = information + np.diag(np.broadcast_to(damping, len(information)))
        if self.is_free:
            common = np.tile(np.eye(6), (len(self.matched), 1)) / np.sqrt(len(self.matched))
            weight = _GAUGE * np.maximum(np.diagonal(held).reshape(-1, 6).mean(axis=0), np.finfo(float).tiny)
            held = held + (common * weight) @ common.T
        return held


def _normal_equations(
    clouds: Sequence[Cloud], poses: Sequence[ScanPose], group: range, size: float, reach: float
) -> _Normal:
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
    return _Normal(*whole, matched, variance, reach, asked, k == len(poses), is_exact)


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
            keys, patch = np.unique(np.column_stack([scans, rows]), axis=0, return_inverse=True)
            self._cells.append(keys)
            self._sums.append(np.bincount(patch.reshape(-1), weights=residual, minlength=len(keys)))
            self._squares += float(residual @ residual)

    @property
    def dependence(self) -> float:
        """Variance of the sums in terms of that of independent residuals, at least 1."""
        if not self._squares:
            return 1.0
        _, patch = np.unique(np.concatenate(self._cells), axis=0, return_inverse=True)
        total = np.bincount(patch.reshape(-1), weights=np.concatenate(self._sums))
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
    times = np.array([pose.time for pose in poses])
    late = ((times - times[0]) / max(float(np.ptp(times)), 1e-300))[:, None, None]
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


def _least_scatter(drift: _Drift, normal: _Normal, size: float) -> float:
    """Scatter about a drift, m, below which it would say more of the places than the matches do that determine them."""
    k = len(normal.matched)
    alone = np.array([_covariance_root(each, size) for each in _information_alone(normal)])
    change = np.einsum("kikj->kij", drift.change.reshape(k, 3, k, 6))
    std = np.linalg.svd(change @ alone, compute_uv=False)
    return max(_DRIFT_SCATTER * float(np.median(std)), STRICTEST * size)


def _on_drift(poses: Sequence[ScanPose], normal: _Normal, size: float) -> list[ScanPose]:
    """Poses on a drift in the directions that the matches leave open."""
    found, done = list(poses), np.zeros(6 * len(poses))
    whole = _proper(normal.certain, normal.information, normal.is_exact) / normal.variance
    turn = HELD * ROTATION_PRIOR if normal.is_exact else ROTATION_PRIOR
    root = _covariance_root(normal.constrained(whole, 0.0), size, turn)
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


def _information_alone(normal: _Normal) -> Float[np.ndarray, "k 6 6"]:
    """Information of every pose with all others exact."""
    k = len(normal.matched)
    certain, information = (
        np.einsum("kikj->kij", each.reshape(k, 6, k, 6)) for each in (normal.certain, normal.information)
    )
    return np.array(
        [_proper(*each, normal.is_exact) / normal.variance for each in zip(certain, information, strict=True)]
    )


def _proper(
    certain: Float[np.ndarray, "a a"], information: Float[np.ndarray, "a a"], is_exact: bool
) -> Float[np.ndarray, "a a"]:
    """The information without eigenvalues that chance gives where there is none.

    Those below zero; of scans without noise also positive ones like these, for no noise would make such directions uncertain. The
    normals of these are wrong next to edges alone. Products of wrong normals with right ones are nothing along open directions,
    but turn them towards exact ones: those of the whole information are open by rounding.
    """
    values, vectors = np.linalg.eigh(certain)
    chance = 0.0
    if is_exact:
        chance = -CHANCE * values[0]
        values, vectors = np.linalg.eigh(information)
    return (vectors * np.where(values > chance, np.maximum(values, 0.0), 0.0)) @ vectors.T


def _covariance_root(
    information: Float[np.ndarray, "a a"], size: float, turn: float = ROTATION_PRIOR
) -> Float[np.ndarray, "a a"]:
    """Square root of the covariance of information and the prior of predicted poses together.

    By eigenvectors in deviations of the prior: scans without noise hold up to 1e27 times its information, and a sum of both would
    lose what it says of the directions that they leave open. ``turn`` is the prior's deviation of a rotation, rad.
    """
    scale = np.tile(np.repeat([turn, size], 3), len(information) // 6)
    values, vectors = np.linalg.eigh(scale[:, None] * information * scale)
    known = np.where(values > NEGLIGIBLE * values[-1], values, 0.0)
    return scale[:, None] * vectors / np.sqrt(1.0 + known)


def _about_certain_scans(
    root: Float[np.ndarray, "a m"], prior: Float[np.ndarray, "6"]
) -> Float[np.ndarray, "a m"]:
    """Root of the covariance where errors of the scans that are determined, not those of all of them, have the mean zero.

    A mean over scans that are open gives all others a part of their errors.
    """
    errors = root.reshape(-1, 6, root.shape[1])
    for _ in range(_GAUGE_SWEEPS):
        weights = 1 / np.maximum(np.einsum("kim,i,kim->k", errors, prior, errors), LEAST_VARIANCE)
        errors = errors - np.average(errors, axis=0, weights=weights)
    return errors.reshape(root.shape)


def _with_bend(covariance: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "6 6"]:
    """Covariance of a pose (translation, rotation) with what rotations move its place by in the second order.

    A rotation by a moves a place that it shifts by d in the first order by a d / 2 across: of panels that turn about their normal,
    more than all that is exact.
    """
    shift, turn = np.trace(covariance[:3, :3]), np.trace(covariance[3:, 3:])
    return covariance + np.diag(np.repeat([shift * turn / 4, 0.0], 3))


def _prior_information(scans: int, size: float) -> Float[np.ndarray, " a"]:
    """Of a predicted pose, for every scan."""
    return np.tile(np.repeat([ROTATION_PRIOR**-2.0, size**-2.0], 3), scans)


def _with_covariances(
    poses: Sequence[ScanPose], normal: _Normal, size: float, common: float | None
) -> AdjustedScans:
    """Poses with the marginals of the joint covariance.

    Their covariances with the poses of the others exact come with them. Of scans without noise, where a drift is known, these are
    the marginals, too, less the inflation ``common``: no factor on exact poses would describe what some scans share that no other
    one holds. What no scan determines has the prior of a predicted pose, see `pose_covariance`.
    """
    k, prior = len(poses), _prior_information(1, size)
    whole = _proper(normal.certain, normal.information, normal.is_exact) / normal.variance
    if k >= FEWEST_ON_DRIFT:
        drift = _drift_of(poses, size)
        whole = whole + drift.information(max(drift.scatter, _least_scatter(drift, normal, size)))
    root = _covariance_root(normal.constrained(whole, 0.0), size)
    if normal.is_exact:
        root = _about_certain_scans(root, prior)
    joint = root @ root.T
    covariance = joint.reshape(k, 6, k, 6)
    alone = _information_alone(normal)
    found = []
    for number, pose in enumerate(poses):
        to_lidar = np.kron(np.eye(2), -pose.rotation)
        root = to_lidar @ _covariance_root(alone[number], size)
        (every, lacking), (own, _) = (
            described_covariance(each, pose.rotation, size)
            for each in (to_lidar @ covariance[number, :, number] @ to_lidar.T, root @ root.T)
        )
        if common is not None:
            every = _with_bend(every)
            own = every / common
        matched = int(normal.matched[number])
        found.append(
            replace(pose, covariance=every, own_covariance=own, undetermined=lacking, matched=matched)
        )
    if common is not None:
        return AdjustedScans(tuple(found), common)
    return AdjustedScans(tuple(found), smooth_inflation(poses, alone + np.diag(prior), joint.__matmul__))


MOST_POINTS: Final = 3000
"""Points of a scan that are registered."""
WIDEST_TURN: Final = 1.8
"""Largest rotation between the first scans that is searched, rad."""
SMALLEST: Final = 1e-9
"""Size of a body that can be registered, in distances, at least."""
SURE_OVERLAP: Final = 0.5
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
    poses = [ScanPose(times[0], np.eye(3), middle, np.zeros((6, 6)), matched=len(clouds[0].points))]
    for k in range(1, len(clouds)):
        poses.append(_next_pose(clouds, poses, times[k], size))
    return adjusted_scans(clouds, poses, size, 0.3 * _REACH * size)


def _next_pose(clouds: list[Cloud], poses: list[ScanPose], time: float, size: float) -> ScanPose:
    """The pose of the next scan: registered from the prediction, or searched where that leads to little overlap.

    Symmetric bodies fit in several attitudes. Of those the motion explains one, and what it does not explain is left out: the scan
    then has the prediction, with the covariance of a pose that no point determines.
    """
    number = len(poses)
    R, t = predicted_pose(poses, time, size)
    target = _scan_matching_map(clouds, poses, R, list(range(number)))
    found = registered(clouds[number], target, R.T, -R.T @ t, _REACH * size)
    if number == 1:
        start = coarse_pose(clouds[number], target, R.T, WIDEST_TURN)
        other = registered(clouds[number], target, *start, _REACH * size)
        return _scan_pose_of(max(found, other, key=_fit_quality), time, size)
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
    clouds: list[Cloud], poses: list[ScanPose], R: Float[np.ndarray, "3 3"], among: list[int]
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
