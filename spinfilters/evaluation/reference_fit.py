"""Clock, axes and origin of a reference, fitted to an estimate.

A reference gives poses of axes m in a frame l at times of its own clock (`spinfilters.io.reference_motion`). With the estimate
R_ig(t), r(t), c of a `ContinuousMotion` it is modelled as

    R_lm(t + d) = X R_ig(t) Y,    p_l(t + d) = X (r(t) + R_ig(t) (o - c)) + s,    w_m(t + d) = Y' w_g(t),

with the clock's offset d, the rotations X = R_li and Y = R_gm, the origin o of m in g, and the shift s. What is left holds white
noise of the reference, which its second differences show, and the error of the estimate, as large as stated, alike over many rows.
The fit is the generalised least-squares one. An estimate that defines g by the pose of its first epoch is exact there, so that Y
follows from the first epochs as in Eq. 6.12 of Tweddle (2013), and hides no error.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.absolute_orientation import nearest_rotation
from spinfilters.core.attitude_conversions import (
    axis_angle_from_quaternion,
    continuous_quaternions,
    cross_matrix,
    inverse,
    matrix_from_quaternion,
    matrix_from_rotation_vector,
    quaternion_from_matrix,
    rotation_vector_from_matrix,
)
from spinfilters.core.errors import InputError
from spinfilters.evaluation.continuous_motion import ContinuousMotion
from spinfilters.io.reference_motion import FEWEST_ROWS, ReferenceMotion

MOST_ROWS: Final = 1500
"""Of a reference that the fit looks at, evenly."""
FIRST_ROWS: Final = 250
"""Of it that choose among the first offsets."""
LEAST_OVERLAP: Final = 0.6
"""Of the shorter recording, that an offset of the clocks must leave."""
DIFFERENCED: Final = 0.5
"""Rotation, rad, over which attitudes are differenced to find the first offset."""
LEAST_RATE: Final = 1e-3
"""Rad/s, of a motion that turns."""
RATE_ANGLE: Final = 0.2
"""Rotation, rad, between two offsets of which the first one is chosen."""
CANDIDATES: Final = 4
"""Offsets from which the fit starts, besides zero."""
ITERATIONS: Final = 40
FLOOR: Final = (1e-6, 1e-6)
"""Smallest noise of a reference, rad (or rad/s) and m: interpolation is no better."""
OUTLIER: Final = 4.0
"""Deviations from which on a row weighs less."""
JUMP: Final = 20.0
"""Deviations by which a row stands out that the instrument has lost."""
UNDETERMINED: Final = 1e-9
"""Eigenvalue of the scaled normal matrix, below which a combination is not determined."""
UNDECIDED: Final = 4.6
"""Nats of log likelihood, a probability ratio of 100, up to which two offsets fit alike; then the smaller one is taken."""
WRONG_FORM: Final = np.deg2rad(5.0)
"""Attitude residual, rad, from which on other forms of the quaternion are tried."""


@dataclass(frozen=True)
class ReferenceFit:
    """Relation of a reference to an estimate.

    Attributes
    ----------
    clock_offset, clock_std : float
        d, s; positive where the reference is late. The deviation is infinite where the motion does not determine it, which d = 0
        then represents.
    frame, frame_std : (3, 3), (3,) float array
        X = R_li and deviations about the axes of l, rad; zero where the frame is shared.
    axes, axes_std : (3, 3), (3,) float array
        Y = R_gm and deviations about the axes of m, rad.
    origin, origin_std : (3,) float array or None
        o in g, m; None where the reference has no positions.
    shift : (3,) float array
        s, m.
    noise : tuple of float
        Of the reference: rad (rad/s where it has rates alone) and m, one component.
    residual : tuple of float
        Root mean square lengths of what is left, in the same units.
    covariance : (p, p) float array
        Of all that was fitted, in the order clock, frame, axes, origin, shift, without what is shared or has no deviation.
    form : str
        How the quaternions have to be read; empty for as they are.
    """

    clock_offset: float
    clock_std: float
    frame: Float[np.ndarray, "3 3"]
    frame_std: Float[np.ndarray, " 3"]
    axes: Float[np.ndarray, "3 3"]
    axes_std: Float[np.ndarray, " 3"]
    origin: Float[np.ndarray, " 3"] | None
    origin_std: Float[np.ndarray, " 3"] | None
    shift: Float[np.ndarray, " 3"]
    noise: tuple[float, float]
    residual: tuple[float, float]
    covariance: Float[np.ndarray, "p p"]
    form: str = ""

    @property
    def has_clock(self) -> bool:
        """Whether the motion determines the offset."""
        return bool(np.isfinite(self.clock_std))

    @property
    def clock_correlation(self) -> float:
        """Multiple correlation of the clock's offset with all else that was fitted, 0 to 1.

        In a spin of constant rate w an offset d and a rotation by w d about the spin axis are the same: then it is close to 1.
        """
        if not self.has_clock or len(self.covariance) < 2:
            return 0.0
        alone, rest = self.covariance[0, 0], self.covariance[1:, 1:]
        shared = self.covariance[0, 1:] @ np.linalg.pinv(rest, hermitian=True) @ self.covariance[1:, 0]
        return float(np.sqrt(np.clip(shared / alone, 0.0, 1.0)))


def fit_reference(
    motion: ContinuousMotion, reference: ReferenceMotion
) -> tuple[ReferenceFit, ReferenceMotion]:
    """The fit, and the reference in the form that it needs.

    Raises
    ------
    InputError
        The recordings have no stretch in common, whatever the offset.
    """
    reference = _without_jumps(reference)
    found = _fit_reference(motion, reference)
    if reference.attitude is None or found.residual[0] < WRONG_FORM:
        return found, reference
    best, chosen = found, reference
    for form, other in _other_forms(reference):
        tried = _fit_reference(motion, other)
        if tried.residual[0] < 0.25 * best.residual[0]:
            best, chosen = replace(tried, form=form), other
    return best, chosen


@dataclass(frozen=True)
class FittedResiduals:
    """What is left between a motion and a reference that was fitted over another stretch.

    Attributes
    ----------
    time : (k,) float array
        On the clock of the estimate, s.
    rotation, place : (k, 3) float array or None
        Rotation of the estimate from the reference about m, rad, or for rates alone reference minus estimate about m, rad/s; place
        of the reference's origin, reference minus estimate, m, axes l, where both know it.
    rotation_std, place_std : (k, 3) float array or None
        Deviations of all that was fitted and of the reference's noise, and of the motion but for its rates.
    """

    time: Float[np.ndarray, " k"]
    rotation: Float[np.ndarray, "k 3"]
    rotation_std: Float[np.ndarray, "k 3"]
    place: Float[np.ndarray, "k 3"] | None
    place_std: Float[np.ndarray, "k 3"] | None


def fitted_residuals(
    fit: ReferenceFit, motion: ContinuousMotion, reference: ReferenceMotion
) -> FittedResiduals | None:
    """Residuals of a reference behind the begin of a motion, with nothing fitted again; None where it has no rows there.

    The deviations of a fit grow outside the stretch that it was made over: they are those of its covariance, J C J'.

    Parameters
    ----------
    fit : ReferenceFit
        Of the same reference, in the form that it was fitted in.
    motion : ContinuousMotion
        What goes on from the fitted motion; nothing at its begin is taken.
    reference : ReferenceMotion
        Of both stretches.
    """
    problem = _fitted_problem(fit, motion, reference)
    begin, end = motion.span
    own_clock = reference.time - fit.clock_offset
    problem.inside = (own_clock > begin) & (own_clock <= end)
    if not problem.inside.any():
        return None
    e, J, own = problem.rows()
    variance = np.einsum("kgip,pq,kgiq->kgi", J, fit.covariance, J)
    std = np.sqrt(variance + (own**2 + np.square(fit.noise[: own.shape[1]]))[..., np.newaxis])
    place, place_std = (e[:, 1], std[:, 1]) if e.shape[1] > 1 else (None, None)
    return FittedResiduals(own_clock[problem.inside], e[:, 0], std[:, 0], place, place_std)


def hidden_error(fit: ReferenceFit, motion: ContinuousMotion, reference: ReferenceMotion) -> float:
    """Root mean square length of the error of attitude, rad, that the fit of an estimate to a reference takes up.

    What is fitted is off by some step d of covariance C, so that rows of derivatives J hide J d of the error: an error against the
    truth has the expected square of the residual plus J C J'. Rad/s where the reference has rates alone.
    """
    problem = _fitted_problem(fit, motion, reference)
    begin, end = motion.span
    own_clock = reference.time - fit.clock_offset
    problem.inside = (own_clock >= begin) & (own_clock <= end)
    _, J, _ = problem.rows()
    variance = np.einsum("kip,pq,kiq->k", J[:, 0], fit.covariance, J[:, 0])
    return float(np.sqrt(max(float(np.mean(variance)), 0.0)))


def _fitted_problem(fit: ReferenceFit, motion: ContinuousMotion, reference: ReferenceMotion) -> "_Problem":
    """The problem at its solution."""
    problem = _Problem(motion, reference, fit.clock_offset)
    problem.X, problem.Y, problem.s, problem.noise = fit.frame, fit.axes, fit.shift, np.array(fit.noise)
    problem.o = np.zeros(3) if fit.origin is None else fit.origin
    problem.clock_is_free = fit.has_clock
    return problem


def nearest_flip(R: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """Of the 24 right-handed choices and signs of axes the one that is nearest to a rotation."""
    return max(_FLIPS, key=lambda flip: float(np.sum(flip * R)))


def axis_and_angle(R: Float[np.ndarray, "3 3"]) -> tuple[Float[np.ndarray, " 3"], float]:
    """Axis and angle, rad in [0, pi], of a rotation (Tweddle 2013, Eqs 6.24 and 6.25)."""
    axis, angle = axis_angle_from_quaternion(quaternion_from_matrix(R))
    return np.asarray(axis), float(angle)


def _flips() -> Iterator[Float[np.ndarray, "3 3"]]:
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            flip = np.zeros((3, 3))
            flip[range(3), order] = signs
            if np.linalg.det(flip) > 0:
                yield flip


_FLIPS: Final = tuple(_flips())


def _other_forms(reference: ReferenceMotion) -> Iterator[tuple[str, ReferenceMotion]]:
    """The same quaternions from the frame to the body, and with the scalar first."""
    q = reference.attitude
    assert q is not None
    yield "its quaternions map the frame to the body", replace(reference, attitude=inverse(q))
    first = continuous_quaternions(q[:, [1, 2, 3, 0]])
    yield "its quaternions have the scalar first", replace(reference, attitude=first)
    yield (
        "its quaternions have the scalar first and map the frame to the body",
        replace(reference, attitude=inverse(first)),
    )


def reference_rates(
    reference: ReferenceMotion, span: float = 0.0
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k 3"]]:
    """Times, s, and body rates about m, rad/s: its own, or differences of its attitudes (Tweddle 2013, Eq. 6.13).

    Parameters
    ----------
    span : float
        Least time, s, between two differenced attitudes; differences over gaps are left out.
    """
    if reference.rate is not None:
        return reference.time, reference.rate
    assert reference.attitude is not None  # a reference has one of the two
    time, q = reference.time, reference.attitude
    stride = int(np.clip(np.ceil(span / reference.step - 1e-9), 1, max(len(time) // 4, 1)))
    turned = quaternion_pairs(q, stride)
    dt = time[stride:] - time[:-stride]
    held = dt <= 1.5 * stride * reference.step
    return (time[stride:] + time[:-stride])[held] / 2, turned[held] / dt[held, None]


def quaternion_pairs(q: Float[np.ndarray, "n 4"], stride: int) -> Float[np.ndarray, "k 3"]:
    """Rotation vectors from every attitude to the one so many rows later, rad, body axes."""
    R = matrix_from_quaternion(q)
    turn = np.swapaxes(R[:-stride], 1, 2) @ R[stride:]
    return rotation_vector_from_matrix(turn)


def _fit_reference(motion: ContinuousMotion, reference: ReferenceMotion) -> ReferenceFit:
    found = [
        _solved_from(motion, _rows_within(motion, reference, start, FIRST_ROWS), start)
        for start in _starts(motion, reference)
    ]
    if not found:
        begin, end = motion.span
        raise InputError(
            f"{reference.name}: from {reference.time[0]:.6g} s to {reference.time[-1]:.6g} s it has no stretch in common with the "
            f"estimate from {begin:.6g} s to {end:.6g} s; give a recording of the same motion"
        )
    chosen = _likeliest(found)
    rows = _rows_within(motion, reference, chosen.offset, MOST_ROWS)
    return chosen.on(rows).with_own_noise().solved().with_own_noise().solved().result()


def _likeliest(found: Sequence["_Problem"]) -> "_Problem":
    """The likeliest of several fits with the noise that the best of them leaves; of those that fit alike the smallest offset."""
    best = min(found, key=lambda problem: problem.cost).with_own_noise().solved()
    again = [best, *(problem.with_noise_of(best).solved() for problem in found)]
    least = min(problem.cost for problem in again)
    # the cost is a mean square of whitened numbers, as many in the best fit as count, and one where all is noise
    nats = 0.5 * max(best.numbers, 1) / max(least, 1.0)
    alike = [problem for problem in again if problem.cost <= least + UNDECIDED / nats]
    smallest = min(alike, key=lambda problem: abs(problem.offset))
    # two that stopped in one valley are the same fit: the cost decides between them, whatever the origin of the stamps
    valley = [problem for problem in alike if abs(problem.offset - smallest.offset) < smallest.turn_time]
    return min(valley, key=lambda problem: problem.cost)


def _rows_within(
    motion: ContinuousMotion, reference: ReferenceMotion, offset: float, most: int
) -> ReferenceMotion:
    """Every k-th row of the stretch that an offset, which may yet be a radian off, puts within the estimate."""
    begin, end = motion.span
    margin = max(1.0 / max(motion.typical_rate, 1e-6), reference.step)
    own = reference.time - offset
    rows = np.flatnonzero((own >= begin - margin) & (own <= end + margin))
    rows = rows if len(rows) >= FEWEST_ROWS else np.arange(len(own))
    return _rows_of(reference, rows[:: max(1, -(-len(rows) // most))])


def _without_jumps(reference: ReferenceMotion) -> ReferenceMotion:
    """Without rows that depart from their neighbours `JUMP` times as far as rows usually do, and twice as far as the motion goes.

    Of a reference with little noise most rows are the median of their neighbours. Its turning points are not, but they depart
    from it by no more than the motion goes from one row to the next.
    """
    good = np.ones(len(reference.time), dtype=bool)
    for values in (reference.position, reference.attitude, reference.rate):
        if values is not None:
            off = np.linalg.norm(values - _running_median(values), axis=1)
            usual = JUMP * max(float(np.median(off)), FLOOR[0])
            good &= off <= np.maximum(usual, 2.0 * _running_steps(values))
    if good.all() or np.count_nonzero(good) < 0.7 * len(good):
        return reference
    said = f"{np.count_nonzero(~good)} rows that jump"
    return replace(_rows_of(reference, np.flatnonzero(good)), left_out=(*reference.left_out, said))


def _rows_of(reference: ReferenceMotion, rows: Int[np.ndarray, " k"]) -> ReferenceMotion:
    cut = {
        name: None if getattr(reference, name) is None else getattr(reference, name)[rows]
        for name in ("attitude", "position", "rate", "velocity")
    }
    return replace(reference, time=reference.time[rows], **cut)


def _starts(motion: ContinuousMotion, reference: ReferenceMotion) -> list[float]:
    """Offsets at which the rates, turned into the estimate's axes, agree best; and zero if the clocks overlap so."""
    turning = max(motion.typical_rate, LEAST_RATE)
    time, rate = reference_rates(reference, DIFFERENCED / turning)
    begin, end = motion.span
    need = LEAST_OVERLAP * min(end - begin, float(time[-1] - time[0]))
    low, high = float(time[0]) + need - end, float(time[-1]) - need - begin
    if not high >= low:
        return []
    step = min(RATE_ANGLE / turning, max((high - low) / 20, 1e-9))
    grid, cost = _rate_costs(motion, time, rate, step)
    inner = np.r_[True, cost[1:] <= cost[:-1]] & np.r_[cost[:-1] <= cost[1:], True]
    inner &= np.isfinite(cost) & (grid >= low - step) & (grid <= high + step)
    order = sorted(np.flatnonzero(inner), key=lambda k: cost[k])[:CANDIDATES]
    zero = [0.0] if low <= 0.0 <= high else []
    return [*zero, *(float(grid[k]) for k in order)]


