"""Errors of estimated trajectories against the truth, in the frame of the first epoch or of the truth."""

from dataclasses import dataclass, fields, replace
from enum import StrEnum
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.absolute_orientation import mean_quaternion
from spinfilters.core.attitude_conversions import inverse, multiply, rotate, rotation_vector_from_quaternion
from spinfilters.core.conventions import PerRun
from spinfilters.core.errors import InputError
from spinfilters.core.linear_algebra import STRETCH, by_stretches
from spinfilters.evaluation.estimated_motion import EstimatedMotion
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.measurement_log import normalised
from spinfilters.io.truth import Truth, truth_in_moved_frame
from spinfilters.models.body import BodyEstimate
from spinfilters.models.state_layout import POSE_BLOCKS

TIME_TOLERANCE: Final[float] = 1e-6
"""Largest difference in s of two stamps of one instant: what printing to six decimals leaves."""


class Alignment(StrEnum):
    """Transformation removed before the estimate is compared."""

    NONE = "none"
    BODY_FRAME = "body frame"
    """The constant rotation between both frames g that fits best: for an estimator that chooses its own g, where the first
    frame does not determine how they differ. The fit hides a part of the errors, so there is no NEES."""
    FIRST_FRAME = "first frame"
    """The constant transformation between both frames g that the first frame determines: an estimator without known map defines its
    g by the pose there, so that this pose is exact and nothing is fitted. Needs what `tells_first_frame` asks for."""
    INERTIAL_FRAME = "inertial frame"
    """The constant rotation between both frames i: a gyro's estimate has the g of its sensor and knows no direction of i.
    Taken from the first frame where the estimate defines its attitude there, else the one that fits best; no NEES."""


@dataclass(frozen=True)
class RmsErrors:
    """Root mean square lengths of errors: m, rad, m/s, rad/s; None without errors."""

    position: PerRun | None
    attitude: PerRun | None
    velocity: PerRun | None
    rate: PerRun


@dataclass(frozen=True)
class TruthErrors:
    """Estimate minus truth at the n common time stamps; errors of many runs at the same stamps have an axis (r,) in front.

    Attributes
    ----------
    time : (n,) float array
        Time, s.
    rows : (n,) int array
        Frames of the trajectory that were compared.
    position, velocity : (n, 3) float array or None
        Errors of the centre of mass in i, m and m/s; None where only rotation is seen.
    attitude : (n, 3) float array
        Rotation vector e in rad, axes of the estimate's g: q_estimate = q_true (x) exp(e).
    rate : (n, 3) float array
        Error of the rate in i axes, rad/s.
    frame : (4,) float array or None
        Quaternion from the estimate's g to that of the truth, None when nothing is aligned.
    """

    time: Float[np.ndarray, " n"]
    rows: Int[np.ndarray, " n"]
    position: Float[np.ndarray, "*r n 3"] | None
    attitude: Float[np.ndarray, "*r n 3"]
    velocity: Float[np.ndarray, "*r n 3"] | None
    rate: Float[np.ndarray, "*r n 3"]
    frame: Float[np.ndarray, "4"] | None

    @property
    def rms(self) -> RmsErrors:
        """Root mean square errors over all common stamps."""
        position = None if self.position is None else root_mean_square(self.position)
        velocity = None if self.velocity is None else root_mean_square(self.velocity)
        return RmsErrors(position, root_mean_square(self.attitude), velocity, root_mean_square(self.rate))

    def within(self, begin: float, end: float) -> "TruthErrors | None":
        """Errors within a span of time (s), both ends included, without copies; None without any."""
        rows = rows_within(self.time, begin, end)
        if rows.start == rows.stop:
            return None
        return TruthErrors(
            self.time[rows],
            self.rows[rows],
            None if self.position is None else self.position[..., rows, :],
            self.attitude[..., rows, :],
            None if self.velocity is None else self.velocity[..., rows, :],
            self.rate[..., rows, :],
            self.frame,
        )

    def of_run(self, run: int) -> "TruthErrors":
        """Errors of one run, of those of many."""
        moving = {name: getattr(self, name) for name in ("position", "attitude", "velocity", "rate")}
        return replace(
            self, **{name: None if error is None else error[run] for name, error in moving.items()}
        )

    @property
    def ape_rmse(self) -> float | None:
        """Rmse as `evo_ape tum truth.tum estimate.tum` prints it (translation, m, nothing aligned)."""
        return self.rms.position

    @property
    def ape_angle_rmse_deg(self) -> float:
        """Rmse as `evo_ape tum ... -r angle_deg` prints it, after the alignment if any."""
        return float(np.rad2deg(root_mean_square(self.attitude)))


