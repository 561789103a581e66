"""Motion of the first epochs in closed form, from directly measured attitudes, body rates and positions.

Single gross errors are removed before closed-form estimation. A sample counts as wrong where it lies far from the line through
its neighbours, and where without it they lie on one. A motion that is fast for a few samples is left alone: without one of them
the others lie no better.

The inertia follows from conserved angular momentum, R_k J w_k = h, which is linear in J and h; the path is a straight line.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import eigh, null_space

from spinfilters.core.attitude_conversions import integrate_gyro, matrix_from_quaternion, rotation_between
from spinfilters.core.errors import InputError
from spinfilters.core.mass_distribution import from_inertia, second_moments_of
from spinfilters.models.sensor import MotionSamples
from spinfilters.models.state_blocks import (
    ACCELERATION,
    CENTRE_OF_MASS,
    DRAG,
    LINEAR_DRAG,
    MASS_DISTRIBUTION,
    VELOCITY,
    StateBlock,
)
from spinfilters.models.state_layout import StateLayout

DEGREE = 4
"""Of the polynomial that a window of rotation vectors is fitted with; a steady spin is a straight line."""
LARGEST_TURN = 2.2
"""Rad from the middle of a window: well below pi, where rotation vectors stop being unique."""
LARGEST_WINDOW = 15
MOST_APART = 0.34
"""Share of the attitudes that may be farther than `LARGEST_TURN` from both neighbours: wrong ones. More are a fast rotation."""


@dataclass(frozen=True)
class InitialMotion:
    """Motion at k times.

    Attributes
    ----------
    time : ndarray of float, shape (k,)
        Time of each epoch, s.
    attitude : ndarray of float, shape (k, 4)
        Attitude quaternions q_ig.
    rates : ndarray of float, shape (k, 3)
        Body rates, rad/s, g axes.
    positions : ndarray of float, shape (k, 3) or None
        Origins of g in i, m, or None when nothing measures them.
    defines_attitude : bool
        Whether the first attitude is a definition of frame i rather than measured.
    """

    time: Float[np.ndarray, " k"]
    attitude: Float[np.ndarray, "k 4"]
    rates: Float[np.ndarray, "k 3"]
    positions: Float[np.ndarray, "k 3"] | None = None
    defines_attitude: bool = field(default=False, kw_only=True)

    @property
    def rotations(self) -> Float[np.ndarray, "k 3 3"]:
        """R_ig at every time."""
        return matrix_from_quaternion(self.attitude)


def initial_motion(samples: MotionSamples, epochs: int) -> InitialMotion:
    """Initial motion samples from the first ``epochs`` samples; what is missing of attitudes and rates is computed.

    Attitudes are integrated from the rates where they are missing, or rates are differenced from the attitudes.

    The rate at an attitude is the slope of a polynomial through the rotation vectors around it. An attitude that is far from
    both of its neighbours, such as a pose from too few common landmarks, is left out.

    Raises
    ------
    InputError
        Neither attitudes nor rates; without rates fewer than 4 attitudes, or more than `MOST_APART` of them farther than
        `LARGEST_TURN` from their neighbours.
    """
    first = {name: getattr(samples, name) for name in ("attitude", "rates", "positions")}
    shared = None if samples.shared is None else samples.shared[:epochs]
    given = {name: None if values is None else values[:epochs] for name, values in first.items()}
    samples = consistent_samples(replace(samples, time=samples.time[:epochs], shared=shared, **given))
    time, positions = samples.time, samples.positions
    if samples.attitude is None and samples.rates is None:
        raise InputError("a motion needs attitudes or body rates; give measurements of such a sensor")
    if samples.attitude is None:
        assert samples.rates is not None
        attitude = integrate_gyro(time, samples.rates, np.array([0.0, 0.0, 0.0, 1.0]))
        return InitialMotion(time, attitude, samples.rates, positions, defines_attitude=True)
    if samples.rates is not None:
        return InitialMotion(time, samples.attitude, samples.rates, positions)
    rates = _differentiate_attitudes(time, samples.attitude, samples.shared)
    near = ~np.isnan(rates[:, 0])
    positions = None if positions is None else positions[near]
    return InitialMotion(time[near], samples.attitude[near], rates[near], positions)


def _differentiate_attitudes(
    time: Float[np.ndarray, " k"], q: Float[np.ndarray, "k 4"], shared: Int[np.ndarray, " k"] | None
) -> Float[np.ndarray, "k 3"]:
    """Body rates of attitudes; NaN of one that is too far from both neighbours.

    Parameters
    ----------
    shared : ndarray of int, shape (k,) or None
        Landmarks in common with the epoch before, where the attitudes come from tracks.
    """
    if len(time) < 4:
        raise InputError(
            f"a start from poses needs at least 4 epochs, got {len(time)}; give a longer recording"
        )
    rates = _rates(time, q)
    apart = np.isnan(rates[:, 0])
    if np.count_nonzero(~apart) < 4 or np.count_nonzero(apart) > MOST_APART * len(time):
        raise InputError(_too_far_apart(time, q, apart, shared))
    return rates


def _too_far_apart(
    time: Float[np.ndarray, " k"],
    q: Float[np.ndarray, "k 4"],
    apart: Bool[np.ndarray, " k"],
    shared: Int[np.ndarray, " k"] | None,
) -> str:
    """Sentence on attitudes that are too far from their neighbours: why, and the cure."""
    step = np.linalg.norm(rotation_between(q[:-1], q[1:]), axis=1)
    first = int(np.argmax(apart))
    beside = int(np.clip(first, 0, len(step) - 1))
    told = (
        f"{np.count_nonzero(apart)} of the first {len(time)} epochs are more than {np.degrees(LARGEST_TURN):.0f} deg from "
        f"their neighbours ({np.degrees(step[beside]):.0f} deg at t = {time[first]:.3f} s), too far to follow"
    )
    if shared is None:
        return f"{told}: give a faster frame rate, or check the attitudes"
    return (
        f"{told}. Images share {int(np.median(shared[1:]))} landmarks with the one before (median), so that poses may be wrong: "
        "give a faster frame rate, or more landmarks"
    )


def _rates(time: Float[np.ndarray, " k"], q: Float[np.ndarray, "k 4"]) -> Float[np.ndarray, "k 3"]:
    """Derivative at every pose of a polynomial through the rotation vectors to the poses around it.

    It is NaN where both neighbours are farther away than `LARGEST_TURN`.
    """
    # neighbours of pose k: those from k - half to k + half, clipped at the ends and masked there
    half = LARGEST_WINDOW // 2
    around = np.arange(len(time))[:, None] + np.arange(-half, half + 1)
    inside = (around >= 0) & (around < len(time))
    around = np.clip(around, 0, len(time) - 1)
    phi = rotation_between(q[:, None], q[around])
    turn = np.linalg.norm(phi, axis=2)
    near = inside & (turn < LARGEST_TURN)
    # a neighbour counts while all between it and the pose are near: accumulate from the middle to either side
    reach = np.logical_and.accumulate
    used = np.concatenate([reach(near[:, half::-1], axis=1)[:, :0:-1], reach(near[:, half:], axis=1)], axis=1)
    # least squares of a polynomial in the scaled time, of lower degree where fewer neighbours count: its slope at the pose
    count = np.count_nonzero(used, axis=1)
    elapsed = np.where(used, time[around] - time[:, None], 0.0)
    scale = np.maximum(np.abs(elapsed).max(axis=1, keepdims=True), np.finfo(float).tiny)
    powers = (elapsed / scale)[..., None] ** np.arange(DEGREE + 1)
    told = used[..., None] & (np.arange(DEGREE + 1) < count[:, None, None])
    slope = np.linalg.pinv(np.where(told, powers, 0.0))[:, 1:2] @ phi
    return np.where(count[:, None] < 2, np.nan, slope[:, 0] / scale)


OUTLYING = 8.0
"""Times the median distance from the neighbours' line, beyond which a sample may be wrong."""
SMALLEST = 1e-3
"""Distance, of the largest value, below which no sample is wrong: exact samples have no median distance."""
MOST = 0.1
"""Share of the samples that may be wrong."""
AROUND = 3
"""Samples on either side of a suspect that its absence must put right."""