def _rate_costs(
    motion: ContinuousMotion, time: Float[np.ndarray, " k"], rate: Float[np.ndarray, "k 3"], step: float
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Offsets at a step, s, and the mean square of the rates that the best rotation leaves at each, (rad/s)^2.

    With C(d) the sum of w_g(t) w_m(t + d)' over the rows that overlap, it is (sum |w_m|^2 + sum |w_g|^2 - 2 max tr(Y' C)) / rows:
    correlations, which the Fourier transform gives for all offsets at once.
    """
    begin, end = motion.span
    own = motion.at(np.arange(begin, end, step)).rate
    # means of the reference over a step each; steps without a row, in gaps, count for nothing
    bins = np.rint((time - time[0]) / step).astype(int)
    rows = np.bincount(bins)
    seen = (rows > 0).astype(float)
    theirs = np.column_stack([np.bincount(bins, rate[:, k]) for k in range(3)]) / np.maximum(rows, 1)[:, None]
    # lag m pairs own sample k with step k + m of the reference; negative lags stand at the end of the transform
    size = 1 << (len(own) + len(theirs) - 1).bit_length()
    lags = np.arange(-len(own) + 1, len(theirs))

    def correlation(a: Float[np.ndarray, "p i"], b: Float[np.ndarray, "q j"]) -> Float[np.ndarray, "n i j"]:
        """Sums over k of a_k b_k+m' for every lag m."""
        A, B = np.fft.rfft(a, size, axis=0), np.fft.rfft(b, size, axis=0)
        return np.fft.irfft(np.conj(A)[:, :, None] * B[:, None, :], size, axis=0)[lags]

    present = np.ones((len(own), 1))
    count = np.rint(correlation(present, seen[:, None])[:, 0, 0])
    square = correlation(present, np.sum(theirs**2, axis=1)[:, None])
    square = square + correlation(np.sum(own**2, axis=1)[:, None], seen[:, None])
    C = correlation(own, theirs)
    singular = np.linalg.svd(C, compute_uv=False)
    most = singular[:, 0] + singular[:, 1] + np.sign(np.linalg.det(C)) * singular[:, 2]  # of rotations alone
    cost = np.where(count < 3, np.inf, (square[:, 0, 0] - 2 * most) / np.maximum(count, 1))
    return float(time[0]) - begin + lags * step, cost


