"""Map of the body's plane faces: identification across scans, adjustment of faces and poses, and its consistency.

Gauss-Newton over the faces, every pose marginalised. Planes alone do not determine how far apart faces are that no scan sees
together; that the origin of g drifts uniformly, to a scatter that is measured, ties them and makes the origin the centre of
rotation.

The faces are found from the same scans as the poses, and their errors move every pose that sees them alike: e_k = own error +
A_k (error of the faces). A pose has the covariance P_k + A_k M A_k', with M of the faces, poses and drift marginalised.
Estimators take poses as independent; what they miss by that falls with the number of scans as M does, so that it stays a
constant share.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from typing import Final, NamedTuple, Protocol

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import cross_matrix
from spinfilters.core.gauss_newton import StepEquations
from spinfilters.lidar.planes import FittedPlane
from spinfilters.lidar.scan_pose import (
    ROTATION_PRIOR,
    ScanPose,
    body_side,
    move_placement,
    prior_stds,
    rotation_variance,
    shares_of_span,
)


@dataclass(frozen=True, eq=False)
class Face:
    """A face n.p = d in frame g."""

    normal: Float[np.ndarray, "3"]
    offset: float

    @property
    def tangents(self) -> Float[np.ndarray, "3 2"]:
        """Two unit tangents of the face."""
        return np.linalg.svd(self.normal[None])[2][1:].T

    def moved(self, change: Float[np.ndarray, "3"]) -> "Face":
        """The face after a change of its normal along its tangents and of its offset."""
        normal = self.normal + self.tangents @ change[:2]
        return Face(normal / np.linalg.norm(normal), self.offset + float(change[2]))


@dataclass(frozen=True, eq=False)
class TrackedFaces:
    """Poses of all scans and the map of faces that they share.

    Attributes
    ----------
    matches : tuple[tuple[int, ...], ...]
        For every scan, the face of each of its planes.
    covariance : ndarray of shape (f, f)
        (3 F, 3 F) of the faces: two tangent components of the normal (`Face.tangents`) and the offset, m;
        zero before it is known.
    common : ndarray
        What it adds to the covariance of every pose.
    contradicted : int
        Number of scans with a plane that lies where the body's uniform drift leaves no face.
    """

    poses: tuple[ScanPose, ...]
    faces: tuple[Face, ...]
    matches: tuple[tuple[int, ...], ...]
    covariance: Float[np.ndarray, "f f"] = field(default_factory=lambda: np.zeros((0, 0)))
    common: tuple[Float[np.ndarray, "6 6"], ...] = ()
    contradicted: int = 0


@dataclass(frozen=True, eq=False)
class FaceInformation:
    """Normal equations of one scan over its pose (6: rotation in L, translation) and the faces (3 each).

    Attributes
    ----------
    own : ndarray of shape (6, 6)
    cross : ndarray of shape (6, f)
    shared : ndarray of shape (f, f)
    own_side : ndarray of shape (6,)
        shared_side: (f,) right-hand sides.
    """

    own: Float[np.ndarray, "6 6"]
    cross: Float[np.ndarray, "6 f"]
    shared: Float[np.ndarray, "f f"]
    own_side: Float[np.ndarray, "6"]
    shared_side: Float[np.ndarray, " f"]


class MatchedFace(NamedTuple):
    """A plane fitted in a scan, and the face of the body that it is."""

    plane: FittedPlane
    face: Face


class FaceEvidence(Protocol):
    """Measurements of faces: fitted planes, or single ranges."""

    def of(self, tracked: TrackedFaces, number: int, robust: bool) -> FaceInformation:
        """Information of scan ``number``; outliers have less say where it is ``robust``."""
        ...


def pose_equations(
    pairs: Sequence[MatchedFace], R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]
) -> StepEquations:
    """Normal equations over (rotation in L, translation).

    Residuals of a face in a plane's own terms: tangent components of its normal, distance from the plane's centroid.
    """
    H, b = np.zeros((6, 6)), np.zeros(6)
    for plane, face in pairs:
        residual, J = residual_and_jacobian(plane, face, R, t)
        W = np.linalg.inv(plane.covariance)
        H += J.T @ W @ J
        b -= J.T @ W @ residual
    return StepEquations(H, b)


def residual_and_jacobian(
    plane: FittedPlane, face: Face, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 6"]]:
    """Residual of a face in a plane's own terms, derivative by (rotation, translation) in L."""
    n, arm = R @ face.normal, t - plane.centroid
    residual = np.array([*(plane.tangents.T @ n), face.offset + n @ arm])
    J = np.zeros((3, 6))
    J[:2, :3] = -plane.tangents.T @ cross_matrix(n)
    J[2, :3], J[2, 3:] = np.cross(n, arm), n
    return residual, J


