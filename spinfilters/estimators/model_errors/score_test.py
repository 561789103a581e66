"""Score test of one model error: its size, gain and probability, and what its removal changes."""

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.linear_algebra.chi_square import chi_square_tail

TELLING: Final = 1e-2
"""Probability of a test below which its error is removed from the solution, to see what that changes."""

TINY: Final = float(np.finfo(float).tiny)


class Effect(NamedTuple):
    """Effect of an error on the state component it moves most.

    In deviations: at one epoch, and root mean square over all.
    """

    largest: float
    rms: float


@dataclass(frozen=True)
class ScoreTest:
    """Score test of one model error.

    Attributes
    ----------
    size, std: of its components, in its unit; of an error by epoch its standard deviation.
    statistic, dof: of the score, chi-squared without the error.   gain: see the module.
    p_value: probability of as much without the error.
    shift: (k, n) by which the states of all epochs move once the error is removed; None of one that is not `TELLING`.
    explained: what it explains of all whitened residuals, likewise.
    level: by how much ln variance of an identified noise level falls with it removed, of the one that falls most.
    level_dof: degrees of freedom that tell the levels that fall; infinite of stated ones.
    beside_all: probability of a greater statistic beside what all residuals leave, at the level of a correlated error; else 1.
    slow: share of what it explains (squared) that slow changes explain as well, of a gyro in a spin about one axis; else 0.
    beside_slow: statistic of what it explains beside these; infinite where there are none.
    is_possible: whether a recording can have an error of this size; one by epoch also whether it is in more than a few of these.
    """

    error: Alternative
    size: Float[np.ndarray, " m"]
    std: Float[np.ndarray, " m"]
    statistic: float
    dof: float
    gain: float
    p_value: float
    shift: Float[np.ndarray, "k n"] | None = None
    explained: Float[np.ndarray, " r"] | None = None
    level: float = 0.0
    level_dof: float = np.inf
    beside_all: float = 1.0
    slow: float = 0.0
    beside_slow: float = np.inf
    is_possible: bool = True

    def likeness(self, other: "ScoreTest") -> float:
        """Correlation of what two errors explain; 0 where it is not known."""
        a, b = self.explained, other.explained
        if a is None or b is None or a.shape != b.shape:
            return 0.0
        product = float(a @ b) / max(float(np.sqrt((a @ a) * (b @ b))), TINY)
        return product if np.isfinite(product) else 0.0

    def effect(self, std: Float[np.ndarray, "k n"]) -> Effect:
        """How far the states would move, in their deviations; infinite where it is not known."""
        if self.shift is None or not (np.isfinite(self.shift).all() and std.shape == self.shift.shape):
            return Effect(np.inf, np.inf)
        moved = np.abs(self.shift) / np.where(std > 0, std, np.inf)
        return Effect(
            float(moved.max(initial=0.0)), float(np.sqrt(np.mean(moved**2, axis=0)).max(initial=0.0))
        )

    @property
    def is_telling(self) -> bool:
        """Whether as much is improbable enough without the error to see what its removal changes."""
        return self.p_value < TELLING

    def removing(self, motion: SmoothedMotion, right: Columns, explained: Columns) -> "ScoreTest":
        """With what its removal does, and whether there can be so much of it."""
        shift = motion.rows.sensitivity(right).states[:, :, 0]
        own, left = (
            np.concatenate([p.ravel() for p in each.parts]) for each in (explained, motion.rows.left)
        )
        is_possible = self.is_possible and self.error.is_possible(self.size, motion)
        found = replace(self, shift=shift, explained=own, is_possible=is_possible)
        changes = motion.slow_changes
        if changes is None:
            return found
        beside = own - changes @ (changes.T @ own)
        square, every = float(beside @ beside), max(float(own @ own), TINY)
        return replace(
            found, slow=1 - square / every, beside_slow=float(beside @ left) ** 2 / max(square, TINY)
        )

    @property
    def score_p_value(self) -> float:
        """Probability of a greater statistic at the noise levels of the estimates."""
        once = float(chi_square_tail(self.statistic, self.dof))
        return min(self.error.trials * once, self.beside_all)

    def p_value_of_inflated(self, inflation: float) -> float:
        """Probability of a greater statistic than one that errors inflate by a factor."""
        return min(1.0, self.error.trials * float(chi_square_tail(self.statistic / inflation, self.dof)))

    @property
    def p_value_beside_slow(self) -> float:
        """Probability of a greater statistic beside slow changes."""
        return float(chi_square_tail(self.beside_slow, self.dof))

    @property
    def merit(self) -> float:
        """Gain beyond what so many free numbers take of noise (Akaike 1974)."""
        return self.gain - 2 * self.dof
