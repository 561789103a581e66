"""Pose of the body in one scan with its covariance, its prediction from the poses before, and the accuracy of several scans."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.special import factorial

from spinfilters.core.absolute_orientation import nearest_rotation
from spinfilters.core.attitude_conversions import (
    angle_from_matrix,
    matrix_from_rotation_vector,
    rotation_vector_from_matrix,
)

ROTATION_PRIOR: Final = 0.2
"""Standard deviation of a predicted attitude, rad: the only knowledge in directions that a scan does not determine."""
UNDETERMINED: Final = 0.1
"""Share of the prior's variance above which a direction counts as not determined by the scan."""
LEAST_VARIANCE: Final = 1e-12
"""Share of the largest variance of a pose, both in those of the prior, below which rounding would make it indefinite."""


@dataclass(frozen=True, eq=False)
class ScanPose:
    """R_Lg and the origin of g in L at the epoch of a scan.

    Attributes
    ----------
    time : float
        s.
    rotation : ndarray of shape (3, 3)
    translation : ndarray of shape (3,)
        m.
    covariance : ndarray of shape (6, 6)
        Over (translation in L, m; rotation vector on the body side, axes g, rad).
    own_covariance : ndarray of shape (6, 6) or None
        Of the error that no other scan shares; None where that is all of it.
    undetermined : tuple[str, ...]
        Directions that only the prediction determines, in words.
    matched : int
        Points or faces that it rests on.
    """

    time: float
    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, "3"]
    covariance: Float[np.ndarray, "6 6"]
    undetermined: tuple[str, ...] = ()
    matched: int = 0
    own_covariance: Float[np.ndarray, "6 6"] | None = None


Placement = tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]
"""R_Lg and the origin of g in L, m."""


def move_placement(placement: Placement, step: Float[np.ndarray, "6"]) -> Placement:
    """The placement after a rotation in L, rad, and a translation, m."""
    return matrix_from_rotation_vector(step[:3]) @ placement[0], placement[1] + step[3:]


def shares_of_span(poses: Sequence[ScanPose]) -> Float[np.ndarray, " n"]:
    """Times of poses as shares of the span from the first, 0, to the last, 1."""
    times = np.array([pose.time for pose in poses])
    return (times - times[0]) / max(float(np.ptp(times)), 1e-300)


