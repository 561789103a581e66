"""Convergence of the smoother: every epoch as it was estimated first and last, its file and its figure."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from zipfile import ZIP_DEFLATED

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from spinfilters.core.attitude_conversions import (
    continuous_quaternions,
    inverse,
    multiply,
    quaternion_from_matrix,
    rotation_vector_from_quaternion,
)
from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.core.inertia_charts import log_ratios_of
from spinfilters.evaluation.estimated_motion import (
    BodyRates,
    Trajectory,
    body_history,
    estimated_rates,
    trajectory_of,
    true_rates,
)
from spinfilters.evaluation.trajectory_errors import (
    attitude_alignment,
    common_stamps,
    tells_first_frame,
    truth_in_first_frame,
)
from spinfilters.filters.history import EstimateHistory, GrowingHistory
from spinfilters.inference.setup import Setup
from spinfilters.inference.smoother_run import NAME
from spinfilters.io.output_files import make_folder, write_bytes
from spinfilters.io.truth import Truth
from spinfilters.models.body import BodyHistory
from spinfilters.models.state_layout import FULL_BLOCKS, Gaussian, StateLayout
from spinfilters.models.status import EstimatorStatus
from spinfilters.plots.convergence import Convergence, ConvergingQuantity, convergence_figure
from spinfilters.plots.settling import (
    SettlingConstant,
    SettlingQuantity,
    SolveCosts,
    constants_figure,
    costs_figure,
    course_animation,
    surfaces_figure,
)
from spinfilters.plots.style import PRINCIPAL_NAMES
from spinfilters.run.array_files import DAMAGED, read_arrays, unusable, write_arrays
from spinfilters.run.pictures import Pictures, draw_pictures
from spinfilters.run.run_folder import (
    CONSTANTS_PICTURE,
    CONVERGENCE_PICTURE,
    COSTS_PICTURE,
    SETTLING_ANIMATIONS,
    SURFACE_PICTURES,
)
from spinfilters.run.run_folder import CONVERGENCE_ARRAYS as ARRAYS
from spinfilters.settings.run_settings import Settings
from spinfilters.smoother.recursive_smoother import MOST_EPOCHS, ConvergenceRecord, record_convergence
from spinfilters.smoother.sliding_smoother import MarginalizedState, SlidingSmoother

ATTITUDE = "attitude"
"""The one of `QUANTITIES` whose values are quaternions q_ig."""


@dataclass(frozen=True)
class PlottedQuantity:
    """A quantity of k epochs whose convergence is plotted, SI.

    Attributes
    ----------
    label, unit : str
        In the picture.
    scale : float
        What SI is multiplied by for that unit.
    size : int
        Components of the values.
    estimate : callable
        Values (k, size) and their standard deviations (k, 3).
    true : callable
        Values of a truth.
    """

    label: str
    unit: str
    scale: float
    size: int
    estimate: Callable[[Trajectory, BodyRates], tuple[Float[np.ndarray, "k q"], Float[np.ndarray, "k 3"]]]
    true: Callable[[Truth], Float[np.ndarray, "k q"]]


def _rates(rates: BodyRates) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]]:
    """Body rates of estimates, with covariance."""
    std = rates.std
    assert std is not None
    return rates.rate, std


QUANTITIES = {
    "position": PlottedQuantity(
        *("position", "mm", 1e3, 3),
        estimate=lambda trajectory, _: (trajectory.position, trajectory.std_position),
        true=lambda truth: truth.center_of_mass,
    ),
    ATTITUDE: PlottedQuantity(
        *("attitude", "deg", float(np.rad2deg(1.0)), 4),
        estimate=lambda trajectory, _: (trajectory.q_ig, trajectory.std_attitude),
        true=lambda truth: truth.q_ig,
    ),
    "velocity": PlottedQuantity(
        *("velocity", "mm/s", 1e3, 3),
        estimate=lambda trajectory, _: (trajectory.velocity, trajectory.std_velocity),
        true=lambda truth: truth.velocity,
    ),
    "body_rate": PlottedQuantity(
        *("body rate", "deg/s", float(np.rad2deg(1.0)), 3),
        estimate=lambda _, rates: _rates(rates),
        true=lambda truth: true_rates(truth).rate,
    ),
}
"""By the names of their surfaces; position and velocity are the centre of mass' in i."""


