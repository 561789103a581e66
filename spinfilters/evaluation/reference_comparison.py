"""An estimate compared with a reference: differences at the reference's own stamps, before and after the axes are corrected.

Tables 6.1 and 6.2 of Tweddle (2013) are the means and standard deviations of these differences; Figures 6-16 to 6-21 their courses.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.absolute_orientation import nearest_rotation
from spinfilters.core.attitude_conversions import (
    axis_angle_from_quaternion,
    continuous_quaternions,
    inverse,
    matrix_from_quaternion,
    multiply,
    quaternion_from_matrix,
    rotate,
    rotation_vector_from_matrix,
)
from spinfilters.core.camera_trajectory import CameraTrajectory
from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.core.linear_algebra import at_times
from spinfilters.evaluation.continuous_motion import ContinuousMotion
from spinfilters.evaluation.estimated_motion import EnergyCourse, quadratic_energy
from spinfilters.evaluation.reference_fit import (
    ReferenceFit,
    axis_and_angle,
    fit_reference,
    hidden_error,
    nearest_flip,
    reference_rates,
)
from spinfilters.evaluation.trajectory_errors import root_mean_square
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.reference_motion import ReferenceMotion
from spinfilters.models.body import body_estimate

FEWEST_COMMON: Final = 4
"""Rows of a reference within an estimate."""
LARGEST_TURN: Final = 0.3
"""Of the body between two differenced rows, rad."""
ALIKE: Final = 0.9
"""Correlation from which a sentence says that the clock and a rotation are barely separated."""
_AXES = "xyz"


@dataclass(frozen=True)
class Course:
    """One quantity of estimate and reference at common times, in the same axes.

    Attributes
    ----------
    time : (k,) float array
        On the clock of the estimate, s.
    estimate, reference : (k, 3) float array
        Values in ``unit``.
    """

    time: Float[np.ndarray, " k"]
    estimate: Float[np.ndarray, "k 3"]
    reference: Float[np.ndarray, "k 3"]

    @property
    def difference(self) -> Float[np.ndarray, "k 3"]:
        """Estimate minus reference."""
        return self.estimate - self.reference


@dataclass(frozen=True)
class AttitudeCourse:
    """Attitude of the reference's axes m relative to the first common row, and the closest angle between both.

    Attributes
    ----------
    time : (k,) float array
        On the clock of the estimate, s.
    estimate, reference : (k, 4) float array
        q(t) = q_m(0)^-1 (x) q_m(t) (Eq. 6.12, with this package's sense of a quaternion), continuous.
    angle : (k,) float array
        Closest angle, rad.
    """

    time: Float[np.ndarray, " k"]
    estimate: Float[np.ndarray, "k 4"]
    reference: Float[np.ndarray, "k 4"]
    angle: Float[np.ndarray, " k"]


@dataclass(frozen=True)
class MotionInFrames:
    """Attitudes and rates of a reference or of the truth in the frames of an estimate, after its last epoch too.

    Attributes
    ----------
    time : (n,) float array
        On the clock of the estimate, s.
    attitude : (n, 4) float array
        q_ig, scalar last.
    rate : (n, 3) float array
        About the axes of g, rad/s.
    """

    time: Float[np.ndarray, " n"]
    attitude: Float[np.ndarray, "n 4"]
    rate: Float[np.ndarray, "n 3"]

    def at(self, rows: Int[np.ndarray, " m"]) -> "MotionInFrames":
        """Some rows of it."""
        return MotionInFrames(self.time[rows], self.attitude[rows], self.rate[rows])


@dataclass(frozen=True)
class ReferenceComparison:
    """One estimator against a reference.

    Attributes
    ----------
    name : str
        Of the estimator.
    reference : ReferenceMotion
        In the form that was used.
    fit : ReferenceFit
        Its relation to the estimate.
    flip : (3, 3) float array
        Principal axes of the estimate in axes m, rounded to the nearest right-handed choice and signs of axes.
    correction : (3, 3) float array
        Rotation that is left: m from the flipped principal axes.
    correction_std : float
        Root mean square over the axes of its deviation, rad: of the fit and of the estimated principal axes.
    attitude : (k, 3) float array or None
        Estimate minus reference, rad, axes m, everything fitted; None for rates alone.
    attitude_before, attitude_after : AttitudeCourse or None
        With the flip alone, and corrected.
    position, velocity : Course or None
        Of the reference's origin in i, m and m/s.
    rate_before, rate_after : Course
        About m, rad/s: with the flip alone, and corrected.
    rate_rms_i : float
        Root mean square of the rates' difference in axes i, rad/s, as the errors against a truth are.
    hidden : float
        Root mean square of the error of attitude, rad, that the fit is expected to have taken up
        (`spinfilters.evaluation.reference_fit.hidden_error`); of the rate, rad/s, for rates alone.
    inertia : (3, 3) float array
        Estimated, about m, over the largest moment.
    rate_std, velocity_std : float
        Median deviation of one component of the estimate, rad/s and m/s.
    typical_rate : float
        Median of the rate, rad/s.
    """

    name: str
    reference: ReferenceMotion
    fit: ReferenceFit
    flip: Float[np.ndarray, "3 3"]
    correction: Float[np.ndarray, "3 3"]
    correction_std: float
    attitude: Float[np.ndarray, "k 3"] | None
    attitude_before: AttitudeCourse | None
    attitude_after: AttitudeCourse | None
    position: Course | None
    velocity: Course | None
    rate_before: Course
    rate_after: Course
    rate_rms_i: float
    hidden: float
    inertia: Float[np.ndarray, "3 3"]
    rate_std: float
    velocity_std: float
    typical_rate: float

    @cached_property
    def energies(self) -> Mapping[str, tuple[EnergyCourse, EnergyCourse]]:
        """Kinetic energy of estimate and reference: of the rotation over the largest moment, of the translation over the mass.

        In (rad/s)^2 and (m/s)^2. What both differ by is taken as the noise of the reference.
        """
        courses = {"rotation": (self.rate_after, self.inertia, self.rate_std)}
        if self.velocity is not None:
            courses["translation"] = (self.velocity, np.eye(3), self.velocity_std)
        found = {}
        for name, (course, form, std) in courses.items():
            own = np.broadcast_to(std**2 * np.eye(3), (len(course.time), 3, 3))
            theirs = np.broadcast_to(np.diag(np.var(course.difference, axis=0)), own.shape)
            found[name] = (
                quadratic_energy(course.time, course.estimate, own, form),
                quadratic_energy(course.time, course.reference, theirs, form),
            )
        return found

    @cached_property
    def energy_changes(self) -> Mapping[str, Mapping[str, tuple[float, float]]]:
        """Relative change of each energy over the common time with its deviation, of both; none of too few rows."""
        found: dict[str, dict[str, tuple[float, float]]] = {}
        for name, pair in self.energies.items():
            for whose, course in zip(("estimate", "reference"), pair, strict=True):
                try:
                    change = course.change(float(course.time[0]), float(course.time[-1]))
                except (*NUMERICAL_ERRORS, IndexError):
                    continue
                if np.isfinite(change).all():
                    found.setdefault(name, {})[whose] = change
        return found

    @cached_property
    def statistics(self) -> Mapping[str, tuple[float, float]]:
        """Mean and standard deviation of every row of Tables 6.1 and 6.2, SI units; those of the second are named corrected."""
        return dict(self._rows())

    def _rows(self) -> Iterator[tuple[str, tuple[float, float]]]:
        for name, course in (("position", self.position), ("velocity", self.velocity)):
            if course is not None:
                yield from _components(name, course.difference)
        for suffix, attitude, rate in (
            ("", self.attitude_before, self.rate_before),
            (" corrected", self.attitude_after, self.rate_after),
        ):
            if attitude is not None:
                yield f"closest angle{suffix}", _mean_and_std(attitude.angle)
            yield from _components("angular velocity", rate.difference, suffix)

    def motion_in_estimate_frames(self) -> MotionInFrames | None:
        """Attitude and rate of the reference as the fit relates them to the estimate; None where it has rates alone.

        With the frames of `ReferenceFit`, R_ig = X' R_lm Y' and w_g = Y w_m.
        """
        fit, reference = self.fit, self.reference
        if reference.attitude is None:
            return None
        time, rate = reference_rates(
            reference, _span(reference, fit.noise[0], self.rate_std, self.typical_rate)
        )
        R = fit.frame.T @ matrix_from_quaternion(reference.attitude) @ fit.axes.T
        return MotionInFrames(
            reference.time - fit.clock_offset,
            continuous_quaternions(quaternion_from_matrix(nearest_rotation(R))),
            at_times(reference.time, time, rate) @ fit.axes.T,
        )

    @property
    def rms(self) -> dict[str, float | None]:
        """Root mean square lengths of the corrected differences: m, rad, m/s, rad/s (axes i)."""
        of = lambda course: None if course is None else root_mean_square(course.difference)  # noqa: E731
        return {
            "position": of(self.position),
            "attitude": None if self.attitude is None else root_mean_square(self.attitude),
            "velocity": of(self.velocity),
            "rate": self.rate_rms_i,
        }

    @property
    def attitude_rms_with_hidden(self) -> float | None:
        """Expected root mean square error of the attitude against the truth, rad: with what the fit took up."""
        return (
            None if self.attitude is None else float(np.hypot(root_mean_square(self.attitude), self.hidden))
        )

    @property
    def sentences(self) -> list[str]:
        """Sentences on the fitted clock offset, axes, origin and frame."""
        fit, found = self.fit, []
        found += [f"rows left out: {', '.join(self.reference.left_out)}"] if self.reference.left_out else []
        found += [f"the reference fits only if {fit.form}"] if fit.form else []
        rate = 1.0 / self.reference.step
        gaps = self.reference.gaps
        lost = sum(end - begin for begin, end in gaps)
        found.append(
            f"{len(self.reference.time)} rows at {rate:.4g} Hz"
            + (f" with {len(gaps)} gaps of {lost:.3g} s together" if gaps else "")
        )
        if fit.has_clock:
            late = "late" if fit.clock_offset >= 0 else "early"
            found.append(
                f"its clock is {1e3 * abs(fit.clock_offset):.2f} ± {1e3 * fit.clock_std:.2g} ms {late}"
            )
            if fit.clock_correlation > ALIKE:
                turn = np.rad2deg(self.typical_rate * fit.clock_std)
                found.append(
                    f"the spin barely separates an offset of the clock from a rotation about its axis (correlation "
                    f"{fit.clock_correlation:.3f}): {1e3 * fit.clock_std:.2g} ms are {turn:.2g} deg"
                )
        else:
            found.append("the motion does not determine the offset of its clock, which is taken as zero")
        axis, angle = axis_and_angle(self.correction)
        found.append(
            f"its axes are the principal axes {_flip_text(self.flip)}, "
            f"turned by {np.rad2deg(angle):.3f} ± {np.rad2deg(self.correction_std):.2g} "
            f"deg about [{', '.join(f'{value:.3f}' for value in axis)}]"
        )
        for name, changes in self.energy_changes.items():
            words = [
                f"{100 * change:+.3g} ± {100 * std:.3g} % by the {whose}"
                for whose, (change, std) in changes.items()
            ]
            found.append(f"the energy of the {name} changes by {', '.join(words)}")
        return found

    @property
    def document(self) -> dict[str, Any]:
        """The comparison as reference.json holds it."""
        fit = self.fit
        axis, angle = axis_and_angle(self.correction)
        return {
            "reference": self.reference.name,
            "clock_offset_s": fit.clock_offset if fit.has_clock else None,
            "clock_offset_std_s": fit.clock_std if fit.has_clock else None,
            "clock_correlation": fit.clock_correlation if fit.has_clock else None,
            "axes_R_gm": fit.axes.tolist(),
            "axes_std_rad": fit.axes_std.tolist(),
            "flip_R_mb": self.flip.tolist(),
            "correction_axis_m": axis.tolist(),
            "correction_angle_rad": angle,
            "correction_std_rad": self.correction_std,
            "frame_R_li": fit.frame.tolist(),
            "frame_std_rad": fit.frame_std.tolist(),
            "origin_g_m": None if fit.origin is None else fit.origin.tolist(),
            "origin_std_m": None if fit.origin_std is None else fit.origin_std.tolist(),
            "noise_rad": fit.noise[0],
            "noise_m": fit.noise[1] if self.position is not None else None,
            "quaternion_form": fit.form,
            "gaps_s": [list(gap) for gap in self.reference.gaps],
            "rows": len(self.rate_after.time) if self.attitude is None else len(self.attitude),
            "rms": self.rms,
            "attitude_rms_with_hidden_rad": self.attitude_rms_with_hidden,
            "energy_changes": {
                name: {whose: {"relative": change, "std": std} for whose, (change, std) in changes.items()}
                for name, changes in self.energy_changes.items()
            },
            "statistics": {name: {"mean": mean, "std": std} for name, (mean, std) in self.statistics.items()},
            "sentences": self.sentences,
        }


def compare_with_reference(history: EstimateHistory, reference: ReferenceMotion) -> ReferenceComparison:
    """An estimate against a reference.

    Raises
    ------
    InputError
        Fewer than two epochs of the estimator are finite, or the recordings have no stretch in common.
    """
    motion = ContinuousMotion(history)
    fit, reference = fit_reference(motion, reference)
    inside = _is_within_motion(motion, reference.time - fit.clock_offset)
    if np.count_nonzero(inside) < FEWEST_COMMON:
        raise InputError(
            f"{reference.name}: {np.count_nonzero(inside)} of its rows lie within the estimate of {history.name}; record longer"
        )
    body = body_estimate(history.belief(-1), intervals=False)
    R_mb = fit.axes.T @ body.principal_axes_g.T
    flip = nearest_flip(R_mb)
    correction = R_mb @ flip.T
    time = reference.time[inside] - fit.clock_offset
    own = motion.at(time)
    uncorrected = body.principal_axes_g.T @ flip.T  # R_gm that the flip alone gives
    attitude = before = after = None
    if reference.attitude is not None:
        R, q = matrix_from_quaternion(own.q_ig), reference.attitude[inside]
        B = matrix_from_quaternion(q)
        left = np.swapaxes(B, 1, 2) @ fit.frame @ R @ fit.axes
        attitude = rotation_vector_from_matrix(left)
        before = _attitude_course(time, q, own.q_ig, uncorrected, anchored=True)
        frame = quaternion_from_matrix(fit.frame)
        after = _attitude_course(
            time, q, multiply(np.broadcast_to(frame, own.q_ig.shape), own.q_ig), fit.axes, anchored=False
        )
    rate_before, rate_after, rms = _rates(motion, reference, fit, uncorrected)
    return ReferenceComparison(
        history.name,
        reference,
        fit,
        flip,
        correction,
        float(np.sqrt(np.mean(fit.axes_std**2) + np.mean(body.principal_axes_std**2))),
        attitude,
        before,
        after,
        *_places(motion, reference, fit),
        rate_before,
        rate_after,
        rms,
        hidden_error(fit, motion, reference),
        fit.axes.T @ motion.inertia @ fit.axes / float(np.linalg.eigvalsh(motion.inertia)[-1]),
        motion.rate_std,
        motion.velocity_std,
        motion.typical_rate,
    )


def _is_within_motion(motion: ContinuousMotion, time: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    begin, end = motion.span
    return (time >= begin) & (time <= end)


def _attitude_course(
    time: np.ndarray, q_lm: np.ndarray, q: np.ndarray, axes: Float[np.ndarray, "3 3"], anchored: bool
) -> AttitudeCourse:
    """Attitudes relative to the first row; the angle of both, each from its own first attitude where anchored."""
    own = multiply(q, np.broadcast_to(quaternion_from_matrix(axes), q.shape))
    estimate, reference = _since_first(own), _since_first(q_lm)
    pair = (estimate, reference) if anchored else (own, q_lm)
    _, angle = axis_angle_from_quaternion(multiply(inverse(pair[1]), pair[0]))
    return AttitudeCourse(time, continuous_quaternions(estimate), continuous_quaternions(reference), angle)


def _since_first(q: Float[np.ndarray, "k 4"]) -> Float[np.ndarray, "k 4"]:
    return multiply(np.broadcast_to(inverse(q[0]), q.shape), q)


def _rates(
    motion: ContinuousMotion, reference: ReferenceMotion, fit: ReferenceFit, uncorrected: np.ndarray
) -> tuple[Course, Course, float]:
    time, rate = reference_rates(
        reference, _span(reference, fit.noise[0], motion.rate_std, motion.typical_rate)
    )
    time = time - fit.clock_offset
    inside = _is_within_motion(motion, time)
    time, rate = time[inside], rate[inside]
    own = motion.at(time)
    before, after = (Course(time, own.rate @ axes, rate) for axes in (uncorrected, fit.axes))
    difference = after.difference
    if reference.attitude is not None:
        # in axes i, where an error of attitude turns the rate too
        poses = CameraTrajectory(
            reference.time, np.hstack([np.zeros((len(reference.time), 3)), reference.attitude])
        )
        theirs = rotate(poses.at(time + fit.clock_offset)[:, 3:], rate) @ fit.frame
        difference = rotate(own.q_ig, own.rate) - theirs
    return before, after, root_mean_square(difference)


def _span(reference: ReferenceMotion, noise: float, std: float, typical_rate: float) -> float:
    """Time over which to take differences, s: their noise is then that of the estimate, if the body turns little meanwhile."""
    longest = max(LARGEST_TURN / max(typical_rate, 1e-6), reference.step)
    return float(np.clip(np.sqrt(2.0) * noise / max(std, 1e-12), reference.step, longest))


def _places(
    motion: ContinuousMotion, reference: ReferenceMotion, fit: ReferenceFit
) -> tuple[Course | None, Course | None]:
    """Position and velocity of the reference's origin in i; no velocity where no two of its rows are close enough."""
    if reference.position is None or fit.origin is None:
        return None, None
    time = reference.time - fit.clock_offset
    inside = _is_within_motion(motion, time)
    position = Course(
        time[inside],
        _origin(motion, fit, time[inside])[0],
        (reference.position[inside] - fit.shift) @ fit.frame,
    )
    velocity = reference.velocity
    if velocity is None:
        stride = int(
            np.ceil(
                _span(reference, fit.noise[1], motion.velocity_std, motion.typical_rate) / reference.step
                - 1e-9
            )
        )
        dt = reference.time[stride:] - reference.time[:-stride]
        held = dt <= 1.5 * stride * reference.step
        velocity = ((reference.position[stride:] - reference.position[:-stride]) / dt[:, None])[held]
        time = (reference.time[stride:] + reference.time[:-stride])[held] / 2 - fit.clock_offset
        inside = _is_within_motion(motion, time)
    if not inside.any():
        return position, None
    course = Course(time[inside], _origin(motion, fit, time[inside])[1], velocity[inside] @ fit.frame)
    return position, course


def _origin(
    motion: ContinuousMotion, fit: ReferenceFit, time: np.ndarray
) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]]:
    """Estimated position and velocity of the reference's origin in i."""
    own = motion.at(time)
    assert fit.origin is not None
    arm = (
        np.zeros_like(own.centre)
        if np.array_equal(fit.origin, motion.final_centre)
        else fit.origin - own.centre
    )
    return own.position + rotate(own.q_ig, arm), own.velocity + rotate(own.q_ig, np.cross(own.rate, arm))


def _components(
    name: str, values: Float[np.ndarray, "k 3"], suffix: str = ""
) -> Iterator[tuple[str, tuple[float, float]]]:
    for axis, column in zip(_AXES, values.T, strict=True):
        yield f"{axis} {name}{suffix}", _mean_and_std(column)


def _mean_and_std(values: Float[np.ndarray, " k"]) -> tuple[float, float]:
    return (float(np.mean(values)), float(np.std(values))) if len(values) else (np.nan, np.nan)


def _flip_text(flip: Float[np.ndarray, "3 3"]) -> str:
    """For each axis of m the principal axis it lies on: minor, intermediate or major."""
    names, parts = ("minor", "intermediate", "major"), []
    for axis, row in zip(_AXES, flip, strict=True):
        k = int(np.argmax(np.abs(row)))
        parts.append(f"{axis} = {'-' if row[k] < 0 else ''}{names[k]}")
    return f"({', '.join(parts)})"