@dataclass(frozen=True)
class _SampleSequence:
    """Samples of one quantity; of unit quaternions both signs mean the same."""

    time: Float[np.ndarray, " n"]
    values: Float[np.ndarray, "n v"]
    has_signs: bool

    def distances(self, kept: Int[np.ndarray, " k"]) -> Float[np.ndarray, " d"]:
        """Distances of inner kept samples from the line through their kept neighbours."""
        time, values = self.time[kept], self.values[kept]
        # Inner samples with both neighbours; time shares the line between these.
        before, here, after = values[:-2], values[1:-1], values[2:]
        if self.has_signs:
            before, after = (_aligned(each, here) for each in (before, after))
        share = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None]
        line = (1 - share) * before + share * after
        if self.has_signs:
            line /= np.maximum(np.linalg.norm(line, axis=1, keepdims=True), SMALLEST)
        return np.linalg.norm(here - line, axis=1)

    def wrong(self) -> Int[np.ndarray, " w"]:
        """Indices of the samples with gross errors."""
        kept, removed = np.arange(len(self.time)), []
        distances = self.distances(kept)
        allowed = max(OUTLYING * float(np.median(distances)), SMALLEST * float(np.abs(self.values).max()))
        doubted = set[int]()
        while len(removed) < MOST * len(self.time):
            suspects = [k for k in np.flatnonzero(distances > allowed) if int(kept[k + 1]) not in doubted]
            if not suspects:
                break
            worst = max(suspects, key=lambda k: distances[k]) + 1
            number = self._explaining(kept, int(worst), allowed)
            if number is None:
                doubted.add(int(kept[worst]))
                continue
            removed.append(int(kept[number]))
            kept = np.delete(kept, number)
            distances = self.distances(kept)
        return np.array(removed, dtype=int)

    def _explaining(self, kept: Int[np.ndarray, " k"], worst: int, allowed: float) -> int | None:
        """Index in ``kept`` of the sample that explains the largest distance.

        It is the worst or next to it: without it its surroundings lie on lines; None without one.
        """
        left = {}
        for place in (worst, worst - 1, worst + 1):
            first = max(place - AROUND, 0)
            near = np.delete(kept[first : place + AROUND + 1], place - first)
            left[place] = float(self.distances(near).max(initial=0.0))
        best = min(left, key=lambda place: left[place])
        return best if left[best] <= allowed else None


