"""Pictures of estimates whose calibration is uncertain: the random part of a band is told apart."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from spinfilters.evaluation.estimator_evaluation import Evaluation, evaluate
from spinfilters.plots.summary import inertia_figure
from spinfilters.plots.time_courses import error_bands_figure
from tests.plots.run_samples import full_runs

RUNS = full_runs()


def considered(evaluation: Evaluation) -> Evaluation:
    """With one error of the calibration, as large as the deviation."""
    history = evaluation.history
    return evaluate(history.considering(np.linalg.norm(history.factor, axis=2)[:, :, None]), RUNS.truth)


def dotted(figure: Figure) -> int:
    """Lines that are the edges of random bands."""
    return sum(line.get_linestyle() == ":" for axes in figure.axes for line in axes.lines)


def test_only_an_uncertain_calibration_draws_edges_of_the_random_part() -> None:
    exact, uncertain = RUNS.with_truth[0], considered(RUNS.with_truth[0])
    assert dotted(error_bands_figure(exact)) == dotted(inertia_figure([exact])) == 0
    assert dotted(error_bands_figure(uncertain)) == 2 * 12
    assert dotted(inertia_figure([uncertain])) == 2 * 2


def test_the_random_trajectory_has_the_deviations_of_before() -> None:
    exact, uncertain = RUNS.with_truth[0], considered(RUNS.with_truth[0])
    random = uncertain.random_trajectory
    assert random is not None
    np.testing.assert_allclose(random.std_rate, exact.trajectory.std_rate, rtol=1e-6)
    assert (uncertain.trajectory.std_rate > exact.trajectory.std_rate).all()
    parts = uncertain.deviation_parts["attitude_rad"]
    assert parts.random == pytest.approx(parts.calibration, rel=1e-6)