@dataclass(frozen=True)
class BodyErrors:
    """Estimated minus true mass properties, of many runs with an axis (r,) in front; None where the truth does not give them.

    Attributes
    ----------
    principal_moments : (3,) float array or None
        Errors of the moments, ascending, largest = 1 in both.
    k1, k2 : PerRun or None
        Errors of the log ratios of the moments.
    axes_angle : (3,) float array or None
        Angle in rad between each estimated and true principal axis, whatever their signs.
    center_of_mass_g : (3,) float array or None
        Error of the centre of mass, m; None also when the frames g differ.
    """

    principal_moments: Float[np.ndarray, "*r 3"] | None
    k1: PerRun | None
    k2: PerRun | None
    axes_angle: Float[np.ndarray, "*r 3"] | None
    center_of_mass_g: Float[np.ndarray, "*r 3"] | None

    def of_run(self, run: int) -> "BodyErrors":
        """Errors of one run, of those of many."""
        found = {each.name: getattr(self, each.name) for each in fields(self)}
        return BodyErrors(**{name: None if error is None else error[run] for name, error in found.items()})


def rows_within(time: Float[np.ndarray, " n"], begin: float, end: float) -> slice:
    """Rows of ascending times (s) within a span, both ends included; a slice, so that no array is copied."""
    return slice(int(np.searchsorted(time, begin)), int(np.searchsorted(time, end, side="right")))


def truth_errors(
    trajectory: EstimatedMotion,
    truth: Truth,
    alignment: Alignment = Alignment.NONE,
    turn: Float[np.ndarray, "4"] | None = None,
) -> TruthErrors:
    """Errors of a trajectory at its common stamps with the truth, where it is finite; nothing is interpolated.

    `Alignment.FIRST_FRAME` takes the first common stamp for the frame that defines g (`tells_first_frame`).

    Parameters
    ----------
    turn : (4,) float array or None
        Rotation of the truth's frame i into that of the estimate (`inertial_turn`), for an estimate of rotation alone; None where
        both are the same.

    Raises
    ------
    InputError
        When no two stamps agree within `TIME_TOLERANCE`, or the trajectory is finite at none of them.
    """
    rows, true_rows = _finite_stamps(trajectory, truth)
    frame = _turn_of_frame(trajectory.q_ig[rows], truth.q_ig[true_rows], alignment)

    def derive(part: slice) -> dict[str, np.ndarray]:
        """Quantities of a stretch of epochs."""
        here, there = rows[part], true_rows[part]
        q_true, rate = truth.q_ig[there], truth.rate_i[there]
        if turn is not None:
            q_true, rate = normalised(multiply(turn, q_true)), rotate(turn, rate)
        if frame is not None:
            q_true = multiply(q_true, frame)
        away = multiply(inverse(q_true), trajectory.q_ig[here])
        turning = {
            "attitude": rotation_vector_from_quaternion(away),
            "rate": trajectory.rate_i[here] - rate,
        }
        if not trajectory.sees_position:
            return turning
        position = trajectory.position[here] - truth.center_of_mass[there]
        return turning | {"position": position, "velocity": trajectory.velocity[here] - truth.velocity[there]}

    unseen = {} if trajectory.sees_position else dict.fromkeys(("position", "velocity"))
    return TruthErrors(
        time=trajectory.time[rows], rows=rows, frame=frame, **unseen, **by_stretches(len(rows), derive)
    )


