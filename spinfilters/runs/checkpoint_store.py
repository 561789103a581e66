"""Checkpoints of a run: when and where they are written, and Ctrl-C."""

import signal
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter

import numpy as np
from jaxtyping import Float

from spinfilters.data.atomic_write import make_folder
from spinfilters.data.input_file import path_text
from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Estimator
from spinfilters.estimators.history import EstimateHistory, GrowingHistory
from spinfilters.estimators.timeline import times_of
from spinfilters.pipeline.setup import Setup
from spinfilters.runs.checkpoint import Checkpoint, load_checkpoint, save_checkpoint, save_ended
from spinfilters.runs.fingerprint import ANEW, RunFingerprint, fingerprint_of
from spinfilters.settings.estimator_names import estimator_names
from spinfilters.settings.run_settings import Settings
from spinfilters.state.status import Verdict

CHECKPOINT_FILE = "checkpoint.npz"

AfterEpoch = Callable[[], None]
"""To be called when a frame is done."""


@dataclass(frozen=True)
class CheckpointInterval:
    """A checkpoint every so many ``seconds``, bounded in cost.

    Less often where writing would take more than this ``share`` of the time.
    """

    seconds: float = 5.0
    share: float = 0.02


class CheckpointStore(ABC):
    """Keeps what one estimator's run has reached."""

    @abstractmethod
    def resume(self, estimator: Estimator) -> Checkpoint | None:
        """Restore the estimator from its checkpoint; None where there is none."""

    @abstractmethod
    def running(self, estimator: Estimator, rows: GrowingHistory) -> AbstractContextManager[AfterEpoch]:
        """Checkpoint while the block runs, which calls the given function after every epoch."""

    @abstractmethod
    def end(self, estimator: Estimator, history: EstimateHistory, rows: GrowingHistory) -> None:
        """Keep a completed or failed run."""


class NullStore(CheckpointStore):
    """Keeps nothing."""

    def resume(self, estimator: Estimator) -> Checkpoint | None:
        """None: nothing was kept."""
        return None

    def running(self, estimator: Estimator, rows: GrowingHistory) -> AbstractContextManager[AfterEpoch]:
        """Keeps nothing on the way."""
        return nullcontext(lambda: None)

    def end(self, estimator: Estimator, history: EstimateHistory, rows: GrowingHistory) -> None:
        """Keeps nothing at the end."""
        return


StoreOf = Callable[[str], CheckpointStore]
"""Checkpoint store of an estimator's name."""


@dataclass(frozen=True)
class CheckpointFile(CheckpointStore):
    """Keeps a run in one file.

    Attributes
    ----------
    fingerprint: of the run.   time: (k,) of the epochs that it is to do, s.
    """

    path: Path
    fingerprint: RunFingerprint
    time: Sequence[float] | Float[np.ndarray, " k"]
    interval: CheckpointInterval = field(default_factory=CheckpointInterval)

    def resume(self, estimator: Estimator) -> Checkpoint | None:
        """The checkpoint in the file. InputError: it is of another run, or damaged."""
        if not self.path.exists():
            return None
        found = load_checkpoint(self.path, estimator, self.fingerprint)
        done = found.rows.arrays()["time"]
        if not np.array_equal(done, self.time[: len(done)]):
            raise InputError(
                f"{path_text(self.path)}: is no whole checkpoint (its epochs are not the first of this run); delete it, {ANEW}"
            )
        return found

    @contextmanager
    def running(self, estimator: Estimator, rows: GrowingHistory) -> Iterator[AfterEpoch]:
        """Ctrl-C takes effect when a frame is done and kept; a second one at once."""
        due = perf_counter() + self.interval.seconds
        with _held_interrupts() as pressed:

            def after_epoch() -> None:
                """Write a checkpoint when one is due."""
                nonlocal due
                begin = perf_counter()
                if begin >= due or pressed():
                    self._save(estimator, rows)
                    end = perf_counter()
                    due = end + max(self.interval.seconds, (end - begin) / self.interval.share)
                if pressed():
                    raise KeyboardInterrupt

            yield after_epoch

    def _save(self, estimator: Estimator, rows: GrowingHistory) -> None:
        make_folder(self.path.parent)
        save_checkpoint(self.path, estimator, rows, self.fingerprint)

    def end(self, estimator: Estimator, history: EstimateHistory, rows: GrowingHistory) -> None:
        """Write the last checkpoint, or the history of an estimator that failed."""
        if history.status.verdict is Verdict.FAILED:
            make_folder(self.path.parent)
            save_ended(self.path, history, rows.begin, self.fingerprint)
        else:
            self._save(estimator, rows)


def no_checkpoints(_: str) -> CheckpointStore:
    """Keep nothing of any estimator."""
    return NullStore()


def checkpoint_stores(
    folder: Path, setup: Setup, settings: Settings, interval: CheckpointInterval | None = None
) -> StoreOf:
    """Keep every estimator's run in ``folder/<its name>/checkpoint.npz``, and go on from what is there."""
    fingerprint = fingerprint_of("", setup.timeline, setup.belief, settings.document)
    time = times_of(setup.timeline[len(setup.initial.mean) :])

    def store(name: str) -> CheckpointStore:
        """The store of an estimator."""
        path = folder / name / CHECKPOINT_FILE
        return CheckpointFile(
            path, replace(fingerprint, estimator=name), time, interval or CheckpointInterval()
        )

    return store


def remove_checkpoints(folder: Path) -> None:
    """Remove the checkpoints of a run folder, and the folders of estimators that then are empty."""
    for name in estimator_names():
        (folder / name / CHECKPOINT_FILE).unlink(missing_ok=True)
        with suppress(OSError):  # absent, or results are in it
            (folder / name).rmdir()


@contextmanager
def _held_interrupts() -> Iterator[Callable[[], bool]]:
    """Hold the first Ctrl-C back and tell whether there was one.

    It is noted instead of raised.
    One that nobody asked for takes effect when the block ends. Where Ctrl-C is not this thread's business nothing changes.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield lambda: False
        return
    noted, told = False, False

    def note(number: int, stack_frame: object) -> None:
        """Note Ctrl-C."""
        nonlocal noted
        if noted:
            raise KeyboardInterrupt
        noted = True

    def pressed() -> bool:
        """Whether Ctrl-C was pressed."""
        nonlocal told
        told = told or noted
        return noted

    signal.signal(signal.SIGINT, note)
    try:
        yield pressed
    finally:
        signal.signal(signal.SIGINT, before)
    if noted and not told:
        raise KeyboardInterrupt
