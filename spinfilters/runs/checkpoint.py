"""Checkpoint file of an estimator: its state and the epochs done."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spinfilters.data.input_file import path_text
from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Estimator
from spinfilters.estimators.history import EPOCH_ARRAYS, EstimateHistory, GrowingHistory
from spinfilters.runs.fingerprint import ANEW, RunFingerprint
from spinfilters.runs.history_file import finding_from, finding_text
from spinfilters.runs.npz_file import DAMAGED, read_arrays, unusable, write_arrays
from spinfilters.state.status import OWN_STATUS, EstimatorStatus, Finding, Verdict

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
    InputError: as `spinfilters.data.atomic_write.atomic_file`.
    """
    state = {_STATE + name: array for name, array in estimator.snapshot().items()}
    _write(path, {**state, **_named_rows(rows)}, {"begin": rows.begin, "ended": None}, fingerprint)


def save_ended(path: Path, history: EstimateHistory, begin: float, fingerprint: RunFingerprint) -> None:
    """Write a run that has ended by itself.

    It began at ``begin`` (s). Errors: `save_checkpoint`.
    """
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
    InputError: missing, damaged, of another format, or of another run: the text names the first difference and the cure.
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


def _named_rows(rows: GrowingHistory) -> dict[str, np.ndarray]:
    return {_ROWS + name: array for name, array in rows.arrays().items()}


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
        raise ValueError("the state is not the one that its last epoch ended with")
