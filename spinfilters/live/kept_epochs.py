"""What still holds of a live run: the epochs that it has kept are estimated and judged as a recording once they have all come."""

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from spinfilters.core.errors import NUMERICAL_ERRORS, SpinfiltersError, numerical
from spinfilters.evaluation.metrics import held_text
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import reason
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.io.sensor_format import sensor_format
from spinfilters.live.sources import ArrivedEpoch
from spinfilters.models.state_layout import Gaussian
from spinfilters.models.status import NOTHING, OF_BLOCKS, EstimatorStatus, Holds
from spinfilters.run.estimation import ComparisonExtent, compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.verdict.checks import finding
from spinfilters.verdict.model_tests import MOST_EPOCHS, MOST_EPOCHS_WITH_MAP

LARGEST_DIFFERENCE: Final = 4.0
"""Joint deviations between the last answer and the estimate of the kept epochs, beyond which the answer is doubtful."""


class KeptEpochs:
    """The latest epochs of a live run, no more than a verdict tests; those of the initialisation are the first to go.

    Parameters
    ----------
    dataset : Dataset
        That the run began from.
    end_of_initialisation : float
        Time up to which its own epochs belong to the run, s.
    """

    def __init__(self, dataset: Dataset, end_of_initialisation: float) -> None:
        self._dataset = dataset
        with_map = any(sensor_format(stream.sensor).has_landmarks for stream in dataset.log.streams)
        self._most = MOST_EPOCHS_WITH_MAP if with_map else MOST_EPOCHS
        times = dataset.log.times
        self._times: list[float] = times[times <= end_of_initialisation].tolist()[-self._most :]
        # None for an epoch of the initialisation: its rows stay in the data set's log until they are asked for
        self._rows: list[tuple[MeasurementStream, ...] | None] = [None] * len(self._times)

    def keep(self, arrived: ArrivedEpoch) -> None:
        """Keep an epoch, in its place by time, and drop the oldest where there are too many."""
        place = bisect_left(self._times, arrived.time)
        self._times.insert(place, arrived.time)
        self._rows.insert(place, arrived.streams)
        if len(self._times) > self._most:
            del self._times[0], self._rows[0]

    @property
    def holds_initialisation(self) -> bool:
        """Whether the first epoch of the run is still among them, so that their frames are those of the run."""
        return self._times[0] == self._dataset.log.start

    @property
    def dataset(self) -> Dataset:
        """The kept epochs with all that the data set states of its sensors, without a truth."""
        by_sensor: dict[str, list[MeasurementStream]] = {}
        for time, rows in zip(self._times, self._rows, strict=True):
            for stream in self._dataset.log.slice(time, time).streams if rows is None else rows:
                by_sensor.setdefault(stream.sensor, []).append(stream)
        return replace(
            self._dataset, log=MeasurementLog(tuple(map(_join_rows, by_sensor.values()))), truth=None
        )

    def __len__(self) -> int:
        return len(self._times)


def _join_rows(parts: list[MeasurementStream]) -> MeasurementStream:
    """Rows of one sensor, in their order."""
    ids = [part.ids for part in parts if part.ids is not None]
    covariances = [part.covariance for part in parts if part.covariance is not None]
    return MeasurementStream(
        parts[0].sensor,
        np.concatenate([part.time for part in parts]),
        np.concatenate([part.values for part in parts]),
        np.concatenate(ids) if ids else None,
        np.concatenate(covariances) if len(covariances) == len(parts) else None,
    )


@dataclass(frozen=True)
class FinalVerdict:
    """The verdict on a live run when its measurements have ended.

    Attributes
    ----------
    epochs : int
        Kept ones that were judged.
    status : EstimatorStatus or None
        With what holds; None where there is none.
    text : str
        What holds in a few words, or why that is not known.
    """

    epochs: int = 0
    status: EstimatorStatus | None = None
    text: str = "not judged: the run ended before its measurements"

    @property
    def sentence(self) -> str:
        """What holds, and the reasons against the rest."""
        if self.status is None:
            return f"what holds: {self.text}"
        head = f"what holds, by the latest {self.epochs} epochs together ({self.status.verdict}): {self.text}"
        return "\n".join([head, *(f"  {reason}" for reason in self.status.reasons)])

    def document(self) -> dict[str, object]:
        """As JSON holds it."""
        status = self.status
        holds: Mapping[str, Holds] = {} if status is None else status.holds
        return {
            "epochs": self.epochs,
            "verdict": None if status is None else str(status.verdict),
            "holds": {name: str(state) for name, state in holds.items()},
            "reasons": [self.text] if status is None else list(status.reasons),
        }


NO_VERDICT: Final = FinalVerdict()


@dataclass(frozen=True)
class LastAnswer:
    """The belief of the last answer of a live run, its time (s), and the estimator that it stands on."""

    time: float
    belief: Gaussian
    estimator: str


def final_verdict(kept: KeptEpochs, settings: Settings, last: LastAnswer) -> FinalVerdict:
    """Estimate and judge the kept epochs as ``compare`` does, and compare the last answer with that estimate.

    A quantity holds where it does in the estimate of the kept epochs and where the last answer agrees with it; the latter is asked
    where the first epoch of the run is among the kept ones, for its frames are those of the first epoch.
    """
    chosen = replace(settings, estimators=(last.estimator,))
    extent = ComparisonExtent(bounding=lambda found, _: list(found), rehearsing=None)
    try:
        comparison = compare_estimators(prepare(kept.dataset, chosen), chosen, lambda *_: None, extent=extent)
    except SpinfiltersError as error:
        return _unknown(kept, str(error))
    except NUMERICAL_ERRORS as error:
        return _unknown(kept, reason(numerical(error)))
    (evaluation,) = comparison.evaluations
    if comparison.interrupted:
        return _unknown(kept, "interrupted")
    if kept.holds_initialisation:
        status = compared_with(evaluation.history, last)
        evaluation = evaluation.with_status(status)
    return FinalVerdict(len(kept), evaluation.history.status, held_text(evaluation))


def _unknown(kept: KeptEpochs, why: str) -> FinalVerdict:
    """No verdict, for a reason."""
    return FinalVerdict(len(kept), None, f"not known: the kept epochs could not be judged ({why})")


def compared_with(history: EstimateHistory, last: LastAnswer) -> EstimatorStatus:
    """The status of an estimate, with a finding where the last answer of a live run lies away from it."""
    status, layout = history.status, history.layout
    if not len(history.time) or layout != last.belief.layout:
        return status
    there = history.belief(int(np.argmin(np.abs(history.time - last.time))))
    away = np.abs(layout.local(there.mean, last.belief.mean)) / np.hypot(there.std, last.belief.std)
    largest = {
        block: float(np.nan_to_num(away[layout.slice(block)], nan=np.inf).max()) for block in layout.blocks
    }
    far = [block for block, size in largest.items() if size > LARGEST_DIFFERENCE]
    about = frozenset[str]().union(*(OF_BLOCKS.get(block, NOTHING) for block in far))
    if not about:
        return status
    doubted = status.doubted(finding("live-disagrees", {"deviations": max(largest.values())}, about))
    holds = {
        name: Holds.DOUBTFUL if name in about and state is Holds.OK else state
        for name, state in status.holds.items()
    }
    return replace(doubted, holds=holds)
