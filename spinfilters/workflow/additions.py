"""What a run writes only when asked to: a prediction ahead, and how the smoother's estimates settle."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from spinfilters.errors import InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.logs.truth import Truth
from spinfilters.plots.convergence import convergence_figure
from spinfilters.plots.prediction import prediction_figure
from spinfilters.workflow import convergence, prediction
from spinfilters.workflow.estimation import Comparison
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.settings import Settings


@dataclass(frozen=True)
class Additions:
    """Seconds to predict ahead, None for none; whether to show convergence."""

    predict_s: float | None = None
    convergence: bool = False

    def require_one_run(self) -> None:
        """Refuse what a run of many segments does not make."""
        if self.predict_s is not None or self.convergence:
            raise InputError(
                "--predict and --convergence are for one recording; choose a segment with --segment N"
            )

    def check(self, prepared: Prepared, settings: Settings) -> None:
        """Refuse what cannot be made, before the estimators run. Raises InputError."""
        if self.predict_s is not None:
            prediction.times_ahead(np.array([frame.time for frame in prepared.timeline]), self.predict_s)
        if self.convergence:
            convergence.require_convergence(prepared, settings)

    def write(
        self, folder: Path, comparison: Comparison, settings: Settings, on_frame: Callable[[int, int], None]
    ) -> None:
        """Into the folder of a run that was written. Raises InputError."""
        if self.predict_s is not None:
            histories = [evaluation.history for evaluation in comparison.evaluations]
            process = comparison.prepared.process
            prediction.write_predictions(folder, process, histories, self.predict_s)
        if self.convergence:
            convergence.write_convergence(folder, comparison.prepared, settings, on_frame)

    def missing(self, folder: Path) -> bool:
        """Whether a finished run lacks some of it; of a prediction it is not known how far it goes."""
        wanted = {convergence.PICTURE} if self.convergence else set()
        return self.predict_s is not None or any(not (folder / name).exists() for name in wanted)


def drawn_additions(
    folder: Path, histories: Sequence[EstimateHistory], truth: Truth | None
) -> dict[str, Callable[[], Figure]]:
    """What draws the additions of a run folder, by file name.

    Raises
    ------
    InputError: a file that one is drawn from is missing or damaged.
    """
    foretold = prediction.read_predictions(folder, histories)
    settled = convergence.read_convergence(folder, truth)
    figures: dict[str, Callable[[], Figure]] = {}
    if foretold:
        figures[prediction.PICTURE] = lambda: prediction_figure(foretold)
    if settled is not None:
        figures[convergence.PICTURE] = lambda: convergence_figure(settled)
    return figures
