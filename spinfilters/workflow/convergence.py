"""The smoother's convergence on a recording: solved again after every frame from the first on, as arrays and a picture."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import inverse, multiply, rotation_vector_from_quaternion
from spinfilters.errors import NUMERICAL_ERRORS, InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.smoothing.sliding import SlidingSmoother
from spinfilters.estimators.smoothing.sliding_records import Retired
from spinfilters.estimators.smoothing.surfaces import MOST_FRAMES, Surfaces, record_surfaces
from spinfilters.evaluation.body import body_history
from spinfilters.evaluation.errors import attitude_alignment, common_stamps
from spinfilters.evaluation.rates import estimated_rates
from spinfilters.evaluation.trajectory import trajectory_of
from spinfilters.evaluation.truth_frames import tells_first_frame, truth_in_first_frame
from spinfilters.logs.atomic_write import make_folder
from spinfilters.logs.truth import Truth
from spinfilters.plots.convergence import Convergence, Settling, convergence_figure
from spinfilters.plots.style import draw_figure
from spinfilters.state.layout import StateLayout
from spinfilters.workflow.convergence_file import (
    newest_frames,
    no_surfaces,
    read_surfaces,
    smoothed_frames,
    write_surfaces,
)
from spinfilters.workflow.motions import ATTITUDE, MOTIONS, deviations_of
from spinfilters.workflow.preparation import Prepared
from spinfilters.workflow.run_folder import CONVERGENCE_ARRAYS as ARRAYS
from spinfilters.workflow.run_folder import CONVERGENCE_PICTURE
from spinfilters.workflow.settings import Settings
from spinfilters.workflow.smoothing import NAME


def require_convergence(prepared: Prepared, settings: Settings) -> None:
    """Refuse a run whose smoother does not take in frame after frame.

    Raises
    ------
    InputError: no smoother, measurements that are smoothed all at once, or too many frames.
    """
    if NAME not in settings.estimators:
        raise InputError(f"--convergence shows the estimator {NAME}; name it in --estimators")
    if not prepared.start.has_landmarks:
        raise InputError(
            "--convergence needs stereo tracks without a known map (landmarks.csv): other measurements are smoothed all at once"
        )
    if len(prepared.timeline) > MOST_FRAMES:
        raise InputError(
            f"--convergence is for at most {MOST_FRAMES} frames, the recording has {len(prepared.timeline)}; give a part of it"
        )


def write_convergence(
    folder: Path, prepared: Prepared, settings: Settings, on_frame: Callable[[int, int], None]
) -> None:
    """smoother/convergence.npz and convergence.png.

    Raises
    ------
    InputError: as `require_convergence`; a file cannot be written.
    """
    require_convergence(prepared, settings)
    start, layout = prepared.start, prepared.process.layout
    options = settings.smoother.options(len(prepared.timeline))
    smoother = SlidingSmoother(prepared.process, start.prior, options, tied=True)
    try:
        found = record_surfaces(smoother, prepared.timeline, partial(_motions, layout), on_frame)
    except NUMERICAL_ERRORS:
        found = no_surfaces(layout, np.array([frame.time for frame in prepared.timeline]))
    make_folder(folder / NAME)
    write_surfaces(folder / NAME / ARRAYS, found, layout)
    truth = prepared.dataset.truth
    draw_figure(
        lambda: convergence_figure(_convergence(found, newest_frames(layout, found), truth)),
        folder / CONVERGENCE_PICTURE,
    )


def is_whole(folder: Path) -> bool:
    """Whether a run folder holds both files, undamaged."""
    try:
        read_surfaces(folder / NAME / ARRAYS)
    except InputError:
        return False
    return (folder / CONVERGENCE_PICTURE).exists()


def read_convergence(folder: Path, truth: Truth | None) -> Convergence | None:
    """What the picture of a run folder shows; None where convergence was not asked for.

    Raises
    ------
    InputError: as `spinfilters.workflow.convergence_file.read_surfaces`.
    """
    path = folder / NAME / ARRAYS
    if not path.exists() and not (folder / CONVERGENCE_PICTURE).exists():
        return None
    layout, found = read_surfaces(path)
    return _convergence(found, newest_frames(layout, found), truth)


def _motions(layout: StateLayout, window: Sequence[Retired]) -> dict[str, Float[np.ndarray, "k q"]]:
    """What is kept of a solve, SI: every one of `MOTIONS`, and their standard deviations."""
    history = smoothed_frames(layout, window)
    trajectory, rates = trajectory_of(history), estimated_rates(history)
    told = {name: motion.estimate(trajectory, rates) for name, motion in MOTIONS.items()}
    values = {name: value for name, (value, _) in told.items()}
    return values | {deviations_of(name): std for name, (_, std) in told.items()}


def _convergence(found: Surfaces, newest: EstimateHistory, truth: Truth | None) -> Convergence:
    """With errors where there is a truth, with distances from the last solve otherwise."""
    if truth is None:
        reference = {name: found.values[name][-1] for name in MOTIONS}
    else:
        truth = _in_estimated_frame(found, newest, truth)
        reference = _true_motions(found.time, truth)
    motions = [
        Settling(
            motion.label,
            motion.unit,
            motion.scale * _distance(name, found.values[name], reference[name]),
            motion.scale * np.linalg.norm(found.values[deviations_of(name)], axis=2),
        )
        for name, motion in MOTIONS.items()
    ]
    ratios = (
        None if truth is None or truth.principal_moments is None else _log_ratios(truth.principal_moments)
    )
    centre = None if truth is None else truth.center_of_mass_g
    known = truth is not None
    return Convergence(found.time, motions, body_history(newest), found.trusted, known, ratios, centre)


def _in_estimated_frame(found: Surfaces, newest: EstimateHistory, truth: Truth) -> Truth:
    """The truth in the g that the first frame defines; where that is not told, in the g that fits the last solve best."""
    if tells_first_frame(newest, truth):
        return truth_in_first_frame(newest, truth)
    rows, true_rows = common_stamps(found.time, truth.time)
    attitudes = found.values[ATTITUDE][-1, rows]
    held = np.isfinite(attitudes).all(axis=1)
    turn = attitude_alignment(attitudes[held], truth.q_ig[true_rows][held])
    return replace(truth, q_ig=multiply(truth.q_ig, turn), principal_axes_g=None, center_of_mass_g=None)


def _true_motions(time: np.ndarray, truth: Truth) -> dict[str, Float[np.ndarray, "f q"]]:
    """By the names of `MOTIONS`, not a number in frames without a truth."""
    rows, true_rows = common_stamps(time, truth.time)
    motions = {name: np.full((len(time), motion.size), np.nan) for name, motion in MOTIONS.items()}
    for name, motion in MOTIONS.items():
        motions[name][rows] = motion.true(truth)[true_rows]
    return motions


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
