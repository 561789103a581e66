"""Verdicts on what gates refuse: nominal noise is never doubted for it, however long the recording; a fault is."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from jaxtyping import Bool
from plain_comparison import plain_comparison

from spinfilters.evaluation.estimator_evaluation import Evaluation, evaluate
from spinfilters.filters.history import EstimateHistory
from spinfilters.filters.outlier_rejection import RobustOptions
from spinfilters.models.state_layout import ROTATION_BLOCKS, StateLayout
from spinfilters.models.status import EstimatorStatus, Verdict
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.verdict.checks import Evidence
from spinfilters.verdict.doubts import measurement_findings
from spinfilters.verdict.judge import judge

LAYOUT = StateLayout(ROTATION_BLOCKS)
FALSE_ALARM = 1e-4


@cache
def nominal(epochs: int) -> Evaluation:
    """A run of a consistent filter that refused nothing."""
    e, accepted = LAYOUT.error_dim, np.ones(epochs, dtype=int)
    return evaluate(
        EstimateHistory(
            name="mekf",
            layout=LAYOUT,
            time=0.01 * np.arange(epochs),
            mean=np.broadcast_to(LAYOUT.origin(), (epochs, LAYOUT.mean_dim)),
            factor=np.broadcast_to(0.01 * np.eye(e), (epochs, e, e)),
            nis=3.0 * accepted,
            dof=3 * accepted,
            log_likelihood=np.zeros(epochs),
            accepted=accepted,
            rejected=0 * accepted,
            runtime=np.ones(epochs),
            status=EstimatorStatus(),
        )
    )


def verdict(refused: Bool[np.ndarray, " n"], values: int = 1, false_alarm: float = FALSE_ALARM) -> Verdict:
    """On a run of a consistent filter some of whose epochs were refused as a whole."""
    evaluation, accepted = nominal(len(refused)), np.where(refused, 0, values)
    history = replace(
        evaluation.history,
        nis=3.0 * accepted,
        dof=3 * accepted,
        accepted=accepted,
        rejected=values - accepted,
    )
    return judge(Evidence(replace(evaluation, history=history), gate_false_alarm=false_alarm)).verdict


def chosen(epochs: int, *rows: int) -> Bool[np.ndarray, " n"]:
    """Some of so many epochs."""
    result = np.zeros(epochs, dtype=bool)
    result[list(rows)] = True
    return result


@pytest.mark.parametrize("epochs", [100, 3000, 120_000])
def test_the_gates_own_false_alarms_are_no_doubt_at_any_length(epochs: int) -> None:
    for seed in range(8):
        refused = np.random.default_rng(seed).random(epochs) < FALSE_ALARM
        assert verdict(refused) is Verdict.OK


@pytest.mark.parametrize("epochs", [3000, 120_000])
def test_one_epoch_in_a_hundred_refused_is_doubted(epochs: int) -> None:
    assert verdict(np.random.default_rng(0).random(epochs) < 0.01) is Verdict.DEGRADED


def test_refusals_a_few_times_as_frequent_as_false_alarms_are_doubted_in_a_long_recording() -> None:
    assert verdict(np.random.default_rng(0).random(120_000) < 4 * FALSE_ALARM) is Verdict.DEGRADED


@pytest.mark.parametrize("epochs", [400, 120_000])
def test_a_burst_of_three_refused_epochs_is_doubted(epochs: int) -> None:
    assert verdict(chosen(epochs, 200, 201, 202)) is Verdict.DEGRADED


def test_a_single_refused_frame_of_many_values_is_doubted() -> None:
    assert verdict(chosen(120_000, 77), values=30) is Verdict.DEGRADED


def test_any_refused_epoch_is_doubted_where_there_is_no_gate() -> None:
    assert verdict(chosen(120_000, 77), false_alarm=0.0) is Verdict.DEGRADED


@pytest.mark.parametrize("kind", ["gyro", "pose"])
def test_nominal_data_are_not_doubted_for_what_a_narrow_gate_refuses(kind: str) -> None:
    scenario = Scenario.simplified(kind=kind, rate_rpm=RICH_RPM, epochs=300, interval=0.2, seed=1)
    settings = Settings(estimators=("mekf", "smoother"), robust=RobustOptions(gate_probability=0.97))
    settings = replace(settings, smoother=replace(settings.smoother, width=3.5))
    comparison = plain_comparison(simulate(scenario), settings)
    for evaluation in comparison.evaluations:
        assert evaluation.history.rejected.sum() > 0
        assert not [reason for reason in evaluation.history.status.reasons if "gave no information" in reason]


@pytest.mark.parametrize(
    ("moment", "std", "wanted"), [(7e-4, 1.4e-3, False), (0.02, 6e-4, True), (0.3, 0.02, True)]
)
def test_a_moment_that_may_be_zero_leaves_its_ratio_open(moment: float, std: float, wanted: bool) -> None:
    evaluation = replace(nominal(100))  # a copy that has computed nothing yet
    evaluation.__dict__["body"] = replace(
        nominal(100).body,
        principal_moments=np.array([moment, 0.99, 1.0]),
        principal_moments_cov=np.diag([std**2, 1e-8, 0.0]),
    )
    status = judge(Evidence(evaluation, gate_false_alarm=FALSE_ALARM))
    assert (status.verdict is Verdict.OK) == wanted
    assert wanted or "may be zero" in status.reasons[0]


def leaving_out(name: str, share: float) -> Evaluation:
    """An estimator that leaves out a share of a thousand measurements."""
    evaluation, rejected = nominal(100), np.full(100, round(10 * share))
    history = replace(evaluation.history, name=name, accepted=10 - rejected, rejected=rejected)
    return replace(evaluation, history=history)


@pytest.mark.parametrize(("smoother", "is_doubted"), [(0.3, True), (0.1, False)])
def test_filters_and_smoother_have_the_same_doubt_about_the_measurements(
    smoother: float, is_doubted: bool
) -> None:
    run = [leaving_out("mekf", 0.2), leaving_out("smoother", smoother)]
    shared = measurement_findings([run[1].history], run)
    assert bool(shared) == is_doubted
    statuses = [judge(Evidence(each, gate_false_alarm=FALSE_ALARM, found=shared)) for each in run]
    assert statuses[0].reasons == statuses[1].reasons == tuple(each.reason for each in shared)


def test_a_filter_that_goes_astray_is_no_doubt_about_the_measurements() -> None:
    run = [leaving_out("mekf", 0.6), leaving_out("ukf", 0.1)]
    assert measurement_findings([], run) == []