def consistent_samples(samples: MotionSamples) -> MotionSamples:
    """Samples without single gross errors of attitude, rate or position."""
    if len(samples.time) < 2 * AROUND:
        return samples
    given = {name: getattr(samples, name) for name in ("attitude", "rates", "positions")}
    wrong = [
        _SampleSequence(samples.time, values, values is samples.attitude).wrong()
        for values in given.values()
        if values is not None
    ]
    good = np.setdiff1d(np.arange(len(samples.time)), np.concatenate(wrong))
    given["shared"] = samples.shared
    kept = {name: None if values is None else values[good] for name, values in given.items()}
    return replace(samples, time=samples.time[good], **kept)


def _aligned(q: Float[np.ndarray, "n v"], to: Float[np.ndarray, "n v"]) -> Float[np.ndarray, "n v"]:
    """Quaternions of the sign that is nearer to others."""
    return q * np.where(np.sum(q * to, axis=1, keepdims=True) < 0, -1.0, 1.0)


MOMENTUM_BLOCKS = (CENTRE_OF_MASS, MASS_DISTRIBUTION, DRAG, LINEAR_DRAG, VELOCITY)
"""What conserved momentum and a straight path determine beyond what was seen."""
MASS_SHARES = (1.0, 0.3, 0.0)
"""Shares of the closed form's departure from a sphere from which a fit is tried, in this order."""


