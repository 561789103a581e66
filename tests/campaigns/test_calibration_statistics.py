"""Ranks, coverage and scores of simulation-based calibration: right posteriors pass, wrong widths are found."""

import numpy as np
import pytest
from scipy.special import ndtr

from spinfilters.campaigns.calibration_draws import CalibrationDraw, StatedComponent, mixture_square
from spinfilters.campaigns.calibration_report import (
    component_calibration,
    gaussian_crps,
    nees_calibration,
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


def test_scores_of_a_mixture_are_its_integral_and_its_density() -> None:
    x = np.linspace(-40, 40, 400_001)
    error, weights, std = 0.7, np.array([0.8, 0.2]), np.array([1.0, 3.0])
    below = weights @ ndtr((x - error) / std[:, np.newaxis])
    stated = StatedComponent(error, 2.0, weights, std)
    integral = np.square(below - (x >= 0)).sum() * (x[1] - x[0])
    assert stated.scores[0] == pytest.approx(integral, abs=1e-4)
    density = weights @ (np.exp(-0.5 * (error / std) ** 2) / std) / np.sqrt(2 * np.pi)
    assert stated.scores[1] == pytest.approx(-np.log(density))
    assert stated.triple[2] == pytest.approx(weights @ ndtr(-error / std))


def test_a_mixture_that_is_right_passes_where_its_gaussian_does_not() -> None:
    generator, weights, std = np.random.default_rng(5), np.array([0.8, 0.2]), np.array([1.0, 4.0])
    errors = generator.standard_normal(COUNT) * generator.choice(std, COUNT, p=weights)
    stated = [StatedComponent(float(error), 3.0, weights, std) for error in errors]
    both = component_calibration([each.triple for each in stated], [each.scores for each in stated])
    one = component_calibration([(e, s, float(ndtr(-e / s))) for e, s, _ in (each.triple for each in stated)])
    assert both.probability > 0.05
    assert one.probability < 0.01
    assert both.crps.value < one.crps.value == both.gaussian_crps.value
    assert both.normal_squares.low < 1 < both.normal_squares.high


def test_the_square_of_a_mixture_is_the_nees_of_its_gaussian_and_one_on_average() -> None:
    generator, error = np.random.default_rng(3), np.array([0.5, -1.0, 0.2])
    one = np.ones(1), 2.0 * np.eye(3)[np.newaxis]
    assert mixture_square(error, *one, generator) == pytest.approx(error @ error / 4, rel=0.1)
    both = np.array([0.7, 0.3]), np.array([1.0, 5.0])[:, np.newaxis, np.newaxis] * np.eye(3)
    size = generator.choice([1.0, 5.0], 300, p=both[0])
    found = [mixture_square(s * generator.standard_normal(3), *both, generator) / 3 for s in size]
    assert np.mean(found) == pytest.approx(1.0, abs=0.14)  # three deviations of the mean


def test_the_nees_is_averaged_by_stated_covariances_and_by_mixtures() -> None:
    draws = [
        CalibrationDraw(k, "mekf", "ok", True, 1.0, {}, {"w": 0.5}, {}, {"w": 1.0} if k else {})
        for k in range(10)
    ]
    found = nees_calibration(draws, lambda draw: True)["w"]
    assert (found["stated"].value, found["mixture"].value) == (0.5, pytest.approx(0.95))
    assert nees_calibration(draws[1:], lambda draw: True) == {}


def test_the_verdict_is_counted_as_a_classifier() -> None:
    worst = (1.0, 2.0, 5.0, 6.0)
    verdicts = ("ok", "degraded", "ok", "degraded")
    draws = [
        CalibrationDraw(seed, "mekf", verdict, True, far, {}, {})
        for seed, (verdict, far) in enumerate(zip(verdicts, worst, strict=True))
    ]
    rates = verdict_rates(draws)
    assert (rates.ok_of_right.value, rates.ok_of_wrong.value, rates.wrong_of_ok.value) == (0.5, 0.5, 0.5)
