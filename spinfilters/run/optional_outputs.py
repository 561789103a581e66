"""Outputs of a run that are asked for: predictions, convergence of the smoother, explanations of residuals."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError, numerical
from spinfilters.evaluation.estimated_motion import estimated_rates, trajectory_of, write_trajectory_csv
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.filters.history import EstimateHistory, GrowingHistory
from spinfilters.filters.measurement_prediction import predict_ahead
from spinfilters.inference.setup import Setup
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import path_text, read_settings_text, reason
from spinfilters.io.output_files import write_text
from spinfilters.io.reference_motion import ReferenceMotion
from spinfilters.io.truth import Truth
from spinfilters.models.body import body_estimate
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.models.status import EstimatorStatus, Verdict
from spinfilters.plots.convergence import convergence_figure
from spinfilters.plots.style import draw_figure
from spinfilters.plots.time_courses import PAST, PredictionCurves, prediction_figure
from spinfilters.run import smoother_convergence
from spinfilters.run.array_files import finite_document, read_history, write_history
from spinfilters.run.estimation import Comparison, compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.run.reference_output import reference_lines, write_reference
from spinfilters.run.run_folder import (
    CONVERGENCE_PICTURE,
    EXPLANATIONS_FILE,
    PREDICTION_PICTURE,
    REFERENCE_FILE,
    read_histories,
)
from spinfilters.run.run_folder import PREDICTION_ARRAYS as ARRAYS
from spinfilters.run.run_folder import PREDICTION_TABLE as TABLE
from spinfilters.run.run_summary import read_process
from spinfilters.settings.run_settings import Settings
from spinfilters.verdict.check import base_name
from spinfilters.verdict.model_errors.score_tests import Alternative, ScoreTest
from spinfilters.verdict.tested_models import TestedModels, model_findings

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
    InputError
        As `times_ahead`; a file cannot be written.
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
    InputError
        A prediction is missing where there are others, damaged, or of another run.
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


SCHEMA: Final = 1


@dataclass(frozen=True)
class Explanation:
    """A refit with one alternative in the state.

    Attributes
    ----------
    settings : Mapping[str, Mapping[str, Any]]
        That hold it, as tables of the settings file.
    evaluation : Evaluation or None
        Of the estimator that was run again; None where the data set was refused, with the ``refusal``.
    """

    alternative: Alternative
    settings: Mapping[str, Mapping[str, Any]]
    evaluation: Evaluation | None
    refusal: str = ""

    @property
    def sentence(self) -> str:
        """The result in one line."""
        keys = ", ".join(
            f"{table}.{key} = {value}" for table, own in self.settings.items() for key, value in own.items()
        )
        head = f"explain: with {self.alternative.phrase} ({keys})"
        if self.evaluation is None:
            return f"{head} nothing is estimated: {self.refusal}"
        body, status = self.evaluation.body, self.evaluation.history.status
        moments = " ".join(
            f"{value:.4f}+-{std:.1g}"
            for value, std in zip(body.principal_moments, body.principal_moments_std, strict=True)
        )
        return f"{head} the {self.evaluation.name} is {status.verdict}: {self._constant()}moments {moments}"

    def _constant(self) -> str:
        assert self.evaluation is not None
        block = self.alternative.block
        found = None if block is None else self.evaluation.constants.get(block.name)
        if found is None:
            return ""
        numbers = ", ".join(
            f"{value:.3g}+-{std:.1g}" for value, std in zip(found.value, found.std, strict=True)
        )
        return f"{found.block.label} ({numbers}) {found.block.unit}, "

    @property
    def document(self) -> dict[str, Any]:
        """The explanation as its file holds it."""
        evaluation, block = self.evaluation, self.alternative.block
        found = None if evaluation is None or block is None else evaluation.constants.get(block.name)
        status = None if evaluation is None else evaluation.history.status
        return {
            "name": self.alternative.name,
            "settings": {table: dict(own) for table, own in self.settings.items()},
            "estimator": None if evaluation is None else evaluation.name,
            "status": None if status is None else str(status.verdict),
            "reasons": [self.refusal] if status is None else list(status.reasons),
            "value": None if found is None else found.value.tolist(),
            "std": None if found is None else found.std.tolist(),
            "principal_moments": None if evaluation is None else evaluation.body.principal_moments.tolist(),
            "principal_moments_std": None
            if evaluation is None
            else evaluation.body.principal_moments_std.tolist(),
        }


def explanations(comparison: Comparison, settings: Settings) -> tuple[TestedModels, list[Explanation]]:
    """Score tests of a comparison, and refits with named alternatives.

    Its best estimator with each alternative that is named and can be held.
    """
    found = comparison.models
    name = "smoother" if "smoother" in settings.estimators else settings.estimators[0]
    refits = [
        _refit(comparison.setup.dataset, replace(settings, estimators=(name,)), test.error)
        for test in found.named
        if test.error.held_by
    ]
    return found, refits


def write_explanations(folder: Path, comparison: Comparison, settings: Settings) -> None:
    """Tests and refits into `EXPLANATIONS_FILE` of a run folder. InputError: it cannot be written."""
    found, refits = explanations(comparison, settings)
    document = {
        "schema": SCHEMA,
        "contradicted": found.contradicted,
        "named": list(found.names),
        "tests": [_test_document(each) for each in found.tests],
        "refits": [each.document for each in refits],
        "sentences": _sentences(found, refits),
    }
    write_text(folder / EXPLANATIONS_FILE, json.dumps(finite_document(document), indent=1) + "\n")


def read_sentences(folder: Path) -> Sequence[str]:
    """Sentences of the file of a run folder, a line each; none where it is missing or damaged."""
    try:
        document = json.loads(read_settings_text(folder / EXPLANATIONS_FILE))
        return [str(each) for each in document["sentences"]]
    except (InputError, ValueError, KeyError, TypeError, RecursionError):
        return []


def _sentences(found: TestedModels, refits: Sequence[Explanation]) -> list[str]:
    findings = model_findings(found, None)
    beside = [f"explain: {each.reason}" for each in findings if base_name(each.check) != "model-error"]
    if not found.named:
        return beside or ["explain: no error of the models is found"]
    held = [each.sentence for each in refits]
    others = [each.error for each in found.named if not each.error.held_by]
    return [
        *beside,
        *held,
        *(
            f"explain: {each.phrase} is no part of a state; {each.cure_before(found.has_inspector)}"
            for each in others
        ),
    ]


def _refit(dataset: Dataset, settings: Settings, alternative: Alternative) -> Explanation:
    tables = {table: replace(getattr(settings, table), **own) for table, own in alternative.held_by.items()}
    own = replace(settings, **tables)
    try:
        (evaluation,) = compare_estimators(prepare(dataset, own), own, lambda *_: None).evaluations
    except InputError as error:
        return Explanation(alternative, alternative.held_by, None, str(error))
    return Explanation(alternative, alternative.held_by, evaluation)


def _test_document(test: ScoreTest) -> dict[str, Any]:
    return {
        "name": test.error.name,
        "phrase": test.error.phrase,
        "cure": test.error.cure,
        "unit": test.error.unit,
        "size": test.size.tolist(),
        "std": test.std.tolist(),
        "chi_square": test.statistic,
        "dof": test.dof,
        "gain": test.gain,
        "p_value": test.p_value,
    }


@dataclass(frozen=True)
class OptionalOutputs:
    """Optional outputs: seconds to predict, convergence, model errors, comparison with a reference.

    None for no prediction; whether to show convergence; whether to refit with named model errors; None for no reference.
    """

    predict_s: float | None = None
    convergence: bool = False
    explain: bool = False
    reference: ReferenceMotion | None = None

    def require_one_run(self) -> None:
        """Refuse what a run of many segments does not make."""
        if self != OptionalOutputs():
            raise InputError(
                "--predict, --convergence, --explain and --reference are for one recording; choose a segment with --segment N"
            )

    def check(self, setup: Setup, settings: Settings) -> None:
        """Refuse what cannot be made, before the estimators run. Raises InputError."""
        if self.predict_s is not None:
            times_ahead(np.array([epoch.time for epoch in setup.timeline]), self.predict_s)
        if self.convergence:
            smoother_convergence.require_convergence(setup, settings)

    def write(
        self,
        folder: Path,
        comparison: Comparison,
        settings: Settings,
        on_epoch: Callable[[int, int], None],
        with_figures: bool = True,
    ) -> None:
        """Write into the folder of a written run; `lacking` tells what could not be made. Raises InputError."""
        if self.predict_s is not None:
            histories = [evaluation.history for evaluation in comparison.evaluations]
            process = comparison.setup.process
            write_predictions(folder, process, histories, self.predict_s)
        if self.convergence:
            smoother_convergence.write_convergence(folder, comparison.setup, settings, on_epoch)
        if self.explain:
            write_explanations(folder, comparison, settings)
        if self.reference is not None:
            histories = [each.history for each in comparison.evaluations]
            write_reference(folder, histories, self.reference, with_figures)

    def complete(
        self,
        folder: Path,
        dataset: Dataset,
        settings: Settings,
        on_epoch: Callable[[int, int], None],
        with_figures: bool = True,
    ) -> list[str]:
        """For a finished run (`finished_run`), no estimator running again; returns the names of the pictures made.

        Convergence is made where it is not whole. A prediction, which goes on from the last beliefs of the histories, is always
        made: its seconds may be others than before.

        Raises
        ------
        InputError
            As `check`; a file of the run is damaged.
        """
        made = []
        if self.convergence and not smoother_convergence.is_whole(folder):
            setup = prepare(dataset, settings)
            self.check(setup, settings)
            smoother_convergence.write_convergence(folder, setup, settings, on_epoch)
            made.append(CONVERGENCE_PICTURE)
        if self.explain and not (folder / EXPLANATIONS_FILE).exists():
            own = compare_estimators(prepare(dataset, settings), settings, lambda *_: None)
            write_explanations(folder, own, settings)
            made.append(EXPLANATIONS_FILE)
        if self.predict_s is not None:
            histories = read_histories(folder, settings.estimators)
            process = read_process(folder, settings.process.tolerance)
            if write_predictions(folder, process, histories, self.predict_s):
                made.append(PREDICTION_PICTURE)
        if self.reference is not None:
            histories = read_histories(folder, settings.estimators)
            made += write_reference(folder, histories, self.reference, with_figures)
        return made

    def sentences(self, folder: Path) -> Sequence[str]:
        """Sentences of a run's explanations and of its reference; none where they were not asked for."""
        told = list(read_sentences(folder)) if self.explain else []
        if self.reference is not None:
            told += reference_lines(json.loads(read_settings_text(folder / REFERENCE_FILE)))
        return told

    def lacking(self, folder: Path) -> str | None:
        """Requested outputs that a folder lacks, and why; None where nothing is missing."""
        if self.predict_s is None or (folder / PREDICTION_PICTURE).exists():
            return None
        return "no prediction was made: every estimator failed, or what follows from its last epoch is not finite"


def draw_optional_outputs(
    folder: Path, histories: Sequence[EstimateHistory], truth: Truth | None
) -> list[str]:
    """Draw the additions of a run folder again; returns the names of the pictures.

    Raises
    ------
    InputError
        A file that one is drawn from is missing or damaged; what else there is has been drawn.
    """
    drawn: list[str] = []
    faults: list[InputError] = []
    for draw in (lambda: _draw_prediction(folder, histories), lambda: _draw_convergence(folder, truth)):
        try:
            drawn += draw()
        except InputError as error:
            faults.append(error)
    if faults:
        raise faults[0]
    return drawn


def _draw_prediction(folder: Path, histories: Sequence[EstimateHistory]) -> list[str]:
    predicted_motions = read_predictions(folder, histories)
    if not predicted_motions:
        return []
    draw_figure(lambda: prediction_figure(predicted_motions), folder / PREDICTION_PICTURE)
    return [PREDICTION_PICTURE]


def _draw_convergence(folder: Path, truth: Truth | None) -> list[str]:
    settled = smoother_convergence.read_convergence(folder, truth)
    if settled is None:
        return []
    draw_figure(lambda: convergence_figure(settled), folder / CONVERGENCE_PICTURE)
    return [CONVERGENCE_PICTURE]
