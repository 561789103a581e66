"""Outputs of a run that are asked for: predictions, convergence of the smoother, explanations of residuals."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.inference.setup import Setup
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import read_settings_text
from spinfilters.io.output_files import write_text
from spinfilters.io.reference_motion import ReferenceMotion
from spinfilters.io.truth import Truth
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.run import smoother_convergence
from spinfilters.run.array_files import finite_document
from spinfilters.run.estimation import Comparison, compare_estimators
from spinfilters.run.pictures import Pictures, draw_pictures
from spinfilters.run.predictions import (
    is_predicted,
    prediction_figures,
    prediction_lines,
    race_figures,
    require_inertias,
    times_ahead,
    write_predictions,
    write_race,
)
from spinfilters.run.preparation import prepare
from spinfilters.run.reference_output import (
    ReferenceComparisons,
    compare_histories,
    kept_reference,
    reference_figures,
    reference_lines,
    write_reference,
)
from spinfilters.run.run_folder import (
    CONVERGENCE_PICTURE,
    EXPLANATIONS_FILE,
    REFERENCE_FILE,
    read_figure_data,
    read_histories,
)
from spinfilters.run.run_summary import read_process
from spinfilters.settings.run_settings import Settings
from spinfilters.verdict.checks import base_name
from spinfilters.verdict.model_errors.alternatives import Alternative
from spinfilters.verdict.model_errors.score_tests import ScoreTest
from spinfilters.verdict.tested_models import TestedModels, model_findings

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
        return beside or ["explain: no error of the models was found"]
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
    """Optional outputs: seconds to predict, convergence, model errors, comparison with a reference, inertias to race.

    None for no prediction; whether to show convergence; whether to refit with named model errors; None for no reference;
    estimators, ``truth`` or files whose inertias are propagated from one state.
    """

    predict_s: float | None = None
    convergence: bool = False
    explain: bool = False
    reference: ReferenceMotion | None = None
    race: tuple[str, ...] = ()

    def require_one_run(self) -> None:
        """Refuse what a run of many segments does not make."""
        if self != OptionalOutputs():
            raise InputError(
                "--predict, --convergence, --explain, --reference and --race are for one recording; choose a segment with "
                "--segment N"
            )

    def check(self, setup: Setup, settings: Settings) -> None:
        """Refuse what cannot be made, before the estimators run. Raises InputError."""
        if self.predict_s is not None:
            times_ahead(np.array([epoch.time for epoch in setup.timeline]), self.predict_s)
        self._check_race(settings)
        if self.convergence:
            smoother_convergence.require_convergence(setup, settings)

    def _check_race(self, settings: Settings) -> None:
        if self.race and self.predict_s is None:
            raise InputError("--race needs the time of the race; give --predict SECONDS")
        require_inertias(self.race, settings.estimators)

    def write(
        self,
        folder: Path,
        comparison: Comparison,
        settings: Settings,
        on_epoch: Callable[[int, int], None],
        with_figures: bool = True,
    ) -> None:
        """Write into the folder of a written run; `lacking` lists what could not be made. Raises InputError."""
        evaluations = comparison.evaluations
        compared = None
        if self.reference is not None:  # once for its own files and for predictions
            compared = compare_histories([each.history for each in evaluations], self.reference)
        if self.predict_s is not None:
            self._write_predictions(
                folder, comparison.setup.process, evaluations, self.predict_s, compared, with_figures
            )
        if self.convergence:
            smoother_convergence.write_convergence(folder, comparison.setup, settings, on_epoch, with_figures)
        if self.explain:
            write_explanations(folder, comparison, settings)
        if compared is not None:
            write_reference(folder, compared, with_figures)

    def _write_predictions(
        self,
        folder: Path,
        process: TorqueFreeProcess,
        evaluations: Sequence[Evaluation],
        seconds: float,
        compared: ReferenceComparisons | None,
        with_figures: bool,
    ) -> list[str]:
        """Predictions and races; returns the names of the pictures."""
        references = {} if compared is None else compared.found
        drawn = write_predictions(folder, process, evaluations, seconds, references, with_figures)
        if self.race:
            drawn += write_race(folder, self.race, evaluations, seconds, references, with_figures)
        return drawn

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
        made: its seconds may be others than before. The reference of an earlier call judges it where no other is given.

        Raises
        ------
        InputError
            As `check`; a file of the run is damaged.
        """
        made = []
        self._check_race(settings)
        if self.convergence and not smoother_convergence.is_recorded(folder):
            setup = prepare(dataset, settings)
            self.check(setup, settings)
            smoother_convergence.write_convergence(folder, setup, settings, on_epoch, with_figures)
            made += [CONVERGENCE_PICTURE] if with_figures else []
        elif self.convergence and with_figures and not (folder / CONVERGENCE_PICTURE).exists():
            made += _draw_convergence(folder, dataset.truth)
        if self.explain and not (folder / EXPLANATIONS_FILE).exists():
            own = compare_estimators(prepare(dataset, settings), settings, lambda *_: None)
            write_explanations(folder, own, settings)
            made.append(EXPLANATIONS_FILE)
        reference = kept_reference(folder) if self.reference is None else self.reference
        compared = None
        if reference is not None and (self.reference is not None or self.predict_s is not None):
            compared = compare_histories(read_histories(folder, settings.estimators), reference)
        if self.predict_s is not None:
            process = read_process(folder, settings.process.tolerance)
            evaluations = read_figure_data(folder).evaluations
            made += self._write_predictions(
                folder, process, evaluations, self.predict_s, compared, with_figures
            )
        if self.reference is not None and compared is not None:
            made += write_reference(folder, compared, with_figures)
        return made

    def sentences(self, folder: Path) -> Sequence[str]:
        """Sentences of a run's explanations, predictions and reference; none where they were not asked for."""
        told = list(read_sentences(folder)) if self.explain else []
        if self.predict_s is not None:
            told += prediction_lines(folder)
        if self.reference is not None:
            told += reference_lines(json.loads(read_settings_text(folder / REFERENCE_FILE)))
        return told

    def lacking(self, folder: Path) -> str | None:
        """Requested outputs that a folder lacks, and why; None where nothing is missing."""
        if self.predict_s is None or is_predicted(folder):
            return None
        return "no prediction was made: every estimator failed, or the prediction is not finite"


