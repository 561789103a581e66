"""Statistics of simulation-based calibration: ranks, coverage, proper scores, non-credibility, and the verdict as a classifier.

Ranks of the truth are uniform where posteriors are right. Their empirical distribution is compared with a band that contains it at
all points at once with the probability 95 %: pointwise binomial intervals of a probability that simulation chooses (Saeilynoja,
Buerkner, Vehtari 2022).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy.special import ndtr, ndtri
from scipy.stats import binom

from spinfilters.campaigns.calibration_draws import CalibrationDraw
from spinfilters.campaigns.statistics import Interval, mean, share
from spinfilters.models.status import MOMENTS

POINTS: Final = 50
"""Of the distribution of ranks, evenly spread."""
SIMULATIONS: Final = 4000
"""Of uniform ranks."""
FEWEST_DRAWS: Final = 10
"""Of which statistics are made."""
SMALLEST_RANK: Final = 1e-15
"""A rank nearer to 0 or 1 counts as this."""
LEVELS: Final = (0.5, 0.8, 0.95, 0.99, 0.9999)
"""Of central intervals whose coverage is counted."""


@dataclass(frozen=True)
class RankBand:
    """Simultaneous band of the empirical distribution of n uniform ranks.

    Attributes
    ----------
    at : ndarray of float, shape (p,)
        Points.
    low, high : ndarray of float, shape (p,)
        Between which the distribution lies at all points with the probability of the band.
    worst : ndarray of float, shape (s,)
        Smallest pointwise probability of simulated ranks, ascending.
    """

    at: Float[np.ndarray, " p"]
    low: Float[np.ndarray, " p"]
    high: Float[np.ndarray, " p"]
    worst: Float[np.ndarray, " s"]


@dataclass(frozen=True)
class ComponentCalibration:
    """Calibration of one component of a quantity.

    Attributes
    ----------
    ranks : ndarray of float, shape (n,)
        Of the truth.
    probability : float
        Of ranks as far from uniform, were the posterior right.
    inside : bool
        Whether their distribution is inside the band of 95 %.
    coverage : tuple of Interval
        Share of truths within the central intervals of `LEVELS`, each with its interval of 95 %.
    bias, squares : Interval
        Mean of errors in deviations, and of their squares: 0 and 1 of a right posterior.
    normal_squares : Interval
        Mean square of ranks as normal numbers: 1 if what is stated is right, also where that is no Gaussian.
    crps, log_score : Interval
        Mean continuous ranked probability score in the unit of the quantity, and mean negative log density; less is better.
    gaussian_crps : Interval
        The former of Gaussians of the stated deviations.
    inclination : float
        10 log10 of the mean square, dB: above zero deviations are too small, below too large.
    """

    ranks: Float[np.ndarray, " n"]
    probability: float
    inside: bool
    coverage: tuple[Interval, ...]
    bias: Interval
    squares: Interval
    normal_squares: Interval
    crps: Interval
    log_score: Interval
    gaussian_crps: Interval
    inclination: float


@cache
def rank_band(count: int, probability: float = 0.95) -> RankBand:
    """The band of so many ranks."""
    at = np.arange(1, POINTS) / POINTS
    generator = np.random.default_rng(count)
    ranks = generator.random((SIMULATIONS, count))
    worst = np.sort(_least_probability(_counts(ranks, at), count, at))
    level = float(np.quantile(worst, 1 - probability))
    low, high = binom.ppf(level / 2, count, at) / count, binom.ppf(1 - level / 2, count, at) / count
    return RankBand(at, low, high, worst)


def component_calibration(
    triples: Sequence[tuple[float, float, float]], scores: Sequence[tuple[float, float]] | None = None
) -> ComponentCalibration:
    """Calibration of one component from errors, deviations and ranks of its draws; those that are not finite are left out.

    Parameters
    ----------
    scores : sequence or None
        CRPS and negative log density of each draw; None for those of Gaussians.
    """
    every = np.array(triples, dtype=float).reshape(-1, 3)
    if scores is None:
        with np.errstate(all="ignore"):
            scores = gaussian_scores(every[:, 0], every[:, 1])
    every = np.concatenate([every, np.array(scores, dtype=float).reshape(-1, 2)], axis=1)
    every = every[np.isfinite(every).all(axis=1) & (every[:, 1] > 0)]
    error, std, ranks, crps, log_score = every.T
    z, count = error / std, len(every)
    band = rank_band(count)
    below = _counts(ranks[np.newaxis], band.at)
    least = float(_least_probability(below, count, band.at)[0])
    # as many simulated ranks are as far from uniform, these among them
    probability = (1 + float(np.searchsorted(band.worst, least, side="right"))) / (1 + len(band.worst))
    distribution = below[0] / count
    inside = bool(((distribution >= band.low) & (distribution <= band.high)).all())
    central = np.abs(2 * ranks - 1)
    return ComponentCalibration(
        ranks,
        probability,
        inside,
        tuple(share(int((central <= level).sum()), count) for level in LEVELS),
        mean(z),
        mean(z**2),
        mean(ndtri(np.clip(ranks, SMALLEST_RANK, 1 - SMALLEST_RANK)) ** 2),
        mean(crps),
        mean(log_score),
        mean(gaussian_crps(error, std)),
        10 * float(np.log10(np.mean(z**2))),
    )


def gaussian_crps(error: Float[np.ndarray, " n"], std: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Continuous ranked probability score of Gaussians (Gneiting, Raftery 2007, Eq. 21)."""
    z = error / std
    density = np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
    return std * (z * (2 * ndtr(z) - 1) + 2 * density - 1 / np.sqrt(np.pi))