def deviations_of(name: str) -> str:
    """The name of the surface of a quantity's standard deviations."""
    return f"std_{name}"


Y_AXIS = 1
"""The axis of the animations, as Tweddle's Figures 6-40 and 6-41."""
CURE = "run compare again with --resume --convergence"
_SIZES = {
    **{name: quantity.size for name, quantity in QUANTITIES.items()},
    **{deviations_of(name): 3 for name in QUANTITIES},
}
"""Components of the surfaces, by name."""


def write_convergence_record(path: Path, found: ConvergenceRecord, layout: StateLayout) -> None:
    """Write the convergence record as arrays.

    Surfaces (solves, epochs, components), the body after every solve, and the states that it was computed from.
    """
    latest = latest_epochs(layout, found)
    states = {"blocks": np.array(layout.blocks), "newest_mean": latest.mean, "newest_factor": latest.factor}
    arrays = {
        "time": found.time,
        "trusted": found.trusted,
        "costs": found.costs,
        "closure": np.array([found.closure or 0]),
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
    return ConvergenceRecord(
        time, values, tuple(latest), np.zeros(n, dtype=bool), np.full((n, 3), np.nan), None
    )


def read_convergence_record(path: Path) -> tuple[StateLayout, ConvergenceRecord]:
    """Read what `write_convergence_record` wrote, and the layout of its states.

    Raises
    ------
    InputError
        Missing, too large, damaged, or arrays that do not fit together.
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
        "costs": (count, 3),
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
    rows = tuple(MarginalizedState(*row) for row in latest)
    closure = arrays["closure"]
    if closure.shape != (1,) or closure.dtype != np.dtype(int):
        raise ValueError(f"closure is {closure.dtype} of shape {closure.shape}, not int of (1,)")
    return layout, ConvergenceRecord(time, values, rows, trusted, arrays["costs"], int(closure[0]) or None)


def require_convergence(setup: Setup, settings: Settings) -> None:
    """Refuse a run whose smoother does not take in epoch after epoch.

    Raises
    ------
    InputError
        No smoother, measurements that are smoothed all at once, or too many epochs.
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
    folder: Path,
    setup: Setup,
    settings: Settings,
    on_epoch: Callable[[int, int], None],
    with_figures: bool = True,
) -> None:
    """smoother/convergence.npz and convergence.png.

    Raises
    ------
    InputError
        As `require_convergence`; a file cannot be written.
    """
    require_convergence(setup, settings)
    layout, truth = setup.process.layout, setup.dataset.truth
    found = recorded_convergence(setup, settings, on_epoch)
    make_folder(folder / NAME)
    write_convergence_record(folder / NAME / ARRAYS, found, layout)
    if with_figures:
        draw_convergence(folder, layout, found, truth)


def draw_convergence(
    folder: Path, layout: StateLayout, found: ConvergenceRecord, truth: Truth | None
) -> None:
    """All pictures of a convergence record into the folder of a run.

    Parameters
    ----------
    folder : Path
        Of the run.
    layout : StateLayout
        Of the record's states.
    found : ConvergenceRecord
        What every solve said.
    truth : Truth or None
        In frame g of the data set; None without one.
    """
    settling = _settling_or_none(found, layout, truth)
    draw_pictures(folder, _pictures(layout, found, truth, settling))
    if settling is not None:
        for name, animated in SETTLING_ANIMATIONS.items():
            moving = course_animation(found.time, settling.quantities[name], Y_AXIS)
            write_bytes(folder / NAME / animated, moving)


def convergence_figures(folder: Path, truth: Truth | None) -> Pictures:
    """Pictures of the convergence of a run folder, without its animations; none where it was not asked for.

    Raises
    ------
    InputError
        As `read_convergence_record`.
    """
    path = folder / NAME / ARRAYS
    if not path.exists() and not (folder / CONVERGENCE_PICTURE).exists():
        return {}
    layout, found = read_convergence_record(path)
    return _pictures(layout, found, truth, _settling_or_none(found, layout, truth))


