"""Inertia ratios of one body from several segments, and whether the segments agree."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.linear_algebra.chi_square import chi_square_tail

DISAGREEMENT: Final = 0.01
"""Probability of a chi-square as large, below which segments disagree and deviations are widened by its root per degree."""


@dataclass(frozen=True, eq=False)
class PooledMoments:
    """Weighted mean of J1/J3 and J2/J3.

    Attributes
    ----------
    ratios: (2,).   covariance: (2, 2) of them, as the segments' covariances say.
    chi_square: of the segments about them, of ``degrees`` degrees of freedom.   segments: that are ok, of ``total``.
    """

    ratios: Float[np.ndarray, " 2"]
    covariance: Float[np.ndarray, "2 2"]
    chi_square: float
    degrees: int
    segments: int
    total: int

    @property
    def probability(self) -> float:
        """Probability of a chi-square as large, 1 for a single segment."""
        return float(chi_square_tail(self.chi_square, self.degrees)) if self.degrees else 1.0

    @property
    def widening(self) -> float:
        """Factor on the deviations: 1 where the segments agree."""
        agree = self.probability >= DISAGREEMENT
        return 1.0 if agree else float(np.sqrt(self.chi_square / self.degrees))

    @property
    def std(self) -> Float[np.ndarray, " 2"]:
        """Standard deviations, widened where the segments disagree."""
        return self.widening * np.sqrt(np.diag(self.covariance))

    @property
    def sentence(self) -> str:
        """The pooled ratios in words."""
        (first, second), (first_std, second_std) = self.ratios, self.std
        words = f"pooled J1/J3 {first:.4f} ± {first_std:.4f}, J2/J3 {second:.4f} ± {second_std:.4f}"
        if not self.degrees:
            return words
        words += f", chi-square {self.chi_square:.1f} of {self.degrees} (p {self.probability:.2g})"
        if self.widening > 1:
            words += f"; the segments disagree beyond their deviations, which are widened {self.widening:.1f} times"
        return words

    @property
    def document(self) -> dict[str, Any]:
        """The pooled ratios as segments.json holds them."""
        return {
            "ratios": self.ratios.tolist(),
            "std": self.std.tolist(),
            "covariance": self.covariance.tolist(),
            "chi_square": self.chi_square,
            "degrees_of_freedom": self.degrees,
            "probability": self.probability,
            "widening": self.widening,
            "segments_ok": self.segments,
            "segments": self.total,
        }


def pooled_moments(estimates: Sequence[Mapping[str, Any]], total: int) -> PooledMoments | None:
    """Pool an estimator's entries of summaries that are ``ok`` and have finite covariances; None of none.

    Parameters
    ----------
    total: how many segments there are, those without a result among them.
    """
    ratios, information = [], []
    for estimate in estimates:
        moments = np.array(estimate["principal_moments"], dtype=float)[:2]
        covariance = np.array(estimate["principal_moments_cov"], dtype=float)[:2, :2]
        if estimate["status"] != "ok" or not np.isfinite(moments).all() or not _is_definite(covariance):
            continue
        ratios.append(moments)
        information.append(np.linalg.inv(covariance))
    if not ratios:
        return None
    together = np.linalg.inv(np.sum(information, axis=0))
    mean = together @ np.sum([each @ r for each, r in zip(information, ratios, strict=True)], axis=0)
    distance = sum(float((r - mean) @ each @ (r - mean)) for each, r in zip(information, ratios, strict=True))
    return PooledMoments(mean, together, distance, 2 * (len(ratios) - 1), len(ratios), total)


def _is_definite(covariance: Float[np.ndarray, "2 2"]) -> bool:
    return bool(np.isfinite(covariance).all() and np.linalg.eigvalsh(covariance)[0] > 0)
