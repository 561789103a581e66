"""Estimated motion with its uncertainty: trajectory in inertial axes, body rates, flips, kinetic energy, files."""

from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Final

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.attitude_conversions import inverse, rotate
from spinfilters.core.attitude_expressions import Expression
from spinfilters.core.attitude_expressions import rotate as rotate_expression
from spinfilters.core.compiled import Compiled
from spinfilters.core.errors import InputError, ShapeError
from spinfilters.core.linear_algebra import by_stretches
from spinfilters.core.working_time import building
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.input_file import path_text
from spinfilters.io.measurement_log import MeasurementLog, normalised
from spinfilters.io.ply_files import read_ply, write_ply
from spinfilters.io.sensor_tables import write_poses
from spinfilters.io.text_table import write_csv
from spinfilters.io.truth import TRUTH_COLUMNS, Truth
from spinfilters.models.body import BodyEstimate, BodyHistory, bodies_of
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.models.state_layout import StateLayout, with_error_jacobian

STD_COLUMNS: Final[tuple[str, ...]] = tuple(
    f"std_{name}{axis}" for name in ("r", "a", "v", "w") for axis in "xyz"
)
"""Standard deviations of position m (i), attitude rad (g axes), velocity m/s (i), rate rad/s (i)."""
TRAJECTORY_COLUMNS: Final[tuple[str, ...]] = (*TRUTH_COLUMNS, *STD_COLUMNS)
MAP_COMMENTS: Final = ("landmarks in frame g, m",)
"""Of a map's PLY."""
PLATEAU: Final = 0.5**0.5
"""Share of the rate that is along the intermediate axis on a plateau: at 45 degrees from it a body turns about another axis."""
CLEAR: Final = 3.0
"""Standard deviations between two moments, below which it is open which axis is the intermediate one."""


@dataclass(frozen=True)
class EstimatedMotion:
    """Motion of the centre of mass and attitude of g as in `spinfilters.io.truth`.

    Attributes
    ----------
    time : (n,) float array
        Time, s.
    position : (n, 3) float array
        Centre of mass in i, m.
    q_ig : (n, 4) float array
        Attitude of g in i, scalar last.
    velocity : (n, 3) float array
        Velocity of the centre of mass in i, m/s.
    rate_i : (n, 3) float array
        Angular rate in i axes, rad/s.
    sees_position : bool
        False for a layout of rotations only: position and velocity are then zero by definition, because the origin of i
        rides on the centre of mass.
    """

    time: Float[np.ndarray, " n"]
    position: Float[np.ndarray, "n 3"]
    q_ig: Float[np.ndarray, "n 4"]
    velocity: Float[np.ndarray, "n 3"]
    rate_i: Float[np.ndarray, "n 3"]
    sees_position: bool

    @property
    def is_finite(self) -> Bool[np.ndarray, " n"]:
        """Epochs whose motion is finite, whatever its uncertainty."""
        motion = (self.position, self.q_ig, self.velocity, self.rate_i)
        return np.logical_and.reduce([np.isfinite(each).all(axis=1) for each in motion])


@dataclass(frozen=True)
class Trajectory(EstimatedMotion):
    """Motion with its uncertainty.

    Attributes
    ----------
    std_position, std_velocity, std_rate : (n, 3) float array
        Standard deviations along the same axes; std_rate includes that of the attitude.
    std_attitude : (n, 3) float array
        Standard deviations about the axes of g, rad.
    """

    std_position: Float[np.ndarray, "n 3"]
    std_attitude: Float[np.ndarray, "n 3"]
    std_velocity: Float[np.ndarray, "n 3"]
    std_rate: Float[np.ndarray, "n 3"]

    def at(self, rows: Int[np.ndarray, " k"]) -> "Trajectory":
        """The trajectory at some epochs."""
        arrays = {field.name for field in fields(self)} - {"sees_position"}
        return replace(self, **{name: getattr(self, name)[rows] for name in arrays})


