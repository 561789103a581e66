"""Perspective pose (PnP) of a known map from one image with outliers.

OpenCV draws hypotheses and scores them by the cost of Torr and Zisserman (2000); Gauss-Newton on the sensor's own model refines
the best.
"""

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.core.attitude_conversions import quaternion_from_rotation_vector
from spinfilters.core.gauss_newton import LeastSquaresEnd, StepEquations, gauss_newton, step_equations
from spinfilters.core.linear_algebra import is_definite
from spinfilters.models.camera_landmarks import MonocularLandmark
from spinfilters.models.measurement import MeasurementModel

HYPOTHESES = 200
"""Most poses that are drawn."""
CONFIDENCE = 0.9999
"""Probability of a pose from right matches alone at which drawing ends."""
SEED = 0
"""Of the draws, so that the same matches give the same pose."""
AGREEMENT = 8.0
"""In standard deviations: the noise of the few matches of a hypothesis turns a body by some 0.05 rad."""
FEWEST = 4
"""Matches that must agree: three are fitted by any pose of theirs."""
SMALLEST_SHARE = 0.3
"""Of the matches that must agree."""
GATE = 5.0
"""In standard deviations beyond which a match counts as wrong at the end."""
OPENING = 6.0
"""Times the lower quartile of the residuals, by which the gate opens while the pose is rough."""
ITERATIONS = 10
SETTLED = 1e-6
"""Length of a step in standard deviations of the pose below which iterations end."""


def perspective_pose(
    model: MonocularLandmark, parameters: Float[np.ndarray, "k p"], pixels: Float[np.ndarray, "k 2"]
) -> Float[np.ndarray, " 7"] | None:
    """Pose (t, q_ig) that most matches agree on; None where too few do.

    Parameters
    ----------
    model : MonocularLandmark
        Of the camera over (t, a), frame i being its own.
    """
    if len(pixels) < FEWEST:
        return None
    points, calibration = parameters[:, :3], parameters[0, 3 : 3 + model.camera.parameter_dim]
    rays = model.camera.rays_of(pixels, calibration)[:, :2]
    usable = np.isfinite(rays).all(axis=1)
    if np.count_nonzero(usable) < FEWEST:
        return None
    std = float(np.median(1.0 / np.abs(model.whitening(model.layout.origin(), parameters)[:, 0, 0])))
    start = _rough_pose(points[usable], rays[usable], AGREEMENT * std / calibration[0])
    return None if start is None else _refined(model, parameters, pixels, start)


def _rough_pose(
    points: Float[np.ndarray, "k 3"], rays: Float[np.ndarray, "k 2"], tolerance: float
) -> Float[np.ndarray, " 7"] | None:
    """Pose that most rays (x/z, y/z) agree on; None where OpenCV finds none."""
    import cv2  # takes as long to load as a short run; only one camera's tracks need it here

    options = cv2.UsacParams()
    options.threshold, options.maxIterations, options.confidence = tolerance, HYPOTHESES, CONFIDENCE
    options.sampler, options.score = cv2.SAMPLING_UNIFORM, cv2.SCORE_METHOD_MSAC
    options.loMethod, options.randomGeneratorState = cv2.LOCAL_OPTIM_INNER_LO, SEED
    try:
        found, _, turn, shift, _ = cv2.solvePnPRansac(points, rays, np.eye(3), None, params=options)
    except cv2.error:  # matches in one place
        return None
    if not found or not np.isfinite([turn, shift]).all():
        return None
    return np.concatenate([shift.ravel(), quaternion_from_rotation_vector(turn.ravel())])


def _refined(
    model: MeasurementModel, parameters: np.ndarray, pixels: np.ndarray, pose: Float[np.ndarray, " 7"]
) -> Float[np.ndarray, " 7"] | None:
    """Gauss-Newton on the matches within a gate that closes while the pose settles."""

    def linearise(pose: Float[np.ndarray, " 7"]) -> StepEquations | None:
        innovation, jacobian, valid, _ = model.linearise(pose, parameters, pixels)
        size = np.linalg.norm(innovation, axis=1)
        quarter = float(np.partition(size, len(size) // 4)[len(size) // 4])
        inliers = valid & (size < max(GATE, OPENING * quarter))
        if not _are_enough(inliers):
            return None
        found = step_equations(innovation[inliers].reshape(-1), jacobian[inliers].reshape(-1, 6))
        return found if is_definite(found.information) else None

    found = gauss_newton(
        pose,
        linearise,
        model.layout.retract,
        lambda step, normal: bool(step @ normal.information @ step < SETTLED**2),
        ITERATIONS,
    )
    if found.end is LeastSquaresEnd.UNDETERMINED:
        return None
    innovation, _, valid, _ = model.linearise(found.state, parameters, pixels)
    agreeing = valid & (np.linalg.norm(innovation, axis=1) < GATE)
    return found.state if _are_enough(agreeing) else None


def _are_enough(inliers: Bool[np.ndarray, " k"]) -> bool:
    return bool(np.count_nonzero(inliers) >= max(FEWEST, SMALLEST_SHARE * len(inliers)))