def gaussian_scores(
    error: Float[np.ndarray, " n"], std: Float[np.ndarray, " n"]
) -> list[tuple[float, float]]:
    """CRPS and negative log density of Gaussians."""
    logs = 0.5 * (error / std) ** 2 + np.log(std) + 0.5 * np.log(2 * np.pi)
    return list(zip(gaussian_crps(error, std).tolist(), logs.tolist(), strict=True))


def quantity_calibration(
    draws: Sequence[CalibrationDraw], chosen: Callable[[CalibrationDraw], bool]
) -> dict[str, list[ComponentCalibration]]:
    """Calibration of every component by quantity, over the draws that are chosen; none of fewer than ten."""
    own = [draw for draw in draws if chosen(draw)]
    names = dict.fromkeys(name for draw in own for name in draw.quantities)
    found: dict[str, list[ComponentCalibration]] = {}
    for name in names:
        held = [draw for draw in own if name in draw.quantities]
        if len(held) >= FEWEST_DRAWS:
            columns = zip(*(draw.quantities[name] for draw in held), strict=True)
            scores = zip(*(_scores(draw, name) for draw in held), strict=True)
            found[name] = [component_calibration(*each) for each in zip(columns, scores, strict=True)]
    return found


def _scores(draw: CalibrationDraw, name: str) -> list[tuple[float, float]]:
    """Scores of a quantity's components; of a draw without, which an earlier version made, those of Gaussians."""
    if name in draw.scores:
        return draw.scores[name]
    error, std, _ = np.array(draw.quantities[name]).T
    with np.errstate(all="ignore"):
        return gaussian_scores(error, std)


def nees_calibration(
    draws: Sequence[CalibrationDraw], chosen: Callable[[CalibrationDraw], bool]
) -> dict[str, dict[str, Interval]]:
    """Mean NEES per degree of freedom by block over the draws that are chosen, by stated covariances and by what is stated.

    "stated" is by the covariances alone, "mixture" by the mixtures where there are any; none of fewer than ten draws.
    """
    own = [draw for draw in draws if chosen(draw)]
    found: dict[str, dict[str, Interval]] = {}
    for name in dict.fromkeys(name for draw in own for name in draw.nees):
        held = [draw for draw in own if name in draw.nees]
        if len(held) >= FEWEST_DRAWS:
            found[name] = {
                "stated": mean(np.array([draw.nees[name] for draw in held])),
                "mixture": mean(np.array([draw.mixture_nees.get(name, draw.nees[name]) for draw in held])),
            }
    return found


@dataclass(frozen=True)
class VerdictRates:
    """The verdict as a classifier of "every published quantity is within four deviations".

    Attributes
    ----------
    ok : Interval
        Share of draws that are ``ok``.
    ok_of_determined : Interval
        Of those whose moments are determined.
    wrong_of_ok : Interval
        Share of ``ok`` draws that are beyond four deviations.
    ok_of_right, ok_of_wrong : Interval
        True and false positive rate: the point of its receiver operating characteristic.
    """

    ok: Interval
    ok_of_determined: Interval
    wrong_of_ok: Interval
    ok_of_right: Interval
    ok_of_wrong: Interval


def verdict_rates(draws: Sequence[CalibrationDraw]) -> VerdictRates:
    """Rates of a list of draws of one estimator."""
    ok = [draw for draw in draws if draw.is_ok]
    determined = [draw for draw in draws if draw.determined]
    right, wrong = ([draw for draw in draws if draw.is_right is is_right] for is_right in (True, False))

    def of(which: Sequence[CalibrationDraw]) -> Interval:
        """Share of ok."""
        return share(sum(draw.is_ok for draw in which), len(which))

    return VerdictRates(
        of(draws),
        of(determined),
        share(sum(not draw.is_right for draw in ok), len(ok)),
        of(right),
        of(wrong),
    )


def width_characteristic(
    draws: Sequence[CalibrationDraw],
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """False and true positive rates of a classifier by the moments' stated deviation alone, with which the verdict is compared."""
    held = [draw for draw in draws if MOMENTS in draw.quantities]
    width = np.array([max(std for _, std, _ in draw.quantities[MOMENTS][:2]) for draw in held])
    right = np.array([draw.is_right for draw in held], dtype=bool)[np.argsort(width)]
    true = np.cumsum(right) / max(int(right.sum()), 1)
    false = np.cumsum(~right) / max(int((~right).sum()), 1)
    return np.concatenate([[0.0], false]), np.concatenate([[0.0], true])


def _counts(ranks: Float[np.ndarray, "s n"], at: Float[np.ndarray, " p"]) -> Int[np.ndarray, "s p"]:
    """How many of each row are at most each point."""
    return np.array([np.searchsorted(np.sort(row), at, side="right") for row in ranks])


def _least_probability(
    below: Int[np.ndarray, "s p"], count: int, at: Float[np.ndarray, " p"]
) -> Float[np.ndarray, " s"]:
    """Smallest over the points of twice the smaller binomial tail."""
    table = binom.cdf(
        np.arange(-1, count + 1)[:, np.newaxis], count, at
    )  # row j: probability of at most j - 1
    points = np.arange(len(at))
    low, high = table[below + 1, points], 1 - table[below, points]
    return 2 * np.minimum(low, high).min(axis=1)
