"""Marginal likelihood of noise levels where measurement errors may be correlated in time, and its maximum by Fisher scoring."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.filters.noise_levels import ComponentRows
from spinfilters.inference.noise_model import NoiseModel, source_factors
from spinfilters.verdict.model_errors.linear_rows import LinearRows

MOST_EPOCHS: Final = 300
"""That are looked at, from the first on."""
SMALLEST: Final = 1e-12
"""Change of a ln likelihood by a level that counts as information."""


@dataclass(frozen=True)
class Innovations:
    """Innovations of a Kalman filter, for b rows of levels.

    Attributes
    ----------
    log_likelihood : (b,) float array
        Of each row.
    residual : (k, b, m) float array
        i.
    covariance : (k, b, m, m) float array
        S; the identity where nothing is measured.
    """

    log_likelihood: Float[np.ndarray, " b"]
    residual: Float[np.ndarray, "k b m"]
    covariance: Float[np.ndarray, "k b m m"]

    @classmethod
    def of(
        cls, residual: Float[np.ndarray, "k b m"], covariance: Float[np.ndarray, "k b m m"]
    ) -> "Innovations":
        """Innovations with their likelihood, -inf where that is not finite."""
        squares = np.einsum("kbi,kbi->b", residual, np.linalg.solve(covariance, residual[..., None])[..., 0])
        found = -0.5 * (np.linalg.slogdet(covariance)[1].sum(axis=0) + squares)
        return cls(np.where(np.isfinite(found), found, -np.inf), residual, covariance)


@dataclass(frozen=True)
class Curvature:
    """Gradient of a ln likelihood by levels, and their Fisher information."""

    gradient: Float[np.ndarray, " f"]
    information: Float[np.ndarray, "f f"]


@dataclass(frozen=True)
class LinearMotion:
    """A linearised motion with its measurements.

    Attributes
    ----------
    interval : (k - 1,) float array
        Time, s.
    transition, shift : (j, n, n) float array, (j, n) float array
        F (n, n) and b (n,) of every step.
    sources : tuple[(j, n, n) float array, ...]
        Covariance that each density adds.
    mean, covariance : (n,) float array, (n, n) float array
        Of the first state.
    jacobian, values, measured : (k, m, n) float array, (k, m) float array, (k, m) bool array
        H (m, n), z and whether there is one, at every epoch.
    slots : tuple[tuple[int, ...], ...]
        Rows of z that each component scales.
    """

    interval: Float[np.ndarray, " j"]
    transition: Float[np.ndarray, "j n n"]
    shift: Float[np.ndarray, "j n"]
    sources: tuple[Float[np.ndarray, "j n n"], ...]
    mean: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "n n"]
    jacobian: Float[np.ndarray, "k m n"]
    values: Float[np.ndarray, "k m"]
    measured: Bool[np.ndarray, "k m"]
    slots: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, rows: LinearRows, model: NoiseModel) -> "LinearMotion":
        """From the whitened rows of a solved problem without landmarks.

        Raises
        ------
        numpy.linalg.LinAlgError
            A prior or step without inverse.
        """
        ordering, steps = rows.problem.ordering, rows.here.dynamics.rows[: MOST_EPOCHS - 1]
        n, d = len(ordering.order), len(ordering.moving)
        # A whitened step is J_k e_k + J_k+1 e_k+1 + J_c c = y; solved for e_k+1 it gives the transition and the shift.
        back = np.linalg.inv(steps[:, :, d : 2 * d])
        transition = np.tile(np.eye(n), (len(steps), 1, 1))
        transition[:, :d, :d] = -back @ steps[:, :, :d]
        transition[:, :d, d:] = -back @ steps[:, :, 2 * d : -1]
        shift = np.zeros((len(steps), n))
        shift[:, :d] = np.einsum("kij,kj->ki", back, steps[:, :, -1])
        sources = []
        for factor in source_factors(rows.problem, rows.here, model.densities):
            own, added = back @ factor[: len(steps)], np.zeros((len(steps), n, n))
            added[:, :d, :d] = own @ np.swapaxes(own, 1, 2)
            sources.append(added)
        jacobian, values, measured = _measurements(rows, ordering.epochs, n)
        prior = rows.prior_rows
        spread = np.linalg.inv(prior[:, :-1])
        return cls(
            *(rows.problem.motion.dt[: len(steps)], transition, shift, tuple(sources)),
            *(spread @ prior[:, -1], spread @ spread.T),
            *(jacobian[:MOST_EPOCHS], values[:MOST_EPOCHS], measured[:MOST_EPOCHS]),
            _slots(rows, model.components),
        )

    @property
    def levels(self) -> int:
        """How many there are."""
        return 2 * len(self.slots) + len(self.sources) + 1

    def disturbed(self, levels: Float[np.ndarray, " c"]) -> float:
        """Share of one interval's disturbances in a measurement's variance, largest over the sensors' components."""
        count = len(self.slots)
        density = np.exp(levels[2 * count : -1])
        added = sum(
            (q * own for q, own in zip(density, self.sources, strict=True)), np.zeros_like(self.transition)
        )
        kicked = np.einsum("kmi,kij,kmj->km", self.jacobian[1:], added, self.jacobian[1:])
        found = [0.0]
        for number, own in enumerate(self.slots):
            part = kicked[:, own][self.measured[1:, own]]
            mean, white = (float(part.mean()) if part.size else 0.0), float(np.exp(levels[number]))
            found.append(mean / (mean + white))
        return max(found)

    def _by_row(self, logarithms: Float[np.ndarray, "b c"], other: float) -> Float[np.ndarray, "b m"]:
        """Variances of z's rows from those of the components."""
        found = np.full((len(logarithms), self.jacobian.shape[1]), other)
        for k, own in enumerate(self.slots):
            found[:, own] = np.exp(logarithms[:, [k]])
        return found

    def _disturbance(self, step: int, density: Float[np.ndarray, "b d"]) -> Float[np.ndarray, "b n n"]:
        """Covariance that a step adds."""
        size = len(self.mean)
        return sum(
            (q[:, None, None] * own[step] for q, own in zip(density.T, self.sources, strict=True)),
            np.zeros((len(density), size, size)),
        )

    def innovations(self, levels: Float[np.ndarray, "b c"]) -> Innovations:
        """Innovations at several rows of levels.

        Raises
        ------
        numpy.linalg.LinAlgError
            Levels that leave no covariance.
        """
        (K, m, n), B, c = self.jacobian.shape, len(levels), len(self.slots)
        white, slow = self._by_row(levels[:, :c], 1.0), self._by_row(levels[:, c : 2 * c], 0.0)
        density, tau = np.exp(levels[:, 2 * c : -1]), np.exp(levels[:, -1])
        at, error = np.arange(m), np.arange(n, n + m)
        # The state is augmented by a lasting error of each row of z (a first-order Gauss-Markov process).
        x, P = np.zeros((B, n + m)), np.zeros((B, n + m, n + m))
        x[:, :n], P[:, :n, :n] = self.mean, self.covariance
        P[:, error, error] = slow
        H = np.concatenate([self.jacobian, np.eye(m) * self.measured[:, :, None]], axis=2)
        F, residual, covariance = np.zeros_like(P), np.zeros((K, B, m)), np.zeros((K, B, m, m))
        for k in range(K):
            if k:
                kept = np.exp(-self.interval[k - 1] / tau)[:, None]
                F[:, :n, :n], F[:, error, error] = self.transition[k - 1], kept
                x = np.einsum("bij,bj->bi", F, x)
                x[:, :n] += self.shift[k - 1]
                P = F @ P @ np.swapaxes(F, 1, 2)
                P[:, :n, :n] += self._disturbance(k - 1, density)
                P[:, error, error] += slow * (1 - kept**2)
            across = P @ H[k].T
            S, R = H[k] @ across, np.where(self.measured[k], white, 1.0)
            S[:, at, at] += R
            i = self.values[k] - x @ H[k].T
            gain = np.swapaxes(np.linalg.solve(S, np.swapaxes(across, 1, 2)), 1, 2)
            x = x + np.einsum("bim,bm->bi", gain, i)
            # Joseph's form, (I - K H) P (I - K H)' + K R K': the difference P - K H P has no digit left where rows of a scan's
            # pose have deviations of 1e-5 m in one direction and of a metre, which nothing determines, in another
            left = np.eye(n + m) - gain @ H[k]
            P = left @ P @ np.swapaxes(left, 1, 2) + (gain * R[:, None]) @ np.swapaxes(gain, 1, 2)
            residual[k], covariance[k] = i, S
        return Innovations.of(residual, covariance)


