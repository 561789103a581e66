"""Poses from all rays of a scan: ranges to a convex body of faces, its edges and the rays that miss it.

A beam whose direction is known to a standard deviation meets, near an edge, now one face and now the other. The range is the
largest of the faces' ranges, each linear in the deviation of the beam: its mean and variance are those of the maximum of jointly
normal variables (Clark 1961, The greatest of a finite set of random variables).

Where a face is few beams wide that halves the standard deviation of the attitude.

Beams that jitter mix the faces at every edge. Planes fitted to the points that are clearly theirs are tilted by what their
gates let in, alike in all scans: angles between faces are wrong by more than their covariance. Ranges of the convex body have
no gates.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy.special import ndtr

from spinfilters.core.gauss_newton import LeastSquaresEnd, StepEquations, gauss_newton, step_equations
from spinfilters.core.linear_algebra import evenly_spaced
from spinfilters.core.ray_angles import angles_of, unit_vectors
from spinfilters.core.robust_losses import Huber
from spinfilters.lidar.face_map import Face, FaceInformation, TrackedFaces, adjusted_faces, with_map_errors
from spinfilters.lidar.planes import FEWEST, WIDE, PointNoise, border_reach, inside_of
from spinfilters.lidar.scan_pose import ScanPose, move_placement, pose_covariance

GRAZING: Final = 0.02
"""Cosine of incidence below which a face is not met."""
_PARAMETERS = 4  # of a face in L: its normal, and the lidar's distance behind it


@dataclass(frozen=True, eq=False)
class ExpectedRanges:
    """Ranges of beams, m; NaN of one that no face is before.

    Attributes
    ----------
    mean, std : ndarray of shape (n,)
    by_pose : ndarray of shape (n, 6)
        Derivative of the mean by (rotation in L, rad; translation, m).
    by_faces : ndarray of shape (n, f)
        (n, 3 F) by two tangent components of every face's normal and its offset, m.
    """

    mean: Float[np.ndarray, " n"]
    std: Float[np.ndarray, " n"]
    by_pose: Float[np.ndarray, "n 6"]
    by_faces: Float[np.ndarray, "n f"]


@dataclass(frozen=True, eq=False)
class _Variable:
    """Normal variables of beams: means, slopes (n, 2) over two standard normal deviations, variances, derivatives.

    ``by``: (n, p) of the mean, ``slopes_by``: (n, 2, p) of the slopes, by the parameters of all faces in L.
    """

    mean: Float[np.ndarray, " n"]
    slopes: Float[np.ndarray, "n 2"]
    variance: Float[np.ndarray, " n"]
    by: Float[np.ndarray, "n p"]
    slopes_by: Float[np.ndarray, "n 2 p"]


def expected_ranges(
    angles: Float[np.ndarray, "n 2"],
    faces: Sequence[Face],
    R: Float[np.ndarray, "3 3"],
    t: Float[np.ndarray, "3"],
    noise: PointNoise,
) -> ExpectedRanges:
    """Expected ranges of beams with jitter (azimuth, elevation, rad) to the body in the pose (R, t in m)."""
    u, by_angles = unit_vectors(*angles.T), _deviations(angles, noise)
    count, size = len(u), _PARAMETERS * len(faces)
    nothing = np.zeros((count, 2, size))
    largest = _Variable(np.full(count, np.nan), nothing[:, :, 0], np.zeros(count), nothing[:, 0], nothing)
    for number, face in enumerate(faces):
        if face.offset + R @ face.normal @ t < 0:
            largest = _larger_of_normals(
                largest, _expected_ranges_of_face(u, by_angles, face, R, t, number, size)
            )
    std = np.sqrt(largest.variance + noise.range_std**2 + 1e-20)
    by_pose, by_faces = np.zeros((count, 6)), np.zeros((count, 3 * len(faces)))
    for number, face in enumerate(faces):
        by = largest.by[:, _PARAMETERS * number : _PARAMETERS * (number + 1)]
        n, tangents = R @ face.normal, R @ face.tangents
        by_pose[:, :3] += np.cross(n, by[:, :3]) + by[:, 3:] * np.cross(n, t)
        by_pose[:, 3:] += by[:, 3:] * n
        by_faces[:, 3 * number : 3 * number + 2] = by[:, :3] @ tangents + by[:, 3:] * (t @ tangents)
        by_faces[:, 3 * number + 2] = by[:, 3]
    return ExpectedRanges(largest.mean, std, by_pose, by_faces)


def _deviations(angles: Float[np.ndarray, "n 2"], noise: PointNoise) -> Float[np.ndarray, "n 2 3"]:
    """Change of a beam's direction per standard deviation of azimuth and of elevation."""
    (ca, ce), (sa, se) = np.cos(angles).T, np.sin(angles).T
    by_azimuth = np.stack([-ce * sa, 0 * sa, ce * ca], axis=1) * noise.azimuth_std
    by_elevation = np.stack([-se * ca, ce, -se * sa], axis=1) * noise.elevation_std
    return np.stack([by_azimuth, by_elevation], axis=1)


