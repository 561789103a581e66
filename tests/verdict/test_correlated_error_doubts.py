"""Errors of measurements that last are a doubt where they are likely, and widen covariances where they may be."""

from functools import cache

import numpy as np
import pytest

from spinfilters.campaigns.row_columns import result_columns
from spinfilters.evaluation.comparison_table import INTERVAL_CAPTION, comparison_cells
from spinfilters.models.process import ProcessNoise
from spinfilters.models.status import Finding, Verdict
from spinfilters.run.estimation import Comparison, compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.run.run_summary import interval_document
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.measurement_faults import with_gauss_markov_errors
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_noise
from spinfilters.verdict import model_tests as model_errors
from spinfilters.verdict import tested_models as correlation_verdict
from spinfilters.verdict.model_errors.correlated_errors import CorrelatedErrors
from spinfilters.verdict.tested_models import NO_CORRELATION, PossibleCorrelation, possible_correlation

SMOOTHER = Settings(estimators=("smoother",), process={"gravity": False})  # pyright: ignore[reportArgumentType]


@cache
def compared(correlation: float) -> Comparison:
    """Of poses that say nothing of their noise."""
    noise = ProcessNoise(1e-6, 1e-6)
    scenario = Scenario.simplified(
        kind="pose", rate_rpm=RICH_RPM, epochs=60, position_std=1e-9, rotation_std=1e-9, noise=noise, seed=2
    )
    std, generator = np.repeat([0.005, 0.01], 3), np.random.default_rng(2)
    dataset = with_gauss_markov_errors(without_noise(simulate(scenario)), std, correlation, generator)
    return compare_estimators(prepare(dataset, SMOOTHER), SMOOTHER, lambda *_: None)


def test_lasting_errors_of_poses_are_doubted_with_their_size_and_time() -> None:
    (evaluation,) = compared(0.9).evaluations
    assert evaluation.history.status.verdict is Verdict.DEGRADED
    (found,) = compared(0.9).models.correlated.doubts
    reason = found.reason
    assert reason in evaluation.history.status.reasons
    assert "correlated over" in reason
    assert "pose_position_std" in reason
    assert len(reason) < 300


def test_white_errors_of_poses_are_not_doubted() -> None:
    assert compared(0.0).models.correlated.doubts == ()
    assert compared(0.0).evaluations[0].history.status.verdict is Verdict.OK


def possible(monkeypatch: pytest.MonkeyPatch, *found: CorrelatedErrors) -> PossibleCorrelation:
    """Of a recording in whose smoothed motion these errors are found."""
    monkeypatch.setattr(correlation_verdict, "correlated_errors", lambda *_: list(found))
    monkeypatch.setattr(correlation_verdict, "observation_correlation", lambda _: None)
    setup, model = compared(0.0).setup, compared(0.0).models
    monkeypatch.setattr(correlation_verdict, "noise_model", lambda *_: model)

    class Rows:
        """Solved rows that nobody looks at."""

        problem = None

    return possible_correlation(setup, Rows(), ())  # pyright: ignore[reportArgumentType]


def errors(probability: float, inflation: float, widening: float = 1.0) -> CorrelatedErrors:
    """Errors that would make variances larger."""
    sizes, wider = ({}, {"noise": 0.1}, {}), widening * np.eye(3)[np.newaxis]
    roots = np.sqrt(inflation) * np.tile(np.eye(3), (3, 1, 1))
    return CorrelatedErrors(*sizes, 3.0, probability, 5.0, inflation, wider, roots)


@pytest.mark.parametrize(
    ("probability", "inflation", "is_doubt"), [(0.9, 2.0, False), (0.9, 4.0, True), (0.3, 200.0, False)]
)
def test_only_errors_that_are_likelier_than_not_are_a_doubt(
    monkeypatch: pytest.MonkeyPatch, probability: float, inflation: float, is_doubt: bool
) -> None:
    doubts = possible(monkeypatch, errors(probability, inflation)).doubts
    assert bool(doubts) == is_doubt
    assert all("3 s (noise 0.1" in each.reason and len(each.reason) < 300 for each in doubts)


