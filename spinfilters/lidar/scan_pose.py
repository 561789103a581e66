"""Pose of the body in one scan, with covariance and undetermined directions."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

ROTATION_PRIOR: Final = 0.2
"""Standard deviation of a predicted attitude, rad: the only knowledge in directions that a scan does not determine."""
UNDETERMINED: Final = 0.1
"""Share of the prior's variance above which a direction counts as not determined by the scan."""


@dataclass(frozen=True, eq=False)
class ScanPose:
    """R_Lg and the origin of g in L at the epoch of a scan.

    Attributes
    ----------
    time: s.   rotation: (3, 3).   translation: (3,) m.
    covariance: (6, 6) over (translation in L, m; rotation vector on the body side, axes g, rad).
    own_covariance: of the error that no other scan shares; None where that is all of it.
    undetermined: directions that only the prediction tells, in words.   matched: points or faces that it rests on.
    """

    time: float
    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, "3"]
    covariance: Float[np.ndarray, "6 6"]
    undetermined: tuple[str, ...] = ()
    matched: int = 0
    own_covariance: Float[np.ndarray, "6 6"] | None = None


def rotation_matrix(vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Rotation by |v| rad about v."""
    return Rotation.from_rotvec(vector).as_matrix()


def rotation_vector(R: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """Rotation vector, rad, of the short way round."""
    return Rotation.from_matrix(nearest_rotation(R)).as_rotvec()


def nearest_rotation(M: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """The rotation nearest to a matrix: U V' with determinant one (Wahba's problem)."""
    U, _, Vt = np.linalg.svd(M)
    U[:, 2] *= np.sign(np.linalg.det(U @ Vt))
    return U @ Vt


def skew(v: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """[v x]."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def pose_covariance(
    information: Float[np.ndarray, "6 6"], rotation: Float[np.ndarray, "3 3"], size: float
) -> tuple[Float[np.ndarray, "6 6"], tuple[str, ...]]:
    """Covariance (translation, body-side rotation) of an information over (rotation in L, translation), with what it lacks.

    The prior of a predicted pose, `ROTATION_PRIOR` and the body's ``size`` (m), fills directions that the scan does not determine:
    there the covariance is the prior's, and they are named.
    """
    scale = np.repeat([ROTATION_PRIOR, size], 3)
    whitened = scale[:, None] * information * scale
    values, vectors = np.linalg.eigh(whitened + np.eye(6))
    lacking = [_named(vectors[:, k] * scale, size) for k in range(6) if 1 / values[k] > UNDETERMINED]
    covariance = (scale[:, None] * vectors / values) @ (vectors.T * scale)
    return body_side(body_side(covariance, rotation).T, rotation), tuple(lacking)


def body_side(
    errors: Float[np.ndarray, "6 m"], rotation: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "6 m"]:
    """Errors (rotation in L, translation) as (translation, rotation vector on the body side)."""
    return np.concatenate([errors[3:], rotation.T @ errors[:3]])


def _named(direction: Float[np.ndarray, "6"], size: float) -> str:
    """A direction of (rotation, translation) in words."""
    turn, shift = direction[:3], direction[3:] / size
    kind, vector = (
        ("rotation about", turn)
        if np.linalg.norm(turn) > np.linalg.norm(shift)
        else ("translation along", shift)
    )
    unit = vector / max(float(np.linalg.norm(vector)), 1e-300)
    return f"{kind} ({', '.join(f'{x:.2f}' for x in unit)})"