def face_jacobian(
    plane: FittedPlane, face: Face, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3 3"]:
    """Derivative of that residual by the face: two tangent components of its normal, and its offset."""
    RT = R @ face.tangents
    J = np.zeros((3, 3))
    J[:2, :2], J[2, :2] = plane.tangents.T @ RT, (t - plane.centroid) @ RT
    J[2, 2] = 1.0
    return J


FEWEST_FOR_DRIFT: Final = 6
"""Scans from which a uniform drift of the centre of rotation is fitted."""
LARGE: Final = 25.0
"""Squared residual of a plane or a pose, in standard deviations, at which its weight is halved (Cauchy)."""
STRICTEST: Final = 1e-7
"""Scatter about the uniform drift, in sizes of the body, below which it is taken as exact."""
SAME_ANGLE: Final = np.deg2rad(3.0)
"""Between the normals of two faces that are one, at most."""
SAME_OFFSET: Final = 0.02
"""Between their offsets, in sizes of the body, at most."""
LOOSE: Final = 0.05
"""Standard deviation of a direction of faces and poses, rad or sizes of the body, from which it counts as not determined."""
SETTLED: Final = 1e-8
"""Predicted cost reduction of a step, in squared standard deviations, below which faces and poses are found."""
_STEPS = 8


@dataclass(frozen=True, eq=False)
class Drift:
    """Uniform motion of the origin of g.

    Place and velocity (6,), times of the poses from 0 to 1, scatter in m (infinite: none).
    """

    motion: Float[np.ndarray, "6"]
    times: Float[np.ndarray, " k"]
    scatter: float

    def along(self, number: int) -> Float[np.ndarray, "3 6"]:
        """Derivative of the place of pose ``number`` by the motion."""
        return np.hstack([np.eye(3), np.eye(3) * self.times[number]])

    def place(self, number: int) -> Float[np.ndarray, "3"]:
        """Position of the origin of g at pose ``number``, m."""
        return self.along(number) @ self.motion


@dataclass(frozen=True, eq=False)
class PlaneEvidence:
    """Fitted planes of every scan, in the order of the matches; a `FaceEvidence`."""

    planes: Sequence[Sequence[FittedPlane]]

    def of(self, tracked: TrackedFaces, number: int, robust: bool) -> FaceInformation:
        """See `FaceEvidence`; the loss of a plane is Cauchy's."""
        pose, count = tracked.poses[number], 3 * len(tracked.faces)
        own, cross, shared = np.zeros((6, 6)), np.zeros((6, count)), np.zeros((count, count))
        own_side, shared_side = np.zeros(6), np.zeros(count)
        for plane, k in zip(self.planes[number], tracked.matches[number], strict=True):
            at = slice(3 * k, 3 * k + 3)
            residual, J = residual_and_jacobian(plane, tracked.faces[k], pose.rotation, pose.translation)
            F = face_jacobian(plane, tracked.faces[k], pose.rotation, pose.translation)
            W = np.linalg.inv(plane.covariance)
            W /= 1 + residual @ W @ residual / LARGE if robust else 1.0
            own, shared[at, at] = own + J.T @ W @ J, shared[at, at] + F.T @ W @ F
            cross[:, at] += J.T @ W @ F
            own_side, shared_side[at] = own_side - J.T @ W @ residual, shared_side[at] - F.T @ W @ residual
        return FaceInformation(own, cross, shared, own_side, shared_side)


def adjusted_faces(tracked: TrackedFaces, evidence: FaceEvidence, size: float) -> TrackedFaces:
    """Faces and poses of robust least squares; ``size`` of the body in m."""
    for _ in range(_STEPS):
        drift = uniform_drift(tracked, size)
        blocks = [
            _normal_equations_of_scan(tracked, drift, k, evidence, size, robust=True)
            for k in range(len(tracked.poses))
        ]
        free = _directions_without_gauge(tracked, size)
        S, side = _eliminate_poses(blocks, size)
        # what no scan determines, such as how faces are turned that are only seen one after the other, stays as it was tracked:
        # there the information is that of the priors, and steps would follow rounding and the curvature of the residuals
        values, vectors = np.linalg.eigh(free.T @ S @ free)
        known = vectors[:, values > LOOSE**-2.0]
        step = free @ (known @ ((known.T @ (free.T @ side)) / values[values > LOOSE**-2.0]))
        tracked = _apply_step(tracked, blocks, step)
        if step @ side < SETTLED:
            break
    return tracked


def merged_faces(tracked: TrackedFaces, size: float) -> TrackedFaces:
    """Faces with duplicates merged.

    Faces that coincide and that no scan sees side by side are one, taken for a new one when it came back.
    """
    first, faces = list(range(len(tracked.faces))), tracked.faces
    for j, face in enumerate(faces):
        for i in (k for k in range(j) if first[k] == k):
            together = any({i, j} <= {first[k] for k in match} | set(match) for match in tracked.matches)
            near = abs(faces[i].offset - face.offset) < SAME_OFFSET * size
            if near and not together and faces[i].normal @ face.normal > np.cos(SAME_ANGLE):
                first[j] = i
                break
    kept = sorted(set(first))
    matches = tuple(tuple(kept.index(first[k]) for k in match) for match in tracked.matches)
    return replace(tracked, faces=tuple(faces[k] for k in kept), matches=matches)


def with_map_errors(tracked: TrackedFaces, evidence: FaceEvidence, size: float) -> TrackedFaces:
    """Faces and poses with the covariance of the faces."""
    drift, count = uniform_drift(tracked, size), 3 * len(tracked.faces)
    blocks = [_normal_equations_of_scan(tracked, drift, k, evidence, size) for k in range(len(tracked.poses))]
    free = _directions_without_gauge(tracked, size)
    values, vectors = np.linalg.eigh(free.T @ _eliminate_poses(blocks, size)[0] @ free)
    # differences of large numbers do not resolve small ones: these directions have the prior's 1 alone
    values[values < len(values) * np.finfo(float).eps * values[-1]] = 1.0
    own = _projection_without_gauge(tracked, blocks)
    root = own @ (free @ vectors / np.sqrt(values))[:count]
    loose = replace(drift, scatter=np.inf)
    alone = [_normal_equations_of_scan(tracked, loose, k, evidence, size) for k in range(len(tracked.poses))]
    arms = [
        body_side(-np.linalg.solve(each.own, each.cross[:, :count]), pose.rotation)
        for each, pose in zip(alone, tracked.poses, strict=True)
    ]
    common = tuple(_at_most_prior(A @ root, size) for A in arms)
    poses = tuple(
        replace(pose, covariance=pose.covariance + more)
        for pose, more in zip(tracked.poses, common, strict=True)
    )
    return replace(tracked, poses=poses, covariance=root @ root.T, common=common)


def _at_most_prior(errors: Float[np.ndarray, "6 f"], size: float) -> Float[np.ndarray, "6 6"]:
    """Covariance (translation, rotation) of errors that the map brings into a pose: the prior of a predicted pose at most.

    Faces that few scans see may leave the map's shift open, which moves a pose by many sizes of the body in a linear model only.
    """
    scale = np.repeat([size, ROTATION_PRIOR], 3)
    vectors, stds, _ = np.linalg.svd(errors / scale[:, None], full_matrices=False)
    bounded = scale[:, None] * vectors * np.minimum(stds, 1.0)
    return bounded @ bounded.T


def uniform_drift(tracked: TrackedFaces, size: float) -> Drift:
    """Uniform drift fitted to the poses' origins; medians keep poses out that do not determine theirs."""
    times = shares_of_span(tracked.poses)
    places = np.array([pose.translation for pose in tracked.poses])
    if len(times) < FEWEST_FOR_DRIFT:
        return Drift(np.concatenate([places[0], places[-1] - places[0]]), times, np.inf)
    A, weights = np.column_stack([np.ones_like(times), times]), np.ones(len(times))
    found, scatter = np.zeros((2, 3)), np.inf
    for _ in range(_STEPS):
        found = np.linalg.lstsq(A * weights[:, None], places * weights[:, None], rcond=None)[0]
        off = np.linalg.norm(places - A @ found, axis=1)
        scatter = max(float(np.median(off)), STRICTEST * size)
        weights = 1 / (1 + (off / (3 * scatter)) ** 2)
    return Drift(found.reshape(-1), times, scatter)


def _normal_equations_of_scan(
    tracked: TrackedFaces,
    drift: Drift,
    number: int,
    evidence: FaceEvidence,
    size: float,
    robust: bool = False,
) -> FaceInformation:
    """Normal equations of one scan: its evidence, the drift, the prior.

    The drift (6) comes after the faces; the prior says that the pose is somewhere near.
    """
    seen, pose, count = evidence.of(tracked, number, robust), tracked.poses[number], 3 * len(tracked.faces)
    own = seen.own + np.diag(prior_stds(size) ** -2.0)
    cross, shared = np.pad(seen.cross, ((0, 0), (0, 6))), np.pad(seen.shared, (0, 6))
    own_side, shared_side = seen.own_side.copy(), np.pad(seen.shared_side, (0, 6))
    # the drift as a measurement of the place: t = along . motion, whose columns come after those of the faces
    along, weight = drift.along(number), drift.scatter**-2.0
    off = weight * (pose.translation - along @ drift.motion)
    own[3:, 3:] += weight * np.eye(3)
    cross[3:, count:] -= weight * along
    shared[count:, count:] += weight * along.T @ along + np.eye(6) / size**2 / len(drift.times)
    own_side[3:] -= off
    shared_side[count:] += along.T @ off
    return FaceInformation(own, cross, shared, own_side, shared_side)


def _eliminate_poses(
    blocks: Sequence[FaceInformation], size: float
) -> tuple[Float[np.ndarray, "m m"], Float[np.ndarray, " m"]]:
    """Normal equations of what is shared, the poses eliminated.

    A face that no scan sees is known to a radian and ``size``.
    """
    faces = (blocks[0].shared.shape[0] - 6) // 3
    S = np.diag(np.concatenate([np.tile([1.0, 1.0, size**-2.0], faces), np.zeros(6)]))
    side = np.zeros(len(S))
    for each in blocks:  # Schur complement of the pose's own 6 by 6 block: shared - cross' own^-1 cross
        gain = np.linalg.solve(each.own, each.cross).T
        S = S + each.shared - gain @ each.cross
        side = side + each.shared_side - gain @ each.own_side
    return S, side


def _directions_without_gauge(tracked: TrackedFaces, size: float) -> Float[np.ndarray, "m f"]:
    """Directions of (faces, drift) without the gauge freedom of frame g.

    Free are its rotation, and its shift without a drift.
    """
    drifts = len(tracked.poses) >= FEWEST_FOR_DRIFT
    # columns of the gauge: rotation of g (3), then its shift (3), which a drift fixes; rows of the drift (6) stay zero
    gauge = np.concatenate([*map(_gauge_jacobian, tracked.faces), np.zeros((6, 6))])[:, : 3 if drifts else 6]
    scale = np.concatenate([np.tile([1.0, 1.0, size], len(tracked.faces)), np.full(6, size)])
    # in scaled unknowns, the left singular vectors beyond those of the gauge span its complement
    return np.linalg.svd(gauge / scale[:, None])[0][:, gauge.shape[1] :] * scale[:, None]


def _projection_without_gauge(
    tracked: TrackedFaces, blocks: Sequence[FaceInformation]
) -> Float[np.ndarray, "f f"]:
    """Projection of errors of the faces that leaves out a common rotation and shift.

    Each face weighs by the information that the scans have of it.
    Which way g is turned and where its origin lies are definitions, and no error of a pose in that g. With equal weights a face
    that was hardly seen would turn g, and all poses with it.
    """
    G = np.concatenate([_gauge_jacobian(face) for face in tracked.faces])
    W = np.zeros((len(G), len(G)))
    for k in range(len(tracked.faces)):
        at = slice(3 * k, 3 * k + 3)  # two tangents of the normal and the offset of face k
        W[at, at] = sum(each.shared[at, at] for each in blocks)
    return np.eye(len(G)) - G @ np.linalg.pinv(G.T @ W @ G, hermitian=True) @ G.T @ W


def _gauge_jacobian(face: Face) -> Float[np.ndarray, "3 6"]:
    """Change of a face by a rotation and by a shift of frame g."""
    return np.block(
        [
            [face.tangents.T @ -cross_matrix(face.normal), np.zeros((2, 3))],
            [np.zeros((1, 3)), face.normal[None]],
        ]
    )


def _apply_step(
    tracked: TrackedFaces, blocks: Sequence[FaceInformation], step: Float[np.ndarray, " m"]
) -> TrackedFaces:
    """Faces after a step, and the poses that it leads to."""
    poses = []
    for pose, each in zip(tracked.poses, blocks, strict=True):
        own = np.linalg.solve(each.own, each.own_side - each.cross @ step)  # back-substitution of the pose
        R, t = move_placement((pose.rotation, pose.translation), own)
        poses.append(replace(pose, rotation=R, translation=t))
    changes = step[: 3 * len(tracked.faces)].reshape(-1, 3)
    faces = tuple(face.moved(change) for face, change in zip(tracked.faces, changes, strict=True))
    return TrackedFaces(tuple(poses), faces, tracked.matches)


CONTRADICTION: Final = 8.0
"""Standard deviations between a plane and its face, with the body where it drifts, beyond which they do not belong together."""
MOST_CONTRADICTED: Final = 0.2
"""Share of the scans, at most: where more contradict the drift, it is the drift that is not uniform."""


@dataclass(frozen=True, eq=False)
class ConsistentFaces:
    """Tracked faces, every scan's consistent planes, and the number of scans that lost a plane (contradicted)."""

    tracked: TrackedFaces
    planes: tuple[tuple[FittedPlane, ...], ...]
    contradicted: int


def consistent_faces(
    tracked: TrackedFaces, planes: Sequence[Sequence[FittedPlane]], size: float
) -> ConsistentFaces:
    """Tracked faces without planes that contradict the uniform drift.

    Scans that lose one begin again where the drift leads.
    A plane that no other of its scan confirms moves the pose as far as its face is wrong, by a whole body, with a small covariance.

    Parameters
    ----------
    planes : Sequence[Sequence[FittedPlane]]
        Of every scan, in the order of ``tracked.matches``.
    size : float
        Of the body, m.
    """
    drift, unchanged = uniform_drift(tracked, size), tuple(map(tuple, planes))
    if not np.isfinite(drift.scatter):
        return ConsistentFaces(tracked, unchanged, 0)
    kept = [
        [
            _is_near(plane, tracked.faces[face], tracked.poses[k], drift, k, size)
            for plane, face in zip(seen, tracked.matches[k], strict=True)
        ]
        for k, seen in enumerate(planes)
    ]
    wrong = [k for k, each in enumerate(kept) if not all(each)]
    if not wrong or len(wrong) > MOST_CONTRADICTED * len(kept):
        return ConsistentFaces(tracked, unchanged, len(wrong))
    poses = list(tracked.poses)
    for k in wrong:
        poses[k] = replace(poses[k], translation=drift.place(k))
    matches = tuple(tuple(compress(match, each)) for match, each in zip(tracked.matches, kept, strict=True))
    left = tuple(tuple(compress(seen, each)) for seen, each in zip(planes, kept, strict=True))
    return ConsistentFaces(replace(tracked, poses=tuple(poses), matches=matches), left, len(wrong))


def _is_near(plane: FittedPlane, face: Face, pose: ScanPose, drift: Drift, number: int, size: float) -> bool:
    """Whether a plane lies where its face is, within what plane, attitude and drift leave open."""
    off = pose.rotation @ face.normal @ (plane.centroid - drift.place(number)) - face.offset
    tilt = size**2 * rotation_variance(pose)
    return abs(off) < CONTRADICTION * np.sqrt(plane.covariance[2, 2] + tilt + drift.scatter**2)
