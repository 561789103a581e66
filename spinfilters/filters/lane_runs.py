"""Many runs of a first-order filter through the same epochs, side by side in the lanes of vectors: `lane_runs.c`.

Means and covariances are those of runs made one by one, to rounding. A run ends where one of `spinfilters.filters.epoch_run` does.
"""

import ctypes
from functools import cache
from importlib.resources import files
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.c_library import KERNEL_FLAGS, LANES, Signature, load_text, with_signatures
from spinfilters.core.compiled import address
from spinfilters.filters.epoch_run import ROWS, EpochCall, RunOptions, epoch_run_text
from spinfilters.filters.estimator import COUNTS, EpochRun, ProcessModel, RunsTaken
from spinfilters.filters.flow_curvature import FlowCurvature
from spinfilters.models.rotation_integrator import FEWEST, MOST_LIMITS, substep_numbers
from spinfilters.models.state_layout import Places

_FLAGS: Final = (*KERNEL_FLAGS, "-fno-strict-aliasing", "-Wno-psabi")
_SIGNATURES: Final = {"take_in_runs": Signature("ppipp" + "iippp" + "iippp", None)}


class _Entries(ctypes.Structure):
    """`Entries` of `lane_runs.c`."""

    _fields_ = (("count", ctypes.c_longlong), ("row", ctypes.c_void_p), ("column", ctypes.c_void_p))


class _Lanes(ctypes.Structure):
    """`Lanes` of `lane_runs.c`."""

    _fields_ = (
        ("step", ctypes.c_void_p),
        ("fewest", ctypes.c_longlong),
        ("each", ctypes.c_void_p),
        ("moving", ctypes.c_longlong),
        *((name, _Entries) for name in ("transition", "noise")),
        *((name, ctypes.c_void_p) for name in ("retract", "reset")),
        ("reset_entries", _Entries),
    )


def take_in_runs(
    process: ProcessModel,
    mean: Float[np.ndarray, "r m"],
    factor: Float[np.ndarray, "r n n"],
    epochs: EpochRun,
    options: RunOptions,
) -> RunsTaken | None:
    """Take a first-order filter through many runs of the same epochs, each to the numbers of `take_in` but for rounding.

    Parameters
    ----------
    mean, factor : ndarray
        The beliefs before, one of each run.
    epochs : EpochRun
        Of the first run; its sensors hold the values of all runs, one run behind the other.
    options : RunOptions
        What is the same in all epochs; the stretch of its curvature is the one that all runs begin in, and it stays.

    Returns
    -------
    RunsTaken or None
        None where something compiled is missing, or a sensor has no plain gate.
    """
    call, library, lanes = EpochCall.of(process, epochs, options), _library(), _lanes(process)
    if call is None or library is None or lanes is None:
        return None
    runs, count = len(mean), len(epochs.dt)
    dt, x, S = (np.array(array, dtype=float, order="C") for array in (epochs.dt, mean, factor))
    room, done = _rows_of_runs(count, x, S), np.zeros(runs, dtype=np.int64)
    per_run = np.array([len(part.every.values) // runs for part in epochs.sensors], dtype=np.int64)
    places = (ctypes.c_void_p * len(ROWS))(*(address(room[name]) for name in ROWS))
    stretch = (options.curvature or FlowCurvature()).stretch_left()
    library.take_in_runs(
        *(ctypes.addressof(call.filter), ctypes.addressof(lanes[0])),
        *(len(call.sensors), ctypes.addressof(call.sensors), address(per_run)),
        *(runs, count, *map(address, (dt, x, S)), call.most, call.width),
        *(address(stretch), ctypes.addressof(places), address(done)),
    )
    return RunsTaken(room, done)


def _rows_of_runs(
    count: int, mean: Float[np.ndarray, "r m"], factor: Float[np.ndarray, "r n n"]
) -> dict[str, np.ndarray]:
    """Room for what so many epochs of each run leave, by name."""
    runs = len(mean)
    room = {name: np.empty((runs, count), dtype=int if name in COUNTS else float) for name in ROWS[2:]}
    room |= {
        name: np.empty((runs, count, *of.shape[1:])) for name, of in (("mean", mean), ("factor", factor))
    }
    return room


def _lanes(process: ProcessModel) -> tuple[_Lanes, tuple[Any, ...]] | None:
    """What lanes need of a process as C reads it, and the arrays behind; None where something compiled is missing."""
    linearised, layout = process.linearised_scan, process.layout
    if linearised is None:
        return None
    reset = layout.many_resets
    loops = (linearised.scan.loop, layout.many_retractions.loop, reset.function.loop)
    if None in loops:
        return None
    numbers = [substep_numbers(FEWEST << j) for j in range(MOST_LIMITS)]
    each = np.array([address(array) for array in numbers], dtype=np.int64)
    made = _Lanes(
        *(loops[0], FEWEST, address(each), linearised.moving),
        *map(_entries, (linearised.transition, linearised.noise)),
        *loops[1:],
        _entries(reset.places),
    )
    return made, (linearised, reset, numbers, each)


def _entries(places: Places) -> _Entries:
    return _Entries(len(places.row), *map(address, places))


@cache
def _library() -> ctypes.PyDLL | None:
    text = f"enum {{ LANES = {LANES} }};\n{epoch_run_text()}"
    text += files("spinfilters.filters").joinpath("lane_runs.c").read_text()
    return with_signatures(load_text("lane_runs", text, _FLAGS), _SIGNATURES)
