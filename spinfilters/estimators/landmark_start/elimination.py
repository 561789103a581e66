"""Landmarks taken out of a least-squares problem, and put back behind its solution.

A landmark's information V = L L' is its own 3 x 3 block, whatever other landmarks there are, so it is eliminated in closed form:
with W its coupling to the poses and Y = L^-1 W', the poses keep H - Y'Y, and p = L^-T (y - Y e) + L^-T n follows their error e.
What remains is factored by Cholesky after scaling to unit diagonal; covariances are products of factors and cannot be indefinite.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg.lapack import dpotrf, dtrtri

from spinfilters.estimators.landmark_start.motion import POSE, NormalEquations, Unknowns
from spinfilters.estimators.landmark_start.sightings import (
    SIGHTINGS_NEEDED,
    LinearSightings,
    Sightings,
)

FLATTEST = 1e-12
"""Determinant of a landmark's scaled information below which its depth is not told."""
DAMPINGS = (0.0, 1e-9, 1e-6, 1e-3, 1e-1)
"""Added to the unit diagonal of a scaled system, in this order, until it can be factored (Levenberg 1944)."""


@dataclass(frozen=True)
class Eliminated:
    """Landmarks that are told by what is believed, and what they leave to the poses.

    Attributes
    ----------
    landmarks: (A,) their numbers.   used: (N,) sightings that count.
    root: (A, 3, 3) L.   coupling: (3A, 6K) Y.   gradient: (3A,) y.
    pose_information: (6K, 6K), pose_gradient: (6K,) of the sightings without the landmarks.
    """

    landmarks: Int[np.ndarray, " A"]
    used: Bool[np.ndarray, " N"]
    root: Float[np.ndarray, "A 3 3"]
    coupling: Float[np.ndarray, "B P"]
    gradient: Float[np.ndarray, " B"]
    pose_information: Float[np.ndarray, "P P"]
    pose_gradient: Float[np.ndarray, " P"]

    def points_step(self, step: Float[np.ndarray, " P"]) -> Float[np.ndarray, "A 3"]:
        """How the landmarks follow a step of the poses."""
        rest = (self.gradient - self.coupling @ step).reshape(-1, 3, 1)
        return np.linalg.solve(np.swapaxes(self.root, 1, 2), rest)[..., 0]


@dataclass(frozen=True)
class Solution:
    """Of the reduced system.

    Attributes
    ----------
    step: (N,) most probable error.   root: (N, N) C with covariance C C'.   std: (N,).   damped: whether it had to be damped.
    """

    step: Float[np.ndarray, " N"]
    root: Float[np.ndarray, "N N"]
    std: Float[np.ndarray, " N"]
    damped: bool


def eliminate(
    sightings: Sightings, linear: LinearSightings, weights: Float[np.ndarray, " N"], frames: int
) -> Eliminated:
    """Take the landmarks out of weighted sightings; sightings of landmarks that are then not told do not count."""
    landmarks, number, used, information = _told(sightings, linear, weights)
    weight = np.sqrt(weights[used])[:, None]
    innovation = weight * linear.innovation[used]
    by_pose, by_point = weight[..., None] * linear.by_pose[used], weight[..., None] * linear.by_landmark[used]
    frame = sightings.frame[used]
    root = np.linalg.cholesky(information)
    rows = np.linalg.solve(root[number], np.swapaxes(by_point, 1, 2))
    coupling = np.zeros((len(landmarks), 3, frames, POSE))
    where: Any = (number, slice(None), frame)
    np.add.at(coupling, where, rows @ by_pose)
    coupling = coupling.reshape(3 * len(landmarks), frames * POSE)
    gradient = np.zeros((len(landmarks), 3))
    np.add.at(gradient, number, (rows @ innovation[..., None])[..., 0])
    blocks, slopes = np.zeros((frames, POSE, POSE)), np.zeros((frames, POSE))
    transposed = np.swapaxes(by_pose, 1, 2)
    np.add.at(blocks, frame, transposed @ by_pose)
    np.add.at(slopes, frame, (transposed @ innovation[..., None])[..., 0])
    gradient, slopes = gradient.reshape(-1), slopes.reshape(-1)
    left = -(coupling.T @ coupling)
    each = np.arange(frames * POSE).reshape(frames, POSE)
    left[each[:, :, None], each[:, None, :]] += blocks
    return Eliminated(landmarks, used, root, coupling, gradient, left, slopes - coupling.T @ gradient)


def _told(
    sightings: Sightings, linear: LinearSightings, weights: Float[np.ndarray, " N"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Landmarks that can be eliminated, their number for every sighting that counts, which those are, and V."""
    count = int(sightings.landmark.max()) + 1
    counted = weights > 0
    by_point = linear.by_landmark[counted]
    information = np.zeros((count, 3, 3))
    weighted = weights[counted][:, None, None] * np.swapaxes(by_point, 1, 2) @ by_point
    np.add.at(information, sightings.landmark[counted], weighted)
    hits = np.bincount(sightings.landmark[counted], minlength=count)
    diagonal = np.einsum("kii->ki", information)
    with np.errstate(invalid="ignore", divide="ignore"):
        shape = np.linalg.det(information) / diagonal.prod(axis=1)
    told = (hits >= SIGHTINGS_NEEDED) & (shape > FLATTEST)
    used = counted & told[sightings.landmark]
    number = (np.cumsum(told) - 1)[sightings.landmark[used]]
    return np.flatnonzero(told), number, used, information[told]


def solve_reduced(motion: NormalEquations, eliminated: Eliminated, unknowns: Unknowns) -> Solution | None:
    """The most probable errors of the motion and their covariance; None when no damping makes the system positive definite."""
    information, gradient, poses = motion.information.copy(), motion.gradient.copy(), unknowns.poses
    information[np.ix_(poses, poses)] += eliminated.pose_information
    gradient[poses] += eliminated.pose_gradient
    diagonal = np.diag(information)
    if not (np.isfinite(information).all() and np.isfinite(gradient).all() and (diagonal > 0).all()):
        return None
    scale = 1 / np.sqrt(diagonal)
    information *= scale * scale[:, None]
    for damping in DAMPINGS:
        information.flat[:: len(scale) + 1] = 1 + damping
        lower, failed = dpotrf(information, lower=1, clean=1)
        if not failed:
            root = scale[:, None] * dtrtri(lower, lower=1)[0].T
            std = np.sqrt(np.einsum("ij,ij->i", root, root))
            return Solution(root @ (root.T @ gradient), root, std, damping > 0)
    return None
