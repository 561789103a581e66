"""The bend of the ridge of likely mass distributions: none of a rich motion, and what it does to a verdict."""

import pytest

from spinfilters import simulate
from spinfilters.inference import smoother_run
from spinfilters.inference.setup import Setup
from spinfilters.inference.smoother_run import CURVED, smooth_and_sample, smoothed_problem
from spinfilters.models.status import Verdict
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.smoother.curved_posterior import expected_nees
from spinfilters.smoother.problem import LinearProblem


@pytest.fixture(scope="module")
def setup() -> Setup:
    """Of a gyro on a motion that shows the moments."""
    return prepare(simulate("gyro", rate_rpm=(4.0, 9.0, 3.0), frames=60, seed=3), Settings())


def test_a_rich_motion_has_a_straight_posterior(setup: Setup) -> None:
    problem, found = smoothed_problem(setup, Settings())
    nees = expected_nees(problem, LinearProblem(found.solved.point, found.solved.normal))
    assert nees == pytest.approx(1.0, abs=1e-2)
    assert nees > 1.0


def test_a_curved_posterior_degrades_the_smoother(setup: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(smoother_run, "expected_nees", lambda problem, linear: 5.0)
    status = smooth_and_sample(setup, Settings(), lambda done, every: None).status
    assert status.verdict is Verdict.DEGRADED
    assert [each.check for each in status.findings] == [CURVED]