class _Problem:
    """Residuals of one reference at one linearisation point, their weights and derivatives."""

    def __init__(self, motion: ContinuousMotion, reference: ReferenceMotion, offset: float) -> None:
        self.motion, self.reference, self.offset = motion, reference, offset
        self.X, self.Y, self.s = np.eye(3), np.eye(3), np.zeros(3)
        self.places = reference.position is not None and motion.sees_position
        self.o = motion.final_centre.copy() if self.places else np.zeros(3)
        self.turns = reference.attitude is not None
        self.noise = np.array([np.deg2rad(1.0), 0.01])
        self.alike = 0.0
        self.inside = self.within()
        self.clock_is_free = True
        self.cost = np.inf

    @property
    def blocks(self) -> dict[str, slice]:
        """Columns of what is fitted."""
        shared = self.reference.shares_frame or not self.turns
        sizes = {
            "clock": int(self.clock_is_free),
            "frame": 0 if shared else 3,
            "axes": 3,
            "origin": 3 if self.places and not self.reference.shares_origin else 0,
            "shift": 3 if self.places and not shared else 0,
        }
        ends = np.cumsum(list(sizes.values())).tolist()
        return {name: slice(end - size, end) for (name, size), end in zip(sizes.items(), ends, strict=True)}

    def within(self) -> Bool[np.ndarray, " n"]:
        """Rows of the reference within the estimate, or one row beyond, so that a change of the offset loses none."""
        begin, end = self.motion.span
        time, margin = self.reference.time - self.offset, self.reference.step
        return (time >= begin - margin) & (time <= end + margin)

    def guess(self) -> None:
        """Rotations and shift in closed form at the offset: Y from rates, then X and Y in turn."""
        rows, reference = self.inside, self.reference
        own = self.motion.at(reference.time[rows] - self.offset)
        if not self.turns:
            assert reference.rate is not None
            self.Y = nearest_rotation(own.rate.T @ reference.rate[rows])
            return
        assert reference.attitude is not None
        time, rate = reference_rates(reference, DIFFERENCED / max(self.motion.typical_rate, LEAST_RATE))
        begin, end = self.motion.span
        held = (time - self.offset >= begin) & (time - self.offset <= end)
        if held.any():
            rates = self.motion.at(time[held] - self.offset).rate
            self.Y = nearest_rotation(rates.T @ rate[held])
        R, B = matrix_from_quaternion(own.q_ig), matrix_from_quaternion(reference.attitude[rows])
        for _ in range(10):
            if not reference.shares_frame:
                self.X = nearest_rotation(np.einsum("nij,njk->ik", B, np.swapaxes(R @ self.Y, 1, 2)))
            self.Y = nearest_rotation(np.einsum("nji,njk->ik", self.X @ R, B))
        if self.places and not reference.shares_frame:
            assert reference.position is not None
            at = own.position + (R @ (self.o - own.centre)[..., None])[..., 0]
            self.s = np.mean(reference.position[rows] - at @ self.X.T, axis=0)

    def rows(self) -> tuple[Float[np.ndarray, "k g 3"], Float[np.ndarray, "k g 3 p"], np.ndarray]:
        """Residuals, derivatives and deviations of the estimate: of rotation, then of place where both know it."""
        inside, reference, blocks = self.inside, self.reference, self.blocks
        own = self.motion.at(reference.time[inside] - self.offset)
        count, size = int(np.count_nonzero(inside)), max(part.stop for part in blocks.values())
        groups = 1 + self.places
        e, J = np.zeros((count, groups, 3)), np.zeros((count, groups, 3, size))
        R = matrix_from_quaternion(own.q_ig)
        w = own.rate @ self.Y
        if self.turns:
            assert reference.attitude is not None
            B = matrix_from_quaternion(reference.attitude[inside])
            left = np.swapaxes(B, 1, 2) @ self.X @ R @ self.Y
            e[:, 0] = rotation_vector_from_matrix(left)
            if blocks["frame"].stop > blocks["frame"].start:
                J[:, 0, :, blocks["frame"]] = np.swapaxes(self.X @ R @ self.Y, 1, 2)
            J[:, 0, :, blocks["axes"]] = np.eye(3)
            if self.clock_is_free:
                J[:, 0, :, 0] = -w
        else:
            assert reference.rate is not None
            e[:, 0] = reference.rate[inside] - w
            J[:, 0, :, blocks["axes"]] = -cross_matrix(w)
            if self.clock_is_free:
                J[:, 0, :, 0] = own.acceleration @ self.Y
        deviations = [own.std_attitude if self.turns else 0.0 * own.std_attitude]
        if self.places:
            assert reference.position is not None
            arm = (R @ (self.o - own.centre)[..., None])[..., 0]
            at = (own.position + arm) @ self.X.T
            e[:, 1] = reference.position[inside] - at - self.s
            if blocks["frame"].stop > blocks["frame"].start:
                J[:, 1, :, blocks["frame"]] = cross_matrix(at)
            if blocks["origin"].stop > blocks["origin"].start:
                J[:, 1, :, blocks["origin"]] = -self.X @ R
            if blocks["shift"].stop > blocks["shift"].start:
                J[:, 1, :, blocks["shift"]] = -np.eye(3)
            if self.clock_is_free:
                spun = np.cross((R @ own.rate[..., None])[..., 0], arm)
                J[:, 1, :, 0] = (own.velocity + spun) @ self.X.T
            deviations.append(own.std_position)
        return e, J, np.stack(deviations, axis=1)

    def on(self, reference: ReferenceMotion) -> "_Problem":
        """The same point with other rows."""
        other = _Problem(self.motion, reference, self.offset)
        other.noise, other.clock_is_free, other.alike = self.noise, self.clock_is_free, self.alike
        other.X, other.Y, other.s, other.o = self.X, self.Y, self.s, self.o
        if reference is self.reference:
            other.inside = self.inside
        return other

    @property
    def numbers(self) -> int:
        """Numbers that the reference gives in common with the estimate."""
        return 3 * (1 + self.places) * int(np.count_nonzero(self.inside))

    def with_noise_of(self, other: "_Problem") -> "_Problem":
        """The same point with the noise of another."""
        same = self.on(self.reference)
        same.noise, same.alike = other.noise, other.alike
        return same

    def moved(self, step: Float[np.ndarray, " p"]) -> "_Problem":
        """The problem at a step away."""
        other, blocks = self.on(self.reference), self.blocks
        if self.clock_is_free:
            other.offset = self.offset + float(step[0])
        if step[blocks["frame"]].size:
            other.X = matrix_from_rotation_vector(step[blocks["frame"]]) @ self.X
        other.Y = self.Y @ matrix_from_rotation_vector(step[blocks["axes"]])
        if step[blocks["origin"]].size:
            other.o = self.o + step[blocks["origin"]]
        if step[blocks["shift"]].size:
            other.s = self.s + step[blocks["shift"]]
        return other

    def whitened(self) -> tuple[Float[np.ndarray, "k g3"], Float[np.ndarray, "k g3 p"]]:
        """Residuals and derivatives as white noise of deviation one, outliers weighing less."""
        return self._whiten(*self.rows())

    def _whiten(
        self,
        e: Float[np.ndarray, "k g 3"],
        J: Float[np.ndarray, "k g 3 p"],
        own: Float[np.ndarray, "k g"],
    ) -> tuple[Float[np.ndarray, "k g3"], Float[np.ndarray, "k g3 p"]]:
        count, size = len(e), J.shape[3]
        both = np.concatenate([e[..., None], J], axis=3)
        if self.alike:
            both = np.stack(
                [self._innovations(both[:, g], own[:, g], g) for g in range(both.shape[1])], axis=1
            )
        else:
            both = both / np.hypot(own, self.noise[: own.shape[1]])[..., None, None]
        both = both.reshape(count, -1, 1 + size)
        e, J = both[..., 0], both[..., 1:]
        length = np.sqrt(np.mean(e**2, axis=1))
        scale = OUTLIER * max(1.0, float(np.median(length)))
        root = np.sqrt(np.minimum(1.0, scale / np.maximum(length, 1e-300)))
        return e * root[:, None], J * root[:, None, None]

    def _innovations(
        self, rows: Float[np.ndarray, "k 3 q"], own: Float[np.ndarray, " k"], group: int
    ) -> Float[np.ndarray, "k 3 q"]:
        """Innovations of a scalar Kalman filter over rows that hold an error of the estimate and white noise of the reference.

        The error is of first order with the stated variance own^2 and a correlation time of ``alike`` rows; all columns of the
        rows pass the same filter, so that a least-squares fit to its innovations is the generalised one.
        """
        time = self.reference.time[self.inside]
        decay = np.exp(-2.0 * np.diff(time) / (self.alike * self.reference.step))
        noise, variance = self.noise[group] ** 2, float(own[0]) ** 2
        x, found = np.zeros(rows.shape[1:]), np.empty_like(rows)
        for k, row in enumerate(rows):
            if k:
                # e_k = f e_k-1 + new, so that a growing deviation adds to an error and does not enlarge it
                f = decay[k - 1] * min(1.0, own[k] / max(own[k - 1], 1e-300))
                x, variance = f * x, f * f * (variance - own[k - 1] ** 2) + own[k] ** 2
            y, S = row - x, variance + noise
            found[k] = y / np.sqrt(S)
            x, variance = x + variance / S * y, variance * noise / S
        return found

    def solved(self) -> "_Problem":
        """Levenberg-Marquardt; the cost is that of a row, so that offsets of other overlaps compare."""
        here, damping = self, 1e-4
        if np.count_nonzero(here.inside) < 4:
            return here
        e, J = here.whitened()
        cost = float(np.mean(e**2))
        if not np.isfinite(cost):
            return here
        for _ in range(ITERATIONS):
            A = np.einsum("kip,kiq->pq", J, J)
            b = np.einsum("kip,ki->p", J, e)
            scale = np.sqrt(np.maximum(np.diag(A), 1e-300))
            A = A / scale[:, None] / scale
            step = -np.linalg.solve(A + damping * np.eye(len(A)), b / scale) / scale
            there = here.moved(step)
            there_e, there_J = there.whitened()
            after = float(np.mean(there_e**2))
            if after < cost:
                done = cost - after < 1e-8 * cost
                here, e, J, cost, damping = there, there_e, there_J, after, max(damping / 10, 1e-12)
                if done:
                    break
            else:
                damping *= 10
                if damping > 1e8:
                    break
        here.cost = cost
        return here

    def with_own_noise(self) -> "_Problem":
        """Noise of the reference by second differences of what is left, and over how many rows errors of the estimate stay alike.

        Rows that stand out from their neighbours by more than `JUMP` deviations are left out.
        """
        self.inside = self.within()
        e, _, _ = self.rows()
        noise, good = self.noise.copy(), np.ones(len(e), dtype=bool)
        dt = np.diff(self.reference.time[self.inside])
        near = (dt[1:] < 1.5 * self.reference.step) & (dt[:-1] < 1.5 * self.reference.step)
        for group in range(e.shape[1]):
            bend = e[2:, group] - 2 * e[1:-1, group] + e[:-2, group]
            if near.any():
                noise[group] = max(np.sqrt(np.median(bend[near] ** 2) / (6 * 0.4549)), FLOOR[group])
            good &= np.linalg.norm(e[:, group] - _running_median(e[:, group]), axis=1) < JUMP * noise[group]
        other = self.on(self.reference)
        if np.count_nonzero(good) > 0.7 * len(good):
            other.inside = self.inside.copy()
            other.inside[np.flatnonzero(self.inside)[~good]] = False
            e = e[good]
        other.noise = noise
        other.alike = max(correlated_rows(e[:, g, k : k + 1]) for g in range(e.shape[1]) for k in range(3))
        return other

    def covariance(self) -> tuple[Float[np.ndarray, "p p"], Bool[np.ndarray, " p"]]:
        """Of what is fitted, larger where what is left is larger than stated; and which of it is determined at all.

        An error of the estimate that keeps its direction in m or l, as that of the first epoch's pose does, leaves no residual
        where what is fitted can take it up. So it is counted by itself: the step that it makes the fit take, with its deviation.
        """
        e, J, own = self.rows()
        constant = np.zeros((*e.shape, 3 * e.shape[1]))
        for group in range(e.shape[1]):
            constant[:, group, :, 3 * group : 3 * group + 3] = own[:, group, None, None] * np.eye(3)
        e, both = self._whiten(e, np.concatenate([J, constant], axis=3), own)
        J, constant = both[..., : J.shape[3]], both[..., J.shape[3] :]
        A = np.einsum("kip,kiq->pq", J, J)
        scale = np.sqrt(np.maximum(np.diag(A), 1e-300))
        values, vectors = np.linalg.eigh(A / scale[:, None] / scale)
        good = values > UNDETERMINED * values[-1]
        inverse_A = (vectors[:, good] / values[good]) @ vectors[:, good].T / scale[:, None] / scale
        determined = np.sum(vectors[:, ~good] ** 2, axis=1) < 0.01
        taken_up = inverse_A @ np.einsum("kip,kiq->pq", J, constant)
        return inverse_A * max(1.0, float(np.mean(e**2))) + taken_up @ taken_up.T, determined

    def result(self) -> ReferenceFit:
        """The fit as others use it."""
        covariance, determined = self.covariance()
        std = np.where(determined, np.sqrt(np.diag(covariance)), np.inf)
        blocks = self.blocks
        if self.clock_is_free and (not determined[0] or std[0] > self.turn_time):
            self.clock_is_free, self.offset = False, 0.0
            if np.count_nonzero(self.inside) >= 4:
                self.guess()
                return self.solved().result()
        part = lambda name: std[blocks[name]] if std[blocks[name]].size else np.zeros(3)  # noqa: E731
        e, _, _ = self.rows()
        left = [float(np.sqrt(np.mean(np.sum(e[:, g] ** 2, axis=1)))) for g in range(e.shape[1])]
        return ReferenceFit(
            self.offset,
            float(std[0]) if self.clock_is_free else np.inf,
            self.X,
            part("frame"),
            self.Y,
            part("axes"),
            self.o if self.places else None,
            part("origin") if self.places else None,
            self.s,
            (float(self.noise[0]), float(self.noise[1])),
            (left[0], left[1] if len(left) > 1 else 0.0),
            covariance,
        )

    @property
    def turn_time(self) -> float:
        """Deviation of the offset, s, beyond which it is no result: a radian of the rotation."""
        return 1.0 / max(self.motion.typical_rate, 1e-6)