def initial_state(layout: StateLayout, evidence: InitialMotion) -> tuple[Float[np.ndarray, " m"], float]:
    """First state and its constancy from conserved angular momentum and a straight path."""
    braking = next((block for block in (DRAG, LINEAR_DRAG) if layout.has(block)), None)
    fit = fit_momentum(evidence.rotations, evidence.rates, evidence.time, braking)
    x = layout.origin()
    x[layout.mean_slice("a")] = evidence.attitude[0]
    x[layout.mean_slice("w")] = evidence.rates[0]
    x[layout.mean_slice("s")] = from_inertia(fit.inertia)
    if braking is not None:
        x[layout.mean_slice(braking.name)] = fit.drag
    if evidence.positions is not None and layout.translates:
        x[layout.mean_slice("t")] = evidence.positions[0]
        path = fit_path(evidence, layout.has(ACCELERATION))
        for block, value in path.items():
            x[layout.mean_slice(block)] = value
    return x, fit.residual


def path_rows(
    elapsed: Float[np.ndarray, " k"], rotations: Float[np.ndarray, "k 3 3"], accelerated: bool
) -> Float[np.ndarray, "k3 c"]:
    """Rows of -t_k by c, r_0, v and, where accelerated, f; see `fit_path`."""
    s, eye = elapsed[:, None, None], np.broadcast_to(np.eye(3), rotations.shape)
    columns = [rotations, -eye, -eye * s, *([-eye * s**2 / 2] if accelerated else [])]
    return np.concatenate(columns, axis=2).reshape(-1, 3 * len(columns))


def fit_path(evidence: InitialMotion, accelerated: bool) -> dict[str, Float[np.ndarray, " 3"]]:
    """Straight or parabolic path: c, v and f by linear least squares.

    t_k + R_k c = r_0 + v s_k + f s_k^2 / 2, s_k = t_k - t_0.
    A centre of mass that rotations do not separate from the path is the smallest one.
    """
    assert evidence.positions is not None
    A = path_rows(evidence.time - evidence.time[0], evidence.rotations, accelerated)
    solution = np.linalg.lstsq(A, -evidence.positions.reshape(-1), rcond=1e-9)[0].reshape(-1, 3)
    names = (CENTRE_OF_MASS.name, "", VELOCITY.name, ACCELERATION.name)
    return {name: value for name, value in zip(names, solution, strict=False) if name}


SMALLEST_SECOND_MOMENT = 2e-3
"""Floor of the second moments relative to the largest: a flat plate of 1 : 20 stays, noise cannot make a body impossible."""
LARGEST_DRAG = 0.2
"""Upper end of the drag coefficients tried, 1/rad: at this value |h| halves within half a revolution."""

SHAPE_STD = 0.3
"""Of the entries of J (trace 2) about the sphere: it matters only where the motion does not determine a direction of J."""
_TRACELESS = null_space(np.array([[1.0, 1.0, 1.0, 0.0, 0.0, 0.0]]))


@dataclass(frozen=True)
class MomentumFit:
    """Inertia J (3, 3) in g axes with trace 2, a rigid body.

    Drag in the unit of its block; and how far momentum was from constant (relative rms).
    """

    inertia: Float[np.ndarray, "3 3"]
    drag: float
    residual: float


