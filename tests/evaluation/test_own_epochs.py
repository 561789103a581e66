"""Statistics of a filter are over its own epochs, those of a smoother beside it over the same ones too."""

from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from spinfilters.evaluation.comparison_table import comparison_table
from spinfilters.evaluation.epoch_spans import (
    epoch_sentences,
    initialisation_end,
    on_identical_measurements,
    own_span,
    shared_begin,
    title_sentences,
)
from spinfilters.evaluation.estimator_evaluation import Evaluation, evaluate
from spinfilters.filters.history import EstimateHistory
from spinfilters.run.run_summary import estimator_numbers
from tests.evaluation.estimate_samples import consistent_history, sample_truth

EPOCHS, INITIALISATION = 40, 15
TRUTH = sample_truth(np.random.default_rng(0), EPOCHS)
CONSISTENT = consistent_history(TRUTH, np.random.default_rng(1))
OBSERVATIONS = np.full(EPOCHS, 7)


def poor_beginning() -> EstimateHistory:
    """A filter whose initialisation, 15 epochs, is off by metres; it uses 2 of 7 observations afterwards."""
    mean, layout = CONSISTENT.mean.copy(), CONSISTENT.layout
    mean[:INITIALISATION, layout.mean_slice("t")] += 10.0
    accepted = np.where(np.arange(EPOCHS) < INITIALISATION, 0, 2)
    return replace(
        CONSISTENT, mean=mean, accepted=accepted, initialisation=INITIALISATION, observations=OBSERVATIONS
    )


def smoother() -> EstimateHistory:
    """Of all epochs, from all observations; the first 15 epochs are off by metres as well."""
    return replace(
        poor_beginning(), name="smoother", initialisation=0, accepted=OBSERVATIONS, dof=0 * OBSERVATIONS
    )


def table_rows(evaluations: list[Evaluation]) -> dict[str, list[str]]:
    """Cells of every row by its name."""
    stream = StringIO()
    Console(file=stream, width=150).print(comparison_table(evaluations))
    lines = [line.split("│")[1:-1] for line in stream.getvalue().splitlines() if "│" in line]
    return {cells[0].strip(): [cell.strip() for cell in cells[1:]] for cells in lines}


def test_errors_and_nees_leave_out_the_initialisation_which_has_its_own() -> None:
    found = estimator_numbers(evaluate(poor_beginning(), TRUTH))["errors"]
    assert found["rms_position_m"] < 0.1
    assert found["nees_per_dof"] == pytest.approx(1.0, abs=0.2)
    assert found["initialisation"]["epochs"] == INITIALISATION
    assert found["initialisation"]["rms_position_m"] > 10
    assert found["initialisation"]["nees_per_dof"] > 100
    assert found["ape_rmse_m"] > 5  # evo's, of all rows of the file


def test_truth_and_states_of_a_span_are_those_of_its_compared_epochs() -> None:
    span = own_span(evaluate(poor_beginning(), TRUTH))
    assert span.truth is not None
    assert span.states is not None
    assert span.errors is not None
    assert span.errors.velocity is not None
    np.testing.assert_array_equal(span.truth.time, TRUTH.time[INITIALISATION:])
    velocity = span.states[:, CONSISTENT.layout.mean_slice("v")]
    np.testing.assert_allclose(velocity - span.truth.velocity, span.errors.velocity, atol=1e-12)
    assert own_span(evaluate(poor_beginning(), None)).truth is None


def test_a_smoother_is_compared_over_the_epochs_of_the_filters_and_has_its_own_besides() -> None:
    evaluations = [evaluate(poor_beginning(), TRUTH), evaluate(smoother(), TRUTH)]
    begin = shared_begin(evaluations)
    assert begin == TRUTH.time[INITIALISATION]
    assert initialisation_end(evaluations) == TRUTH.time[INITIALISATION - 1]
    ours, theirs = (estimator_numbers(evaluation, begin)["errors"] for evaluation in evaluations)
    assert theirs["shared_epochs"]["rms_position_m"] == ours["rms_position_m"]
    assert theirs["shared_epochs"]["epochs"] == EPOCHS - INITIALISATION
    assert theirs["rms_position_m"] > 5
    assert theirs["initialisation"] is None
    rows = table_rows(evaluations)
    assert rows["own epochs"] == ["25", "40, 25 compared"]
    assert rows["position error [mm]"][0] == rows["position error [mm]"][1]
    filters, smoothers = rows["all epochs: position [mm]"]
    assert filters == "-"
    assert float(smoothers) > 5000


def test_nothing_is_said_twice_where_all_epochs_are_everyones_own() -> None:
    rows = table_rows([evaluate(CONSISTENT, TRUTH), evaluate(smoother(), TRUTH)])
    assert not [name for name in rows if name.startswith("all epochs")]


def test_what_each_used_of_the_observations_is_counted_over_the_same_epochs() -> None:
    evaluations = [evaluate(poor_beginning()), evaluate(smoother())]
    rows = table_rows(evaluations)
    assert rows["observations per epoch"] == ["7.0", "7.0"]
    assert rows["of these used"] == ["2.0", "7.0"]
    assert rows["share used"] == ["28.6 %", "100.0 %"]
    assert rows["accepted / rejected"] == ["50 / 0", "175 / 0"]
    found = estimator_numbers(evaluations[1], shared_begin(evaluations))["observations"]
    assert found["epochs"] == EPOCHS
    assert found["shared_epochs"]["epochs"] == EPOCHS - INITIALISATION
    assert found["share_used"] == 1.0


def test_measurements_are_called_identical_only_where_every_estimator_used_them_all() -> None:
    partly, wholly = evaluate(poor_beginning()), evaluate(smoother())
    complete = evaluate(replace(poor_beginning(), accepted=OBSERVATIONS))
    untold = evaluate(replace(smoother(), observations=None))
    assert on_identical_measurements([complete, wholly])
    assert title_sentences([complete, wholly]) == ["Estimators on identical measurements"]
    for evaluations in ([partly, wholly], [complete, untold]):
        assert not on_identical_measurements(evaluations)
        assert "identical" not in " ".join(title_sentences(evaluations))
    assert title_sentences([partly]) == []


def test_a_filter_that_failed_before_its_first_own_epoch_has_no_statistics() -> None:
    arrays = {
        name: value[:INITIALISATION]
        for name, value in vars(poor_beginning()).items()
        if isinstance(value, np.ndarray)
    }
    failed = replace(poor_beginning(), status=CONSISTENT.status.failed("it"), **arrays)
    evaluations = [evaluate(failed, TRUTH), evaluate(smoother(), TRUTH)]
    document = estimator_numbers(evaluations[0], shared_begin(evaluations))
    found = document["errors"]
    assert found["rms_position_m"] is None
    assert found["nees_per_dof"] is None
    assert found["shared_epochs"] is None
    assert document["observations"]["share_used"] is None
    rows = table_rows(evaluations)
    assert rows["position error [mm]"][0] == "-"
    assert rows["status"] == ["failed", "ok"]


@pytest.mark.parametrize(
    ("origin", "says"), [(0.0, "from t = "), (1.7e9, "s after the first epoch (t = 1700000000")]
)
def test_times_of_a_clock_since_1970_are_said_after_the_first_epoch(origin: float, says: str) -> None:
    history = poor_beginning()
    filters = [
        evaluate(replace(history, name=name, time=history.time + origin), None) for name in ("mekf", "ukf")
    ]
    (sentence,) = epoch_sentences(filters)
    assert says in sentence
    assert "e+09" not in sentence