def curvature(found: Innovations, rows: slice, steps: Float[np.ndarray, " f"]) -> Curvature:
    """Gradient and information from differences of innovations.

    F_ij = sum of tr(S^-1 dS_i S^-1 dS_j) / 2 + di_i' S^-1 di_j over epochs, which is that expected.

    Parameters
    ----------
    rows : slice
        Of the levels, and then of each with one level larger by a step.
    """
    L, S, i = found.log_likelihood[rows], found.covariance[:, rows], found.residual[:, rows]
    inverse = np.linalg.inv(S[:, 0])
    by_S = (S[:, 1:] - S[:, :1]) / steps[:, None, None]
    by_i = (i[:, 1:] - i[:, :1]) / steps[:, None]
    whitened = inverse[:, None] @ by_S
    information = np.einsum("kaij,kbji->ab", whitened, whitened) / 2
    information += np.einsum("kai,kij,kbj->ab", by_i, inverse, by_i)
    return Curvature((L[1:] - L[0]) / steps, information + SMALLEST * np.eye(len(steps)))


def _measurements(
    rows: LinearRows, epochs: int, size: int
) -> tuple[Float[np.ndarray, "k m n"], Float[np.ndarray, "k m"], Bool[np.ndarray, "k m"]]:
    """H, z and what counts, of all sensors below one another."""
    width = sum(each.shape[1] for each in rows.sensor_rows)
    jacobian, values = np.zeros((epochs, width, size)), np.zeros((epochs, width))
    measured, first = np.zeros((epochs, width), dtype=bool), 0
    for sensor, own in zip(rows.problem.motion.sensors, rows.sensor_rows, strict=True):
        at = np.arange(first, first + own.shape[1])
        jacobian[sensor.epoch[:, None, None], at[:, None], rows.columns_of(sensor)] = own[:, :, :-1]
        values[sensor.epoch[:, None], at] = own[:, :, -1]
        measured[sensor.epoch[:, None], at] = (np.abs(own).max(axis=(1, 2)) > 0)[:, None]
        first += own.shape[1]
    return jacobian, values, measured


