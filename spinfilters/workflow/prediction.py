"""What every estimator of a run foretells after its last frame, as tables and a picture."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.history import EstimateHistory, GrowingHistory
from spinfilters.estimators.prediction import predict_ahead
from spinfilters.evaluation.evaluation import Evaluation
from spinfilters.evaluation.rates import estimated_rates
from spinfilters.evaluation.trajectory import trajectory_of, write_trajectory_csv
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.plots.prediction import PAST, Foretold, prediction_figure
from spinfilters.plots.style import save_figure
from spinfilters.state.status import EstimatorStatus, Verdict
from spinfilters.workflow.estimation import Comparison
from spinfilters.workflow.preparation import Prepared

TABLE, PICTURE = "prediction.csv", "prediction.png"
MOST_STEPS = 20_000
"""Of a prediction: each keeps a covariance factor."""
ROUNDING = 1e-6
"""Of a step: time stamps are printed with six decimals."""


def times_ahead(prepared: Prepared, seconds: float) -> Float[np.ndarray, " k"]:
    """Steps of the recording's median frame interval up to so many seconds, s ahead of the last frame.

    Raises
    ------
    InputError: less than one step, or more than `MOST_STEPS`.
    """
    interval = float(np.median(np.diff([frame.time for frame in prepared.timeline])))
    if not interval * (1 - ROUNDING) <= seconds <= interval * MOST_STEPS:
        raise InputError(
            f"--predict {seconds:g} s is not between 1 and {MOST_STEPS} of the recording's frame intervals: give "
            f"{interval:.6g} to {interval * MOST_STEPS:.6g} s"
        )
    return interval * np.arange(1, int(seconds / interval + ROUNDING) + 1)


def write_predictions(folder: Path, comparison: Comparison, seconds: float) -> None:
    """<estimator>/prediction.csv of all that did not fail, in the columns of trajectory.csv, and prediction.png of all of them.

    Raises
    ------
    InputError: as `times_ahead`; a file cannot be written.
    """
    prepared, ahead = comparison.prepared, times_ahead(comparison.prepared, seconds)
    good = [e for e in comparison.evaluations if e.history.status.verdict is not Verdict.FAILED]
    if not good:
        return
    predicted = [_predicted(prepared.process, evaluation, ahead) for evaluation in good]
    for each in predicted:
        write_trajectory_csv(folder / each.evaluation.name / TABLE, trajectory_of(each.after))
    axes = good[0].body.principal_axes_g
    save_figure(prediction_figure([each.foretold(axes, seconds) for each in predicted]), folder / PICTURE)


@dataclass(frozen=True)
class _Predicted:
    """An estimator's run, and the last frame with all that is predicted from it."""

    evaluation: Evaluation
    history: EstimateHistory

    @property
    def after(self) -> EstimateHistory:
        """Without the last frame."""
        return _cut(self.history, slice(1, None))

    def foretold(self, axes: Float[np.ndarray, "3 3"], seconds: float) -> Foretold:
        """With a share of so many seconds of what was estimated before; rates about axes given as rows in g."""
        known = self.evaluation.history
        before = _cut(known, slice(int(np.searchsorted(known.time, known.time[-1] - PAST * seconds)), None))
        return Foretold(
            trajectory_of(before),
            trajectory_of(self.history),
            estimated_rates(before).in_axes(axes),
            estimated_rates(self.history).in_axes(axes),
        )


def _predicted(
    process: TorqueFreeProcess, evaluation: Evaluation, ahead: Float[np.ndarray, " k"]
) -> _Predicted:
    last, now = evaluation.history.belief(-1), float(evaluation.history.time[-1])
    prediction = predict_ahead(process, last, ahead)
    rows = GrowingHistory(last.layout, now)
    rows.append(now, last, [], 0.0)
    for k, seconds in enumerate(prediction.times):
        rows.append(now + float(seconds), prediction.belief(k), [], 0.0)
    return _Predicted(evaluation, rows.ended(evaluation.name, EstimatorStatus()))


def _cut(history: EstimateHistory, rows: slice) -> EstimateHistory:
    """Some frames of a history."""
    beliefs = GrowingHistory(history.layout, float(history.time[0]))
    for k in range(*rows.indices(len(history.time))):
        beliefs.append(float(history.time[k]), history.belief(k), [], 0.0)
    return beliefs.ended(history.name, history.status)