def _settling_or_none(
    found: ConvergenceRecord, layout: StateLayout, truth: Truth | None
) -> "Settling | None":
    """None where the numbers lead nowhere: the first picture says that nothing can be drawn."""
    try:
        return settling_of(found, layout, truth)
    except NUMERICAL_ERRORS:
        return None


def _pictures(
    layout: StateLayout, found: ConvergenceRecord, truth: Truth | None, settling: "Settling | None"
) -> Pictures:
    pictures: dict[str, Callable[[], Figure]] = {
        CONVERGENCE_PICTURE: lambda: convergence_figure(
            _convergence(found, latest_epochs(layout, found), truth)
        )
    }
    if settling is not None:
        for name, quantity in settling.quantities.items():
            surfaces = partial(surfaces_figure, found.time, quantity, found.closure)
            pictures[f"{NAME}/{SURFACE_PICTURES[name]}"] = surfaces
        constants = partial(constants_figure, settling.constants, found.closure)
        pictures[f"{NAME}/{CONSTANTS_PICTURE}"] = constants
        pictures[f"{NAME}/{COSTS_PICTURE}"] = partial(costs_figure, settling.costs)
    return pictures


def recorded_convergence(
    setup: Setup, settings: Settings, on_epoch: Callable[[int, int], None] = lambda *_: None
) -> ConvergenceRecord:
    """What a smoother that takes in epoch after epoch from the first one on says after every epoch.

    Parameters
    ----------
    setup : Setup
        Tracks without a known map.
    settings : Settings
        Of the smoother.
    on_epoch : callable
        Called with epochs done and all epochs.

    Returns
    -------
    ConvergenceRecord
        Not a number where the smoother's numbers led nowhere.
    """
    options = settings.smoother.options(len(setup.timeline))
    smoother = SlidingSmoother(setup.process, setup.initial.prior, options, has_landmarks=True)
    layout = setup.process.layout
    try:
        return record_convergence(smoother, setup.timeline, partial(_quantities, layout), on_epoch)
    except NUMERICAL_ERRORS:
        return empty_convergence_record(layout, np.array([epoch.time for epoch in setup.timeline]))


@dataclass(frozen=True)
class Settling:
    """What every solve said, for figures axis by axis.

    Attributes
    ----------
    quantities : dict
        By the names of `QUANTITIES`.
    constants : list of SettlingConstant
        Centre of mass, principal axes, ratios of moments.
    costs : SolveCosts
        Of every solve.
    """

    quantities: dict[str, SettlingQuantity]
    constants: list[SettlingConstant]
    costs: SolveCosts


def settling_of(found: ConvergenceRecord, layout: StateLayout, truth: Truth | None) -> Settling:
    """Values and deviations axis by axis, with truth where there is one.

    Parameters
    ----------
    found : ConvergenceRecord
        What every solve said.
    layout : StateLayout
        Of its states.
    truth : Truth or None
        In frame g of the data set; None without one.

    Returns
    -------
    Settling
        In the units of the figures.
    """
    latest = latest_epochs(layout, found)
    known = None if truth is None else _in_estimated_frame(found, latest, truth)
    true = {} if known is None else _true_quantities(found.time, known)
    quantities = {}
    for name, quantity in QUANTITIES.items():
        values, std = found.values[name], quantity.scale * found.values[deviations_of(name)]
        own = true.get(name)
        if name == ATTITUDE:  # q and -q are one attitude: the signs are those of the last solve
            last = _latest_attitudes(values)
            values = values * _signs(values, last)
            own = None if own is None else own * _signs(own, last)
            quantities[name] = SettlingQuantity(
                *(quantity.label, "-", quantity.unit, ("qx", "qy", "qz")),
                *(values[..., :3], std, None if own is None else own[:, :3]),
            )
        else:
            scaled = None if own is None else quantity.scale * own
            quantities[name] = SettlingQuantity(
                *(quantity.label, quantity.unit, quantity.unit, ("x", "y", "z")),
                *(quantity.scale * values, std, scaled),
            )
    return Settling(quantities, _settling_constants(body_history(latest), known), SolveCosts(*found.costs.T))


