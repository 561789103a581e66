"""Predictions of a run: tables and arrays of each estimator, pictures, and their errors where the truth goes on."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError, numerical
from spinfilters.evaluation.estimated_motion import estimated_rates, trajectory_of, write_trajectory_csv
from spinfilters.evaluation.estimator_evaluation import Evaluation, not_failed
from spinfilters.evaluation.prediction_errors import (
    UNITS,
    PredictionErrors,
    errors_against_reference,
    errors_ahead,
)
from spinfilters.evaluation.reference_comparison import ReferenceComparison
from spinfilters.filters.history import EstimateHistory, GrowingHistory
from spinfilters.filters.measurement_prediction import predict_ahead
from spinfilters.io.input_file import path_text, read_settings_text, reason
from spinfilters.io.output_files import write_json
from spinfilters.io.text_table import write_csv
from spinfilters.models.body import body_estimate
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.models.status import EstimatorStatus
from spinfilters.plots.prediction_figures import prediction_errors_figure
from spinfilters.plots.time_courses import PAST, PredictionCurves, prediction_figure
from spinfilters.run.array_files import finite_document, read_history, write_history
from spinfilters.run.pictures import Pictures, draw_pictures
from spinfilters.run.run_folder import PREDICTION_ARRAYS as ARRAYS
from spinfilters.run.run_folder import (
    PREDICTION_ERRORS_PICTURE,
    PREDICTION_ERRORS_TABLE,
    PREDICTION_FILE,
    PREDICTION_PICTURE,
)
from spinfilters.run.run_folder import PREDICTION_TABLE as TABLE

SCHEMA: Final = 1

CURE = "run compare again with --resume --predict SECONDS"
MOST_STEPS = 20_000
"""Of a prediction: each keeps a covariance factor."""
ROUNDING = 1e-6
"""Of a step: time stamps are printed with six decimals."""
CLOSE = 1e-3
"""Of a step: a stamp of the truth counts as a step that is so near."""


def times_ahead(time: Float[np.ndarray, " n"], seconds: float) -> Float[np.ndarray, " k"]:
    """Times ahead of the last epoch, s.

    Steps of the median interval of a recording's frames (s) up to so many seconds.

    Raises
    ------
    InputError
        Less than one step, or more than `MOST_STEPS`.
    """
    interval = float(np.median(np.diff(time)))
    if not interval * (1 - ROUNDING) <= seconds <= interval * MOST_STEPS:
        raise InputError(
            f"--predict {seconds:g} s is not between 1 and {MOST_STEPS} of the recording's frame intervals: give "
            f"{interval:.6g} to {interval * MOST_STEPS:.6g} s"
        )
    return interval * np.arange(1, int(seconds / interval + ROUNDING) + 1)


def stamps_ahead(
    time: Float[np.ndarray, " n"], seconds: float, compared: Float[np.ndarray, " m"]
) -> Float[np.ndarray, " k"]:
    """Times ahead of the last epoch, s: those of `times_ahead`, and the stamps (s) at which a truth gives the motion.

    Where a truth has more rows than a prediction may have steps, every so many of them are taken.

    Raises
    ------
    InputError
        As `times_ahead`.
    """
    steps = times_ahead(time, seconds)
    interval, now = float(steps[0]), float(time[-1])
    told = compared - now
    told = told[(told > CLOSE * interval) & (told <= steps[-1] + CLOSE * interval)]
    told = told[:: max(1, -(-len(told) // MOST_STEPS))]
    if not len(told):
        return steps
    after = np.clip(np.searchsorted(told, steps), 1, max(len(told) - 1, 1))
    apart = np.minimum(
        np.abs(told[np.minimum(after, len(told) - 1)] - steps), np.abs(told[after - 1] - steps)
    )
    return np.union1d(told, steps[apart > CLOSE * interval])


def write_predictions(
    folder: Path,
    process: TorqueFreeProcess,
    evaluations: Sequence[Evaluation],
    seconds: float,
    references: Mapping[str, ReferenceComparison] = MappingProxyType({}),
    with_figures: bool = True,
) -> list[str]:
    """Write prediction.csv of each estimator and prediction.png of all, and their errors where the truth goes on.

    The columns are those of trajectory.csv, and estimators that failed are left out. <estimator>/prediction.npz is the
    history that the picture is drawn from: the last epoch, and all that is predicted from it; it is ``failed`` and holds the
    last epoch alone where the prediction is not finite, and then there is no table. Where the truth, or else a reference, has rows
    after the last epoch, these are among what is predicted, and prediction.json, <estimator>/prediction_errors.csv and
    prediction-errors.png hold the errors with their stated deviations and NEES.
    Returns the names of the pictures; none where nothing could be predicted.

    Parameters
    ----------
    folder : Path
        Of the run.
    process : TorqueFreeProcess
        Of the run.
    evaluations : sequence of Evaluation
        Of its estimators.
    seconds : float
        To predict, s.
    references : mapping
        Comparisons of estimators with a reference, by name; one judges where there is no truth.
    with_figures : bool
        Whether the pictures are drawn.

    Raises
    ------
    InputError
        As `times_ahead`; a file cannot be written.
    """
    good = not_failed(evaluations)
    predicted = []
    for each in good:
        stamps = np.empty(0) if each.truth is None else each.truth.time
        ahead = stamps_ahead(each.history.time, seconds, stamps)
        predicted.append(predict_history(process, each.history, ahead))
    for each in predicted:
        write_history(folder / each.name / ARRAYS, each)
        if len(each.time) > 1:
            write_trajectory_csv(
                folder / each.name / TABLE, trajectory_of(_cut_history(each, slice(1, None)))
            )
        else:
            (folder / each.name / TABLE).unlink(missing_ok=True)
    compared = _compared(good, predicted, references)
    _write_errors(folder, seconds, good, compared)
    pictures = _figures(good, predicted, compared) if with_figures else {}
    for name in (PREDICTION_PICTURE, PREDICTION_ERRORS_PICTURE):
        if name not in pictures:
            (folder / name).unlink(missing_ok=True)  # of an earlier prediction
    return draw_pictures(folder, pictures)


def is_predicted(folder: Path) -> bool:
    """Whether any estimator of a run folder predicts more than its last epoch."""
    return any(folder.glob(f"*/{TABLE}"))


def prediction_figures(
    folder: Path,
    evaluations: Sequence[Evaluation],
    references: Mapping[str, ReferenceComparison] = MappingProxyType({}),
) -> Pictures:
    """Pictures of the predictions of a run folder; none where there are none.

    Raises
    ------
    InputError
        A prediction is missing where there are others, damaged, or of another run.
    """
    good = not_failed(evaluations)
    paths = [folder / each.name / ARRAYS for each in good]
    told = [folder / PREDICTION_PICTURE, *paths, *(path.with_name(TABLE) for path in paths)]
    if not good or not any(path.exists() for path in told):
        return {}
    predicted = [_read_prediction(path, each.history) for path, each in zip(paths, good, strict=True)]
    return _figures(good, predicted, _compared(good, predicted, references))


def _figures(
    good: Sequence[Evaluation],
    predicted: Sequence[EstimateHistory],
    compared: Mapping[str, PredictionErrors],
) -> Pictures:
    """The predictions, and their errors where there are any."""
    motions = _predicted_motion([each.history for each in good], predicted)
    found: dict[str, Callable[[], Figure]] = {}
    if motions:
        found[PREDICTION_PICTURE] = lambda: prediction_figure(motions)
    if compared:
        found[PREDICTION_ERRORS_PICTURE] = lambda: prediction_errors_figure(compared)
    return found


def _compared(
    good: Sequence[Evaluation],
    predicted: Sequence[EstimateHistory],
    references: Mapping[str, ReferenceComparison],
) -> dict[str, PredictionErrors]:
    """Errors of every prediction against the truth, or else the reference."""
    without_truth = [ahead for each, ahead in zip(good, predicted, strict=True) if each.truth is None]
    return _compared_with_truth(good, predicted) | _compared_with_references(without_truth, references)


def _compared_with_truth(
    good: Sequence[Evaluation], predicted: Sequence[EstimateHistory]
) -> dict[str, PredictionErrors]:
    """Errors of every prediction that the truth can judge, by estimator: a truth that cannot ends no run."""
    found = {}
    for evaluation, ahead in zip(good, predicted, strict=True):
        try:
            with np.errstate(all="ignore"):
                errors = errors_ahead(ahead, evaluation)
        except (*NUMERICAL_ERRORS, InputError):
            continue
        if errors is not None:
            found[evaluation.name] = errors
    return found


def _compared_with_references(
    predicted: Sequence[EstimateHistory], references: Mapping[str, ReferenceComparison]
) -> dict[str, PredictionErrors]:
    """Errors of every prediction that a reference can judge, as it was fitted over the measurements; what cannot ends no run."""
    found = {}
    for ahead in predicted:
        judge = references.get(ahead.name)
        if judge is None:
            continue
        try:
            with np.errstate(all="ignore"):
                errors = errors_against_reference(ahead, judge.reference, judge.fit)
        except (*NUMERICAL_ERRORS, InputError):
            continue
        if errors is not None:
            found[ahead.name] = errors
    return found


def _write_errors(
    folder: Path, seconds: float, good: Sequence[Evaluation], compared: Mapping[str, PredictionErrors]
) -> None:
    for each in good:
        path = folder / each.name / PREDICTION_ERRORS_TABLE
        if each.name in compared:
            _write_table(path, compared[each.name])
        else:
            path.unlink(missing_ok=True)
    estimators = {name: errors.document for name, errors in compared.items()}
    document = {"schema": SCHEMA, "asked_s": seconds, "estimators": estimators}
    write_json(folder / PREDICTION_FILE, finite_document(document))


def _write_table(path: Path, errors: PredictionErrors) -> None:
    """Errors and deviations at every stamp, SI units; NaN for a NEES that there is not."""
    names, columns = ["ahead_s"], [errors.ahead]
    for name in (name for name in UNITS if name in errors.courses):
        course = errors.courses[name]
        for kind, block in (("error", course.error), ("std", course.std)):
            names += [f"{kind}_{name}_{axis}" for axis in "xyz"]
            columns += list(block.T)
    ratio = errors.ratio
    names.append("nees_per_dof")
    columns.append(np.full(len(errors.ahead), np.nan) if ratio is None else ratio)
    write_csv(path, names, columns)


def prediction_lines(folder: Path) -> list[str]:
    """Lines for the terminal on the errors of a folder's predictions; none where the file is missing or damaged."""
    try:
        document = json.loads(read_settings_text(folder / PREDICTION_FILE))
        return [_line(name, found) for name, found in document["estimators"].items()]
    except (InputError, ValueError, KeyError, TypeError, RecursionError):
        return []