def _finite_stamps(
    trajectory: EstimatedMotion, truth: Truth
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    rows, true_rows = common_stamps(trajectory.time, truth.time)
    finite = trajectory.is_finite[rows]
    if not finite.any():
        raise InputError("the estimate is finite at no time stamp of the truth; it has no errors")
    return rows[finite], true_rows[finite]


def _turn_of_frame(q: np.ndarray, q_true: np.ndarray, alignment: Alignment) -> Float[np.ndarray, "4"] | None:
    if alignment in (Alignment.NONE, Alignment.INERTIAL_FRAME):
        return None
    if alignment is Alignment.FIRST_FRAME:
        return multiply(inverse(q_true[0]), q[0])
    return attitude_alignment(q, q_true)


def attitude_alignment(
    q: Float[np.ndarray, "n 4"], q_true: Float[np.ndarray, "n 4"]
) -> Float[np.ndarray, "4"]:
    """The constant rotation x from the estimate's g to the truth's for which q is nearest to q_true (x) x."""
    starts = range(0, len(q), STRETCH)
    stretches = (slice(start, start + STRETCH) for start in starts)
    turns = [np.empty((0, 4)), *(multiply(inverse(q_true[rows]), q[rows]) for rows in stretches)]
    return mean_quaternion(np.concatenate(turns))


def body_errors(body: BodyEstimate, truth: Truth, frame: Float[np.ndarray, "4"] | None = None) -> BodyErrors:
    """Errors of the mass properties.

    ``frame`` is `TruthErrors.frame`, None where truth and body are expressed in a common g.
    """
    moments = k1 = k2 = None
    if truth.principal_moments is not None:
        true = np.sort(truth.principal_moments)
        moments = body.principal_moments - true / true[2]
        k1 = body.k1 - float(np.log(true[2] / true[1]))
        k2 = body.k2 - float(np.log(true[1] / true[0]))
    centre = None
    if truth.center_of_mass_g is not None and body.center_of_mass_g is not None and frame is None:
        centre = body.center_of_mass_g - truth.center_of_mass_g
    return BodyErrors(moments, k1, k2, _axes_angle(body, truth, frame), centre)


def common_stamps(
    time: Float[np.ndarray, " n"], reference: Float[np.ndarray, " m"]
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Rows of both (s, ascending) whose stamps agree within `TIME_TOLERANCE`.

    Raises
    ------
    InputError
        When there are none.
    """
    after = np.clip(np.searchsorted(reference, time), 1, max(len(reference) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(reference) - 1)
    nearest = np.where(np.abs(reference[after] - time) < np.abs(reference[before] - time), after, before)
    rows = np.flatnonzero(np.abs(reference[nearest] - time) <= TIME_TOLERANCE)
    if not rows.size:
        raise InputError(
            f"no time stamp of the estimate ({_span(time)}) agrees with one of the truth "
            f"({_span(reference)}) within {TIME_TOLERANCE:g} s; give a truth at the times of the measurements"
        )
    return rows, nearest[rows]


def root_mean_square(error: Float[np.ndarray, "*r n 3"]) -> PerRun:
    """Root mean square length of vectors, over the last axis but one."""
    return np.sqrt(np.mean(np.square(error).sum(axis=-1), axis=-1))


def _axes_angle(
    body: BodyEstimate, truth: Truth, frame: np.ndarray | None
) -> Float[np.ndarray, "*r 3"] | None:
    if truth.principal_axes_g is None or truth.principal_moments is None:
        return None
    axes = truth.principal_axes_g[np.argsort(truth.principal_moments)]
    estimated = body.principal_axes_g
    if not np.isfinite(estimated).all():
        return None
    if frame is not None:
        estimated = rotate(frame, estimated)
    sine = np.linalg.norm(np.cross(estimated, axes), axis=-1)
    return np.arctan2(sine, np.abs(np.einsum("...ki,ki->...k", estimated, axes)))


def _span(time: np.ndarray) -> str:
    return f"{len(time)} from {time[0]:.6f} s to {time[-1]:.6f} s" if len(time) else "none"


DEFINED_STD: Final[float] = 1e-4
"""Largest standard deviation (m, rad) of a pose that is a definition: well above any such prior, well below any measurement."""


def tells_first_frame(history: EstimateHistory, truth: Truth) -> bool:
    """Whether `Alignment.FIRST_FRAME` applies.

    The estimate must hold the pose of g at its first frame as a definition, without doubt (`DEFINED_STD`): a pose that was
    measured there would hand its error on to everything after. The truth must give that pose: a row at the time of the first
    frame, and the centre of mass in its own g.
    """
    layout = history.layout
    if not layout.translates or truth.center_of_mass_g is None:
        return False
    doubt = max(np.linalg.norm(history.factor[0, layout.slice(b)], axis=1).max() for b in POSE_BLOCKS)
    told = doubt <= DEFINED_STD and np.isfinite(history.mean[0]).all()
    return bool(told and np.abs(truth.time - history.time[0]).min() <= TIME_TOLERANCE)


def truth_in_estimate_frames(
    history: EstimateHistory,
    truth: Truth,
    alignment: Alignment,
    rows: Int[np.ndarray, " k"] | None = None,
) -> Truth:
    """The truth in the estimate's frames i and g; as it is where nothing or a fit of both frames g relates them.

    Parameters
    ----------
    rows : (k,) int array or None
        Stamps of the truth that are wanted, ascending, None for all; the frames are found from all.

    Raises
    ------
    InputError
        As `truth_in_first_frame` and `inertial_turn`.
    """
    if alignment is Alignment.FIRST_FRAME:
        return truth_in_first_frame(history, truth, rows)
    if alignment is Alignment.INERTIAL_FRAME:
        return _turned(_chosen(truth, rows), inertial_turn(history, truth))
    return _chosen(truth, rows)


def _chosen(truth: Truth, rows: Int[np.ndarray, " k"] | None) -> Truth:
    """Some stamps of a truth, itself where all are wanted."""
    return truth if rows is None else truth.chosen(rows)


def truth_in_first_frame(
    history: EstimateHistory, truth: Truth, rows: Int[np.ndarray, " k"] | None = None
) -> Truth:
    """The truth in the g that has the estimated pose at the history's first frame.

    With T = (R_ig, t) and t = r - R_ig c the transformation from the estimate's g to that of the truth is
    T_true(0)^-1 T_estimate(0); attitude, principal axes and centre of mass of the truth are expressed with it.

    Raises
    ------
    InputError
        When `tells_first_frame` is False.
    """
    if not tells_first_frame(history, truth) or truth.center_of_mass_g is None:
        raise InputError(
            "the first frame does not show how the frames g of estimate and truth differ; give center_of_mass_g in truth.toml, a "
            f"true pose at {history.time[0]:.6f} s and an estimate that defines g there, or use {Alignment.BODY_FRAME.name}"
        )
    row, layout, first = common_stamps(history.time[:1], truth.time)[1][0], history.layout, history.mean[0]
    q_true, q_first = truth.q_ig[row], first[layout.mean_slice("a")]
    turn = multiply(inverse(q_true), q_first)
    from_origin = truth.center_of_mass[row] - first[layout.mean_slice("t")]
    shift = truth.center_of_mass_g - rotate(inverse(q_true), from_origin)
    return truth_in_moved_frame(_chosen(truth, rows), turn, shift)


def inertial_turn(history: EstimateHistory, truth: Truth) -> Float[np.ndarray, "4"]:
    """Rotation R_i'i of the truth's frame i into that of a rotation-only estimate, from both attitudes of one body.

    It is that of the first common frame where the estimate defines its attitude there, else the one that fits best.

    Raises
    ------
    InputError
        When no time stamp is common, or the estimate is finite at none.
    """
    rows, true_rows = common_stamps(history.time, truth.time)
    layout = history.layout
    attitude = history.mean[:, layout.mean_slice("a")]
    finite = np.asarray(np.isfinite(attitude).all(axis=1))[rows]
    if not finite.any():
        raise InputError("the estimate is finite at no time stamp of the truth; it has no errors")
    rows, true_rows = rows[finite], true_rows[finite]
    doubt = np.linalg.norm(history.factor[rows[0], layout.slice("a")], axis=1).max()
    if doubt <= DEFINED_STD:
        return multiply(attitude[rows[0]], inverse(truth.q_ig[true_rows[0]]))
    return inverse(attitude_alignment(inverse(attitude[rows]), inverse(truth.q_ig[true_rows])))


def _turned(truth: Truth, turn: Float[np.ndarray, "4"]) -> Truth:
    """The truth in a frame i that is turned by R_i'i."""
    return replace(
        truth,
        center_of_mass=rotate(turn, truth.center_of_mass),
        q_ig=multiply(turn, truth.q_ig),
        velocity=rotate(turn, truth.velocity),
        rate_i=rotate(turn, truth.rate_i),
    )
