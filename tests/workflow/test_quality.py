"""Verdicts on what gates refuse: nominal noise is never doubted for it, however long the recording; a fault is."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from jaxtyping import Bool

from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.robustness import RobustOptions
from spinfilters.evaluation.evaluation import Evaluation, evaluate
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.state.layout import ROTATION_BLOCKS, StateLayout
from spinfilters.state.status import EstimatorStatus, Verdict
from spinfilters.workflow.estimation import compare_estimators
from spinfilters.workflow.preparation import prepare
from spinfilters.workflow.quality import judged
from spinfilters.workflow.settings import Settings

LAYOUT = StateLayout(ROTATION_BLOCKS)
FALSE_ALARM = 1e-4


@cache
def nominal(frames: int) -> Evaluation:
    """A run of a consistent filter that refused nothing."""
    e, accepted = LAYOUT.error_dim, np.ones(frames, dtype=int)
    return evaluate(
        EstimateHistory(
            name="mekf",
            layout=LAYOUT,
            time=0.01 * np.arange(frames),
            mean=np.broadcast_to(LAYOUT.origin(), (frames, LAYOUT.mean_dim)),
            factor=np.broadcast_to(0.01 * np.eye(e), (frames, e, e)),
            nis=3.0 * accepted,
            dof=3 * accepted,
            log_likelihood=np.zeros(frames),
            accepted=accepted,
            rejected=0 * accepted,
            runtime=np.ones(frames),
            status=EstimatorStatus(),
        )
    )


def verdict(refused: Bool[np.ndarray, " n"], values: int = 1, false_alarm: float = FALSE_ALARM) -> Verdict:
    """On a run of a consistent filter some of whose frames were refused as a whole."""
    evaluation, accepted = nominal(len(refused)), np.where(refused, 0, values)
    history = replace(
        evaluation.history,
        nis=3.0 * accepted,
        dof=3 * accepted,
        accepted=accepted,
        rejected=values - accepted,
    )
    return judged(replace(evaluation, history=history), [], [], false_alarm).verdict


def chosen(frames: int, *rows: int) -> Bool[np.ndarray, " n"]:
    """Some of so many frames."""
    result = np.zeros(frames, dtype=bool)
    result[list(rows)] = True
    return result


@pytest.mark.parametrize("frames", [100, 3000, 120_000])
def test_the_gates_own_false_alarms_are_no_doubt_at_any_length(frames: int) -> None:
    for seed in range(8):
        refused = np.random.default_rng(seed).random(frames) < FALSE_ALARM
        assert verdict(refused) is Verdict.OK


@pytest.mark.parametrize("frames", [3000, 120_000])
def test_one_frame_in_a_hundred_refused_is_doubted(frames: int) -> None:
    assert verdict(np.random.default_rng(0).random(frames) < 0.01) is Verdict.DEGRADED


def test_refusals_a_few_times_as_frequent_as_false_alarms_are_doubted_in_a_long_recording() -> None:
    assert verdict(np.random.default_rng(0).random(120_000) < 4 * FALSE_ALARM) is Verdict.DEGRADED


@pytest.mark.parametrize("frames", [400, 120_000])
def test_a_burst_of_three_refused_frames_is_doubted(frames: int) -> None:
    assert verdict(chosen(frames, 200, 201, 202)) is Verdict.DEGRADED


def test_a_single_refused_frame_of_many_values_is_doubted() -> None:
    assert verdict(chosen(120_000, 77), values=30) is Verdict.DEGRADED


def test_any_refused_frame_is_doubted_where_there_is_no_gate() -> None:
    assert verdict(chosen(120_000, 77), false_alarm=0.0) is Verdict.DEGRADED


@pytest.mark.parametrize("kind", ["gyro", "pose"])
def test_nominal_data_are_not_doubted_for_what_a_narrow_gate_refuses(kind: str) -> None:
    scenario = Scenario(kind=kind, rate_rpm=RICH_RPM, frames=300, interval=0.2, seed=1)
    settings = Settings(estimators=("mekf", "smoother"), robust=RobustOptions(gate_probability=0.97))
    settings = replace(settings, smoother=replace(settings.smoother, width=3.5))
    comparison = compare_estimators(prepare(simulate(scenario), settings), settings, lambda *_: None)
    for evaluation in comparison.evaluations:
        assert evaluation.history.rejected.sum() > 0
        assert not [reason for reason in evaluation.history.status.reasons if "told nothing" in reason]
