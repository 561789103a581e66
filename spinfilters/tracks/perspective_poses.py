"""Perspective pose (PnP) of a known map from one image with outliers.

Hypotheses are the up to four poses of random triples (P3P after Grunert 1841, in the form of Haralick et al. 1994, Eqs 4-13), the
best by the cost of Torr and Zisserman 2000 is refined by Gauss-Newton on the sensor's own model.
"""

import numpy as np
from jaxtyping import Bool, Complex, Float

from spinfilters.attitude.conversions import quaternion_from_matrix
from spinfilters.geometry.absolute_orientation import rigid_motions
from spinfilters.linear_algebra.definite import is_definite
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.sensor_models.monocular_landmark import MonocularLandmark

TRIPLES = 80
"""Where half of the matches are right, one triple in eight is: none of 80 is with a probability of 2e-5."""
SEED = 0
"""Of the triples, so that the same matches give the same pose."""
AGREEMENT = 20.0
"""In standard deviations: a triple's own noise turns a body by some 0.05 rad, ten pixels on its rim."""
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
_REAL = 1e-3  # imaginary part of a root, relative: noise makes touching roots slightly complex


def perspective_pose(
    model: MonocularLandmark, parameters: Float[np.ndarray, "k p"], pixels: Float[np.ndarray, "k 2"]
) -> Float[np.ndarray, " 7"] | None:
    """Pose (t, q_ig) that most matches agree on; None where too few do.

    Parameters
    ----------
    model: of the camera over (t, a), frame i being its own.
    """
    if len(pixels) < FEWEST:
        return None
    points, calibration = parameters[:, :3], parameters[0, 3 : 3 + model.camera.parameter_dim]
    rays = model.camera.rays_of(pixels, calibration)
    chosen = np.random.default_rng(SEED).random((TRIPLES, len(points))).argpartition(2, axis=1)[:, :3]
    rotations, shifts = three_point_poses(points[chosen], rays[chosen])
    if not len(rotations):
        return None
    at = points @ np.swapaxes(rotations, 1, 2) + shifts[:, None]
    away = model.camera.pixels_of(at, calibration) - pixels
    squared = np.where(at[..., 2] > 0, np.sum(away**2, axis=2), np.inf)
    std = float(np.median(1.0 / np.abs(model.whitening(_pose(rotations[0], shifts[0]), parameters)[:, 0, 0])))
    best = int(np.argmin(np.minimum(squared, (AGREEMENT * std) ** 2).sum(axis=1)))
    return _refined(model, parameters, pixels, _pose(rotations[best], shifts[best]))


def three_point_poses(
    points: Float[np.ndarray, "h 3 3"], rays: Float[np.ndarray, "h 3 3"]
) -> tuple[Float[np.ndarray, "s 3 3"], Float[np.ndarray, "s 3"]]:
    """(R_ig, t) of all real solutions of h triples.

    Points in g (m) on rays in the camera's frame (any length).
    """
    j = rays / np.linalg.norm(rays, axis=2, keepdims=True)
    cos_a, cos_b, cos_c = (np.sum(j[:, m] * j[:, n], axis=1) for m, n in ((1, 2), (0, 2), (0, 1)))
    a, b, c = (np.sum((points[:, m] - points[:, n]) ** 2, axis=1) for m, n in ((1, 2), (0, 2), (0, 1)))
    with np.errstate(all="ignore"):
        v = _quartic_roots(_grunert(a / b, c / b, cos_a, cos_b, cos_c))
        d = ((a - c) / b)[:, None]
        u = ((d - 1) * v**2 - 2 * d * cos_b[:, None] * v + 1 + d) / (
            2 * (cos_c[:, None] - v * cos_a[:, None])
        )
        first = np.sqrt(b[:, None] / (1 + v**2 - 2 * v * cos_b[:, None]))
        lengths = np.stack([first, u * first, v * first], axis=2)
        good = np.isfinite(lengths).all(axis=2) & (lengths > 0).all(axis=2)
    triple, root = np.nonzero(good)
    return rigid_motions(lengths[triple, root][..., None] * j[triple], points[triple])


def _grunert(
    a: Float[np.ndarray, " h"],
    c: Float[np.ndarray, " h"],
    cos_a: Float[np.ndarray, " h"],
    cos_b: Float[np.ndarray, " h"],
    cos_c: Float[np.ndarray, " h"],
) -> Float[np.ndarray, "h 5"]:
    """Coefficients of Grunert's quartic in v = s3 / s1, highest first.

    Squared sides a and c are over that of b.
    """
    d, e = a - c, a + c
    return np.stack(
        [
            (d - 1) ** 2 - 4 * c * cos_a**2,
            4 * (d * (1 - d) * cos_b - (1 - e) * cos_a * cos_c + 2 * c * cos_a**2 * cos_b),
            2
            * (
                d**2
                - 1
                + 2 * d**2 * cos_b**2
                + 2 * (1 - c) * cos_a**2
                - 4 * e * cos_a * cos_b * cos_c
                + 2 * (1 - a) * cos_c**2
            ),
            4 * (-d * (1 + d) * cos_b + 2 * a * cos_c**2 * cos_b - (1 - e) * cos_a * cos_c),
            (1 + d) ** 2 - 4 * a * cos_c**2,
        ],
        axis=1,
    )


def _quartic_roots(coefficients: Float[np.ndarray, "h 5"]) -> Float[np.ndarray, "h 4"]:
    """Real roots, NaN for the others: eigenvalues of companion matrices."""
    companion = np.zeros((len(coefficients), 4, 4))
    companion[:, 1:, :3] = np.eye(3)
    first = -coefficients[:, 1:] / coefficients[:, :1]
    good = np.asarray(np.isfinite(first).all(axis=1))
    companion[:, 0] = np.where(good[:, None], first, 0.0)
    roots: Complex[np.ndarray, "h 4"] = np.linalg.eigvals(companion).astype(complex)
    real = good[:, None] & (np.abs(np.imag(roots)) <= _REAL * np.abs(roots))
    return np.where(real, np.real(roots), np.nan)


def _refined(
    model: MeasurementModel, parameters: np.ndarray, pixels: np.ndarray, pose: Float[np.ndarray, " 7"]
) -> Float[np.ndarray, " 7"] | None:
    """Gauss-Newton on the matches within a gate that closes while the pose settles."""
    for _ in range(ITERATIONS):
        innovation, jacobian, valid, _ = model.linearise(pose, parameters, pixels)
        size = np.linalg.norm(innovation, axis=1)
        quarter = float(np.partition(size, len(size) // 4)[len(size) // 4])
        inliers = valid & (size < max(GATE, OPENING * quarter))
        if not _are_enough(inliers):
            return None
        A, b = jacobian[inliers].reshape(-1, 6), innovation[inliers].reshape(-1)
        information = A.T @ A
        if not is_definite(information):
            return None
        step = np.linalg.solve(information, A.T @ b)
        pose = model.layout.retract(pose, step)
        if step @ information @ step < SETTLED**2:
            break
    innovation, _, valid, _ = model.linearise(pose, parameters, pixels)
    agreeing = valid & (np.linalg.norm(innovation, axis=1) < GATE)
    return pose if _are_enough(agreeing) else None


def _are_enough(inliers: Bool[np.ndarray, " k"]) -> bool:
    return bool(np.count_nonzero(inliers) >= max(FEWEST, SMALLEST_SHARE * len(inliers)))


def _pose(rotation: Float[np.ndarray, "3 3"], shift: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 7"]:
    return np.concatenate([shift, quaternion_from_matrix(rotation)])
