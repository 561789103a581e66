"""Checkpoints of a run: their files, the fingerprint of the run they belong to, when they are written, and Ctrl-C."""

import hashlib
import json
import signal
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.filters.estimator import Estimator, LandmarkBelief
from spinfilters.filters.history import EPOCH_ARRAYS, EstimateHistory, GrowingHistory
from spinfilters.filters.timeline import Timeline, by_sensor, times_of
from spinfilters.inference.setup import Setup
from spinfilters.io.input_file import path_text, value_text
from spinfilters.io.output_files import make_folder
from spinfilters.models.state_layout import Gaussian
from spinfilters.models.status import OWN_STATUS, EstimatorStatus, Finding, Verdict
from spinfilters.run.array_files import (
    DAMAGED,
    finding_from,
    finding_text,
    read_arrays,
    unusable,
    write_arrays,
)
from spinfilters.run.provenance import provenance
from spinfilters.settings.run_settings import Settings, estimator_names

ANEW = "or run without --resume to start again"


@dataclass(frozen=True)
class RunFingerprint:
    """Everything that decides the numbers of a run.

    Attributes
    ----------
    estimator : str
        Its name.
    versions : Mapping[str, Any]
        Of this package, its commit, and the libraries.
    settings : Mapping[str, Any]
        Of the run, tables of plain values.
    measurements : str
        Digest of all epochs, values and parameters.
    start : str
        Digest of the belief that the estimator starts from.
    """

    estimator: str
    versions: Mapping[str, Any]
    settings: Mapping[str, Any]
    measurements: str
    start: str

    @property
    def document(self) -> dict[str, Any]:
        """The fingerprint for JSON."""
        return json.loads(json.dumps(asdict(self)))

    def difference(self, document: Mapping[str, Any]) -> str | None:
        """First difference from another run's `document`, with the cure; None where it does not differ.

        Raises
        ------
        KeyError, TypeError, AttributeError
            It is no such document.
        """
        return next(_differences(document, self.document), None)


def fingerprint_of(
    estimator: str, timeline: Timeline, start: Gaussian | LandmarkBelief, settings: Mapping[str, Any]
) -> RunFingerprint:
    """Fingerprint of a run over all epochs of a timeline, from a start, with settings (tables of plain values).

    The choice of estimators and of the checks of their verdicts is left out: each estimator runs by itself, to the same numbers.
    """
    document = {name: value for name, value in settings.items() if name not in ("estimators", "verdict")}
    return RunFingerprint(estimator, provenance(), document, _digest_of_timeline(timeline), _digest_of(start))


def _differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> Iterator[str]:
    if there["estimator"] != here["estimator"]:
        yield f"is of the estimator {value_text(there['estimator'])}, not of {here['estimator']}; put it back, {ANEW}"
    for name, was, is_now in _list_changes(there["versions"], here["versions"]):
        yield f"was made with {name} {was}, this is {is_now}; resume with the former, {ANEW}"
    for name, was, is_now in _list_changes(there["settings"], here["settings"]):
        yield f"was made with {name} = {was}, now it is {is_now}; set it back, {ANEW}"
    if there["measurements"] != here["measurements"]:
        yield (
            f"was made from other measurements (digest {_short(there['measurements'])}, now "
            f"{_short(here['measurements'])}); give the same data set, {ANEW}"
        )
    if there["start"] != here["start"]:
        yield (
            "its initialisation gives other numbers here (another machine or number of threads); resume where it was made, "
            f"{ANEW}"
        )


def _list_changes(there: Any, here: Any, path: str = "") -> Iterator[tuple[str, str, str]]:
    """Name, former and present value of everything that differs in two documents of nested tables."""
    if isinstance(there, dict) and isinstance(here, dict):
        for key in sorted({*there, *here}):
            yield from _list_changes(there.get(key), here.get(key), f"{path}.{key}" if path else str(key))
    elif there != here:
        yield path, value_text(there), value_text(here)


def _short(digest: object) -> str:
    return value_text(str(digest)[:12])


def _digest_of_timeline(timeline: Timeline) -> str:
    digest = hashlib.sha256(np.ascontiguousarray(times_of(timeline)).data)
    for part in by_sensor(timeline):
        measured = part.measurement
        arrays = (part.epoch, measured.values, measured.parameters, measured.ids)
        shapes = [None if array is None else array.shape for array in arrays]
        digest.update(f"{measured.model.name} {shapes}".encode())
        for array in arrays:
            digest.update(b"" if array is None else np.ascontiguousarray(array).data)
    return digest.hexdigest()


def _digest_of(belief: Gaussian | LandmarkBelief) -> str:
    digest = hashlib.sha256(" ".join(belief.layout.blocks).encode())
    joint = belief.joint
    landmarks = () if joint is None else (joint.ids, joint.points, joint.modes, joint.roots)
    for array in (belief.mean, belief.factor, *landmarks):
        digest.update(f"{array.shape}".encode() + array.tobytes())
    return digest.hexdigest()


FORMAT = 1
_STATE, _ROWS, _META = "state.", "rows.", "meta"