def rotation_vector(R: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """Rotation vector, rad, of the short way round, of what is a rotation but for rounding."""
    return rotation_vector_from_matrix(nearest_rotation(R))


def angles_from(poses: Sequence[ScanPose], R: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " n"]:
    """Angles between the attitudes of poses and one attitude, rad."""
    apart = np.array([pose.rotation @ R.T for pose in poses])
    return angle_from_matrix(nearest_rotation(apart))


def prior_stds(size: float) -> Float[np.ndarray, "6"]:
    """Standard deviations of a predicted pose over (rotation, rad, and translation, m) of a body of this size, m."""
    return np.repeat([ROTATION_PRIOR, size], 3)


def pose_covariance(
    information: Float[np.ndarray, "6 6"], rotation: Float[np.ndarray, "3 3"], size: float
) -> tuple[Float[np.ndarray, "6 6"], tuple[str, ...]]:
    """Covariance (translation, body-side rotation) of an information over (rotation in L, translation), with what it lacks.

    The prior of a predicted pose, `ROTATION_PRIOR` and the body's ``size`` (m), fills directions that the scan does not determine:
    there the covariance is the prior's, and they are named.
    """
    scale = prior_stds(size)
    values, vectors = np.linalg.eigh(scale[:, None] * information * scale + np.eye(6))
    return _describe_pose(1 / np.maximum(values, 1.0), vectors, rotation, size)


def described_covariance(
    covariance: Float[np.ndarray, "6 6"], rotation: Float[np.ndarray, "3 3"], size: float
) -> tuple[Float[np.ndarray, "6 6"], tuple[str, ...]]:
    """A covariance over (rotation in L, translation) that holds the prior already, as `pose_covariance` returns it."""
    scale = prior_stds(size)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return _describe_pose(values[::-1], vectors[:, ::-1], rotation, size)


def _describe_pose(
    values: Float[np.ndarray, "6"],
    vectors: Float[np.ndarray, "6 6"],
    rotation: Float[np.ndarray, "3 3"],
    size: float,
) -> tuple[Float[np.ndarray, "6 6"], tuple[str, ...]]:
    """Covariance (translation, body-side rotation), from eigenvalues in variances of the prior, with what it lacks."""
    scale = prior_stds(size)
    lacking = [_describe_direction(vectors[:, k] * scale, size) for k in range(6) if values[k] > UNDETERMINED]
    # next to an undetermined direction, rounding loses smaller variances
    values = np.maximum(values, LEAST_VARIANCE * values.max())
    covariance = (scale[:, None] * vectors * values) @ (vectors.T * scale)
    return body_side(body_side(covariance, rotation).T, rotation), tuple(lacking)


def body_side(
    errors: Float[np.ndarray, "6 m"], rotation: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "6 m"]:
    """Errors (rotation in L, translation) as (translation, rotation vector on the body side)."""
    return np.concatenate([errors[3:], rotation.T @ errors[:3]])


def _describe_direction(direction: Float[np.ndarray, "6"], size: float) -> str:
    """A direction of (rotation, translation) in words."""
    turn, shift = direction[:3], direction[3:] / size
    kind, vector = (
        ("rotation about", turn)
        if np.linalg.norm(turn) > np.linalg.norm(shift)
        else ("translation along", shift)
    )
    unit = vector / max(float(np.linalg.norm(vector)), 1e-300)
    return f"{kind} ({', '.join(f'{x:.2f}' for x in unit)})"


MOST_SCANS: Final = 20
"""Scans before that a prediction is made from."""
NEIGHBOURS: Final = 7
"""Scans between which a rotation is interpolated, at most."""
WIDEST: Final = 2.0
"""Rotation between them, rad, at most: rotation vectors are smooth far below half a turn."""
SURE: Final = float(np.sqrt(UNDETERMINED)) * ROTATION_PRIOR
"""Standard deviation of a rotation, rad, below which it is determined."""
_DEGREE = 4  # of the polynomial
RATE_STEPS: Final = 9
"""Steps between scans by which a rate is interpolated."""
_RATE_DEGREE, _ROUNDS = 3, 6  # of that polynomial, and of its weights
LEAST_DEPARTURE: Final = 0.1
"""Of an attitude from its prediction, rad, that is always admitted."""
FEW_STEPS: Final = 4
"""Scans up to which the rate is hardly known."""
EXACT: Final = 1e-4
"""Standard deviation, rad and sizes of the body, below which a prediction takes no pose."""
CHANGE: Final = 0.3
"""Change of a rate in a time, per square of the rate: that of a torque-free body whose moments differ by so much."""


def predicted_pose(
    poses: Sequence[ScanPose], time: float, size: float
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Pose at a time if the body goes on as before.

    Earlier scans count with the weight of their covariance.
    What a scan does not determine is taken from those that do: a body that shows one face for some scans is found again after.

    Parameters
    ----------
    poses : Sequence[ScanPose]
        At least one.
    size : float
        Of the body, m: how far the origin of g may be from the centre of mass.
    """
    recent = poses[-MOST_SCANS:]
    last = recent[-1]
    if len(recent) < 2:
        return last.rotation, last.translation
    rotation = matrix_from_rotation_vector((time - last.time) * _mean_rate(recent)) @ last.rotation
    return rotation, drifted_origin(recent, time, rotation, size)


def rates_of_steps(poses: Sequence[ScanPose]) -> Float[np.ndarray, "n 3"] | None:
    """Mean rate in L, rad/s, from each scan to the next, by polynomials over the nearest steps whose rotation is determined.

    A rotation that one of the two scans does not determine is bridged so. None where too few steps are determined.
    """
    sure = [k > 0 and rotation_std(pose) < SURE for k, pose in enumerate(poses)]
    known = np.array([k for k in range(1, len(poses) - 1) if sure[k] and sure[k + 1]], dtype=int)
    if len(known) < RATE_STEPS:
        return None
    times = np.array([pose.time for pose in poses])
    middles = (times[1:] + times[:-1]) / 2
    turned = [rotation_vector(poses[k + 1].rotation @ poses[k].rotation.T) for k in known]
    rates, found = np.array(turned) / np.diff(times)[known, None], []
    for middle, place in zip(middles, np.searchsorted(known, np.arange(len(middles))), strict=True):
        # known steps are in the order of time: the nearest ones are among as many before and as many behind
        around = np.arange(max(place - RATE_STEPS, 0), min(place + RATE_STEPS, len(known)))
        late = middles[known[around]] - middle
        near = np.argsort(np.abs(late), kind="stable")[:RATE_STEPS]
        found.append(_rate_between(late[near], rates[around[near]]))
    return np.array(found)


def _rate_between(late: Float[np.ndarray, " s"], rates: Float[np.ndarray, "s 3"]) -> Float[np.ndarray, "3"]:
    """Rate at the time zero by a polynomial over rates at the times ``late``; those that do not fit weigh little (Cauchy loss)."""
    A, weights = np.vander(late / np.abs(late).max(), _RATE_DEGREE + 1), np.ones(len(late))
    found = np.zeros((_RATE_DEGREE + 1, 3))
    for _ in range(_ROUNDS):
        found = np.linalg.lstsq(A * weights[:, None], rates * weights[:, None], rcond=None)[0]
        off = np.linalg.norm(rates - A @ found, axis=1)
        weights = 1 / np.sqrt(1 + (off / (3 * np.median(off) + 1e-12)) ** 2)
    return found[-1]


def largest_departure(poses: Sequence[ScanPose], time: float) -> float:
    """Angle, rad, by which the attitude at a time may differ from the prediction where the body goes on as before.

    A rate that is known from one step only may be wrong by half of it; one from many changes by `CHANGE` of its square.
    """
    recent = poses[-MOST_SCANS:]
    if len(recent) < 2:
        return np.pi
    turn = float(np.linalg.norm(_mean_rate(recent))) * abs(time - recent[-1].time)
    return LEAST_DEPARTURE + turn * (0.5 if len(recent) < FEW_STEPS else min(CHANGE * (1.0 + turn), 0.5))


def _mean_rate(poses: Sequence[ScanPose]) -> Float[np.ndarray, "3"]:
    """Mean rate in L, rad/s, of the steps between scans.

    Older ones have less weight the faster the body turns.
    """
    times = np.array([pose.time for pose in poses])
    span = np.diff(times)
    steps = np.array([rotation_vector(b.rotation @ a.rotation.T) for a, b in pairwise(poses)])
    rates = steps / span[:, None]
    P = np.array([pose.rotation @ pose.covariance[3:, 3:] @ pose.rotation.T for pose in poses])
    aged = CHANGE * np.sum(np.median(rates, axis=0) ** 2) * (times[-1] - times[:-1]) * span
    W = (
        np.linalg.inv(P[:-1] + P[1:] + (aged**2 + EXACT**2)[:, None, None] * np.eye(3))
        * span[:, None, None] ** 2
    )
    return np.linalg.solve(np.sum(W, axis=0), np.einsum("nij,nj->i", W, rates))


def drifted_origin(
    poses: Sequence[ScanPose], time: float, rotation: Float[np.ndarray, "3 3"], size: float
) -> Float[np.ndarray, "3"]:
    """Origin of g at a time, m, by a weighted uniform drift.

    t = r + v time - R c with the centre c in g; r, v and c of least squares.
    """
    last, span = poses[-1], poses[-1].time - poses[0].time

    def by_drift(time: float, rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 9"]:
        """Derivative of the origin's place, less the last one, by (r, v over the whole span, c)."""
        return np.hstack([np.eye(3), np.eye(3) * (time - last.time) / span, last.rotation - rotation])

    H, b = np.eye(9) / size**2, np.zeros(9)
    for pose in poses:
        W = np.linalg.inv(pose.covariance[:3, :3] + (EXACT * size) ** 2 * np.eye(3))
        A = by_drift(pose.time, pose.rotation)
        H += A.T @ W @ A
        b += A.T @ W @ (pose.translation - last.translation)
    return last.translation + by_drift(time, rotation) @ np.linalg.solve(H, b)


def interpolated_rotation(poses: Sequence[ScanPose], number: int) -> Float[np.ndarray, "3 3"]:
    """R_Lg of a scan, interpolated from scans that determine theirs.

    From the nearest: a polynomial of their rotation vectors; else its own.
    Its coefficients over the angle turned are CHANGE / j! to a standard deviation for j > 1: noise leaves a constant rate.
    """
    time = poses[number].time
    sure = [pose for k, pose in enumerate(poses) if k != number and rotation_std(pose) < SURE]
    near = sorted(sure, key=lambda pose: abs(pose.time - time))[:NEIGHBOURS]
    if len(near) < 2:
        return poses[number].rotation
    vectors = np.array([rotation_vector(pose.rotation @ near[0].rotation.T) for pose in near])
    near = [pose for pose, vector in zip(near, vectors, strict=True) if np.linalg.norm(vector) < WIDEST]
    vectors = vectors[np.linalg.norm(vectors, axis=1) < WIDEST]
    late = np.array([pose.time - time for pose in near])
    stds = np.array([rotation_std(pose) + 1e-12 for pose in near])
    line = np.linalg.lstsq(np.vander(late, 2) / stds[:, None], vectors / stds[:, None], rcond=None)[0]
    turns = late * float(np.linalg.norm(line[0])) + 1e-12 * np.sign(late)
    order = np.arange(_DEGREE + 1)
    known = np.where(order < 2, 1e-3, factorial(order) / CHANGE)
    A = np.concatenate([np.vander(turns, _DEGREE + 1, increasing=True) / stds[:, None], np.diag(known)])
    b = np.concatenate([vectors / stds[:, None], np.zeros((_DEGREE + 1, 3))])
    return matrix_from_rotation_vector(np.linalg.lstsq(A, b, rcond=None)[0][0]) @ near[0].rotation


def rotation_std(pose: ScanPose) -> float:
    """Standard deviation of the least certain rotation, rad."""
    return float(np.sqrt(rotation_variance(pose)))


def rotation_variance(pose: ScanPose) -> float:
    """Variance of the least certain rotation, rad^2."""
    return float(np.linalg.eigvalsh(pose.covariance[3:, 3:])[-1])


def attitude_stds(poses: Sequence[ScanPose]) -> Float[np.ndarray, " n"]:
    """Standard deviations, rad, of the first 1, 2, ... n scans' mean attitude.

    They are of its least certain rotation. Scans that leave a rotation undetermined count for what they determine.
    """
    information = np.cumsum([np.linalg.inv(pose.covariance[3:, 3:]) for pose in poses], axis=0)
    return 1 / np.sqrt(np.linalg.eigvalsh(information)[:, 0])


def scans_needed(poses: Sequence[ScanPose], attitude_std: float) -> int:
    """Scans whose mean attitude is accurate to this, rad.

    The variance falls with their number.
    The closing question of Decoust (2008), for scans like these.
    """
    worst = float(attitude_stds(poses)[-1]) * np.sqrt(len(poses))
    return max(1, int(np.ceil((worst / attitude_std) ** 2)))
