"""Predictions of a run: tables and arrays of each estimator, pictures, and their errors where the truth goes on.

In a race, several inertias are propagated from the last state of the run's first estimator.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from types import MappingProxyType
from typing import Any, Final
from zipfile import ZIP_DEFLATED

import numpy as np
from jaxtyping import Float, Int
from matplotlib.figure import Figure

from spinfilters.core.attitude_conversions import inverse, rotate
from spinfilters.core.errors import NUMERICAL_ERRORS, InputError, numerical
from spinfilters.core.polhode import validate_principal_moments
from spinfilters.evaluation.estimated_motion import estimated_rates, trajectory_of, write_trajectory_csv
from spinfilters.evaluation.estimator_evaluation import Evaluation, not_failed
from spinfilters.evaluation.prediction_errors import (
    UNITS,
    NamedInertia,
    PredictionErrors,
    PropagatedInertia,
    errors_against_reference,
    errors_ahead,
    propagate_inertias,
    truth_in_frames_of,
)
from spinfilters.evaluation.reference_comparison import MotionInFrames, ReferenceComparison
from spinfilters.evaluation.trajectory_errors import common_stamps
from spinfilters.filters.history import EstimateHistory, GrowingHistory
from spinfilters.filters.measurement_prediction import predict_ahead
from spinfilters.io.document import numbers
from spinfilters.io.input_file import path_text, read_settings_text, read_toml, reason, value_text
from spinfilters.io.output_files import write_json
from spinfilters.io.text_table import write_csv
from spinfilters.io.truth import Truth
from spinfilters.models.body import body_estimate
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.models.status import EstimatorStatus
from spinfilters.plots.reference_figures import inertia_race_figure, prediction_errors_figure
from spinfilters.plots.time_courses import PAST, PredictionCurves, prediction_figure
from spinfilters.run.array_files import (
    DAMAGED,
    finite_document,
    read_arrays,
    read_history,
    unusable,
    write_arrays,
    write_history,
)
from spinfilters.run.pictures import Pictures, draw_pictures
from spinfilters.run.run_folder import PREDICTION_ARRAYS as ARRAYS
from spinfilters.run.run_folder import (
    PREDICTION_ERRORS_PICTURE,
    PREDICTION_ERRORS_TABLE,
    PREDICTION_FILE,
    PREDICTION_PICTURE,
    RACE_ARRAYS,
    RACE_FILE,
    RACE_PICTURE,
    RACE_TABLE,
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


RACE_CURE: Final = "run compare again with --resume --predict SECONDS --race NAMES"
TRUTH: Final = "truth"
TRUE_MOTION: Final = "the true motion"
KEYS: Final = ("principal_moments", "principal_axes_g", "inertia_g")


def require_inertias(names: Sequence[str], estimators: Sequence[str]) -> None:
    """Refuse names that are neither estimators of the run nor ``truth`` nor files of an inertia. Raises InputError."""
    for name in names:
        if name != TRUTH and name not in estimators:
            _read_inertia(name, np.eye(3))


def write_race(
    folder: Path,
    names: Sequence[str],
    evaluations: Sequence[Evaluation],
    seconds: float,
    references: Mapping[str, ReferenceComparison] = MappingProxyType({}),
    with_figures: bool = True,
) -> list[str]:
    """Write race.json, race.csv, race.npz and race.png; returns the names of the pictures.

    All start from the attitude and rate of the first estimator after the last measurement. They are compared with the truth where
    it goes on, else with the attitudes of a reference that does, else with the first of them.

    Raises
    ------
    InputError
        A file of an inertia cannot be used, or one of the run cannot be written.
    """
    good = not_failed(evaluations)
    if not good:
        return []
    first = good[0]
    belief, now = first.history.belief(-1), float(first.history.time[-1])
    layout = belief.layout
    attitude, rate = belief.mean[layout.mean_slice("a")], belief.mean[layout.mean_slice("w")]
    truth = truth_in_frames_of(first)
    inertias = _inertias(names, good, truth)
    if not inertias:  # of estimators that failed
        return []
    time, reference = np.r_[0.0, stamps_ahead(first.history.time, seconds, np.empty(0))], None
    for name, motion in _motions_to_compare_with(truth, references.get(first.name)):
        stamps = stamps_ahead(first.history.time, seconds, motion.time)
        rows = _rows_at(motion, np.r_[now, now + stamps])
        if rows is not None:
            chosen = motion.at(rows)
            time, reference = chosen.time - now, PropagatedInertia(name, chosen.attitude, chosen.rate)
            break
    found = propagate_inertias(inertias, attitude, rate, time)
    reference = found[0] if reference is None else reference
    compared_with = TRUE_MOTION if reference.name == TRUTH and reference is not found[0] else reference.name
    _write(folder, compared_with, time, found, reference, first.name)
    if not with_figures:
        (folder / RACE_PICTURE).unlink(missing_ok=True)  # of an earlier race
        return []
    return draw_pictures(folder, race_figures(folder))


def race_figures(folder: Path) -> Pictures:
    """The picture of a run's race; none where there was no race.

    Raises
    ------
    InputError
        Its arrays are damaged.
    """
    path = folder / RACE_ARRAYS
    if not path.exists():
        return {}
    try:
        arrays = read_arrays(path)
        time, names = np.asarray(arrays["time"], dtype=float), list(map(str, arrays["names"]))
        attitude, rate = (np.asarray(arrays[name], dtype=float) for name in ("attitude", "rate"))
        alike = attitude.shape == (len(names), len(time), 4) and rate.shape == (len(names), len(time), 3)
        if len(names) < 2 or not (alike and all(np.isfinite(each).all() for each in (time, attitude, rate))):
            raise ValueError("its rows do not belong together")
    except DAMAGED as error:
        raise unusable(path, "race of a run", error, RACE_CURE) from None
    *found, reference = map(PropagatedInertia, names, attitude, rate)
    return {RACE_PICTURE: lambda: inertia_race_figure(time, found, reference)}


def _inertias(names: Sequence[str], good: Sequence[Evaluation], truth: Truth | None) -> list[NamedInertia]:
    """The inertias of the names; of a file without axes about the principal axes of the first estimator.

    An estimator's is that of its last state, to which attitude and rate belong, not the mean of a sampled posterior.
    """
    bodies = {each.name: body_estimate(each.history.belief(-1)) for each in good}
    axes = bodies[good[0].name].principal_axes_g
    found = []
    for name in names:
        if name == TRUTH:
            if truth is None or truth.principal_moments is None or truth.principal_axes_g is None:
                raise InputError(
                    "--race truth needs moments and axes of the truth; give principal_moments and principal_axes_g in truth.toml"
                )
            found.append(NamedInertia(name, truth.principal_moments, truth.principal_axes_g))
        elif name in bodies:
            found.append(NamedInertia(name, bodies[name].principal_moments, bodies[name].principal_axes_g))
        elif Path(name).exists():
            found.append(_read_inertia(name, axes))
    return found


def _read_inertia(name: str, axes: Float[np.ndarray, "3 3"]) -> NamedInertia:
    """The inertia of a TOML file with `KEYS`; moments without axes are in ascending order about the given ones."""
    path = Path(name)
    if not path.is_file():
        raise InputError(
            f"--race {value_text(name)} is no estimator of the run and no file; give estimators, truth or TOML files with "
            f"{', '.join(KEYS)}"
        )
    document = read_toml(path)
    unknown = [key for key in document if key not in KEYS]
    if unknown or ("inertia_g" in document) == ("principal_moments" in document):
        raise InputError(
            f"{path_text(path)}: give principal_moments (and principal_axes_g), or inertia_g, three rows in axes g"
        )
    if "inertia_g" in document:
        J = numbers(path, "inertia_g", document["inertia_g"], (3, 3))
        if not np.allclose(J, J.T, rtol=1e-6, atol=1e-9 * np.abs(J).max()):
            raise InputError(f"{path_text(path)}: inertia_g is not symmetric; correct it")
        moments, vectors = np.linalg.eigh((J + J.T) / 2)
        axes = vectors.T * np.sign(np.linalg.det(vectors))
    else:
        moments = numbers(path, "principal_moments", document["principal_moments"], (3,))
        if "principal_axes_g" in document:
            axes = numbers(path, "principal_axes_g", document["principal_axes_g"], (3, 3))
            if not np.allclose(axes @ axes.T, np.eye(3), atol=1e-4) or np.linalg.det(axes) < 0:
                raise InputError(
                    f"{path_text(path)}: principal_axes_g are not right-handed unit axes; give them as rows"
                )
        else:
            moments = np.sort(moments)
    try:
        return NamedInertia(path.stem, validate_principal_moments(moments), axes)
    except InputError as error:
        raise InputError(f"{path_text(path)}: {error}") from None


def _motions_to_compare_with(
    truth: Truth | None, compared: ReferenceComparison | None
) -> Iterator[tuple[str, MotionInFrames]]:
    """The truth, then the reference, each with its name, in the frames of the first estimator."""
    if truth is not None:
        yield TRUTH, MotionInFrames(truth.time, truth.q_ig, rotate(inverse(truth.q_ig), truth.rate_i))
    found = None if compared is None else compared.motion_in_estimate_frames()
    if compared is not None and found is not None:
        yield PurePath(compared.reference.name).name, found


def _rows_at(motion: MotionInFrames, time: Float[np.ndarray, " k"]) -> Int[np.ndarray, " m"] | None:
    """Rows of a motion at the times, s; None where it has fewer than two of them."""
    try:
        _, rows = common_stamps(time, motion.time)
    except InputError:
        return None
    return rows if len(rows) >= 2 else None


def _write(
    folder: Path,
    compared_with: str,
    time: Float[np.ndarray, " k"],
    found: Sequence[PropagatedInertia],
    reference: PropagatedInertia,
    state: str,
) -> None:
    names, columns, document = ["ahead_s"], [time], {}
    for each in found:
        angle, rate = each.angle_from(reference.attitude), each.rate_from(reference.rate)
        names += [f"{each.name}_angle_rad", f"{each.name}_rate_rad_s"]
        columns += [angle, rate]
        document[each.name] = {
            "angle_end_rad": float(angle[-1]),
            "angle_largest_rad": float(angle.max()),
            "rate_end_rad_s": float(rate[-1]),
            "rate_largest_rad_s": float(rate.max()),
        }
    write_csv(folder / RACE_TABLE, names, columns)
    every = (*found, reference)
    write_arrays(
        folder / RACE_ARRAYS,
        {
            "time": time,
            "names": np.array([each.name for each in every]),
            "attitude": np.stack([each.attitude for each in every]),
            "rate": np.stack([each.rate for each in every]),
        },
        ZIP_DEFLATED,
    )
    write_json(
        folder / RACE_FILE,
        {
            "schema": SCHEMA,
            "state": state,
            "compared_with": compared_with,
            "seconds": float(time[-1]),
            "inertias": document,
        },
    )
