"""Predictions of every estimator after its last epoch, as tables and a figure."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from spinfilters.data.input_file import path_text, reason
from spinfilters.errors import NUMERICAL_ERRORS, InputError, numerical
from spinfilters.estimators.filters.belief_prediction import predict_ahead
from spinfilters.estimators.history import EstimateHistory, GrowingHistory
from spinfilters.evaluation.body import body_estimate
from spinfilters.evaluation.estimated_motion import estimated_rates, trajectory_of, write_trajectory_csv
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.plots.prediction import PAST, PredictionCurves, prediction_figure
from spinfilters.plots.style import draw_figure
from spinfilters.runs.history_file import read_history, write_history
from spinfilters.runs.run_folder import PREDICTION_ARRAYS as ARRAYS
from spinfilters.runs.run_folder import PREDICTION_PICTURE
from spinfilters.runs.run_folder import PREDICTION_TABLE as TABLE
from spinfilters.state.status import EstimatorStatus, Verdict

CURE = "run compare again with --resume --predict SECONDS"
MOST_STEPS = 20_000
"""Of a prediction: each keeps a covariance factor."""
ROUNDING = 1e-6
"""Of a step: time stamps are printed with six decimals."""


def times_ahead(time: Float[np.ndarray, " n"], seconds: float) -> Float[np.ndarray, " k"]:
    """Times ahead of the last epoch, s.

    Steps of the median interval of a recording's frames (s) up to so many seconds.

    Raises
    ------
    InputError: less than one step, or more than `MOST_STEPS`.
    """
    interval = float(np.median(np.diff(time)))
    if not interval * (1 - ROUNDING) <= seconds <= interval * MOST_STEPS:
        raise InputError(
            f"--predict {seconds:g} s is not between 1 and {MOST_STEPS} of the recording's frame intervals: give "
            f"{interval:.6g} to {interval * MOST_STEPS:.6g} s"
        )
    return interval * np.arange(1, int(seconds / interval + ROUNDING) + 1)


def write_predictions(
    folder: Path, process: TorqueFreeProcess, histories: Sequence[EstimateHistory], seconds: float
) -> bool:
    """Write prediction.csv of each estimator and prediction.png of all.

    The columns are those of trajectory.csv, and estimators that failed are left out. <estimator>/prediction.npz is the
    history that the picture is drawn from: the last epoch, and all that is predicted from it; it is ``failed`` and holds the
    last epoch alone where the prediction is not finite, and then there is no table.
    Returns False, with no picture, where nothing could be predicted.

    Raises
    ------
    InputError: as `times_ahead`; a file cannot be written.
    """
    good = _sound(histories)
    predicted = [_predicted(process, each, times_ahead(each.time, seconds)) for each in good]
    for each in predicted:
        write_history(folder / each.name / ARRAYS, each)
        if len(each.time) > 1:
            write_trajectory_csv(folder / each.name / TABLE, trajectory_of(_cut(each, slice(1, None))))
        else:
            (folder / each.name / TABLE).unlink(missing_ok=True)
    predicted_motions = _predicted_motion(good, predicted)
    if not predicted_motions:
        (folder / PREDICTION_PICTURE).unlink(missing_ok=True)
        return False
    draw_figure(lambda: prediction_figure(predicted_motions), folder / PREDICTION_PICTURE)
    return True


def read_predictions(folder: Path, histories: Sequence[EstimateHistory]) -> list[PredictionCurves]:
    """Predictions of a run folder for the figure; none where not asked for.

    Raises
    ------
    InputError: a prediction is missing where there are others, damaged, or of another run.
    """
    good = _sound(histories)
    paths = [folder / history.name / ARRAYS for history in good]
    told = [folder / PREDICTION_PICTURE, *paths, *(path.with_name(TABLE) for path in paths)]
    if not good or not any(path.exists() for path in told):
        return []
    return _predicted_motion(good, [_read(path, history) for path, history in zip(paths, good, strict=True)])


def _sound(histories: Sequence[EstimateHistory]) -> list[EstimateHistory]:
    """Evaluations that did not fail."""
    return [history for history in histories if history.status.verdict is not Verdict.FAILED]


def _predicted(
    process: TorqueFreeProcess, history: EstimateHistory, ahead: Float[np.ndarray, " k"]
) -> EstimateHistory:
    """The last epoch, and all that is predicted from it if that is finite."""
    last, now = history.belief(-1), float(history.time[-1])
    rows = GrowingHistory(last.layout, now)
    rows.append(now, last, [], 0.0)
    try:
        prediction = predict_ahead(process, last, ahead)
        if not (np.isfinite(prediction.mean).all() and np.isfinite(prediction.factor).all()):
            return rows.ended(history.name, EstimatorStatus().failed("the prediction is not finite"))
    except NUMERICAL_ERRORS as error:
        return rows.ended(
            history.name, EstimatorStatus().failed(f"no prediction ({reason(numerical(error))})")
        )
    for k, seconds in enumerate(prediction.times):
        rows.append(now + float(seconds), prediction.belief(k), [], 0.0)
    return rows.ended(history.name, EstimatorStatus())


def _read(path: Path, history: EstimateHistory) -> EstimateHistory:
    """The prediction that goes on from a history."""
    predicted = read_history(path, CURE)
    time, mean = predicted.time, predicted.mean
    alike = (predicted.name, predicted.layout) == (history.name, history.layout)
    whole = len(time) > 1 or (len(time) == 1 and predicted.status.verdict is Verdict.FAILED)
    sound = alike and whole and np.isfinite(mean).all() and np.isfinite(predicted.factor).all()
    if not (sound and time[0] == history.time[-1] and np.array_equal(mean[0], history.mean[-1])):
        raise InputError(f"{path_text(path)}: does not go on from the last epoch of this run; {CURE}")
    return predicted


def _predicted_motion(
    histories: Sequence[EstimateHistory], predicted: Sequence[EstimateHistory]
) -> list[PredictionCurves]:
    """Predicted motion with a share of the past in front.

    Rates about the principal axes of the first estimator.
    Those that predict nothing are left out.
    """
    pairs = [pair for pair in zip(histories, predicted, strict=True) if len(pair[1].time) > 1]
    found = []
    for known, ahead in pairs:
        axes = body_estimate(pairs[0][0].belief(-1)).principal_axes_g
        past = PAST * float(ahead.time[-1] - ahead.time[0])
        begin = max(int(np.searchsorted(known.time, known.time[-1] - past)), known.initialisation)
        before = _cut(known, slice(min(begin, len(known.time) - 1), None))
        found.append(
            PredictionCurves(
                trajectory_of(before),
                trajectory_of(ahead),
                estimated_rates(before).in_axes(axes),
                estimated_rates(ahead).in_axes(axes),
            )
        )
    return found


def _cut(history: EstimateHistory, rows: slice) -> EstimateHistory:
    """A history cut to some epochs."""
    beliefs = GrowingHistory(history.layout, float(history.time[0]))
    for k in range(*rows.indices(len(history.time))):
        beliefs.append(float(history.time[k]), history.belief(k), [], 0.0)
    return beliefs.ended(history.name, history.status)