def _line(name: str, found: Mapping[str, Any]) -> str:
    """Errors at the end of a prediction against what it states."""
    scales = {
        "m": (1e3, "mm"),
        "rad": (180 / np.pi, "deg"),
        "m/s": (1e3, "mm/s"),
        "rad/s": (180 / np.pi, "deg/s"),
    }
    parts = []
    for quantity, values in found["errors"].items():
        scale, unit = scales[values["unit"]]
        parts.append(
            f"{quantity} {scale * values['end']:.3g} {unit} ({scale * values['end_std']:.3g} stated)"
        )
    head = (
        f"prediction of {name} against {found['judge']}, after {found['seconds']:.4g} s: {', '.join(parts)}"
    )
    if found["nees_per_dof_end"] is None:
        return f"{head}; no NEES: {found['nees_missing']}"
    low, high = found["nees_band_95"]
    return f"{head}; NEES per dof {found['nees_per_dof_end']:.2f} ({low:.2f} to {high:.2f} expected)"


def predict_history(
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


def _read_prediction(path: Path, history: EstimateHistory) -> EstimateHistory:
    """The prediction that goes on from a history."""
    predicted = read_history(path, CURE)
    time, mean = predicted.time, predicted.mean
    alike = (predicted.name, predicted.layout) == (history.name, history.layout)
    whole = len(time) > 1 or (len(time) == 1 and predicted.has_failed)
    sound = alike and whole and np.isfinite(mean).all() and np.isfinite(predicted.factor).all()
    if not (sound and time[0] == history.time[-1] and np.array_equal(mean[0], history.mean[-1])):
        raise InputError(f"{path_text(path)}: does not continue from the last epoch of this run; {CURE}")
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
        before = _cut_history(known, slice(min(begin, len(known.time) - 1), None))
        found.append(
            PredictionCurves(
                trajectory_of(before),
                trajectory_of(ahead),
                estimated_rates(before).in_axes(axes),
                estimated_rates(ahead).in_axes(axes),
            )
        )
    return found


def _cut_history(history: EstimateHistory, rows: slice) -> EstimateHistory:
    """A history cut to some epochs."""
    beliefs = GrowingHistory(history.layout, float(history.time[0]))
    for k in range(*rows.indices(len(history.time))):
        beliefs.append(float(history.time[k]), history.belief(k), [], 0.0)
    return beliefs.ended(history.name, history.status)