def test_covariances_hold_with_the_errors_that_widen_them_most(monkeypatch: pytest.MonkeyPatch) -> None:
    found = possible(monkeypatch, errors(0.3, 2.0, 1.5), errors(0.1, 20.0, 4.0))
    assert found.widening == pytest.approx(4.0 * np.eye(3)[np.newaxis])
    assert found.undecided is not None
    assert "3 s (noise 0.1" in found.undecided.sentence
    assert len(found.undecided.reason) < 300


def test_errors_are_a_mixture_of_white_ones_and_of_each_explanation_at_its_odds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = possible(monkeypatch, errors(0.3, 2.0, 1.5), errors(0.1, 20.0, 4.0)).mixture
    assert found is not None
    assert found.weights.sum() == pytest.approx(1.0)
    odds = [found.weights[1:4].sum() / found.weights[0], found.weights[4:].sum() / found.weights[0]]
    assert odds == pytest.approx([1 / 9, 3 / 7])
    variances = np.square(found.factors).sum(axis=2)[:, 0]
    assert variances == pytest.approx([1.0, *[20.0] * 3, *[2.0] * 3])
    assert NO_CORRELATION.mixture is None


def test_errors_that_surely_last_leave_white_ones_no_weight(monkeypatch: pytest.MonkeyPatch) -> None:
    found = possible(monkeypatch, errors(1.0, 2.0, 1.5)).mixture
    assert found is not None
    assert found.weights[0] < 1e-9
    assert found.weights.sum() == pytest.approx(1.0)


@cache
def compared_gyro(correlation: float) -> Comparison:
    """Of rates that say nothing of their noise."""
    scenario = Scenario.simplified(
        kind="gyro", rate_rpm=RICH_RPM, epochs=115, gyro_std=1e-9, noise=ProcessNoise(1e-6, 1e-6), seed=531
    )
    dataset = without_noise(simulate(scenario))
    if correlation:
        dataset = with_gauss_markov_errors(
            dataset, np.full(3, 0.005), correlation, np.random.default_rng([531, 5])
        )
    return compare_estimators(prepare(dataset, SMOOTHER), SMOOTHER, lambda *_: None)


def test_deviations_of_a_gyro_hold_with_errors_that_may_be_correlated() -> None:
    comparison = compared_gyro(0.97)
    (evaluation,) = comparison.evaluations
    assert evaluation.history.status.verdict is Verdict.OK
    assert comparison.models.correlated.widening is not None
    assert result_columns(evaluation)["worst_error"] < 4.0
    assert evaluation.intervals is not None
    half_widths, std = evaluation.intervals["rate_rad_s"], evaluation.deviation_parts["rate_rad_s"].random
    assert (np.diff(half_widths, axis=0) > 0).all()
    assert (half_widths[0] < 0.6745 * std).all()
    document = interval_document(evaluation)
    assert document is not None
    assert list(document["rate_rad_s"].values()) == half_widths.tolist()
    assert list(document["rate_rad_s"]) == ["50", "80", "95"]
    cells = comparison_cells([evaluation])
    assert "rate in i: 95 % within ± [deg/s]" in {row[0] for section in cells.sections for row in section}
    assert INTERVAL_CAPTION in cells.captions


def test_moments_that_only_white_errors_determine_are_not_determined(monkeypatch: pytest.MonkeyPatch) -> None:
    setup = compared(0.0).setup
    undecided = Finding("correlation-undecided", "errors may be correlated")
    wide = PossibleCorrelation((), 1e3 * np.eye(setup.process.layout.error_dim)[np.newaxis], undecided)
    monkeypatch.setattr(model_errors, "possible_correlation", lambda *_: wide)
    (evaluation,) = compare_estimators(setup, SMOOTHER, lambda *_: None).evaluations
    reasons = "; ".join(evaluation.history.status.reasons)
    assert evaluation.history.status.verdict is Verdict.DEGRADED
    assert "not determined" in reasons
    assert "errors may be correlated" in reasons
