"""Noise of stereo observations, from feature size and patch alignment, and the errors that observations from like directions share.

A detector that is deceived by shading or foreshortening is deceived again when the body shows the same face after a revolution,
by the same vector of the body. So errors of the place (u, v) and of the disparity, over the standard deviations of white noise,
have the covariances

    cov(e_i, e_j) = (a_0 [i = j] + sum_k a_k [angle(i, j) < angle_k]) B_i B_j',    a >= 0,

with B the axes of the image in the body's frame for the place, and 1 for the disparity. Landmarks' positions, which are
estimated, take a part of such errors; what they leave are the residuals M e. The a are found from these by MINQUE (Rao 1971).

Estimators take white noise. Of a small motion H common to the poses of all epochs, white noise of variance s gives the
covariance s (sum H'MH)^-1, sums over landmarks; with these errors it is A^-1 (sum H'M C M H) A^-1, A = sum H'MH. The white
noise that says as much on the mean over the six directions has s = trace(A^-1 sum H'M C M H) / 6.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import nnls

SMALLEST_STD: Final = 0.02
"""Of a coordinate, px: an interpolated image shows no less."""
FEWEST: Final = 60
"""Observations from which noise is identified."""


@dataclass(frozen=True)
class TrackNoise:
    """Variances of an observation's place and disparity, px^2.

    The place has ``place[0] + place[1] size^2``: a detector finds the same point of a body again only so well, the worse the larger
    it is. The disparity adds ``disparity[0] + disparity[1] residual^2``, for the right image is aligned with the left one.

    Attributes
    ----------
    place, disparity : tuple[float, float]
        The two coefficients of each.
    """

    place: tuple[float, float] = (0.01, 0.008)
    disparity: tuple[float, float] = (0.002, 0.3)

    def variances(
        self, size: Float[np.ndarray, " n"], residual: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Variances of the place (each coordinate) and of the disparity, px^2."""
        place = self.place[0] + self.place[1] * size**2
        disparity = self.disparity[0] + self.disparity[1] * residual**2
        return np.maximum(place, SMALLEST_STD**2), np.maximum(disparity, SMALLEST_STD**2)

    def covariance(
        self, size: Float[np.ndarray, " n"], residual: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, "n 3 3"]:
        """Covariance of (u_left, v_left, u_right): errors of place move both columns alike."""
        place, disparity = self.variances(size, residual)
        covariance = np.zeros((len(size), 3, 3))
        covariance[:, [0, 1, 2, 0, 2], [0, 1, 2, 2, 0]] = place[:, None]
        covariance[:, 2, 2] += disparity
        return covariance


def identified(
    residuals: Float[np.ndarray, "n 3"],
    freedom: Float[np.ndarray, "n 3"],
    size: Float[np.ndarray, " n"],
    residual: Float[np.ndarray, " n"],
) -> TrackNoise:
    """Noise of observations from what a fit leaves of them.

    Parameters
    ----------
    residuals : ndarray of shape (n, 3)
        Of u_left, v_left and disparity, px.
    freedom : ndarray of shape (n, 3)
        Share of each one's variance that the fit has left: one minus its leverage.
    size, residual : ndarray of shape (n,)
        Of the features, see `TrackNoise.variances`.
    """
    place = _variance_coefficients(residuals[:, :2], freedom[:, :2], size)
    return TrackNoise(place, _variance_coefficients(residuals[:, 2:], freedom[:, 2:], residual))


