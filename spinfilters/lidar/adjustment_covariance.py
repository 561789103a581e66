"""Joint covariance of poses that were adjusted together: its gauge, what the normal equations leave open, what scans share.

Frame g has no place of its own: the sums of all rotations and shifts of a step are zero, and so are those of the errors that the
covariance describes (inner constraints; Blaha 1971).

Poses that were adjusted together have errors that are alike from scan to scan. A motion that is fitted to poses of covariances
W^-1 each has the covariance N^-1 S N^-1 for the poses' joint covariance C, N = B' W B, S = B' W C W B, with B what the poses
change by with the motion. Covariances s W^-1 carry as much information on average where s = tr(N^-1 S) / dim.

The columns of B span any smooth motion: places, velocities and attitudes at the start, drifts of the attitude in the
lidar's frame and in that of the body. A rotation and a shift of frame g are none, for nothing but the poses defines it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.lidar.scan_pose import LEAST_VARIANCE, ROTATION_PRIOR, ScanPose, described_covariance

NEGLIGIBLE: Final = 1e-9
"""Share of the largest information, below which a direction counts as not determined."""

CHANCE: Final = 10.0
"""Largest positive eigenvalues by chance, in terms of the most negative one."""

LARGEST: Final = 1e6
"""Inflation, at most."""

Product = Callable[[Float[np.ndarray, "a m"]], Float[np.ndarray, "a m"]]
"""A matrix times columns."""

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


@dataclass(frozen=True, eq=False)
class ScanNormalEquations:
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


def information_alone(normal: ScanNormalEquations) -> Float[np.ndarray, "k 6 6"]:
    """Information of every pose with all others exact."""
    k = len(normal.matched)
    certain, information = (
        np.einsum("kikj->kij", each.reshape(k, 6, k, 6)) for each in (normal.certain, normal.information)
    )
    return np.array(
        [
            significant_information(*each, normal.is_exact) / normal.variance
            for each in zip(certain, information, strict=True)
        ]
    )


def significant_information(
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


def covariance_root(
    information: Float[np.ndarray, "a a"], size: float, turn: float | Float[np.ndarray, " k"] = ROTATION_PRIOR
) -> Float[np.ndarray, "a a"]:
    """Square root of the covariance of information and the prior of predicted poses together.

    By eigenvectors in deviations of the prior: scans without noise hold up to 1e27 times its information, and a sum of both would
    lose what it says of the directions that they leave open. ``turn`` is the prior's deviation of a rotation, rad, of all scans or
    of each.
    """
    turns = np.broadcast_to(turn, len(information) // 6)
    scale = np.repeat(np.column_stack([turns, np.full_like(turns, size, dtype=float)]).ravel(), 3)
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


def _prior_information(size: float) -> Float[np.ndarray, "6"]:
    """Of a predicted pose over (rotation, shift)."""
    return np.repeat([ROTATION_PRIOR**-2.0, size**-2.0], 3)


def with_covariances(
    poses: Sequence[ScanPose],
    normal: ScanNormalEquations,
    size: float,
    common: float | None,
    of_drift: Float[np.ndarray, "a a"] | float,
    differing: Float[np.ndarray, "k 6"],
) -> AdjustedScans:
    """Poses with the marginals of the joint covariance, to which a drift may add its information ``of_drift``.

    Their covariances with the poses of the others exact come with them. Of scans without noise, where a drift is known, these are
    the marginals, too, less the inflation ``common``: no factor on exact poses would describe what some scans share that no other
    one holds. What no scan determines has the prior of a predicted pose, see `pose_covariance`.
    ``differing`` are variances (translation, rotation) of what matches and drift of scans without noise differ about.
    """
    k, prior = len(poses), _prior_information(size)
    whole = significant_information(normal.certain, normal.information, normal.is_exact) / normal.variance
    root = covariance_root(normal.constrained(whole + of_drift, 0.0), size)
    if normal.is_exact:
        root = _about_certain_scans(root, prior)
    joint = root @ root.T
    covariance = joint.reshape(k, 6, k, 6)
    alone = information_alone(normal)
    found = []
    for number, pose in enumerate(poses):
        to_lidar = np.kron(np.eye(2), -pose.rotation)
        root = to_lidar @ covariance_root(alone[number], size)
        (every, lacking), (own, _) = (
            described_covariance(each, pose.rotation, size)
            for each in (to_lidar @ covariance[number, :, number] @ to_lidar.T, root @ root.T)
        )
        if common is not None:
            every = _with_bend(every) + np.diag(differing[number])
            own = every / common
        matched = int(normal.matched[number])
        found.append(
            replace(pose, covariance=every, own_covariance=own, undetermined=lacking, matched=matched)
        )
    if common is not None:
        return AdjustedScans(tuple(found), common)
    return AdjustedScans(tuple(found), smooth_inflation(poses, alone + np.diag(prior), joint.__matmul__))


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
