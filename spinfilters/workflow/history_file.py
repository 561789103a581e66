"""Histories as files, so that figures can be drawn again without running anything."""

import io
from pathlib import Path

import numpy as np

from spinfilters.errors import InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.logs.atomic_write import write_bytes
from spinfilters.state.layout import StateLayout
from spinfilters.state.status import EstimatorStatus, Verdict

_ARRAYS = ("time", "mean", "factor", "nis", "dof", "log_likelihood", "accepted", "rejected", "runtime")
LARGEST_FILE = 2 << 30


def write_history(path: Path, history: EstimateHistory) -> None:
    """Write a history as an .npz of plain arrays, atomically."""
    buffer = io.BytesIO()
    arrays = {name: getattr(history, name) for name in _ARRAYS}
    words = {
        "name": np.array(history.name),
        "blocks": np.array(history.layout.blocks),
        "verdict": np.array(str(history.status.verdict)),
        "reasons": np.array(history.status.reasons, dtype=str),
    }
    np.savez_compressed(buffer, allow_pickle=False, **arrays, **words)
    write_bytes(path, buffer.getvalue())


def read_history(path: Path) -> EstimateHistory:
    """Read what `write_history` wrote; nothing in the file is evaluated.

    Raises
    ------
    InputError: missing, too large, damaged, or arrays that do not fit together.
    """
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise InputError(f"{path}: {path.stat().st_size} bytes is larger than any run; make the run again")
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in (*_ARRAYS, "name", "blocks", "verdict", "reasons")}
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise InputError(f"{path}: is no history of a run ({' '.join(str(error).split())}); make the run again") from None
    layout = StateLayout(tuple(map(str, arrays["blocks"])))
    count, shapes = len(arrays["time"]), (layout.mean_dim, layout.error_dim)
    if arrays["mean"].shape != (count, shapes[0]) or arrays["factor"].shape != (count, shapes[1], shapes[1]):
        raise InputError(f"{path}: its arrays do not fit its state {layout.blocks}; make the run again")
    status = EstimatorStatus(Verdict(str(arrays["verdict"])), tuple(map(str, arrays["reasons"])))
    return EstimateHistory(
        name=str(arrays["name"]), layout=layout, status=status, **{name: arrays[name] for name in _ARRAYS}
    )