def _expected_ranges_of_face(
    u: Float[np.ndarray, "n 3"],
    by_angles: Float[np.ndarray, "n 2 3"],
    face: Face,
    R: Float[np.ndarray, "3 3"],
    t: Float[np.ndarray, "3"],
    number: int,
    size: int,
) -> _Variable:
    """Ranges of one face, r = d / (u.n) with d = offset + n.t.

    NaN where it is met at a grazing angle or from behind.
    """
    n = R @ face.normal
    front = u @ n < -GRAZING
    along = np.where(front, u @ n, -1.0)
    r = (face.offset + n @ t) / along
    ahead = by_angles @ n
    slopes = -(r / along)[:, None] * ahead
    by, slopes_by = np.zeros((len(u), size)), np.zeros((len(u), 2, size))
    at, last = slice(_PARAMETERS * number, _PARAMETERS * number + 3), _PARAMETERS * number + 3
    by[:, at], by[:, last] = -(r / along)[:, None] * u, 1 / along
    slopes_by[:, :, at] = (2 * r / along**2)[:, None, None] * ahead[:, :, None] * u[:, None]
    slopes_by[:, :, at] -= (r / along)[:, None, None] * by_angles
    slopes_by[:, :, last] = -ahead / along[:, None] ** 2
    return _Variable(np.where(front, r, np.nan), slopes, np.sum(slopes**2, axis=1), by, slopes_by)


def _larger_of_normals(a: _Variable, b: _Variable) -> _Variable:
    """Clark's maximum of two normal variables; NaN is none."""
    both = ~(np.isnan(a.mean) | np.isnan(b.mean))
    first = np.where(np.isnan(a.mean), 0.0, 1.0)
    means, variances = np.where(first > 0, a.mean, b.mean), np.where(first > 0, a.variance, b.variance)
    apart, apart_by = a.slopes - b.slopes, a.slopes_by - b.slopes_by
    spread = np.sqrt(np.maximum(np.sum(apart**2, axis=1), 1e-24))
    x = np.where(both, np.clip((a.mean - b.mean) / spread, -1e3, 1e3), 0.0)
    density = np.where(both, np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi), 0.0)
    first = np.where(both, ndtr(x), first)
    low = np.minimum(a.mean, b.mean)  # squares of ranges at 500 m would drown the variance
    p, q = a.mean - low, b.mean - low
    mean = p * first + q * (1 - first) + spread * density
    square = (p**2 + a.variance) * first + (q**2 + b.variance) * (1 - first) + (p + q) * spread * density
    spread_by = np.einsum("ni,nip->np", apart, apart_by) / spread[:, None]
    mixed = first[:, None] * a.by + (1 - first)[:, None] * b.by + density[:, None] * spread_by
    turned = (density / spread)[:, None] * (a.by - b.by - x[:, None] * spread_by)
    weight = first[:, None]
    return _Variable(
        np.where(both, low + mean, means),
        weight * a.slopes + (1 - weight) * b.slopes,
        np.where(both, np.maximum(square - mean**2, 0), variances),
        mixed,
        weight[:, :, None] * a.slopes_by
        + (1 - weight)[:, :, None] * b.slopes_by
        + apart[:, :, None] * turned[:, None],
    )


