"""Joint adjustment of scans of a body of any shape.

Every scan's points are matched with the nearest of the scans seen from the most alike directions, and all poses move together
(Gauss-Newton on point-to-plane distances). Scans registered one by one keep the errors of those before in what scans of alike
directions hardly determine, a common distance above all, and their covariances are those beside an exact map.

Frame g has no place of its own: the sums of all rotations and shifts of a step are zero, and so are those of the errors that the
covariance describes (inner constraints; Blaha 1971).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from spinfilters.lidar.common_errors import smooth_inflation
from spinfilters.lidar.registration import Cloud, ScanMatches, closest_points
from spinfilters.lidar.scan_pose import ROTATION_PRIOR, ScanPose, pose_covariance, rotation_matrix

MAP_SCANS: Final = 12
"""Scans that one is matched with, those seen from most alike directions: distant views share no surface."""
MOST_TOGETHER: Final = 400
"""Scans whose poses move together; those of longer sequences in groups, beside all others."""
PATCHES: Final = (0.15, 0.3, 0.6)
"""Sides of patches of like residuals, in sizes of the body."""
LEAST_RESPONSE: Final = 0.2
"""Share of a shift that residuals follow, at least."""
_ITERATIONS, _SHRINKING = 12, 0.6
_SHIFT = 0.5  # robust standard deviations of a residual
_SETTLED = 0.04  # mean square of a step in standard deviations
_DAMPING, _GAUGE = 1e-9, 1e3  # in terms of the mean diagonal


@dataclass(frozen=True, eq=False)
class AdjustedScans:
    """Poses of all scans with covariances.

    Attributes
    ----------
    inflation: of the poses' own covariances, for the errors that scans share (`smooth_inflation`).
    """

    poses: tuple[ScanPose, ...]
    inflation: float = 1.0


def adjusted_scans(
    clouds: Sequence[Cloud], poses: Sequence[ScanPose], size: float, reach: float
) -> AdjustedScans:
    """Poses of all scans with their covariances.

    Parameters
    ----------
    clouds: in L.   poses: about which the matches begin.   size: of the body, m.   reach: of the first matches, m.
    """
    found, inflation = list(poses), 1.0
    for begin in range(0, len(poses), MOST_TOGETHER):
        group = range(begin, min(begin + MOST_TOGETHER, len(poses)))
        normal = _normal_equations(clouds, found, group, size, reach)
        for _ in range(_ITERATIONS):
            if not normal.matched.any():
                break
            step = normal.step()
            for k, by in zip(group, step.reshape(-1, 6), strict=True):
                found[k] = _moved(found[k], by)
            small = normal.gradient @ step < _SETTLED * normal.variance * len(step)
            normal = _normal_equations(clouds, found, group, size, normal.following_reach)
            if small and normal.reach <= normal.asked_reach / _SHRINKING:
                break
        share = _response(clouds, found, group, normal.reach)
        normal = replace(normal, variance=normal.variance / share**2)
        adjusted = _with_covariances([found[k] for k in group], normal, size)
        found[begin : group.stop], inflation = adjusted.poses, max(inflation, adjusted.inflation)
    return AdjustedScans(tuple(found), inflation)


@dataclass(frozen=True, eq=False)
class _Normal:
    """Normal equations of the poses of k scans over (rotation, shift), both in g.

    Attributes
    ----------
    information: (6k, 6k), of unit variance.   gradient: (6k,).   matched: (k,) points of every scan.
    variance: of a residual, m^2, times the dependence of neighbouring ones.
    reach: of the matches, m.   asked_reach: what the residuals ask for, m.
    is_free: whether no pose is held.
    """

    information: Float[np.ndarray, "a a"]
    gradient: Float[np.ndarray, " a"]
    matched: Int[np.ndarray, " k"]
    variance: float
    reach: float
    asked_reach: float
    is_free: bool

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
    H, b = np.zeros((k, 6, k, 6)), np.zeros((k, 6))
    moved = [_in_body_frame(*each) for each in zip(clouds, poses, strict=True)]
    patches = [_Patches(side * size, k) for side in PATCHES]
    matched, squares, std = np.zeros(k, dtype=int), 0.0, 0.0
    for row, number in enumerate(group):
        among = _alike(poses, number)
        near = _matches(clouds[number], poses[number], _map(moved, among), reach)
        owner = np.repeat(among, [len(moved[j].points) for j in among])[near.targets] - group.start
        jacobian = np.concatenate([np.cross(near.moved, near.normals), near.normals], axis=1)
        for other in np.unique(owner):
            at = owner == other
            A, g = jacobian[at].T @ jacobian[at], jacobian[at].T @ near.residual[at]
            H[row, :, row] += A
            b[row] -= g
            if 0 <= other < k:
                H[other, :, other] += A
                H[row, :, other] -= A
                H[other, :, row] -= A
                b[other] += g
        for each in patches:
            each.add(row, owner, near)
        matched[row] = len(near.rows)
        squares, std = squares + float(near.residual @ near.residual), max(std, near.std)
    variance = max(squares / max(matched.sum(), 1), 1e-24) * max(each.dependence for each in patches)
    asked = max(6 * std, *(clouds[number].least_reach for number in group))
    return _Normal(H.reshape(6 * k, 6 * k), b.ravel(), matched, variance, reach, asked, k == len(poses))


def _in_body_frame(cloud: Cloud, pose: ScanPose) -> Cloud:
    """A scan in g; its tree is the one in L."""
    return replace(
        cloud,
        points=(cloud.points - pose.translation) @ pose.rotation,
        normals=cloud.normals @ pose.rotation,
    )


def _alike(poses: Sequence[ScanPose], number: int) -> Int[np.ndarray, " m"]:
    """Scans of the directions most like those of one, without itself."""
    turns = Rotation.from_matrix(np.array([pose.rotation @ poses[number].rotation.T for pose in poses]))
    order = np.argsort(turns.magnitude(), kind="stable")
    return order[order != number][:MAP_SCANS]


def _map(moved: Sequence[Cloud], among: Int[np.ndarray, " m"]) -> Cloud:
    """Points in g of some scans."""
    return Cloud.of(
        np.concatenate([moved[j].points for j in among]), np.concatenate([moved[j].normals for j in among])
    )


def _matches(cloud: Cloud, pose: ScanPose, target: Cloud, reach: float) -> ScanMatches:
    """Points of a scan in its pose with the nearest of others."""
    return closest_points(cloud, target, pose.rotation.T, -pose.rotation.T @ pose.translation, reach)


def _response(clouds: Sequence[Cloud], poses: Sequence[ScanPose], group: range, reach: float) -> float:
    """Share of a shift along the normals that residuals follow.

    Below 1, as nearest points change with the shift: those of small residuals are chosen among noisy ones. Sums of residuals are
    that much less steep in the poses than the normal equations have it.
    """
    moved, steep, told = [_in_body_frame(*each) for each in zip(clouds, poses, strict=True)], 0.0, 0
    for number in group:
        target = _map(moved, _alike(poses, number))
        by = _SHIFT * _matches(clouds[number], poses[number], target, reach).std
        for sign in (-1, 1):
            shifted = replace(
                clouds[number], points=clouds[number].points + sign * by * clouds[number].normals
            )
            near = _matches(shifted, poses[number], target, reach)
            if by > 0 and len(near.rows):
                steep, told = steep + sign * float(near.residual.mean()) / by, told + 1
    return float(np.clip(steep / told, LEAST_RESPONSE, 1.0)) if told else 1.0


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


def _moved(pose: ScanPose, step: Float[np.ndarray, "6"]) -> ScanPose:
    """The pose after its scan is turned by d and shifted by e in g."""
    turn = rotation_matrix(step[:3])
    R = pose.rotation @ turn.T
    return replace(pose, rotation=R, translation=pose.translation - R @ step[3:])


def _with_covariances(poses: Sequence[ScanPose], normal: _Normal, size: float) -> AdjustedScans:
    """Poses with the marginals of the joint covariance.

    Their covariances beside exact poses of the others come with them. What no scan determines has the prior of a predicted
    pose, see `pose_covariance`.
    """
    k, prior = len(poses), np.repeat([ROTATION_PRIOR**-2.0, size**-2.0], 3)
    whole = normal.information / normal.variance
    joint = np.linalg.inv(normal.constrained(whole, np.tile(prior, k)))
    covariance = joint.reshape(k, 6, k, 6)
    alone = np.einsum("kikj->kij", whole.reshape(k, 6, k, 6))
    found = []
    for number, pose in enumerate(poses):
        to_lidar = np.kron(np.eye(2), -pose.rotation)
        told = np.linalg.inv(covariance[number, :, number]) - np.diag(prior)
        (every, lacking), (own, _) = (
            pose_covariance(to_lidar @ each @ to_lidar.T, pose.rotation, size)
            for each in (told, alone[number])
        )
        matched = int(normal.matched[number])
        found.append(
            replace(pose, covariance=every, own_covariance=own, undetermined=lacking, matched=matched)
        )
    return AdjustedScans(tuple(found), smooth_inflation(poses, alone + np.diag(prior), joint.__matmul__))
