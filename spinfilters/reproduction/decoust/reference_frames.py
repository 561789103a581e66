"""Centre of rotation, reference frames and transition matrices (Decoust 2008, sections 4.2 to 4.4)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.reproduction.decoust.corners import SnapshotFeatures


@dataclass(frozen=True, eq=False)
class Sphere:
    """Sphere with the error of its centre.

    Centre, m, radius, m, and how much larger the error of the centre is than that of the points (both RMS, 3D).
    """

    centre: Float[np.ndarray, "3"]
    radius: float
    amplification: float


def best_fitting_sphere(points: Float[np.ndarray, "n 3"]) -> Sphere:
    """Sphere of least squares of Eq. 4.15, corrected: about the mean of the points.

    The normal equations as printed, in mm from the lidar, are so ill-conditioned that 1.5 m of the centre are lost.

    Raises
    ------
    InputError: fewer than four points, or points in one plane, which leave the centre undetermined.
    """
    mean = points.mean(axis=0)
    q = points - mean
    scale = np.sqrt(np.mean(q**2)) or 1.0
    A = np.column_stack([2 * q / scale, np.ones(len(q))])
    if len(points) < 4 or np.linalg.matrix_rank(A, tol=1e-9 * len(q)) < 4:
        raise InputError(
            f"{len(points)} points in a plane or fewer than four determine no sphere; give other poses"
        )
    x = np.linalg.lstsq(A, np.sum(q**2, axis=1) / scale, rcond=None)[0]
    centre = x[:3]
    radius = float(np.sqrt(x[3] * scale + centre @ centre))
    # an error e of a point changes its equation by 2 (q - centre).e, that is by 2 r times its radial part
    gain = np.linalg.pinv(A)[:3] * (2 * radius / scale)
    return Sphere(centre + mean, radius, float(np.linalg.norm(gain) / np.sqrt(3)))


def reference_frame(
    centre: Float[np.ndarray, "3"], corner: Float[np.ndarray, "3"], boundary_corner: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3 3"]:
    """Direction cosine matrix of centre A, corner B and boundary corner C: columns x = AB, y, and z normal to ABC (Figure 4.10)."""
    x = (corner - centre) / np.linalg.norm(corner - centre)
    z = np.cross(corner - centre, boundary_corner - centre)
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z], axis=1)


def transition_errors(
    measured: Float[np.ndarray, "n 3 3"], true: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, "m 3"]:
    """Angles, deg, between rows of measured and true transition matrices M = DCM(t + 1) DCM(t)' (section 4.4)."""
    ours, theirs = (epochs[1:] @ np.swapaxes(epochs[:-1], 1, 2) for epochs in (measured, true))
    sines = np.linalg.norm(np.cross(ours, theirs), axis=2)
    return np.rad2deg(np.arctan2(sines, np.einsum("nij,nij->ni", ours, theirs)))


def tracked_boundary_corners(snapshots: Sequence[SnapshotFeatures | None]) -> Float[np.ndarray, "n 3 3"]:
    """Boundary corners of every snapshot in the order of the first.

    The first is that with three; each corner is the nearest to its predecessor.
    NaN where a snapshot failed, or shows none within half the distance between corners.
    """
    tracked = np.full((len(snapshots), 3, 3), np.nan)
    last: np.ndarray | None = None
    for row, snapshot in enumerate(snapshots):
        if snapshot is None or (last is None and len(snapshot.boundary_corners) < 3):
            continue
        found = snapshot.boundary_corners
        if last is None:
            last = found.copy()
        reach = 0.5 * np.linalg.norm(last[:, None] - last[None], axis=2)[np.triu_indices(3, 1)].min()
        for k in range(3):
            distance = np.linalg.norm(found - last[k], axis=1)
            if len(found) and distance.min() < reach:
                tracked[row, k] = last[k] = found[np.argmin(distance)]
    return tracked
