"""Errors of an inspector's known trajectory, and a camera that moves and of which no trajectory is given."""

from typing import ClassVar, Final

import numpy as np
from jaxtyping import Float
from numpy.polynomial.legendre import legvander

from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.displaced_camera import KnownCamera, displaced_camera
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.geometry.camera_displacements import Displacement, later, levered, turning

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
        return displaced_camera(motion, _smooth_paths(degree), camera)


def _smooth_paths(degree: int) -> Displacement:
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
