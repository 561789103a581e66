"""Errors of measurements that last are a doubt, and white ones are none."""

from functools import cache

import numpy as np
import pytest

from spinfilters.estimators.model_errors.correlated_errors import CorrelatedErrors
from spinfilters.models.process import ProcessNoise
from spinfilters.pipeline import correlation_verdict
from spinfilters.pipeline.estimation import Comparison, compare_estimators
from spinfilters.pipeline.setup import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.gauss_markov import with_gauss_markov_errors
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_noise
from spinfilters.state.status import Verdict

SMOOTHER = Settings(estimators=("smoother",), process={"gravity": False})  # pyright: ignore[reportArgumentType]


@cache
def compared(correlation: float) -> Comparison:
    """Of poses that say nothing of their noise."""
    noise = ProcessNoise(1e-6, 1e-6)
    scenario = Scenario(
        "pose", rate_rpm=RICH_RPM, epochs=60, position_std=1e-9, rotation_std=1e-9, noise=noise, seed=2
    )
    std, generator = np.repeat([0.005, 0.01], 3), np.random.default_rng(2)
    dataset = with_gauss_markov_errors(without_noise(simulate(scenario)), std, correlation, generator)
    return compare_estimators(prepare(dataset, SMOOTHER), SMOOTHER, lambda *_: None)


def test_lasting_errors_of_poses_are_doubted_with_their_size_and_time() -> None:
    (evaluation,) = compared(0.9).evaluations
    assert evaluation.history.status.verdict is Verdict.DEGRADED
    (reason,) = compared(0.9).models.correlated
    assert reason in evaluation.history.status.reasons
    assert "correlated over" in reason
    assert "pose_position_std" in reason
    assert len(reason) < 300


def test_white_errors_of_poses_are_not_doubted() -> None:
    assert compared(0.0).models.correlated == ()
    assert compared(0.0).evaluations[0].history.status.verdict is Verdict.OK


@pytest.mark.parametrize(
    ("probability", "inflation", "disturbed", "matters"),
    [
        (0.9, 2.0, 0.1, False),
        (0.9, 4.0, 0.1, True),
        (0.3, 20.0, 0.5, False),
        (0.3, 200.0, 0.5, True),
        (0.01, 100.0, 0.9, False),
        (0.01, 400.0, 0.9, True),
    ],
)
def test_what_errors_would_do_counts_by_how_likely_they_are(
    monkeypatch: pytest.MonkeyPatch, probability: float, inflation: float, disturbed: float, matters: bool
) -> None:
    found = CorrelatedErrors({}, {"noise": 0.1}, {}, 3.0, probability, 5.0, inflation, disturbed)
    monkeypatch.setattr(correlation_verdict, "correlated_errors", lambda *_: [found])
    monkeypatch.setattr(correlation_verdict, "observation_correlation", lambda _: None)
    setup, rows = compared(0.0).setup, compared(0.0).models
    monkeypatch.setattr(correlation_verdict, "noise_model", lambda *_: rows)

    class Rows:
        """Solved rows that nobody looks at."""

        problem = None

    doubts = correlation_verdict.correlated_error_doubts(setup, Rows(), ())  # pyright: ignore[reportArgumentType]
    assert bool(doubts) == matters
    assert all("3 s (noise 0.1" in each and len(each) < 300 for each in doubts)
