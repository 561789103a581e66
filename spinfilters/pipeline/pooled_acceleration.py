"""Acceleration, such as gravity, pooled over several flights of a recording."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.evaluation.reported_constants import REPORTED
from spinfilters.linear_algebra.chi_square import chi_square_tail
from spinfilters.pipeline.pooled_moments import DISAGREEMENT
from spinfilters.state.blocks.acceleration import ACCELERATION
from spinfilters.state.status import Verdict

FARTHEST: Final = 4.0
"""Deviations from the median of all segments, beyond which one is left out: a bounce that is no flight."""


@dataclass(frozen=True)
class Strength:
    """Length of an estimated acceleration with both parts of its standard deviation, m/s^2."""

    value: float
    random: float
    calibration: float

    @property
    def std(self) -> float:
        """Whole standard deviation."""
        return float(np.hypot(self.random, self.calibration))


@dataclass(frozen=True)
class PooledAcceleration:
    """Weighted mean of the strengths.

    The errors of the calibration are in all of them and are not averaged away.

    Attributes
    ----------
    strength: the mean, its random part widened where the segments disagree.
    chi_square: of the segments about it, of ``degrees`` degrees of freedom.   left_out: segments too far from their median.
    """

    strength: Strength
    chi_square: float
    degrees: int
    left_out: int = 0

    @property
    def probability(self) -> float:
        """Probability of a chi-square as large, 1 for a single segment."""
        return float(chi_square_tail(self.chi_square, self.degrees)) if self.degrees else 1.0

    @property
    def sentence(self) -> str:
        """The pooled acceleration in words."""
        mean = self.strength
        words = f"pooled acceleration {mean.value:.3f} ± {mean.std:.3f} m/s^2 (± {mean.calibration:.2g} of it of lengths and clock)"
        if not self.degrees:
            return words
        words += f", chi-square {self.chi_square:.1f} of {self.degrees} (p {self.probability:.2g})"
        return f"{words}; left out as far off: {self.left_out}" if self.left_out else words

    @property
    def document(self) -> dict[str, Any]:
        """The pooled acceleration as segments.json holds it."""
        return {
            "strength": self.strength.value,
            "random_std": self.strength.random,
            "calibration_std": self.strength.calibration,
            "chi_square": self.chi_square,
            "degrees_of_freedom": self.degrees,
            "probability": self.probability,
            "left_out": self.left_out,
        }


def strength_of(estimate: Mapping[str, Any]) -> Strength | None:
    """Strength in an estimator's entry of a summary, or None.

    None where the estimator failed or has no acceleration. Errors of components are taken for independent.
    """
    key = REPORTED[ACCELERATION.name].value_key
    parts = (estimate.get("deviation_parts") or {}).get(key)
    if estimate["status"] == Verdict.FAILED or estimate.get(key) is None or parts is None:
        return None
    value = np.array(estimate[key], dtype=float)
    length = float(np.linalg.norm(value))
    along = value / max(length, np.finfo(float).tiny)
    found = Strength(length, _along(along, parts["random"]), _along(along, parts["calibration"]))
    return found if np.isfinite([found.value, found.std]).all() and found.random > 0 else None


def pooled_acceleration(estimates: Sequence[Mapping[str, Any]]) -> PooledAcceleration | None:
    """Pooled acceleration of an estimator's summaries; None without any."""
    found = [each for each in map(strength_of, estimates) if each is not None]
    if not found:
        return None
    median = float(np.median([each.value for each in found]))
    near = [each for each in found if abs(each.value - median) <= FARTHEST * each.random]
    kept = near if 2 * len(near) > len(found) else found
    values, random = np.array([each.value for each in kept]), np.array([each.random for each in kept])
    weights = random**-2 / np.sum(random**-2)
    mean, degrees = float(weights @ values), len(kept) - 1
    distance = float(np.sum(((values - mean) / random) ** 2))
    agree = not degrees or chi_square_tail(distance, degrees) >= DISAGREEMENT
    widening = 1.0 if agree else float(np.sqrt(distance / degrees))
    common = float(weights @ [each.calibration for each in kept])
    std = widening * float(np.sum(random**-2)) ** -0.5
    return PooledAcceleration(Strength(mean, std, common), distance, degrees, len(found) - len(kept))


def _along(direction: Float[np.ndarray, " 3"], std: list[float | None]) -> float:
    return float(np.linalg.norm(direction * np.array(std, dtype=float)))