def _variance_coefficients(
    residuals: Float[np.ndarray, "n k"], freedom: Float[np.ndarray, "n k"], size: Float[np.ndarray, " n"]
) -> tuple[float, float]:
    """Coefficients of a variance a + b size^2, from groups of like size."""
    groups = np.array_split(np.argsort(size), max(1, min(8, len(size) // FEWEST)))
    variance = np.array([np.sum(residuals[g] ** 2) / np.maximum(np.sum(freedom[g]), 1e-9) for g in groups])
    square = np.array([np.mean(size[g] ** 2) for g in groups])
    weights = 1 / np.maximum(variance, SMALLEST_STD**2)
    (a, b), _ = nnls(np.column_stack([weights, square * weights]), variance * weights)
    return float(a), float(b)


ANGLES_DEG: Final = (5.0, 10.0, 15.0, 20.0, 30.0, 45.0)
"""Between directions, within which errors are alike; beyond the last they are independent."""
COSINES: Final = np.cos(np.deg2rad(ANGLES_DEG))
FEWEST_LANDMARKS: Final = 50
"""With two observations or more, from which covariances are identified; white noise is assumed otherwise."""
MOST_LANDMARKS: Final = 800
MOST_OBSERVATIONS: Final = 60
"""Of a landmark that are looked at: the cost grows with their third power."""
MOST_KERNELS: Final = 2_000_000
"""Numbers of covariances of errors that are in memory together."""
_COEFFICIENTS: Final = 2 * (1 + len(ANGLES_DEG))
RIDGE: Final = 1e-9
"""Share of the trace that is added to the information, as angles that no pair has would make it singular."""


@dataclass(frozen=True)
class LandmarkResiduals:
    """Residuals of n observations after a fit of landmarks, or of n observations of each of some landmarks.

    Attributes
    ----------
    landmark : ndarray of shape (n,)
        Which.
    point : ndarray of shape (n, 3)
        Where it is, m, frame g.
    rotation, position : ndarray of shape (n, 3, 3) and ndarray of shape (n, 3)
        (n, 3, 3), (n, 3) m of g at the epoch.
    residual : ndarray of shape (n, 3)
        Of u_left, v_left and disparity, in standard deviations of white noise.
    jacobian : ndarray of shape (n, 3, 3)
        Of these by the landmark's position.
    """

    landmark: Int[np.ndarray, "*n"]
    point: Float[np.ndarray, "*n 3"]
    rotation: Float[np.ndarray, "*n 3 3"]
    position: Float[np.ndarray, "*n 3"]
    residual: Float[np.ndarray, "*n 3"]
    jacobian: Float[np.ndarray, "*n 3 3"]

    def part(self, chosen: Bool[np.ndarray, " n"] | Int[np.ndarray, "*k"]) -> "LandmarkResiduals":
        """Some of them, in the shape of their numbers."""
        return LandmarkResiduals(*(getattr(self, each.name)[chosen] for each in fields(self)))

    @property
    def direction(self) -> Float[np.ndarray, "*n 3"]:
        """Unit vectors from the landmarks to the camera, frame g."""
        away = -np.einsum("...ji,...j->...i", self.rotation, self.position) - self.point
        return away / np.linalg.norm(away, axis=-1, keepdims=True)

    @property
    def by_common_motion(self) -> Float[np.ndarray, "*n 3 6"]:
        """Derivative of predictions by a small common motion of all poses.

        It is in the camera's frame: translation, then rotation about g.
        """
        by_camera = self.jacobian @ np.swapaxes(self.rotation, -2, -1)
        arm = np.einsum("...ij,...j->...i", self.rotation, self.point)
        return np.concatenate([by_camera, np.cross(arm[..., None, :], by_camera)], axis=-1)


@dataclass(frozen=True)
class ErrorCorrelation:
    """Covariances of errors over those of white noise, and the white noise that says as much.

    Attributes
    ----------
    place, disparity : tuple[float, ...]
        a_0, and a_k of every angle of `ANGLES_DEG`.
    inflation : float
        Factor on the variances of white noise, at least 1.
    """

    place: tuple[float, ...] = (1.0,)
    disparity: tuple[float, ...] = (1.0,)
    inflation: float = 1.0

    def inflated(self, noise: TrackNoise) -> TrackNoise:
        """Equivalent white noise for pose estimation."""
        (a, b), (c, d) = noise.place, noise.disparity
        return TrackNoise((self.inflation * a, self.inflation * b), (self.inflation * c, self.inflation * d))


def error_correlation(residuals: LandmarkResiduals) -> ErrorCorrelation:
    """Error correlation from the residuals of landmarks."""
    groups = [rows[:MOST_OBSERVATIONS] for rows in _rows_by_landmark(residuals.landmark) if len(rows) > 1]
    if len(groups) < FEWEST_LANDMARKS:
        return ErrorCorrelation()
    chosen = list(_of_equal_length(residuals, groups[:: -(-len(groups) // MOST_LANDMARKS)]))
    coefficients = _error_correlation_coefficients(chosen)
    half = len(coefficients) // 2
    place, disparity = tuple(coefficients[:half].tolist()), tuple(coefficients[half:].tolist())
    return ErrorCorrelation(place, disparity, max(_inflation(chosen, coefficients), 1.0))


def _of_equal_length(
    residuals: LandmarkResiduals, groups: list[Int[np.ndarray, " k"]]
) -> Iterator[LandmarkResiduals]:
    """Residuals of landmarks with n observations each, (l, n) of them, within `MOST_KERNELS`."""
    by_length: dict[int, list[Int[np.ndarray, " k"]]] = {}
    for rows in groups:
        by_length.setdefault(len(rows), []).append(rows)
    for length, every in by_length.items():
        most = max(MOST_KERNELS // (_COEFFICIENTS * (3 * length) ** 2), 1)
        for begin in range(0, len(every), most):
            yield residuals.part(np.array(every[begin : begin + most]))


def _error_correlation_coefficients(landmarks: list[LandmarkResiduals]) -> Float[np.ndarray, " k"]:
    """Coefficients of the place, then of the disparity, by MINQUE."""
    count = _COEFFICIENTS
    information, squares = np.zeros((count, count)), np.zeros(count)
    for some in landmarks:
        left, kernels = _residual_projection(some), _kernels(some)
        number, m = left.shape[:2]
        r, projected = left @ some.residual.reshape(number, m, 1), kernels @ left[:, None]
        # tr(P_k P_l) of all landmarks: products of the entries (i, j) of one and (j, i) of the other
        flat, turned = (
            each.reshape(number, count, m * m) for each in (projected, np.swapaxes(projected, -2, -1))
        )
        information += (flat @ np.swapaxes(turned, 1, 2)).sum(axis=0)
        r = r[:, None]
        squares += (np.swapaxes(r, -2, -1) @ kernels @ r)[..., 0, 0].sum(axis=0)
    information[np.diag_indices(count)] += RIDGE * np.trace(information)
    root = np.linalg.cholesky(information)
    return nnls(root.T, np.linalg.solve(root, squares))[0]


def _inflation(landmarks: list[LandmarkResiduals], coefficients: Float[np.ndarray, " k"]) -> float:
    """Inflation of white noise to the uncertainty of correlated errors.

    That of a motion common to all poses, on the mean.
    """
    white, shared = np.zeros((6, 6)), np.zeros((6, 6))
    for some in landmarks:
        projection = _residual_projection(some)
        left = projection @ some.by_common_motion.reshape(*projection.shape[:2], 6)
        turned, mixed = np.swapaxes(left, 1, 2), np.tensordot(_kernels(some), coefficients, axes=(1, 0))
        white += (turned @ left).sum(axis=0)
        shared += (turned @ mixed @ left).sum(axis=0)
    return float(np.trace(np.linalg.lstsq(white, shared, rcond=None)[0]) / 6)


def _residual_projection(some: LandmarkResiduals) -> Float[np.ndarray, "l m m"]:
    """Projections on what each landmark's position cannot explain."""
    Q = np.linalg.qr(some.jacobian.reshape(len(some.landmark), -1, 3))[0]
    return np.eye(Q.shape[1]) - Q @ np.swapaxes(Q, 1, 2)


def _kernels(some: LandmarkResiduals) -> Float[np.ndarray, "l k m m"]:
    """Covariances of each landmark's m = 3 n errors per unit of each coefficient: place first, then disparity."""
    (count, n), place, disparity = some.landmark.shape, some.rotation.copy(), np.zeros((3, 3))
    place[:, :, 2], disparity[2, 2] = 0.0, 1.0
    rows = place.reshape(count, 3 * n, 3)
    alike = (rows @ np.swapaxes(rows, 1, 2)).reshape(count, n, 3, n, 3)
    cosines = some.direction @ np.swapaxes(some.direction, 1, 2)
    same = np.broadcast_to(np.eye(n, dtype=bool), cosines.shape)
    within = np.stack([same, *((cosines > least) | same for least in COSINES)], axis=1)[
        :, :, :, None, :, None
    ]
    both = np.concatenate([within * alike[:, None], within * disparity[:, None]], axis=1)
    return both.reshape(count, _COEFFICIENTS, 3 * n, 3 * n)


def _rows_by_landmark(landmark: Int[np.ndarray, " n"]) -> Iterator[Int[np.ndarray, " k"]]:
    """Rows of each landmark."""
    order = np.argsort(landmark, kind="stable")
    yield from np.split(order, np.flatnonzero(np.diff(landmark[order])) + 1)
