"""Calibrations that nobody stated are considered as wrong as the residuals leave possible."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from spinfilters.evaluation.stated_errors import quantity_errors
from spinfilters.io.dataset import Dataset
from spinfilters.models.process import ProcessNoise
from spinfilters.run.comparison_run import compare_dataset
from spinfilters.run.conditions import conditions_of
from spinfilters.run.estimation import Comparison
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.model_faults import faulty_recording, model_faults
from spinfilters.simulation.scenario import Scenario, without_noise
from spinfilters.verdict.calibration_errors import possible_deviation

DEFAULT, PLAUSIBLE = 1e-3, 0.05
"""Of a focal length."""
WRONG = 0.03
"""Error of the focal length: its test determines it to 0.013 on this motion."""


@cache
def recording() -> Dataset:
    """Tracks of a slow tumble with a known map, by a camera pair of another focal length than stated."""
    scenario = Scenario.simplified(
        kind="stereo-tracks",
        principal_moments=(1.0, 0.8, 0.55),
        rate_rpm=(1.6, 3.6, 1.2),
        epochs=45,
        interval=0.5,
        landmarks=60,
        noise=ProcessNoise(4e-8, 1e-6),
        seed=5,
    )
    seeds = tuple(np.random.SeedSequence(5).spawn(3))
    dataset = faulty_recording(scenario, model_faults()["focal-length"], WRONG, seeds)
    return replace(dataset, options=replace(dataset.options, calibration={}))


@cache
def compared(focal_std: float | None) -> Comparison:
    """Both estimators, with the focal length's deviation stated or not."""
    calibration = {} if focal_std is None else {"focal_std": focal_std}
    return compare_dataset(
        recording(),
        Settings(estimators=("mekf", "smoother"), calibration=calibration),  # pyright: ignore[reportArgumentType]
    )


@pytest.mark.parametrize("number", [0, 1])
def test_a_focal_length_that_residuals_hardly_determine_is_in_the_deviation_of_the_position(
    number: int,
) -> None:
    found, stated = (compared(std).evaluations[number] for std in (None, DEFAULT))
    assert quantity_errors(stated)["position"][-1] > 10.0  # who states a deviation vouches for it
    assert quantity_errors(found)["position"][-1] < 4.0


def test_the_random_part_of_deviations_stays() -> None:
    found, stated = (compared(std).evaluations[1].history for std in (None, DEFAULT))
    np.testing.assert_allclose(
        np.linalg.norm(found.random_factor(), axis=2),
        np.linalg.norm(stated.random_factor(), axis=2),
        rtol=1e-6,
    )


def test_an_error_that_residuals_determine_well_keeps_its_default() -> None:
    assert possible_deviation(0.0, DEFAULT / 10, DEFAULT, PLAUSIBLE) == DEFAULT


def test_an_error_that_residuals_contradict_is_as_large_as_they_show() -> None:
    assert possible_deviation(0.03, 0.002, DEFAULT, PLAUSIBLE) == pytest.approx(0.03, rel=0.02)


def test_an_error_that_residuals_show_beyond_what_is_plausible_is_as_large_as_they_show() -> None:
    assert possible_deviation(0.5, 0.1, DEFAULT, PLAUSIBLE) == pytest.approx(0.5, rel=0.1)


def test_moments_before_a_gyro_of_a_wrong_scale_are_not_said_to_hold_where_they_are_wrong() -> None:
    scenario = Scenario.simplified(
        kind="gyro",
        principal_moments=(1.0, 0.6, 0.5),
        rate_rpm=(80.0, 180.0, 60.0),
        epochs=42,
        interval=0.02,
        noise=ProcessNoise(4e-8, 1e-6),
        seed=5051,
    )
    seeds = tuple(np.random.SeedSequence([5051, 1115]).spawn(3))
    dataset = faulty_recording(scenario, model_faults()["gyro-scale"], 0.42, seeds)
    dataset = without_noise(replace(dataset, options=replace(dataset.options, calibration={})))
    (found,) = compare_dataset(dataset, Settings(estimators=("smoother",))).evaluations
    errors, holds = quantity_errors(found), found.history.status.holds
    assert not [name for name, each in errors.items() if holds[name] == "ok" and each[-1] > 4.0]


def test_an_error_that_residuals_hardly_determine_is_a_few_times_its_default() -> None:
    grown = possible_deviation(0.0, 0.013, DEFAULT, PLAUSIBLE) / DEFAULT
    assert 2.0 < grown < 5.0


@pytest.mark.parametrize("std", [0.0, np.inf, np.nan])
def test_an_error_of_which_residuals_show_nothing_keeps_its_default(std: float) -> None:
    assert possible_deviation(0.0, std, DEFAULT, PLAUSIBLE) == DEFAULT


def test_four_deviations_contain_a_possible_error_but_for_half_a_percent() -> None:
    size, std = 0.016, 0.013
    deviation = possible_deviation(size, std, DEFAULT, PLAUSIBLE)
    x = np.linspace(-PLAUSIBLE, PLAUSIBLE, 100_001)
    density = np.exp(-0.5 * ((size - x) / std) ** 2) / (1 + (x / DEFAULT) ** 2)
    beyond = density[np.abs(x) > 4 * deviation].sum() / density.sum()
    assert beyond == pytest.approx(5e-3, rel=0.05)


@pytest.mark.parametrize(("focal_std", "is_said"), [(None, True), (DEFAULT, False)])
def test_conditions_say_which_assumed_deviations_may_grow(focal_std: float | None, is_said: bool) -> None:
    calibration = {} if focal_std is None else {"focal_std": focal_std}
    setup = prepare(recording(), Settings(calibration=calibration))  # pyright: ignore[reportArgumentType]
    said = " ".join(conditions_of(setup).sentences)
    assert ("Those of focal length" in said) is is_said
    assert "principal point" in said
