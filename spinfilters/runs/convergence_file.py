"""Convergence record as a file, from which figures can be drawn again."""

from collections.abc import Sequence
from pathlib import Path
from zipfile import ZIP_DEFLATED

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.history import EstimateHistory, GrowingHistory
from spinfilters.estimators.smoothing.window.convergence_record import ConvergenceRecord
from spinfilters.estimators.smoothing.window.smoother_records import MarginalizedState
from spinfilters.evaluation.body import BodyHistory
from spinfilters.evaluation.estimated_motion import body_history
from spinfilters.pipeline.plotted_quantities import QUANTITIES, deviations_of
from spinfilters.pipeline.smoother_run import NAME
from spinfilters.runs.npz_file import DAMAGED, read_arrays, unusable, write_arrays
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import FULL_BLOCKS, StateLayout
from spinfilters.state.status import EstimatorStatus

CURE = "run compare again with --resume --convergence"
_SIZES = {
    **{name: quantity.size for name, quantity in QUANTITIES.items()},
    **{deviations_of(name): 3 for name in QUANTITIES},
}
"""Components of the surfaces, by name."""


def write_convergence_record(path: Path, found: ConvergenceRecord, layout: StateLayout) -> None:
    """Write the convergence record as arrays.

    Surfaces (solves, epochs, components), the body after every solve, and the states that it was told from.
    """
    latest = latest_epochs(layout, found)
    states = {"blocks": np.array(layout.blocks), "newest_mean": latest.mean, "newest_factor": latest.factor}
    arrays = {
        "time": found.time,
        "trusted": found.trusted,
        **found.values,
        **_constants(body_history(latest)),
        **states,
    }
    write_arrays(path, arrays, ZIP_DEFLATED)


def empty_convergence_record(layout: StateLayout, time: Float[np.ndarray, " f"]) -> ConvergenceRecord:
    """Convergence record of a smoother without a single solution: nothing is finite."""
    n, m, e = len(time), layout.mean_dim, layout.error_dim
    latest = [MarginalizedState(float(t), np.full(m, np.nan), np.full((e, e), np.nan)) for t in time]
    values = {name: np.full((n, n, size), np.nan) for name, size in _SIZES.items()}
    return ConvergenceRecord(time, values, tuple(latest), np.zeros(n, dtype=bool))


def read_convergence_record(path: Path) -> tuple[StateLayout, ConvergenceRecord]:
    """Read what `write_convergence_record` wrote, and the layout of its states.

    Raises
    ------
    InputError: missing, too large, damaged, or arrays that do not fit together.
    """
    try:
        return _convergence_record(read_arrays(path))
    except DAMAGED as error:
        raise unusable(path, "whole convergence", error, CURE) from None


def latest_epochs(layout: StateLayout, found: ConvergenceRecord) -> EstimateHistory:
    """The epoch that each solve took in, as that solve saw it."""
    return smoothed_epochs(layout, found.latest)


def smoothed_epochs(layout: StateLayout, rows: Sequence[MarginalizedState]) -> EstimateHistory:
    """Epochs of a smoother as a history."""
    beliefs = GrowingHistory(layout, rows[0].time)
    for row in rows:
        beliefs.append(row.time, Gaussian(layout, row.mean, row.factor), [], 0.0)
    return beliefs.ended(NAME, EstimatorStatus())


def _constants(bodies: BodyHistory) -> dict[str, np.ndarray]:
    """Rows are solves."""
    assert bodies.center_of_mass_g is not None
    assert bodies.center_of_mass_std is not None
    return {
        "log_ratios": bodies.log_ratios,
        "std_log_ratios": bodies.log_ratios_std,
        "principal_moments": bodies.principal_moments,
        "std_principal_moments": bodies.principal_moments_std,
        "center_of_mass_g": bodies.center_of_mass_g,
        "std_center_of_mass_g": bodies.center_of_mass_std,
    }


def _convergence_record(arrays: dict[str, np.ndarray]) -> tuple[StateLayout, ConvergenceRecord]:
    layout = StateLayout(tuple(map(str, arrays["blocks"])))
    if not set(FULL_BLOCKS) <= set(layout.blocks):
        raise ValueError(f"its states are {layout.blocks}")
    count = len(arrays["time"])
    shapes = {
        "time": (count,),
        **{name: (count, count, size) for name, size in _SIZES.items()},
        "newest_mean": (count, layout.mean_dim),
        "newest_factor": (count, layout.error_dim, layout.error_dim),
    }
    for name, shape in shapes.items():
        if arrays[name].shape != shape or arrays[name].dtype != np.dtype(float):
            raise ValueError(f"{name} is {arrays[name].dtype} of shape {arrays[name].shape}, not {shape}")
    time, mean, trusted = arrays["time"], arrays["newest_mean"], arrays["trusted"]
    if trusted.shape != (count,) or trusted.dtype != np.dtype(bool):
        raise ValueError(f"trusted is {trusted.dtype} of shape {trusted.shape}, not bool of {(count,)}")
    if count < 2 or not (np.isfinite(time).all() and (np.diff(time) > 0).all()):
        raise ValueError("its time does not run forwards")
    latest = zip(time.tolist(), mean, arrays["newest_factor"], strict=True)
    values = {name: arrays[name] for name in _SIZES}
    return layout, ConvergenceRecord(time, values, tuple(MarginalizedState(*r) for r in latest), trusted)