@dataclass(frozen=True)
class Checkpoint:
    """Content of a checkpoint: the epochs done, and the run's end if reached."""

    rows: GrowingHistory
    status: EstimatorStatus | None


def save_checkpoint(
    path: Path, estimator: Estimator, rows: GrowingHistory, fingerprint: RunFingerprint
) -> None:
    """Write an estimator's state and records, atomically.

    On line, where no history is wanted, rows may be ``GrowingHistory(estimator.layout, time)``.

    Raises
    ------
    InputError
        As `spinfilters.io.output_files.atomic_file`.
    """
    state = {_STATE + name: array for name, array in estimator.snapshot().items()}
    named = {_ROWS + name: array for name, array in rows.arrays().items()}
    _write(path, {**state, **named}, {"begin": rows.begin, "ended": None}, fingerprint)


def save_ended(path: Path, history: EstimateHistory, begin: float, fingerprint: RunFingerprint) -> None:
    """Write a run that has ended by itself; it began at ``begin`` (s). Errors: `save_checkpoint`."""
    rows = {_ROWS + name: getattr(history, name) for name in EPOCH_ARRAYS}
    status = history.status
    ended = {
        "verdict": str(status.verdict),
        "reasons": list(status.reasons),
        "findings": [json.loads(finding_text(each)) for each in status.findings],
    }
    _write(path, rows, {"begin": begin, "ended": ended}, fingerprint)


def load_checkpoint(path: Path, estimator: Estimator, fingerprint: RunFingerprint) -> Checkpoint:
    """Restore an estimator built alike, and return the epochs done.

    An estimator whose run has ended is left as it is.

    Raises
    ------
    InputError
        Missing, damaged, of another format, or of another run: the text names the first difference and the cure.
    """
    try:
        arrays = read_arrays(path)
        meta = json.loads(str(arrays[_META]))
        if meta["format"] != FORMAT:
            raise ValueError(f"format {meta['format']!r}, expected {FORMAT}")
        difference = fingerprint.difference(meta["identity"])
        checkpoint = _checkpoint(arrays, meta, estimator) if difference is None else None
    except (*DAMAGED, AttributeError, np.linalg.LinAlgError) as error:
        raise unusable(path, "whole checkpoint", error, f"delete it, {ANEW}") from None
    if checkpoint is None:
        raise InputError(f"{path_text(path)}: {difference}")
    return checkpoint


def _write(
    path: Path, arrays: dict[str, np.ndarray], meta: dict[str, Any], fingerprint: RunFingerprint
) -> None:
    text = json.dumps({"format": FORMAT, **meta, "identity": fingerprint.document})
    write_arrays(path, {_META: np.array(text), **arrays})


def _checkpoint(arrays: dict[str, np.ndarray], meta: dict[str, Any], estimator: Estimator) -> Checkpoint:
    held = {name.removeprefix(_ROWS): a for name, a in arrays.items() if name.startswith(_ROWS)}
    rows = GrowingHistory.from_arrays(estimator.layout, float(meta["begin"]), held)
    for name, array in {"begin": np.array(rows.begin), **rows.arrays()}.items():
        if not np.isfinite(array).all():
            raise ValueError(f"{name} is not finite")
    if meta["ended"] is not None:
        return Checkpoint(rows, _ended_status(meta["ended"]))
    _restore(estimator, {n.removeprefix(_STATE): a for n, a in arrays.items() if n.startswith(_STATE)}, rows)
    return Checkpoint(rows, None)


def _ended_status(ended: dict[str, Any]) -> EstimatorStatus:
    """Status that a run ended with; of older checkpoints findings are sentences, and older still, without names."""
    if "findings" in ended:
        found = tuple(map(finding_from, ended["findings"]))
    else:
        reasons = list(map(str, ended["reasons"]))
        checks = map(str, ended.get("checks", [OWN_STATUS] * len(reasons)))
        found = tuple(Finding(check, text) for check, text in zip(checks, reasons, strict=True))
    return EstimatorStatus(Verdict(ended["verdict"]), found)


def _restore(estimator: Estimator, state: dict[str, np.ndarray], rows: GrowingHistory) -> None:
    """Restore, and hold the belief that comes out against the last one that was noted."""
    estimator.restore(state)
    belief, noted = estimator.belief, rows.belief
    if not (np.isfinite(belief.mean).all() and np.isfinite(belief.factor).all()):
        raise ValueError("the state is not finite")
    if noted is not None and not (
        np.array_equal(belief.mean, noted.mean) and np.array_equal(belief.factor, noted.factor)
    ):
        raise ValueError("the state differs from that of its last epoch")


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
    fingerprint : RunFingerprint
        Of the run.
    time : sequence of float or ndarray of float, shape (k,)
        Of the epochs that it is to do, s.
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
        if history.has_failed:
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
    """Defer the first Ctrl-C and report whether there was one.

    It is noted instead of raised.
    One that was not asked for takes effect when the block ends. Where Ctrl-C is not this thread's business nothing changes.
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
