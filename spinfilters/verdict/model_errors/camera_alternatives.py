"""Errors of cameras and of their known trajectory: calibration, right camera of a pair, moving camera, inspector."""

from abc import abstractmethod
from typing import ClassVar, Final

import numpy as np
from jaxtyping import Float
from numpy.polynomial.legendre import legvander

from spinfilters.core.camera_trajectory import Displacement, later, levered, turning
from spinfilters.models.calibration import BASELINE, FOCAL_LENGTH, PRINCIPAL_POINT
from spinfilters.verdict.model_errors.linear_rows import Columns
from spinfilters.verdict.model_errors.score_tests import Alternative
from spinfilters.verdict.model_errors.smoothed_motion import (
    KnownCamera,
    MeasuredRows,
    SmoothedMotion,
    displaced_camera,
)

CALIBRATION: Final = 3
"""First parameter of a camera's calibration (fx, fy, cx, cy px, of a pair the baseline m): the point stands before it."""
U, V, RIGHT = 0, 1, 2
"""Components of an observation: pixels of the (left) camera, column of the right one."""


def _normalised(each: MeasuredRows) -> tuple[Float[np.ndarray, "r i"], Float[np.ndarray, "r i"]]:
    """Image coordinates of predicted pixels about the principal point over the focal length, and that length, by component."""
    pixels, calibration = each.model.predict(each.states, each.parameters), each.parameters[:, CALIBRATION:]
    columns = [U, V, U][: pixels.shape[1]]
    focal, centre = calibration[:, columns], calibration[:, [2 + k for k in columns]]
    return (pixels - centre) / focal, focal


class _CameraAlternative(Alternative):
    """An error of every image."""

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Shift of the pixels of all cameras by this error."""
        return motion.shifted(lambda each: self.of_pixels(each) if each.model.images else None)

    @abstractmethod
    def of_pixels(self, each: MeasuredRows) -> Float[np.ndarray, "r i m"]:
        """Change of the observations in px per unit."""


class CameraShake(_CameraAlternative):
    """A shift in px that all observations of an image have in common."""

    name, phrase, unit = "camera-shake", "a shift common to each image (camera shake)", "px"
    plausible = 10.0
    cure = "fix the camera, or give its motion (inspector.tum)"
    moving_cure = "give poses of the camera that are known to what a pixel is (inspector.tum), or state a larger pixel_std"
    by_epoch = True

    def of_pixels(self, each: MeasuredRows) -> Float[np.ndarray, "r i m"]:
        """Common shifts of u and v at every epoch."""
        by = np.zeros((len(each.epoch), each.model.dim, 2))
        by[:, U, 0] = by[:, V, 1] = 1.0
        if each.model.dim > RIGHT:
            by[:, RIGHT, 0] = 1.0
        return by


class _CalibrationAlternative(Alternative):
    """Error of the calibration, as estimates consider it.

    The data are of a larger number than they are read with. A subclass states its parameter.
    """

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Negative shift of the expected pixels per unit of the parameter."""

        def of_data(each: MeasuredRows) -> Float[np.ndarray, "r i m"] | None:
            """Shift of the data by the parameter."""
            by = None if self.parameter is None else each.by_calibration(self.parameter)
            return None if by is None else -by

        return motion.shifted(of_data)


class FocalLength(_CalibrationAlternative):
    """Relative error of both focal lengths."""

    name, phrase, unit = "focal-length", "an error of the focal length", "of it"
    plausible = 0.05
    cure = "calibrate the cameras again (spinfilters calibrate)"
    parameter = FOCAL_LENGTH


class PrincipalPoint(_CalibrationAlternative):
    """Error of (cx, cy), px."""

    name, phrase, unit = "principal-point", "an error of the principal point", "px"
    plausible = 20.0
    cure = "calibrate the cameras again (spinfilters calibrate)"
    parameter = PRINCIPAL_POINT


class Distortion(_CameraAlternative):
    """x' = x (1 + k r^2) of every camera."""

    name, phrase, unit = (
        "distortion",
        "distortion of the lens that the calibration lacks",
        "of the radius cubed",
    )
    plausible = 0.3
    cure = "calibrate the cameras with distortion, and rectify the tracks"

    def of_pixels(self, each: MeasuredRows) -> Float[np.ndarray, "r i m"]:
        """Radial shift by the square of the normalised radius."""
        xy, focal = _normalised(each)
        columns = [[U, V], [U, V], [RIGHT, V]][: xy.shape[1]]
        radius = np.stack([(xy[:, pair] ** 2).sum(axis=1) for pair in columns], axis=1)
        return (focal * xy * radius)[:, :, None]


