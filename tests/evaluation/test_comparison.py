"""The evaluation of a run, its table and its numbers."""

import json
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from spinfilters.core.attitude_conversions import quaternion_from_rotation_vector, rotate
from spinfilters.core.errors import InputError
from spinfilters.evaluation.comparison_table import comparison_table
from spinfilters.evaluation.estimated_motion import estimated_rates, true_rates
from spinfilters.evaluation.estimator_evaluation import Evaluation, evaluate, with_uncertainty
from spinfilters.evaluation.trajectory_errors import Alignment
from spinfilters.run.run_summary import estimator_numbers
from tests.evaluation.estimate_samples import consistent_history, sample_truth

TRUTH = sample_truth(np.random.default_rng(0), 40)
HISTORY = consistent_history(TRUTH, np.random.default_rng(1))


def text(evaluations: list[Evaluation]) -> str:
    stream = StringIO()
    Console(file=stream, width=150).print(comparison_table(evaluations))
    return stream.getvalue()


def test_the_table_sets_estimators_side_by_side_with_errors_and_consistency() -> None:
    slow = replace(HISTORY, name="ukf", runtime=4 * HISTORY.runtime, rejected=HISTORY.dof)
    shown = text([evaluate(HISTORY, TRUTH), evaluate(slow, TRUTH)])
    rows = {line.split("│")[1].strip(): line.split("│")[2:4] for line in shown.splitlines() if "│" in line}
    assert [cell.strip() for cell in rows["processor ms per epoch"]] == ["1", "4"]
    assert [cell.strip() for cell in rows["accepted / rejected"]] == ["80 / 0", "80 / 240"]
    assert float(rows["J smallest / largest"][0]) == pytest.approx(0.6, abs=0.02)
    assert float(rows["NIS per dof"][0]) == 1.0
    assert 0.8 < float(rows["NEES per dof"][0]) < 1.2
    assert "position error [mm]" in rows
    assert "MEKF" in shown
    assert "UKF" in shown


def test_rows_that_need_a_truth_are_left_out_without_one() -> None:
    shown = text([evaluate(HISTORY)])
    assert "NEES" not in shown
    assert "error" not in shown
    assert "NIS per dof" in shown


def test_numbers_are_json_and_name_their_units() -> None:
    found = estimator_numbers(evaluate(HISTORY, TRUTH))
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert found["errors"]["rms_position_m"] == found["errors"]["ape_rmse_m"]
    assert found["frames"] == 40
    assert estimator_numbers(evaluate(HISTORY))["errors"] is None


def test_nees_is_left_out_when_the_frames_g_differ() -> None:
    assert evaluate(HISTORY, TRUTH).nees is not None
    aligned = evaluate(HISTORY, TRUTH, Alignment.BODY_FRAME)
    assert aligned.nees is None
    assert aligned.body_errors is not None
    assert aligned.body_errors.center_of_mass_g is None


def test_a_run_that_left_no_epoch_is_refused_with_its_reason() -> None:
    empty = {name: value[:0] for name, value in vars(HISTORY).items() if isinstance(value, np.ndarray)}
    status = HISTORY.status.failed("the estimate stopped being finite")
    failed = replace(HISTORY, status=status, **empty)
    with pytest.raises(InputError, match="stopped being finite"):
        evaluate(failed)


def test_epochs_of_the_start_do_not_count_as_fast_epochs() -> None:
    runtime = np.where(np.arange(40) < 30, 0.0, 2e-3)
    assert evaluate(replace(HISTORY, runtime=runtime)).milliseconds_per_frame == pytest.approx(2.0)
    assert evaluate(replace(HISTORY, runtime=np.zeros(40))).milliseconds_per_frame is None


def test_rates_turn_with_their_axes_and_meet_the_truth_in_the_frame_of_the_estimate() -> None:
    rates = estimated_rates(HISTORY)
    np.testing.assert_allclose(rates.rate, true_rates(TRUTH).rate, atol=2e-3)
    axes = rotate(quaternion_from_rotation_vector(np.array([0.4, -1.0, 0.2])), np.eye(3))
    turned = rates.in_axes(axes)
    np.testing.assert_allclose(np.linalg.norm(turned.rate, axis=1), np.linalg.norm(rates.rate, axis=1))
    assert turned.covariance is not None
    assert rates.covariance is not None
    np.testing.assert_allclose(
        np.trace(turned.covariance, axis1=1, axis2=2), np.trace(rates.covariance, axis1=1, axis2=2)
    )
    frame = quaternion_from_rotation_vector(np.array([0.1, 0.7, -0.3]))
    np.testing.assert_allclose(rotate(frame, true_rates(TRUTH, frame).rate), true_rates(TRUTH).rate)


@pytest.mark.parametrize(
    ("value", "std", "expected"),
    [
        (0.81242, 0.01364, "0.812 ± 0.014"),
        (0.99, 0.5, "0.99 ± 0.50"),
        (1.0, 0.0, "1.0000 ± 0.0000"),
        (0.34, 1.7e-5, "0.340000 ± 0.000017"),
        (12.0, np.nan, "12.0000 ± unknown"),
    ],
)
def test_an_uncertainty_is_given_to_two_digits(value: float, std: float, expected: str) -> None:
    assert with_uncertainty(value, std) == expected