@dataclass(frozen=True)
class BodyRates:
    """Rates over time.

    Attributes
    ----------
    label : str
        Whose they are.
    time : (n,) float array
        Time, s.
    rate : (n, 3) float array
        Rates, rad/s, in axes fixed to the body (g unless turned).
    covariance : (n, 3, 3) float array or None
        Covariances, (rad/s)^2; None where there is none.
    """

    label: str
    time: Float[np.ndarray, " n"]
    rate: Float[np.ndarray, "n 3"]
    covariance: Float[np.ndarray, "n 3 3"] | None = None

    @property
    def std(self) -> Float[np.ndarray, "n 3"] | None:
        """Standard deviations along the axes, rad/s."""
        return None if self.covariance is None else np.sqrt(np.einsum("nii->ni", self.covariance))

    def in_axes(self, axes: Float[np.ndarray, "3 3"]) -> "BodyRates":
        """The same rates along other axes, given as rows in the present ones (R_bg for principal axes b)."""
        own, rate = self.covariance, self.rate @ axes.T
        if own is None:
            return BodyRates(self.label, self.time, rate)
        turned = by_stretches(len(own), lambda rows: {"P": axes @ own[rows] @ axes.T})
        return BodyRates(self.label, self.time, rate, turned["P"])


def trajectory_of(history: EstimateHistory) -> Trajectory:
    """Motion r = t + R c and rate R w of a history, with covariances that include all cross terms."""
    layout = history.layout

    def derive(rows: slice) -> dict[str, np.ndarray]:
        """Quantities of a stretch of epochs."""
        value, derivative = _motion(layout)(history.mean[rows])
        std = np.linalg.norm(derivative @ history.factor[rows], axis=2)
        return {
            "q_ig": normalised(history.mean[rows, layout.mean_slice("a")]),
            "std_attitude": np.linalg.norm(history.factor[rows, layout.slice("a")], axis=2),
            **{name: value[:, columns] for name, columns in moving.items()},
            **{f"std_{name.removesuffix('_i')}": std[:, columns] for name, columns in moving.items()},
        }

    moving = _places(layout)
    motion = by_stretches(len(history.time), derive, history.factor)
    if not layout.translates:
        nothing = np.broadcast_to(0.0, (len(history.time), 3))
        motion |= {name: nothing for place in _PLACES for name in (place, f"std_{place}")}
    return Trajectory(time=history.time, sees_position=layout.translates, **motion)


def motion_of(history: EstimateHistory) -> EstimatedMotion:
    """Motion of a history without its covariances, as of `trajectory_of` to rounding."""
    layout = history.layout
    (value,) = _motion_alone(layout)(history.mean)
    motion = {name: value[:, columns] for name, columns in _places(layout).items()}
    if not layout.translates:
        motion |= dict.fromkeys(_PLACES, np.broadcast_to(0.0, (len(history.time), 3)))
    q_ig = normalised(history.mean[:, layout.mean_slice("a")])
    return EstimatedMotion(time=history.time, q_ig=q_ig, sees_position=layout.translates, **motion)


_PLACES: Final = {"position": slice(0, 3), "velocity": slice(3, 6)}


def _places(layout: StateLayout) -> dict[str, slice]:
    """Components of `_motion` by their names, of those that the layout has."""
    return (_PLACES if layout.translates else {}) | {"rate_i": slice(6, 9)}


def estimated_rates(history: EstimateHistory) -> BodyRates:
    """Block w of a history, axes g, labelled with the estimator's name."""
    factor = history.factor[:, history.layout.slice("w")]
    rate = history.mean[:, history.layout.mean_slice("w")]
    squares = by_stretches(
        len(rate), lambda rows: {"P": factor[rows] @ np.swapaxes(factor[rows], 1, 2)}, factor
    )
    return BodyRates(history.name, history.time, rate, squares["P"])


def true_rates(truth: Truth, frame: Float[np.ndarray, "4"] | None = None) -> BodyRates:
    """True rates in the truth's g, or in the estimate's with ``frame`` = `TruthErrors.frame`."""
    rate = rotate(inverse(truth.q_ig), truth.rate_i)
    return BodyRates("truth", truth.time, rate if frame is None else rotate(inverse(frame), rate))