class _PairAlternative(_CameraAlternative):
    """An error of the right camera of a pair."""

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Shift of the pixels of stereo pairs by this error."""
        return motion.shifted(lambda each: self.of_pixels(each) if each.model.images > 1 else None)


class Baseline(_CalibrationAlternative):
    """Relative error of the baseline."""

    name, phrase, unit = "baseline", "an error of the baseline", "of it"
    plausible = 0.05
    cure = "calibrate the pair again (spinfilters calibrate)"
    parameter = BASELINE

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """One column: the pixels of a longer baseline, and the motion in its unit."""
        measured = super().columns(motion)
        return None if measured is None else motion.scaling(measured)


class RightCameraTurned(_PairAlternative):
    """Yaw, pitch and roll of the right camera, as far as they move its columns."""

    name, phrase, unit = "right-camera-turned", "a turned right camera", "rad"
    plausible = 0.03
    cure = "calibrate the pair again and rectify (spinfilters calibrate)"

    def of_pixels(self, each: MeasuredRows) -> Float[np.ndarray, "r i m"]:
        """Shift of u_right by small rotations of the right camera, rad."""
        xy, focal = _normalised(each)
        x, y = xy[:, RIGHT], xy[:, V]
        by = np.zeros((len(x), each.model.dim, 3))
        by[:, RIGHT] = focal[:, [U]] * np.stack([1 + x * x, x * y, y], axis=1)
        return by


class RightCameraLate(Alternative):
    """The right image is taken later than the left one."""

    name, phrase, unit = "right-camera-late", "a right camera that triggers late", "s"
    plausible = 0.03
    cure = "trigger both cameras together"

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Shift of u_right by the motion of the image during the delay."""

        def moved(each: MeasuredRows) -> Float[np.ndarray, "r i m"] | None:
            """Shift of u_right of a pair's rows."""
            if each.model.images < 2:
                return None
            counts = np.flatnonzero(np.abs(each.whitening).max(axis=(1, 2)) > 0)
            by = np.zeros((*each.change.shape, 1))
            by[counts, RIGHT, 0] = _solved_lower(each.whitening[counts], each.change[counts])[:, RIGHT]
            return by

        return motion.shifted(moved)


def _solved_lower(
    lower: Float[np.ndarray, "r i i"], right: Float[np.ndarray, "r i"]
) -> Float[np.ndarray, "r i"]:
    """Solutions of many small lower triangular systems."""
    found = np.empty_like(right)
    for i in range(right.shape[1]):
        known = np.einsum("rj,rj->r", lower[:, i, :i], found[:, :i])
        found[:, i] = (right[:, i] - known) / lower[:, i, i]
    return found


DEGREE, HIGHEST_DEGREE = 4, 14
"""Of the polynomials in time of a camera that moves; the latter where the motion is beyond its disturbances, as before a camera
that swings some times. Places of degree 1 are a velocity of the body."""
BEYOND: Final = 2.0
"""Mean square of the whitened steps from which the motion is beyond its disturbances."""


class _InspectorAlternative(Alternative):
    """An error of all poses of a moving camera."""

    displacement: ClassVar[Displacement]
    is_of_poses = True

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Columns of the displaced poses; None of a camera at rest."""
        camera = KnownCamera.of(motion)
        if camera is None or not camera.moves:
            return None
        return displaced_camera(motion, type(self).displacement, camera)


class InspectorDelay(_InspectorAlternative):
    """The inspector is where its poses say a moment later: they are late.

    Of a uniform circle about a resting body a turned frame i, which nothing shows.
    """

    name, phrase, unit = "inspector-delay", "poses of the inspector that are late", "s"
    plausible = 0.5
    cure = "give inspector.tum on the clock of the images, or state calibration.inspector_clock_std"
    displacement = staticmethod(later)


class InspectorDrift(_InspectorAlternative):
    """Attitudes of the inspector drift evenly.

    An even drift of its places is a velocity of the body, which nothing shows.
    """

    name, phrase, unit = "inspector-drift", "attitudes of the inspector that drift", "rad/min"
    plausible = 0.2
    cure = "correct inspector.tum, or state calibration.inspector_rotation_std"
    displacement = staticmethod(turning)


class InspectorLever(_InspectorAlternative):
    """The inspector's poses are of another point of it than the camera, as of the spacecraft's navigation.

    Of a camera that does not turn it is a shift of frame i, which nothing shows.
    """

    name, phrase, unit = "inspector-lever", "poses of another point of the inspector than its camera", "m"
    plausible = 0.3
    cure = "give the poses of cam0 itself (inspector.tum), or state calibration.inspector_lever_std"

    @staticmethod
    def displacement(
        time: Float[np.ndarray, " k"], poses: Float[np.ndarray, "k 7"]
    ) -> Float[np.ndarray, "k 6 3"]:
        """Beside their mean, which as a shift of frame i is far larger than what can be seen."""
        found = levered(time, poses)
        return found - found.mean(axis=0)


class InspectorMissing(Alternative):
    """The camera moves smoothly, and no trajectory is given.

    Polynomials in time of its place and attitude, whose first frame is i.
    """

    name, phrase, unit = "inspector-missing", "a camera that moves", "rad and m"
    plausible = 2.0
    cure = "give the camera's known poses (inspector.tum), or fix the camera"

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Columns of the turning, then of the places; None where a trajectory is given."""
        camera = KnownCamera.of(motion)
        if camera is None or camera.moves:
            return None
        steps = motion.rows.left.steps
        degree = HIGHEST_DEGREE if float(np.mean(steps**2)) > BEYOND else DEGREE
        return displaced_camera(motion, smooth_paths(degree), camera)


def smooth_paths(degree: int) -> Displacement:
    """Legendre polynomials of every axis, zero at the first time."""

    def displacement(
        time: Float[np.ndarray, " k"], poses: Float[np.ndarray, "k 7"]
    ) -> Float[np.ndarray, "k 6 m"]:
        """Attitudes of all degrees, then places of those that are no velocity."""
        values = legvander(2 * (time - time[0]) / (time[-1] - time[0]) - 1, degree)
        values = values - values[0]
        turns, places = np.eye(6)[:, 3:], np.eye(6)[:, :3]
        return np.concatenate(
            [np.kron(values[:, None, 1:], turns), np.kron(values[:, None, 2:], places)], axis=2
        )

    return displacement