def _solved_from(motion: ContinuousMotion, reference: ReferenceMotion, offset: float) -> _Problem:
    problem = _Problem(motion, reference, offset)
    problem.guess()
    return problem.solved()


def _running_median(values: Float[np.ndarray, "k c"]) -> Float[np.ndarray, "k c"]:
    """Median of every row and the two on either side; the ends are their own."""
    found = values.copy()
    if len(values) >= 5:
        found[2:-2] = np.median(np.stack([values[k : len(values) - 4 + k] for k in range(5)]), axis=0)
    return found


def _running_steps(values: Float[np.ndarray, "k c"]) -> Float[np.ndarray, " k"]:
    """Median of the six steps about every row, so that a jump of one row or of two does not count."""
    if len(values) < 2:
        return np.zeros(len(values))
    steps = np.pad(np.linalg.norm(np.diff(values, axis=0), axis=1), 3, mode="edge")
    return np.median(np.lib.stride_tricks.sliding_window_view(steps, 6), axis=1)


def correlated_rows(values: Float[np.ndarray, "k c"]) -> float:
    """Integrated autocorrelation time in rows, up to the first lag that is not positive: 1 + 2 sum rho."""
    rows = len(values)
    spectrum = np.abs(np.fft.rfft(values, 2 * rows, axis=0)) ** 2
    total = np.fft.irfft(spectrum.sum(axis=1))[:rows]
    rho = total / max(float(total[0]), 1e-300)
    ends = np.flatnonzero(rho <= 0)
    return float(max(1.0, 1.0 + 2.0 * rho[1 : int(ends[0]) if ends.size else rows].sum()))
