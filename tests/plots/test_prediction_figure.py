"""The picture of a prediction: standard deviations and rates over the time ahead, continuous at the last epoch."""

from io import BytesIO

import numpy as np
import pytest
from matplotlib.figure import Figure

from spinfilters.evaluation.estimated_motion import BodyRates, Trajectory, estimated_rates
from spinfilters.plots.time_courses import PredictionCurves, prediction_figure
from tests.plots.run_samples import SampleRuns, full_runs, rotation_runs

LAST = 40


def cut(trajectory: Trajectory, rows: slice) -> Trajectory:
    """Some epochs of it."""
    arrays = {name: value[rows] for name, value in vars(trajectory).items() if isinstance(value, np.ndarray)}
    return Trajectory(**arrays, sees_position=trajectory.sees_position)


def part(rates: BodyRates, rows: slice) -> BodyRates:
    """Some epochs of them."""
    assert rates.covariance is not None
    return BodyRates(rates.label, rates.time[rows], rates.rate[rows], rates.covariance[rows])


def drawn(runs: SampleRuns) -> Figure:
    """The second part of every run in the place of a prediction."""
    before, ahead = slice(LAST - 10, LAST + 1), slice(LAST, None)
    predicted_motions = []
    for run in runs.with_truth:
        rates = estimated_rates(run.history)
        motion = run.trajectory
        predicted_motions.append(
            PredictionCurves(cut(motion, before), cut(motion, ahead), part(rates, before), part(rates, ahead))
        )
    return prediction_figure(predicted_motions)


@pytest.mark.parametrize(("runs", "panels"), [(full_runs(), 6), (rotation_runs(), 5)], ids=["full", "gyro"])
def test_every_estimator_stands_in_every_panel(runs: SampleRuns, panels: int) -> None:
    figure = drawn(runs)
    figure.savefig(BytesIO(), dpi=40)
    assert len(figure.axes) == panels
    for axes in figure.axes:
        courses = [xy for xy in (np.asarray(line.get_xydata()) for line in axes.lines) if len(xy) > 2]
        assert len(courses) == 2 * len(runs.with_truth)
        for earlier, later in zip(courses[::2], courses[1::2], strict=True):
            assert earlier[-1, 0] == later[0, 0] == 0.0
            assert earlier[-1, 1] == later[0, 1]
        assert "[" in axes.get_ylabel()
