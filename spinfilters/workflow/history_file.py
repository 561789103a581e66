"""Histories as files, so that figures can be drawn again without running anything."""

import io
import zlib
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from spinfilters.errors import InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.logs.atomic_write import write_bytes
from spinfilters.logs.input_file import named, reason
from spinfilters.state.layout import StateLayout
from spinfilters.state.status import EstimatorStatus, Verdict

_ARRAYS = ("time", "mean", "factor", "nis", "dof", "log_likelihood", "accepted", "rejected", "runtime")
LARGEST_FILE = 2 << 30
_DAMAGED = (
    OSError,
    ValueError,
    TypeError,
    KeyError,
    EOFError,
    NotImplementedError,
    BadZipFile,
    zlib.error,
    InputError,
)


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
            raise ValueError(f"{path.stat().st_size} bytes is larger than any run")
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            arrays = {name: file[name] for name in (*_ARRAYS, "name", "blocks", "verdict", "reasons")}
        layout = StateLayout(tuple(map(str, arrays["blocks"])))
        status = EstimatorStatus(Verdict(str(arrays["verdict"])), tuple(map(str, arrays["reasons"])))
        numbers = {name: _checked(name, arrays[name], len(arrays["time"]), layout) for name in _ARRAYS}
    except _DAMAGED as error:
        raise InputError(
            f"{named(path)}: is no history of a run ({reason(error)}); make the run again"
        ) from None
    return EstimateHistory(name=str(arrays["name"]), layout=layout, status=status, **numbers)


def _checked(name: str, array: np.ndarray, count: int, layout: StateLayout) -> np.ndarray:
    shapes = {"mean": (count, layout.mean_dim), "factor": (count, layout.error_dim, layout.error_dim)}
    kind = "i" if name in ("dof", "accepted", "rejected") else "f"
    if array.shape != shapes.get(name, (count,)) or array.dtype.kind != kind:
        raise ValueError(
            f"{name} is {array.dtype} of shape {array.shape}, which does not fit {layout.blocks}"
        )
    return array