def measured_rates(log: MeasurementLog) -> BodyRates | None:
    """Rates of the first rate sensor of a log in axes g, rad/s; None without such a sensor."""
    for stream in log.streams:
        rates = sensor_of(stream.sensor).measured_rates(stream)
        if rates is not None:
            return BodyRates(stream.sensor, stream.time, rates)
    return None


def count_flips(rate: Float[np.ndarray, "n 3"], intermediate: int = 1) -> int:
    """Reversals of the rotation about the intermediate axis.

    From within 45 degrees of the axis to within 45 degrees of its opposite.
    A rate that only crosses zero, as in every nutation about another axis, is none, nor is a reversal that is not complete.

    Parameters
    ----------
    rate : (n, 3) float array
        Along the principal axes, rad/s.
    """
    along, length = rate[:, intermediate], np.linalg.norm(rate, axis=1)
    plateau = np.sign(along[np.abs(along) > PLATEAU * length])
    return int(np.count_nonzero(np.diff(plateau)))


def knows_intermediate_axis(body: BodyEstimate) -> bool:
    """Whether the moments are distinct: two equal moments define no axes, and no flip about them."""
    moments, covariance = body.principal_moments, body.principal_moments_cov
    variance = np.diag(covariance)
    apart = variance[1:] + variance[:-1] - 2 * np.diag(covariance, 1)
    return bool(np.all(np.diff(moments) > CLEAR * np.sqrt(np.maximum(apart, 0.0))))


def write_trajectory_csv(path: Path, trajectory: Trajectory) -> None:
    """Write `TRAJECTORY_COLUMNS`, so that reading gives the same bits. Atomic."""
    write_csv(path, TRAJECTORY_COLUMNS, trajectory_columns(trajectory))


def trajectory_columns(trajectory: Trajectory) -> list[Float[np.ndarray, " n"]]:
    """Columns of `TRAJECTORY_COLUMNS`."""
    motion = [trajectory.position, trajectory.q_ig, trajectory.velocity, trajectory.rate_i]
    std = [trajectory.std_position, trajectory.std_attitude, trajectory.std_velocity, trajectory.std_rate]
    return [trajectory.time, *(column for block in (*motion, *std) for column in block.T)]


def write_trajectory_tum(path: Path, trajectory: Trajectory) -> None:
    """Write the trajectory of the centre of mass as TUM, atomically.

    `time, position of the centre of mass in i, q_ig`, for evo say.
    Epochs that are not finite are left out: no reader of the format takes them. The file is a line of comment where none is.
    Mind that `poses.tum` of a data set holds the origin of g instead of the centre of mass.
    """
    held = trajectory.is_finite
    write_poses(path, trajectory.time[held], trajectory.position[held], trajectory.q_ig[held])


def write_frame_tum(path: Path, history: EstimateHistory) -> None:
    """Write the pose of frame g in i of a history whose state has one, `time, origin of g, q_ig`, as TUM, atomically.

    This is what `poses.tum` of a data set holds, so a comparison with that file has no lever arm from g to the centre of mass.
    Epochs that are not finite are left out.
    """
    layout = history.layout
    position = history.mean[:, layout.mean_slice("t")]
    attitude = history.mean[:, layout.mean_slice("a")]
    held = np.isfinite(position).all(axis=1) & np.isfinite(attitude).all(axis=1)
    write_poses(path, history.time[held], position[held], normalised(attitude[held]))


def write_map_ply(path: Path, points: Float[np.ndarray, "k 3"]) -> None:
    """Write points (m, frame g) as a binary little-endian PLY of doubles x, y, z. Atomic.

    Raises
    ------
    ShapeError
        Points that are not (k, 3).
    InputError
        As `spinfilters.io.output_files.write_bytes`.
    """
    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError(f"map points have shape {points.shape}, expected (k, 3)")
    write_ply(path, dict(zip("xyz", points.T.astype(np.float64), strict=True)), MAP_COMMENTS)


def read_map_ply(path: Path) -> Float[np.ndarray, "k 3"]:
    """Points of a file of `write_map_ply`. InputError: as `read_ply`, or another PLY."""
    content = read_ply(path)
    if content.comments != MAP_COMMENTS or not np.isfinite(content.points).all():
        raise InputError(f"{path_text(path)}: is no map of a run; make the run again")
    return content.points