def fit_momentum(
    rotations: Float[np.ndarray, "k 3 3"],
    rates: Float[np.ndarray, "k 3"],
    time: Float[np.ndarray, " k"],
    braking: StateBlock | None,
) -> MomentumFit:
    """Least-squares J up to scale from attitudes and body rates.

    R_ig and rad/s, g axes, at k >= 4 times (s).
    With drag, |h| decays with the angle turned, h_k = h_0 exp(-d angle_k), or if it is linear in the rate with time, h_k = h_0
    exp(-k t_k); the fit is linear for each d or k, which is found by a bounded search of one variable.

    Raises
    ------
    InputError
        With fewer than 4 epochs, or a body that does not rotate.
    """
    if len(rates) < 4:
        raise InputError(
            f"a start from data needs at least 4 epochs with attitude and rate, got {len(rates)}"
        )
    speed = np.linalg.norm(rates, axis=1)
    if not speed.max() * (time[-1] - time[0]) > 1e-3:
        raise InputError(
            "the body does not rotate in the first epochs, so its inertia cannot be estimated; choose a part where it rotates"
        )
    angle = np.concatenate([[0.0], np.cumsum(np.diff(time) * (speed[1:] + speed[:-1]) / 2)])
    drag, decay, largest = 0.0, angle, LARGEST_DRAG
    if braking is LINEAR_DRAG:
        decay, largest = time - time[0], LARGEST_DRAG * float(speed.max())
    if braking is not None:
        from scipy.optimize import minimize_scalar  # here alone: a tenth of a second of every command's start

        found: Any = minimize_scalar(
            lambda d: _smallest(rotations, rates, decay, d)[1], bounds=(0.0, largest), method="bounded"
        )
        drag = float(found.x)
    J, residual = _smallest(rotations, rates, decay, drag)
    return MomentumFit(_physical(J), drag, residual)


def _smallest(
    rotations: np.ndarray, rates: np.ndarray, decay: np.ndarray, drag: float
) -> tuple[np.ndarray, float]:
    """J with trace 2 whose momentum varies least, and the relative size of that variation.

    Noise in attitude and rate adds the same amount to the variation of every J of one Frobenius norm. It is the smallest
    generalised eigenvalue, and is taken off before J is solved for, so that noise does not bend J towards bodies that move little.
    """
    momentum = rotations @ _momentum_rows(rates) * np.exp(drag * decay)[:, None, None]
    variation = (momentum - momentum.mean(axis=0)).reshape(-1, 6)
    gram = variation.T @ variation
    norm = np.diag([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    noise = float(eigh(gram, norm, eigvals_only=True, subset_by_index=[0, 0])[0])
    sphere = np.array([2.0, 2.0, 2.0, 0.0, 0.0, 0.0]) / 3
    level = max(noise, np.finfo(float).eps * float(np.trace(gram))) / max(3 * len(rates) - 9, 1)
    A = _TRACELESS.T @ (gram - noise * norm) @ _TRACELESS + level / SHAPE_STD**2 * np.eye(5)
    j = sphere - _TRACELESS @ np.linalg.solve(A, _TRACELESS.T @ (gram - noise * norm) @ sphere)
    J = np.array([[j[0], j[3], j[4]], [j[3], j[1], j[5]], [j[4], j[5], j[2]]])
    size = np.linalg.norm(momentum.mean(axis=0) @ j) * np.sqrt(len(rates))
    return J, float(np.sqrt(max(j @ gram @ j, 0.0)) / max(size, np.finfo(float).tiny))


def _momentum_rows(w: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3 6"]:
    """Rows that take (Jxx, Jyy, Jzz, Jxy, Jxz, Jyz) to J w."""
    x, y, z = w.T
    o = np.zeros_like(x)
    return np.stack(
        [np.stack(row, -1) for row in ([x, o, o, y, z, o], [o, y, o, x, o, z], [o, o, z, o, x, y])], axis=1
    )


def _physical(J: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """The nearest J whose second moments are positive.

    S = tr(J)/2 I - J with its eigenvalues floored.
    """
    values, vectors = np.linalg.eigh(second_moments_of(J))
    values = np.maximum(values, SMALLEST_SECOND_MOMENT * max(values[-1], np.finfo(float).tiny))
    S = (vectors * (values / values.sum())) @ vectors.T
    return np.eye(3) - S
