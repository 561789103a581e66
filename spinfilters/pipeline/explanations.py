"""Refits with the model errors that score tests name, where the state can hold them."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from spinfilters.data.atomic_write import write_text
from spinfilters.data.dataset import Dataset
from spinfilters.data.input_file import read_settings_text
from spinfilters.errors import InputError
from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.score_test import ScoreTest
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.pipeline.estimation import Comparison, compare_estimators
from spinfilters.pipeline.model_findings import model_findings
from spinfilters.pipeline.preparation import prepare
from spinfilters.pipeline.tested_models import TestedModels
from spinfilters.runs.run_folder import EXPLANATIONS_FILE
from spinfilters.settings.run_settings import Settings
from spinfilters.verdict.check import base_name

SCHEMA: Final = 1


@dataclass(frozen=True)
class Explanation:
    """A refit with one alternative in the state.

    Attributes
    ----------
    settings: that hold it, as tables of the settings file.   evaluation: of the estimator that was run again; None where the data
        set was refused, with the ``refusal``.
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
    write_text(folder / EXPLANATIONS_FILE, json.dumps(_finite(document), indent=1) + "\n")


def read_sentences(folder: Path) -> Sequence[str]:
    """Sentences of the file of a run folder, a line each.

    None where it is not there or damaged.
    """
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


def _finite(value: Any) -> Any:
    """The document with null for what is not finite."""
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