def _slots(rows: LinearRows, components: Sequence[ComponentRows]) -> tuple[tuple[int, ...], ...]:
    """Rows of all sensors' measurements that each component scales."""
    first = np.concatenate([[0], np.cumsum([each.shape[1] for each in rows.sensor_rows])])
    return tuple(
        tuple(int(first[k]) + row for k, own in each.sensors.items() for row in own) for each in components
    )


SCORE_TIMES: Final = (1.5, 4.5, 10.0, 33.0)
"""At which the score of lasting errors is asked."""
TIME_RANGE: Final = (0.3, 1.0)
"""Of correlation times: in intervals at least, in recordings at most."""
LEVEL_RANGE: Final = (-18.0, 18.0)
ITERATIONS: Final = 12
SETTLED: Final = 0.05
"""Expected rise of a ln likelihood below which it is climbed no further."""
LONGEST_STEP: Final = 2.5
DIFFERENCE: Final = 1e-3
SMALL_VARIANCE: Final = 1e-2
"""Of a lasting error relative to the stated variance, for its score."""
DAMPING: Final = (1e-2, 1e4)


@dataclass(frozen=True)
class LikelyLevels:
    """Most likely levels of an explanation, and which of these are free.

    Attributes
    ----------
    levels : (c,) float array
        ln variances of white, then of lasting errors by component, ln densities, and ln of the correlation time.
    free : (f,) int array
        Their numbers.
    log_likelihood : float
        -infinity before they are climbed to.
    """

    levels: Float[np.ndarray, " c"]
    free: Int[np.ndarray, " f"]
    log_likelihood: float

    def moved(self, step: Float[np.ndarray, " f"]) -> "LikelyLevels":
        """With the free ones changed, within `LEVEL_RANGE`."""
        levels = self.levels.copy()
        levels[self.free] = np.clip(levels[self.free] + step, *LEVEL_RANGE)
        return replace(self, levels=levels)


