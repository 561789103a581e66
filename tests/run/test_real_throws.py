"""Recordings of thrown phones and racquets, and the simulated tracks that were made outside this package."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float
from plain_comparison import plain_comparison

from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.io.dataset import Dataset
from spinfilters.run.estimation import Comparison
from spinfilters.run.preparation import prepare
from spinfilters.run.readers import read_dataset
from spinfilters.settings.run_settings import FILTER, ProcessSettings, Settings

FILTERS = Settings(estimators=("mekf", "ukf"))
PHONE = "round1/Gyroscope rotation rate 2025-01-16 17-10-11"
RACQUET = "round3/Gyroscope rotation rate 2025-02-14 10-47-18"
PHONE_MOMENTS = {3: (0.221, 0.787, 1.0), 4: (0.212, 0.795, 1.0)}
"""Of the same throws, fitted offline to the whole segment."""
HORIZON = 0.3
"""s that a rate is predicted ahead: about one turn."""


def compared(dataset: Dataset, settings: Settings) -> Comparison:
    """The run of a data set."""
    return plain_comparison(dataset, settings)


@pytest.fixture(scope="module", params=PHONE_MOMENTS)
def phone(request: pytest.FixtureRequest, shared_data: Callable[[str], Path]) -> Comparison:
    """Both filters on a throw of a bare phone, no drag."""
    folder = shared_data("racquet_phyphox") / "data" / PHONE
    return compared(read_dataset(folder, request.param), FILTERS)


def test_the_moments_of_a_phone_are_found_by_both_filters(phone: Comparison) -> None:
    segment = phone.setup.dataset.segment
    assert segment is not None
    assert segment.number is not None
    for evaluation in phone.evaluations:
        assert evaluation.history.status.verdict == "ok"
        np.testing.assert_allclose(
            evaluation.body.principal_moments, PHONE_MOMENTS[segment.number], atol=0.03
        )


def test_the_rate_of_a_phone_is_predicted_ahead(phone: Comparison) -> None:
    for evaluation in phone.evaluations:
        error = prediction_errors(phone, evaluation)
        assert len(error) > 10
        rms, most = float(np.sqrt(np.mean(error**2))), float(error.max())
        print(
            f"{evaluation.name}: {len(error)} predictions, rms {100 * rms:.2f} %, at most {100 * most:.2f} %"
        )
        assert rms < 0.05
        assert most < 0.1


def prediction_errors(run: Comparison, evaluation: Evaluation) -> Float[np.ndarray, " k"]:
    """Predicted minus measured rate relative to |w|, from every epoch after the start."""
    gyro, history = run.setup.dataset.log.stream("gyro"), evaluation.history
    rate = history.layout.mean_slice("w")
    errors = []
    for k in range(len(run.setup.initial.mean), len(history.time)):
        ahead = int(np.searchsorted(gyro.time, history.time[k] + HORIZON))
        if ahead < len(gyro):
            predicted = run.setup.process.step(history.mean[k], float(gyro.time[ahead] - history.time[k]))
            measured = gyro.values[ahead]
            errors.append(np.linalg.norm(predicted[rate] - measured) / np.linalg.norm(measured))
    return np.array(errors)


def test_throws_of_a_racquet_agree_and_need_drag(shared_data: Callable[[str], Path]) -> None:
    folder = shared_data("racquet_phyphox") / "data" / RACQUET
    with_drag = Settings(estimators=("mekf",), process=ProcessSettings(drag=True), verdict=FILTER)
    without = replace(with_drag, process=ProcessSettings(drag=False))
    moments, ratios = [], []
    for number in range(6):
        dataset = read_dataset(folder, number)
        run = compared(dataset, with_drag)
        moments.append(run.evaluations[0].body.principal_moments)
        if number < 3:
            free, damped = prepare(dataset, without).gyro_noise, run.setup.gyro_noise
            assert free is not None
            assert damped is not None
            ratios.append(free.relative_error / damped.relative_error)
    median = np.median(moments, axis=0)
    print(f"median J1/J3 {median[0]:.4f}, J2/J3 {median[1]:.4f}; gyro error without / with drag {ratios}")
    assert median[0] == pytest.approx(0.0705, abs=0.005)
    assert median[1] == pytest.approx(0.932, abs=0.01)
    assert min(ratios) > 1.15


def test_tracks_made_elsewhere_give_their_body_and_attitude(shared_data: Callable[[str], Path]) -> None:
    dataset = read_dataset(shared_data("disam115") / "rich-0")
    run = compared(dataset, replace(FILTERS, process=ProcessSettings(force_psd=1e-6), verdict=FILTER))
    true_moments = np.sort([1.0322, 1.0, 0.8596]) / 1.0322
    for evaluation in run.evaluations:
        np.testing.assert_allclose(evaluation.body.principal_moments, true_moments, atol=0.01)
        assert evaluation.errors is not None
        assert evaluation.errors.rms.attitude is not None
        assert np.rad2deg(evaluation.errors.rms.attitude) < 1.0
