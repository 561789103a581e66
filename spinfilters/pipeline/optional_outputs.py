"""Outputs that a run writes only when asked to.

A prediction ahead, and how the smoother's estimates settle.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spinfilters.data.dataset import Dataset
from spinfilters.data.truth import Truth
from spinfilters.errors import InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.pipeline import predictions, smoother_convergence
from spinfilters.pipeline.estimation import Comparison, compare_estimators
from spinfilters.pipeline.explanations import read_sentences, write_explanations
from spinfilters.pipeline.preparation import prepare
from spinfilters.pipeline.setup import Setup
from spinfilters.plots.convergence import convergence_figure
from spinfilters.plots.prediction import prediction_figure
from spinfilters.plots.style import draw_figure
from spinfilters.runs.run_folder import (
    CONVERGENCE_PICTURE,
    EXPLANATIONS_FILE,
    PREDICTION_PICTURE,
    read_histories,
)
from spinfilters.runs.run_summary import read_process
from spinfilters.settings.run_settings import Settings


@dataclass(frozen=True)
class OptionalOutputs:
    """Optional outputs: seconds to predict, convergence, model errors.

    None for no prediction; whether to show convergence; whether to refit with named model errors.
    """

    predict_s: float | None = None
    convergence: bool = False
    explain: bool = False

    def require_one_run(self) -> None:
        """Refuse what a run of many segments does not make."""
        if self.predict_s is not None or self.convergence or self.explain:
            raise InputError(
                "--predict, --convergence and --explain are for one recording; choose a segment with --segment N"
            )

    def check(self, setup: Setup, settings: Settings) -> None:
        """Refuse what cannot be made, before the estimators run. Raises InputError."""
        if self.predict_s is not None:
            predictions.times_ahead(np.array([epoch.time for epoch in setup.timeline]), self.predict_s)
        if self.convergence:
            smoother_convergence.require_convergence(setup, settings)

    def write(
        self, folder: Path, comparison: Comparison, settings: Settings, on_epoch: Callable[[int, int], None]
    ) -> None:
        """Write into the folder of a written run.

        `lacking` tells what came to nothing. Raises InputError.
        """
        if self.predict_s is not None:
            histories = [evaluation.history for evaluation in comparison.evaluations]
            process = comparison.setup.process
            predictions.write_predictions(folder, process, histories, self.predict_s)
        if self.convergence:
            smoother_convergence.write_convergence(folder, comparison.setup, settings, on_epoch)
        if self.explain:
            write_explanations(folder, comparison, settings)

    def complete(
        self, folder: Path, dataset: Dataset, settings: Settings, on_epoch: Callable[[int, int], None]
    ) -> list[str]:
        """For a finished run (`finished_run`), no estimator running again; returns the names of the pictures made.

        Convergence is made where it is not whole. A prediction, which goes on from the last beliefs of the histories, is always
        made: its seconds may be others than before.

        Raises
        ------
        InputError: as `check`; a file of the run is damaged.
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
            if predictions.write_predictions(folder, process, histories, self.predict_s):
                made.append(PREDICTION_PICTURE)
        return made

    def sentences(self, folder: Path) -> Sequence[str]:
        """Sentences of a run's explanations; none where they were not asked for."""
        return read_sentences(folder) if self.explain else []

    def lacking(self, folder: Path) -> str | None:
        """Requested outputs that a folder lacks, and why.

        None where nothing is missing.
        """
        if self.predict_s is None or (folder / PREDICTION_PICTURE).exists():
            return None
        return "no prediction was made: every estimator failed, or what follows from its last epoch is not finite"


def draw_optional_outputs(
    folder: Path, histories: Sequence[EstimateHistory], truth: Truth | None
) -> list[str]:
    """Draw the additions of a run folder again; returns the names of the pictures.

    Raises
    ------
    InputError: a file that one is drawn from is missing or damaged; what else there is has been drawn.
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
    predicted_motions = predictions.read_predictions(folder, histories)
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