FITTING: Final = 1.5
"""Reduced chi-square of all points, at most: above, the body is not the convex one of these faces."""
_MOST, _STEPS = 4000, 6
_LARGE = 4.0  # standard deviations beyond which a point counts less
LOSS: Final = Huber(_LARGE)
"""Of the range residuals, in standard deviations."""


@dataclass(frozen=True, eq=False)
class RangeEquations(StepEquations):
    """Normal equations of a pose by ranges, with the mean square ``chi`` of the residuals, each bounded."""

    chi: float


def _range_equations(expected: ExpectedRanges, measured: Float[np.ndarray, " n"]) -> RangeEquations | None:
    """Normal equations of measured ranges, m; None where a tenth of the rays misses the body."""
    residual = (measured - expected.mean) / expected.std
    good = np.isfinite(residual)
    if good.mean() < 0.9:
        return None
    residual, J = residual[good], (expected.by_pose / expected.std[:, None])[good]
    found = step_equations(residual, J, LOSS)
    return RangeEquations(found.information, found.gradient, _mean_bounded_square(residual))


def with_edges(
    pose: ScanPose,
    points: Float[np.ndarray, "n 3"],
    faces: Sequence[Face],
    noise: PointNoise,
    size: float,
    common: Float[np.ndarray, "6 6"],
) -> ScanPose:
    """The pose from all points within the outline, or the given one.

    Given: beams that do not jitter, a body that is not convex, nothing gained.

    Parameters
    ----------
    points : ndarray of shape (n, 3)
        Frame L, m.
    size : float
        Of the body, m.
    common : ndarray of shape (6, 6)
        Share of the map's errors in the pose's covariance.
    """
    kept = inner_rays(points, noise, _MOST)
    if kept is None:
        return pose
    points = points[kept]
    angles, measured = np.stack(angles_of(points), axis=1), np.linalg.norm(points, axis=1)
    prior = np.repeat([1.0, 1 / size], 3) ** 2
    fit = gauss_newton(
        (pose.rotation, pose.translation),
        lambda placement: _range_equations(expected_ranges(angles, faces, *placement, noise), measured),
        move_placement,
        lambda step, _: bool(np.abs(step).max() < 1e-9),
        _STEPS,
        lambda _: prior,
    )
    if fit.normal is None or fit.end is LeastSquaresEnd.UNDETERMINED or not fit.normal.chi < FITTING:
        return pose
    (R, t), chi = fit.state, fit.normal.chi
    covariance, lacking = pose_covariance(fit.normal.information / max(1.0, chi), R, size)
    found = replace(pose, rotation=R, translation=t, covariance=covariance + common, undetermined=lacking)
    return found if _is_nearer(found, pose) else pose


def _is_nearer(found: ScanPose, pose: ScanPose) -> bool:
    """Whether the place is known better than before."""
    return bool(np.trace(found.covariance[3:, 3:]) < np.trace(pose.covariance[3:, 3:]))


def inner_rays(
    points: Float[np.ndarray, "n 3"], noise: PointNoise, most: int
) -> Int[np.ndarray, " k"] | None:
    """At most this many rays within the outline, evenly chosen.

    None of too few, or where edges are no wider than a ray.
    """
    angles = np.stack(angles_of(points), axis=1)
    kept = np.flatnonzero(inside_of(angles, noise))
    if len(kept) < FEWEST or border_reach(angles, noise).max() < WIDE:
        return None
    return kept[evenly_spaced(len(kept), most)]


MOST_RAYS: Final = 2000
"""Of a scan within the outline: planes of more points are better than the ranges of so many of them."""


