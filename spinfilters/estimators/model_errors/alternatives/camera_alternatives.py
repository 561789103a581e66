"""Errors of cameras: calibration, right camera of a pair, motion of the hand."""

from abc import abstractmethod
from typing import ClassVar, Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.consider_parameter import ConsiderParameter
from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import MeasuredRows, SmoothedMotion
from spinfilters.sensors.calibration.baseline import BASELINE
from spinfilters.sensors.calibration.focal_length import FOCAL_LENGTH
from spinfilters.sensors.calibration.principal_point import PRINCIPAL_POINT

CALIBRATION: Final = 3
"""First parameter of a camera's calibration (fx, fy, cx, cy px, of a pair the baseline m): the point stands before it."""
U, V, RIGHT = 0, 1, 2
"""Components of an observation: pixels of the (left) camera, column of the right one."""


def _normalised(each: MeasuredRows) -> tuple[Float[np.ndarray, "r i"], Float[np.ndarray, "r i"]]:
    """Normalised image coordinates of predicted pixels, and the focal lengths.

    About the principal point, for each component.
    """
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

    The data are of a larger number than they are read with.
    """

    parameter: ClassVar[ConsiderParameter]

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Negative shift of the expected pixels per unit of the parameter."""

        def of_data(each: MeasuredRows) -> Float[np.ndarray, "r i m"] | None:
            """Shift of the data by the parameter."""
            by = each.by_calibration(self.parameter)
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