@cache
def _motion(layout: StateLayout) -> Compiled:
    """Centre of mass, velocity and rate in i (9), derivative (9 x e) by the error."""
    return with_error_jacobian(layout, "motion_in_i", _motion_in_i)


@cache
@building()
def _motion_alone(layout: StateLayout) -> Compiled:
    """Centre of mass, velocity and rate in i (9)."""
    x = ca.SX.sym("x", layout.mean_dim)
    value = _motion_in_i(layout.unpack(x))
    return Compiled.late(ca.Function("motion_in_i_alone", [x], [value], ["x"], ["y"]))


def _motion_in_i(state: dict[str, Expression]) -> Expression:
    """Centre of mass, velocity and rate in i (9); zeros instead of the first two where the state has no place."""
    rate = rotate_expression(state["q"], state["w"])
    if "t" not in state:
        return ca.vertcat(ca.SX.zeros(6), rate)
    return ca.vertcat(state["t"] + rotate_expression(state["q"], state["c"]), state["v"], rate)


def body_history(history: EstimateHistory, intervals: bool = True) -> BodyHistory:
    """The body after every epoch of a history with block s; see `bodies_of`."""
    return bodies_of(history.layout, history.time, history.mean, history.factor, intervals)


@dataclass(frozen=True)
class EnergyCourse:
    """An energy over time.

    Attributes
    ----------
    time : (k,) float array
        Time, s.
    energy, std : (k,) float array
        Value and standard deviation, J.
    """

    time: Float[np.ndarray, " k"]
    energy: Float[np.ndarray, " k"]
    std: Float[np.ndarray, " k"]

    def change(self, begin: float, end: float) -> tuple[float, float]:
        """Relative change between two times (s) and its deviation: of a straight line through the logarithms within.

        Rows weigh by their deviations, and their errors are taken as independent. Rows whose deviation is
        below rounding have no meaningful weight and are left out. LinAlgError: fewer than two times.
        """
        inside = (self.time >= begin) & (self.time <= end) & (self.energy > 0)
        inside &= self.std > np.finfo(float).eps * self.energy
        if len(np.unique(self.time[inside])) < 2:
            raise np.linalg.LinAlgError("fewer than two times")
        weight = self.energy[inside] / self.std[inside]
        rows = np.stack([np.ones(len(weight)), self.time[inside] - begin], axis=1) * weight[:, None]
        Q, R = np.linalg.qr(rows)  # of log E = a + b t: b = (Q' y)_2 / R_22, its deviation 1 / |R_22|
        slope = (Q.T @ (weight * np.log(self.energy[inside])))[1] / R[1, 1]
        ratio = float(np.exp(slope * (end - begin)))
        std = (end - begin) * ratio / float(abs(R[1, 1]))
        return ratio - 1.0, std


def quadratic_energy(
    time: Float[np.ndarray, " k"],
    values: Float[np.ndarray, "k 3"],
    covariance: Float[np.ndarray, "k 3 3"],
    form: Float[np.ndarray, "3 3"],
) -> EnergyCourse:
    """E = x' A x / 2 of Gaussian x, A symmetric: w' J w / 2 (Tweddle 2013, Eq. 2.80), or m v' v / 2.

    The variance is (A x)' P (A x) + tr((A P)^2) / 2; the excess of the mean, tr(A P) / 2, is taken off.

    Parameters
    ----------
    time : (k,) float array
        Time, s.
    values : (k, 3) float array
        Rates, rad/s, or velocities, m/s.
    covariance : (k, 3, 3) float array
        Of the values.
    form : (3, 3) float array
        Inertia, kg m^2, in the axes of the rates, or the mass, kg, times the identity.

    Returns
    -------
    EnergyCourse
        Energies, J.
    """
    bent = values @ form
    product = form @ covariance
    excess = np.einsum("kii->k", product) / 2
    variance = np.einsum("ki,kij,kj->k", bent, covariance, bent)
    variance = variance + np.einsum("kij,kji->k", product, product) / 2
    return EnergyCourse(time, np.einsum("ki,ki->k", bent, values) / 2 - excess, np.sqrt(variance))
