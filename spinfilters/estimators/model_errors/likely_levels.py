"""Most likely noise levels of a linearised motion under several explanations at once, by Fisher scoring."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.estimators.model_errors.linear_likelihood import Curvature, LinearMotion, curvature

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
"""Of a lasting error beside the stated variance, for its score."""
DAMPING: Final = (1e-2, 1e4)


@dataclass(frozen=True)
class LikelyLevels:
    """Most likely levels of an explanation, and which of these are free.

    Attributes
    ----------
    levels: see `linear_likelihood`.   free: their numbers.   log_likelihood: -infinity before they are climbed to.
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
            for k, (likelihood, own) in zip(at, self._evaluated([trial[k] for k in at]), strict=True):
                if likelihood > best[k].log_likelihood:
                    best[k], slope[k] = replace(trial[k], log_likelihood=likelihood), own
                    damping[k] = max(damping[k] / 10, DAMPING[0])
                else:
                    damping[k] *= 30
                step = _step(slope[k], damping[k])
                going[k] = step is not None and damping[k] < DAMPING[1]
                if step is not None:
                    trial[k] = self._moved(best[k], step)
        return best

    def information(self, one: LikelyLevels) -> Float[np.ndarray, "f f"]:
        """Fisher information of the free levels."""
        return self._evaluated([one])[0][1].information

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

    def _evaluated(self, each: list[LikelyLevels]) -> list[tuple[float, Curvature]]:
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

    def _moved(self, one: LikelyLevels, step: Float[np.ndarray, " f"]) -> LikelyLevels:
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
