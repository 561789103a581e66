"""A camera that moves without known poses, fitted where a recording is doubted.

The score of its motion is of first order about a trajectory that the motion has bent: it promises less than the motion explains,
while a flywheel is fitted in full. So the path of the camera is improved step by step, with the body's motion smoothed again before
the camera on that path, and -2 ln likelihood compared with that of a camera at rest, each at the noise levels that it identifies.
"""

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import rotation_vector_from_quaternion
from spinfilters.core.camera_trajectory import CameraTrajectory, Displacement, displaced
from spinfilters.core.chi_square import chi_square_tail
from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.filters.timeline import build_timeline, times_of
from spinfilters.inference.setup import Setup, camera_view
from spinfilters.smoother.problem import Problem
from spinfilters.verdict.flywheel_refit import DoubtedMotion, at_own_levels
from spinfilters.verdict.model_errors.alternatives import INSPECTOR_MISSING
from spinfilters.verdict.model_errors.error_columns import HIGHEST_DEGREE, smooth_paths
from spinfilters.verdict.model_errors.hypotheses import minus_twice_log_likelihood
from spinfilters.verdict.model_errors.score_tests import TELLING
from spinfilters.verdict.model_errors.smoothed_motion import KnownCamera, SmoothedMotion, displaced_camera
from spinfilters.verdict.model_tests import linear_problem
from spinfilters.verdict.tested_models import TestedModels

STEPS: Final = 3
"""Improvements of the path: the first takes three quarters of what there is, a fourth one 2 % more."""


def with_camera_refit(models: TestedModels, motion: DoubtedMotion) -> TestedModels:
    """Score tests with that of a moving camera from a fit, where it explains more than its score promises."""
    test = next((each for each in models.tests if each.error.name == INSPECTOR_MISSING.name), None)
    if test is None or not (models.contradicted or test.p_value < TELLING) or models.tests[0] is test:
        return models
    gain, dof, farthest, std = fitted_camera(motion)
    if not gain - 2 * dof > test.merit:
        return models
    p_value = min(test.p_value, float(chi_square_tail(gain, dof)))
    size, of_size = np.array([farthest]), np.array([std])
    fitted = replace(test, size=size, std=of_size, gain=gain, statistic=gain, dof=dof, p_value=p_value)
    others = [each for each in models.tests if each is not test]
    return replace(models, tests=tuple(sorted((*others, fitted), key=lambda each: -each.merit)))


class FittedCamera(NamedTuple):
    """A smooth path of a camera.

    Attributes
    ----------
    gain : float
        Fall of -2 ln likelihood; minus infinity where no fit leads there.
    numbers : float
        Of which the path is made.
    farthest, std : float
        Largest component of its displacement and its standard deviation, m or rad.
    """

    gain: float = -np.inf
    numbers: float = 0.0
    farthest: float = 0.0
    std: float = np.inf


def fitted_camera(doubted: DoubtedMotion) -> FittedCamera:
    """Fit a smooth path of the camera beside the motion of the body near a trajectory."""
    try:
        with np.errstate(all="ignore"):
            return _fitted(doubted)
    except (InputError, *NUMERICAL_ERRORS):
        return FittedCamera()


def _fitted(doubted: DoubtedMotion) -> FittedCamera:
    setup, rows = doubted.setup, doubted.rows
    time = times_of(setup.timeline[: len(doubted.trajectory)])
    if rows is None:
        return FittedCamera()
    at_rest = least = minus_twice_log_likelihood(rows)
    paths, count = smooth_paths(HIGHEST_DEGREE), 0.0
    std = np.full((len(time), 6), np.inf)
    poses = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(time), 1))
    for _ in range(STEPS):
        motion = SmoothedMotion(time, rows)
        camera = KnownCamera.of(motion)
        if camera is None:
            break
        by, std, count = _path(motion, replace(camera, poses=poses), paths)
        poses = displaced(poses, by)
        rows = at_own_levels(setup, _problem_before(setup, time, poses), rows.here.trajectory)
        if rows is None:
            break
        least = min(least, minus_twice_log_likelihood(rows))
    away = np.abs(np.concatenate([poses[:, :3], rotation_vector_from_quaternion(poses[:, 3:])], axis=1))
    at = np.unravel_index(np.argmax(away), away.shape)
    return FittedCamera(at_rest - least, count, float(away[at]), float(std[at]))


def _path(
    motion: SmoothedMotion, camera: KnownCamera, paths: Displacement
) -> tuple[Float[np.ndarray, "k 6"], Float[np.ndarray, "k 6"], float]:
    """The most probable displacement of the camera at every epoch, its deviation, and of how many numbers it is made."""
    own = motion.rows.residual(displaced_camera(motion, paths, camera))
    F, u = own.gram(own), own.gram(motion.rows.left)[:, 0]
    covariance = np.linalg.inv(F + np.eye(len(F)) / INSPECTOR_MISSING.plausible**2)
    made = paths(motion.time, camera.poses)
    std = np.sqrt(np.einsum("kim,mn,kin->ki", made, covariance, made))
    return made @ (covariance @ u), std, float(len(F))


def _problem_before(setup: Setup, time: Float[np.ndarray, " k"], poses: Float[np.ndarray, "k 7"]) -> Problem:
    """The smoothing problem of the epochs at these times, before a camera of known poses."""
    view = camera_view(setup.dataset)
    assert view is not None
    view = replace(view, inspector=CameraTrajectory(time, poses))
    epochs = build_timeline(setup.log.slice(time[0], time[-1]), setup.process.layout, setup.noise, view)
    return linear_problem(setup, epochs)
