"""The smoother's convergence on a recording, as arrays and a picture.

Solved again after every epoch from the first on.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import inverse, multiply, rotation_vector_from_quaternion
from spinfilters.data.atomic_write import make_folder
from spinfilters.data.truth import Truth
from spinfilters.errors import NUMERICAL_ERRORS, InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.smoothing.window.convergence_record import (
    MOST_EPOCHS,
    ConvergenceRecord,
    record_convergence,
)
from spinfilters.estimators.smoothing.window.sliding_smoother import SlidingSmoother
from spinfilters.estimators.smoothing.window.smoother_records import MarginalizedState
from spinfilters.evaluation.estimated_motion import body_history, estimated_rates, trajectory_of
from spinfilters.evaluation.trajectory_errors import attitude_alignment, common_stamps
from spinfilters.evaluation.truth_frames import tells_first_frame, truth_in_first_frame
from spinfilters.pipeline.plotted_quantities import ATTITUDE, QUANTITIES, deviations_of
from spinfilters.pipeline.setup import Setup
from spinfilters.pipeline.smoother_run import NAME
from spinfilters.plots.convergence import Convergence, ConvergingQuantity, convergence_figure
from spinfilters.plots.style import draw_figure
from spinfilters.runs.convergence_file import (
    empty_convergence_record,
    latest_epochs,
    read_convergence_record,
    smoothed_epochs,
    write_convergence_record,
)
from spinfilters.runs.run_folder import CONVERGENCE_ARRAYS as ARRAYS
from spinfilters.runs.run_folder import CONVERGENCE_PICTURE
from spinfilters.settings.run_settings import Settings
from spinfilters.state.layout import StateLayout


def require_convergence(setup: Setup, settings: Settings) -> None:
    """Refuse a run whose smoother does not take in epoch after epoch.

    Raises
    ------
    InputError: no smoother, measurements that are smoothed all at once, or too many epochs.
    """
    if NAME not in settings.estimators:
        raise InputError(f"--convergence shows the estimator {NAME}; name it in --estimators")
    if not setup.initial.has_landmarks:
        raise InputError(
            "--convergence needs stereo tracks without a known map (landmarks.csv): other measurements are smoothed all at once"
        )
    if len(setup.timeline) > MOST_EPOCHS:
        raise InputError(
            f"--convergence is for at most {MOST_EPOCHS} epochs, the recording has {len(setup.timeline)}; give a part of it"
        )


def write_convergence(
    folder: Path, setup: Setup, settings: Settings, on_epoch: Callable[[int, int], None]
) -> None:
    """smoother/convergence.npz and convergence.png.

    Raises
    ------
    InputError: as `require_convergence`; a file cannot be written.
    """
    require_convergence(setup, settings)
    start, layout = setup.initial, setup.process.layout
    options = settings.smoother.options(len(setup.timeline))
    smoother = SlidingSmoother(setup.process, start.prior, options, has_landmarks=True)
    try:
        found = record_convergence(smoother, setup.timeline, partial(_quantities, layout), on_epoch)
    except NUMERICAL_ERRORS:
        found = empty_convergence_record(layout, np.array([epoch.time for epoch in setup.timeline]))
    make_folder(folder / NAME)
    write_convergence_record(folder / NAME / ARRAYS, found, layout)
    truth = setup.dataset.truth
    draw_figure(
        lambda: convergence_figure(_convergence(found, latest_epochs(layout, found), truth)),
        folder / CONVERGENCE_PICTURE,
    )


def is_whole(folder: Path) -> bool:
    """Whether a run folder holds both files, undamaged."""
    try:
        read_convergence_record(folder / NAME / ARRAYS)
    except InputError:
        return False
    return (folder / CONVERGENCE_PICTURE).exists()


def read_convergence(folder: Path, truth: Truth | None) -> Convergence | None:
    """Convergence of a run folder for the figure; None where not asked for.

    Raises
    ------
    InputError: as `spinfilters.runs.convergence_file.read_convergence_record`.
    """
    path = folder / NAME / ARRAYS
    if not path.exists() and not (folder / CONVERGENCE_PICTURE).exists():
        return None
    layout, found = read_convergence_record(path)
    return _convergence(found, latest_epochs(layout, found), truth)


def _quantities(
    layout: StateLayout, window: Sequence[MarginalizedState]
) -> dict[str, Float[np.ndarray, "k q"]]:
    """Estimates of every one of `QUANTITIES` after a solve, SI, with standard deviations."""
    history = smoothed_epochs(layout, window)
    trajectory, rates = trajectory_of(history), estimated_rates(history)
    told = {name: quantity.estimate(trajectory, rates) for name, quantity in QUANTITIES.items()}
    values = {name: value for name, (value, _) in told.items()}
    return values | {deviations_of(name): std for name, (_, std) in told.items()}


def _convergence(found: ConvergenceRecord, latest: EstimateHistory, truth: Truth | None) -> Convergence:
    """Convergence with errors where there is a truth, else distances from the last solve."""
    if truth is None:
        reference = {name: found.values[name][-1] for name in QUANTITIES}
    else:
        truth = _in_estimated_frame(found, latest, truth)
        reference = _true_quantities(found.time, truth)
    quantities = [
        ConvergingQuantity(
            quantity.label,
            quantity.unit,
            quantity.scale * _distance(name, found.values[name], reference[name]),
            quantity.scale * np.linalg.norm(found.values[deviations_of(name)], axis=2),
        )
        for name, quantity in QUANTITIES.items()
    ]
    ratios = (
        None if truth is None or truth.principal_moments is None else _log_ratios(truth.principal_moments)
    )
    centre = None if truth is None else truth.center_of_mass_g
    known = truth is not None
    return Convergence(found.time, quantities, body_history(latest), found.trusted, known, ratios, centre)


def _in_estimated_frame(found: ConvergenceRecord, latest: EstimateHistory, truth: Truth) -> Truth:
    """The truth in the estimate's g.

    That which the first epoch defines; where it is not told, that which fits the last solve best.
    """
    if tells_first_frame(latest, truth):
        return truth_in_first_frame(latest, truth)
    rows, true_rows = common_stamps(found.time, truth.time)
    attitudes = found.values[ATTITUDE][-1, rows]
    held = np.isfinite(attitudes).all(axis=1)
    turn = attitude_alignment(attitudes[held], truth.q_ig[true_rows][held])
    return replace(truth, q_ig=multiply(truth.q_ig, turn), principal_axes_g=None, center_of_mass_g=None)


def _true_quantities(time: np.ndarray, truth: Truth) -> dict[str, Float[np.ndarray, "f q"]]:
    """True `QUANTITIES` by name, not a number in epochs without a truth."""
    rows, true_rows = common_stamps(time, truth.time)
    quantities = {name: np.full((len(time), quantity.size), np.nan) for name, quantity in QUANTITIES.items()}
    for name, quantity in QUANTITIES.items():
        quantities[name][rows] = quantity.true(truth)[true_rows]
    return quantities


def _log_ratios(moments: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2"]:
    """k1, k2."""
    low, middle, high = np.sort(moments)
    return np.log([high / middle, middle / low])


def _distance(name: str, surface: np.ndarray, reference: np.ndarray) -> Float[np.ndarray, "f f"]:
    """Lengths of differences; of an attitude the angle."""
    if name != ATTITUDE:
        return np.linalg.norm(surface - reference, axis=2)
    held = np.isfinite(surface).all(axis=2) & np.isfinite(reference).all(axis=1)
    against = np.broadcast_to(reference, surface.shape)[held]
    angle = np.full(surface.shape[:2], np.nan)
    turn = multiply(inverse(against), surface[held])
    angle[held] = np.linalg.norm(rotation_vector_from_quaternion(turn), axis=1)
    return angle
