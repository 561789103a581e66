"""Histories as files, so that figures can be drawn again without running anything."""

from pathlib import Path
from zipfile import ZIP_DEFLATED

import numpy as np

from spinfilters.estimators.history import FRAME_ARRAYS, EstimateHistory, checked_frames
from spinfilters.state.layout import StateLayout
from spinfilters.state.status import EstimatorStatus, Verdict
from spinfilters.workflow.array_file import DAMAGED, read_arrays, unusable, write_arrays


def write_history(path: Path, history: EstimateHistory) -> None:
    """Write a history as an .npz of plain arrays, atomically."""
    arrays = {name: getattr(history, name) for name in FRAME_ARRAYS}
    words = {
        "name": np.array(history.name),
        "blocks": np.array(history.layout.blocks),
        "verdict": np.array(str(history.status.verdict)),
        "reasons": np.array(history.status.reasons, dtype=str),
    }
    write_arrays(path, {**arrays, **words}, ZIP_DEFLATED)


def read_history(path: Path, cure: str = "make the run again") -> EstimateHistory:
    """Read what `write_history` wrote; nothing in the file is evaluated.

    Parameters
    ----------
    cure: what to do about a file that cannot be used.

    Raises
    ------
    InputError: missing, too large, damaged, or arrays that do not fit together.
    """
    try:
        arrays = read_arrays(path)
        layout = StateLayout(tuple(map(str, arrays["blocks"])))
        status = EstimatorStatus(Verdict(str(arrays["verdict"])), tuple(map(str, arrays["reasons"])))
        numbers, name = checked_frames(layout, arrays), str(arrays["name"])
        if not (np.isfinite(numbers["time"]).all() and (np.diff(numbers["time"]) > 0).all()):
            raise ValueError("its time does not run forwards")
    except DAMAGED as error:
        raise unusable(path, "history of a run", error, cure) from None
    return EstimateHistory(name=name, layout=layout, status=status, **numbers)
