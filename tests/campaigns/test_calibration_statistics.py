"""Ranks, coverage and scores of simulation-based calibration: right posteriors pass, wrong widths are found."""

import numpy as np
import pytest
from scipy.special import ndtr

from spinfilters.campaigns.calibration_draws import CalibrationDraw
from spinfilters.campaigns.calibration_statistics import (
    component_calibration,
    gaussian_crps,
    rank_band,
    verdict_rates,
)

COUNT = 150


def triples(width: float, seed: int = 2) -> list[tuple[float, float, float]]:
    """Errors of unit deviation that are stated so many times as wide, and ranks."""
    error = np.random.default_rng(seed).standard_normal(COUNT)
    return [(e, width, float(ndtr(-e / width))) for e in error.tolist()]


def test_a_right_posterior_passes() -> None:
    found = component_calibration(triples(1.0))
    assert found.inside
    assert found.probability > 0.05
    assert found.squares.low < 1 < found.squares.high
    for level, coverage in zip((0.5, 0.8, 0.95), found.coverage, strict=False):
        assert coverage.low < level < coverage.high


@pytest.mark.parametrize(("width", "sign"), [(1.8, -1), (0.6, 1)])
def test_a_wrong_width_is_found(width: float, sign: int) -> None:
    found = component_calibration(triples(width))
    assert not found.inside
    assert found.probability < 0.01
    assert sign * found.inclination > 3


def test_the_band_holds_uniform_ranks_as_often_as_it_says() -> None:
    band, generator = rank_band(COUNT), np.random.default_rng(7)
    inside = 0
    for _ in range(400):
        below = np.searchsorted(np.sort(generator.random(COUNT)), band.at, side="right") / COUNT
        inside += bool(((below >= band.low) & (below <= band.high)).all())
    assert inside / 400 == pytest.approx(0.95, abs=0.035)


def test_the_ranked_score_is_its_integral() -> None:
    x = np.linspace(-12, 14, 200_001)
    error, std = 0.7, 1.3  # estimate minus truth; the truth at zero
    integral = np.square(ndtr((x - error) / std) - (x >= 0)).sum() * (x[1] - x[0])
    assert gaussian_crps(np.array([error]), np.array([std]))[0] == pytest.approx(integral, abs=1e-4)


def test_the_verdict_is_counted_as_a_classifier() -> None:
    worst = (1.0, 2.0, 5.0, 6.0)
    verdicts = ("ok", "degraded", "ok", "degraded")
    draws = [
        CalibrationDraw(seed, "mekf", verdict, True, far, {}, {})
        for seed, (verdict, far) in enumerate(zip(verdicts, worst, strict=True))
    ]
    rates = verdict_rates(draws)
    assert (rates.ok_of_right.value, rates.ok_of_wrong.value, rates.wrong_of_ok.value) == (0.5, 0.5, 0.5)