@dataclass(frozen=True, eq=False)
class RangeEvidence:
    """Ranges, m, of the beams of every scan; a `FaceEvidence`.

    Beams by azimuth and elevation, rad; ``size``: of the body, m.
    """

    angles: Sequence[Float[np.ndarray, "n 2"]]
    ranges: Sequence[Float[np.ndarray, " n"]]
    noise: PointNoise
    size: float

    def of(self, tracked: TrackedFaces, number: int, robust: bool) -> FaceInformation:
        """See `FaceEvidence`; the information is smaller where residuals are larger than the noise."""
        J, residual = self._linearise_ranges(tracked, number)
        weight = LOSS.weight(residual**2) if robust else 1.0
        scale = max(1.0, _mean_bounded_square(residual))
        weighted = (J.T * weight) / scale
        H, b = weighted @ J, weighted @ residual
        return FaceInformation(H[:6, :6], H[:6, 6:], H[6:, 6:], b[:6], b[6:])

    def reduced_chi_square(self, tracked: TrackedFaces) -> float:
        """Reduced chi-square of the scan that fits worst."""
        return max(
            _mean_bounded_square(self._linearise_ranges(tracked, k)[1]) for k in range(len(self.ranges))
        )

    def _linearise_ranges(
        self, tracked: TrackedFaces, number: int
    ) -> tuple[Float[np.ndarray, "n m"], Float[np.ndarray, " n"]]:
        """Derivatives of the whitened ranges by pose and faces, and their residuals; rays without a face are left out."""
        pose = tracked.poses[number]
        expected = expected_ranges(
            self.angles[number], tracked.faces, pose.rotation, pose.translation, self.noise
        )
        J = np.hstack([expected.by_pose, expected.by_faces]) / expected.std[:, None]
        residual = (self.ranges[number] - expected.mean) / expected.std
        good = np.isfinite(residual) & np.isfinite(J).all(axis=1)
        return J[good], residual[good]


def edge_adjusted(
    tracked: TrackedFaces, clouds: Sequence[Float[np.ndarray, "n 3"]], noise: PointNoise, size: float
) -> TrackedFaces:
    """Faces and poses of all ranges, or the given ones with edges.

    Given: beams that do not jitter, many rays or scans, a body that is not convex.

    Parameters
    ----------
    clouds : Sequence[ndarray of shape (n, 3)]
        Points of every scan, frame L, m.
    size : float
        Of the body, m.
    """
    rays = [inner_rays(points, noise, MOST_RAYS + 1) for points in clouds]
    if not tracked.faces or any(each is None or len(each) > MOST_RAYS for each in rays):
        return _fit_poses_with_edges(tracked, clouds, noise, size)
    chosen = [points[rows] for points, rows in zip(clouds, rays, strict=True) if rows is not None]
    angles = [np.stack(angles_of(points), axis=1) for points in chosen]
    evidence = RangeEvidence(angles, [np.linalg.norm(points, axis=1) for points in chosen], noise, size)
    found = adjusted_faces(tracked, evidence, size)
    sound = all(np.isfinite(pose.translation).all() for pose in found.poses)
    if not sound or evidence.reduced_chi_square(found) > FITTING:
        return _fit_poses_with_edges(tracked, clouds, noise, size)
    bare = tuple(
        replace(new, covariance=old.covariance - more)
        for new, old, more in zip(found.poses, tracked.poses, tracked.common, strict=True)
    )
    none = tuple(np.zeros((6, 6)) for _ in bare)
    posed = _fit_poses_with_edges(replace(found, poses=bare, common=none), clouds, noise, size)
    return replace(with_map_errors(posed, evidence, size), contradicted=tracked.contradicted)


def _fit_poses_with_edges(
    tracked: TrackedFaces, clouds: Sequence[Float[np.ndarray, "n 3"]], noise: PointNoise, size: float
) -> TrackedFaces:
    poses = (
        with_edges(pose, points, tracked.faces, noise, size, common)
        for pose, points, common in zip(tracked.poses, clouds, tracked.common, strict=True)
    )
    return replace(tracked, poses=tuple(poses))


def _mean_bounded_square(residual: Float[np.ndarray, " n"]) -> float:
    """Mean square of residuals in standard deviations, each bounded at `_LARGE`."""
    return float(np.mean(np.minimum(residual**2, _LARGE**2))) if len(residual) else np.inf