def optional_figures(folder: Path, evaluations: Sequence[Evaluation], truth: Truth | None) -> Pictures:
    """Pictures of predictions, race, reference and convergence whose numbers a run folder holds.

    Raises
    ------
    InputError
        A file that one is drawn from is missing or damaged.
    """
    compared = _kept_comparisons(folder, evaluations)
    return {
        **prediction_figures(folder, evaluations, {} if compared is None else compared.found),
        **race_figures(folder),
        **({} if compared is None else reference_figures(compared)),
        **smoother_convergence.convergence_figures(folder, truth),
    }


def draw_optional_outputs(folder: Path, evaluations: Sequence[Evaluation], truth: Truth | None) -> list[str]:
    """Draw the additions of a run folder again; returns the names of the pictures.

    Raises
    ------
    InputError
        A file that one is drawn from is missing or damaged; what else there is has been drawn.
    """

    kept_comparisons = cache(partial(_kept_comparisons, folder, evaluations))  # a reference is fitted once

    def draw_predictions() -> list[str]:
        compared = kept_comparisons()
        found = {} if compared is None else compared.found
        return draw_pictures(folder, prediction_figures(folder, evaluations, found))

    def draw_reference() -> list[str]:
        compared = kept_comparisons()
        return [] if compared is None else draw_pictures(folder, reference_figures(compared))

    drawn: list[str] = []
    faults: list[InputError] = []
    for draw in (
        draw_predictions,
        lambda: draw_pictures(folder, race_figures(folder)),
        draw_reference,
        lambda: _draw_convergence(folder, truth),
    ):
        try:
            drawn += draw()
        except InputError as error:
            faults.append(error)
    if faults:
        raise faults[0]
    return drawn


def _kept_comparisons(folder: Path, evaluations: Sequence[Evaluation]) -> ReferenceComparisons | None:
    """Estimators against the reference that a run folder keeps; None without one."""
    reference = kept_reference(folder)
    return None if reference is None else compare_histories([each.history for each in evaluations], reference)


def _draw_convergence(folder: Path, truth: Truth | None) -> list[str]:
    return [CONVERGENCE_PICTURE] if smoother_convergence.redraw_convergence(folder, truth) else []