@dataclass(frozen=True)
class LikelihoodClimb:
    """Fisher scoring of several explanations at once, each damped for itself (Levenberg and Marquardt)."""

    motion: LinearMotion

    def highest(self, first: list[LikelyLevels]) -> list[LikelyLevels]:
        """Each at its most likely levels."""
        best, trial = list(first), list(first)
        slope: list[Curvature | None] = [None] * len(first)
        damping, going = np.full(len(first), DAMPING[0]), np.ones(len(first), dtype=bool)
        for _ in range(ITERATIONS):
            at = np.flatnonzero(going)
            if not len(at):
                break
            for k, (likelihood, own) in zip(at, self._evaluate_levels([trial[k] for k in at]), strict=True):
                if likelihood > best[k].log_likelihood:
                    best[k], slope[k] = replace(trial[k], log_likelihood=likelihood), own
                    damping[k] = max(damping[k] / 10, DAMPING[0])
                else:
                    damping[k] *= 30
                step = _step(slope[k], damping[k])
                going[k] = step is not None and damping[k] < DAMPING[1]
                if step is not None:
                    trial[k] = self._step_levels(best[k], step)
        return best

    def information(self, one: LikelyLevels) -> Float[np.ndarray, "f f"]:
        """Fisher information of the free levels."""
        return self._evaluate_levels([one])[0][1].information

    def scores(self, white: LikelyLevels) -> Float[np.ndarray, " s"]:
        """Scores of lasting errors of each component and time of `SCORE_TIMES`.

        In standard deviations, the levels that are free being so.
        """
        count, f = len(self.motion.slots), len(white.free)
        rows, steps = [*self._around(white)], [DIFFERENCE] * f
        for time in SCORE_TIMES:
            for k in range(count):
                levels = white.levels.copy()
                levels[count + k] = np.log(SMALL_VARIANCE)
                levels[-1] = np.log(time * np.median(self.motion.interval))
                rows.append(levels)
                steps.append(SMALL_VARIANCE)
        found = curvature(self.motion.innovations(np.array(rows)), slice(None), np.array(steps))
        g, F = found.gradient, found.information
        left = np.linalg.solve(F[:f, :f], np.column_stack([g[:f], F[:f, f:]]))
        own = F[f:, f:] - F[f:, :f] @ left[:, 1:]
        score = g[f:] - F[f:, :f] @ left[:, 0]
        return score / np.sqrt(np.maximum(np.diag(own), np.finfo(float).tiny))

    def _evaluate_levels(self, each: list[LikelyLevels]) -> list[tuple[float, Curvature]]:
        rows = [self._around(one) for one in each]
        found, first, made = self.motion.innovations(np.concatenate(rows)), 0, []
        for own, one in zip(rows, each, strict=True):
            at = slice(first, first + len(own))
            made.append(
                (float(found.log_likelihood[first]), curvature(found, at, np.full(len(one.free), DIFFERENCE)))
            )
            first = at.stop
        return made

    def _around(self, one: LikelyLevels) -> Float[np.ndarray, "f1 c"]:
        rows = np.tile(one.levels, (len(one.free) + 1, 1))
        rows[np.arange(len(one.free)) + 1, one.free] += DIFFERENCE
        return rows

    def _step_levels(self, one: LikelyLevels, step: Float[np.ndarray, " f"]) -> LikelyLevels:
        """With correlation times within `TIME_RANGE` too."""
        moved, interval = one.moved(step), self.motion.interval
        if one.free[-1] == len(one.levels) - 1:
            shortest, longest = TIME_RANGE[0] * np.median(interval), TIME_RANGE[1] * interval.sum()
            moved.levels[-1] = np.clip(one.levels[-1] + step[-1], np.log(shortest), np.log(longest))
        return moved


def _step(slope: Curvature | None, damping: float) -> Float[np.ndarray, " f"] | None:
    """None where the likelihood rises no further."""
    if slope is None:
        return None
    F, g = slope.information, slope.gradient
    step = np.linalg.solve(F + damping * np.diag(np.diag(F)) + 1e-3 * np.eye(len(g)), g)
    if not np.isfinite(step).all() or g @ step / 2 < SETTLED / (1 + damping):
        return None
    return np.clip(step, -LONGEST_STEP, LONGEST_STEP)