def _latest_attitudes(attitudes: Float[np.ndarray, "f f 4"]) -> Float[np.ndarray, "f 4"]:
    """Attitude of each epoch by the last solve that estimated it, with continuous signs; the unit quaternion where none did."""
    held = np.asarray(np.isfinite(attitudes).all(axis=2))
    last = len(held) - 1 - np.argmax(held[::-1], axis=0)
    latest = attitudes[last, np.arange(held.shape[1])]
    latest[~held.any(axis=0)] = (0.0, 0.0, 0.0, 1.0)
    return continuous_quaternions(latest)


def _signs(values: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Signs that bring quaternions to the side of others."""
    return np.where((values * last).sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)


def _settling_constants(bodies: BodyHistory, truth: Truth | None) -> list[SettlingConstant]:
    assert bodies.center_of_mass_g is not None
    assert bodies.center_of_mass_std is not None
    turn = _axes_turned(bodies.principal_axes_g, bodies.principal_axes_g[-1])
    turn_std = np.sqrt(np.einsum("nii->ni", bodies.principal_axes_cov))
    moments = axes = centre = ratios = None
    if truth is not None:
        moments, axes, centre = truth.principal_moments, truth.principal_axes_g, truth.center_of_mass_g
    if moments is not None:
        ratios = log_ratios_of(moments)
    true_turn = None
    if axes is not None and moments is not None:
        true_turn = _axes_turned(axes[np.argsort(moments)][np.newaxis], bodies.principal_axes_g[-1])[0]
    degrees = float(np.rad2deg(1.0))
    return [
        SettlingConstant(
            *("centre of mass in g", "mm", ("x", "y", "z")),
            *(1e3 * bodies.center_of_mass_g, 1e3 * bodies.center_of_mass_std),
            None if centre is None else 1e3 * centre,
        ),
        SettlingConstant(
            *("principal axes, turned from their last estimate", "deg", PRINCIPAL_NAMES),
            *(degrees * turn, degrees * turn_std),
            None if true_turn is None else degrees * true_turn,
        ),
        SettlingConstant(
            "ratios of the moments, k1 = ln(Jmax/Jmid), k2 = ln(Jmid/Jmin)",
            *("-", ("k1", "k2"), bodies.log_ratios, bodies.log_ratios_std, ratios),
        ),
    ]


def _axes_turned(
    axes: Float[np.ndarray, "n 3 3"], reference: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "n 3"]:
    """Rotation vector from reference axes to others, about the reference axes; signs of axes are chosen to make it small."""
    turned = np.full((len(axes), 3), np.nan)
    held = np.isfinite(axes).all(axis=(1, 2))
    if not np.isfinite(reference).all() or not held.any():
        return turned
    rows = axes[held]
    rows = rows * np.where(np.einsum("nki,ki->nk", rows, reference) < 0, -1.0, 1.0)[..., np.newaxis]
    rows[:, 2] = np.cross(rows[:, 0], rows[:, 1])
    turned[held] = rotation_vector_from_quaternion(
        quaternion_from_matrix(reference @ np.swapaxes(rows, 1, 2))
    )
    return turned


def is_recorded(folder: Path) -> bool:
    """Whether a run folder holds an undamaged convergence record."""
    try:
        read_convergence_record(folder / NAME / ARRAYS)
    except InputError:
        return False
    return True


def redraw_convergence(folder: Path, truth: Truth | None) -> bool:
    """Draw the convergence of a run folder again; False where it was not asked for.

    Raises
    ------
    InputError
        As `spinfilters.run.smoother_convergence.read_convergence_record`.
    """
    path = folder / NAME / ARRAYS
    if not path.exists() and not (folder / CONVERGENCE_PICTURE).exists():
        return False
    draw_convergence(folder, *read_convergence_record(path), truth)
    return True


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
        None if truth is None or truth.principal_moments is None else log_ratios_of(truth.principal_moments)
    )
    centre = None if truth is None else truth.center_of_mass_g
    known = truth is not None
    return Convergence(found.time, quantities, body_history(latest), found.trusted, known, ratios, centre)


def _in_estimated_frame(found: ConvergenceRecord, latest: EstimateHistory, truth: Truth) -> Truth:
    """The truth in the estimate's g.

    That which the first epoch defines; where it is not given, that which fits the last solve best.
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
