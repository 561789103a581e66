"""Calibration of one camera from views of a board, and the covariance of a pair's: what the views determine, and how well.

The parameters are x = [left intrinsics | right intrinsics | pose of the left camera in the right one]: nine numbers of each
camera (`PARAMETERS`), then rotation vector and place. To first order their error is linear in the errors of the corners of all
views, dx = sum_g G_g e_g. That matrix holds for the two steps of the estimator, intrinsics of each camera first, relative pose
after.

Errors of corners have three parts, each with its own level, taken from the residuals:

1. independent of corner to corner and view to view;
2. smooth within a view, as of blur or of a lens that the model does not describe: the heterogeneity of the views (Birge ratio)
   is how much more they disagree about the intrinsics than part 1 explains;
3. the same in every view for each corner of the board, as of printing, or of a board that does not move: N such views count as one.

The jackknife, compared with that model, assumes no error model: the spread of calibrations that each leave out one view. Of
eight views or more, the larger deviation of both counts for each parameter.

A board that hardly moves leaves directions of x almost free. Beyond the first order, the cost is therefore computed again with
the focal length moved by four standard deviations: where it rises less than the first order says, the deviations are widened.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import cv2
import numpy as np
from jaxtyping import Float
from scipy.special import ndtr, stdtrit

from spinfilters.core.errors import InputError
from spinfilters.vision.calibration_images import Board, BoardView

PARAMETERS: Final[tuple[str, ...]] = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
ITERATIONS: Final = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-9)


@dataclass(frozen=True)
class CameraCalibration:
    """Calibration of one camera.

    Attributes
    ----------
    K, distortion : ndarray of shape (3, 3) and ndarray of shape (5,)
        Found.
    std : dict[str, float]
        Standard deviation of `PARAMETERS`, NaN before the covariance of the pair is known.
    rms : float
        px.
    view_errors : ndarray of shape (v,)
        Rms of each view, px.
    poses : ndarray of shape (v, 6)
        Of the board in the camera, rotation vector and place, (v, 6).
    """

    K: Float[np.ndarray, "3 3"]
    distortion: Float[np.ndarray, " 5"]
    std: dict[str, float]
    rms: float
    view_errors: Float[np.ndarray, " v"]
    poses: Float[np.ndarray, "v 6"]

    @property
    def focal_std(self) -> float:
        """Standard deviation of the focal length relative to it, the larger of both axes."""
        return max(self.std["fx"] / float(self.K[0, 0]), self.std["fy"] / float(self.K[1, 1]))


class CameraPair(NamedTuple):
    """Calibrations of both cameras, each by itself."""

    left: CameraCalibration
    right: CameraCalibration


class RelativePose(NamedTuple):
    """Pose of the left camera in the right one: rotation vector, and place, m."""

    turn: Float[np.ndarray, " 3"]
    place: Float[np.ndarray, " 3"]


def calibrated_camera(
    views: list[BoardView], board: Board, size: tuple[int, int], right: bool
) -> CameraCalibration:
    """Intrinsics of one camera of the pair; deviations come from `calibration_covariance`.

    Those of OpenCV count every corner as independent and drop directions that the views leave free.

    Raises
    ------
    InputError
        No camera explains the views.
    """
    points, pixels = _seen_corners(views, board, right)
    try:
        rms, K, distortion, turns, places, _, _, errors = cv2.calibrateCameraExtended(
            points, pixels, size, np.eye(3), np.zeros(5), criteria=ITERATIONS
        )
    except cv2.error:
        raise InputError(
            "the views do not determine the focal length: no camera explains them; move the board and tilt it by 20 to 45 degrees "
            "between the images, and check --corners"
        ) from None
    poses = np.column_stack([np.reshape(turns, (-1, 3)), np.reshape(places, (-1, 3))])
    return CameraCalibration(
        np.asarray(K),
        np.asarray(distortion).ravel()[:5],
        dict.fromkeys(PARAMETERS, float("nan")),
        float(rms),
        np.asarray(errors).ravel(),
        poses,
    )


def _seen_corners(
    views: Sequence[BoardView], board: Board, right: bool
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Corners of every view as OpenCV takes them: on the board, and in the image of one camera."""
    points = [board.points[view.seen].astype(np.float32) for view in views]
    pixels = [(view.right if right else view.left)[view.seen].astype(np.float32) for view in views]
    return points, pixels


N: Final = len(PARAMETERS)
RELATIVE: Final = slice(2 * N, 2 * N + 6)
"""Of the parameters: the relative pose."""
PROFILE: Final = 4.0
"""Standard deviations at which the cost is computed again."""
LARGEST_STEP: Final = 0.5
"""Of ln(focal length) in that: a calibration that free is refused anyway."""
FEWEST_LEFT_OUT: Final = 8
"""Views from which the jackknife counts: of fewer, what is left without one may determine nothing."""
LINEAR: Final = 1e-4
"""Relative deviation of the focal length up to which the first order is exact enough."""
LEAST_RISE: Final = 1e-3
"""Of the rise that the first order says: below it the cost is flat."""
_FLAT: Final = 1e-13  # eigenvalue of a scaled information matrix below which only rounding is left
_TINY: Final = 1e-300
_SEEN: Final = 1e-6  # singular value of a view's Jacobian, relative to the largest, from which the view determines that direction


@dataclass(frozen=True)
class CalibrationCovariance:
    """Covariance of the parameters of a pair, (24, 24), and what made it.

    Attributes
    ----------
    covariance : ndarray of shape (24, 24)
        Of [left intrinsics | right intrinsics | rotation vector and place of the left camera in the right
        one].
    independent, common : ndarray of shape (2,)
        Standard deviation of both kinds of corner errors, px, of left and right.
    heterogeneity : ndarray of shape (2,)
        Variance of the views' disagreement over that of independent errors, of left and right, at least 1.
    widening : ndarray of shape (2,)
        Factor on standard deviations from the profile of the cost, of left and right, at least 1.
    """

    covariance: Float[np.ndarray, "24 24"]
    independent: Float[np.ndarray, " 2"]
    common: Float[np.ndarray, " 2"]
    heterogeneity: Float[np.ndarray, " 2"]
    widening: Float[np.ndarray, " 2"]

    @property
    def std(self) -> Float[np.ndarray, " 24"]:
        """Standard deviations."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, eq=False)
class _LinearisedViews:
    """One camera's views about its calibration.

    Attributes
    ----------
    residuals : ndarray of shape (v, m)
        (v, 2n) px, zero for corners that are not seen.
    seen : ndarray
        (v, 2n).
    intrinsics : ndarray of shape (v, m, 9)
        Jacobian by the intrinsics; that by the pose of the view is (v, 2n, 6). ``reduced`` is the former once
        the pose of the view is eliminated, and ``information`` its Gramian, (9, 9).
    """

    residuals: Float[np.ndarray, "v m"]
    seen: np.ndarray
    intrinsics: Float[np.ndarray, "v m 9"]
    pose: Float[np.ndarray, "v m 6"]
    reduced: Float[np.ndarray, "v m 9"]
    information: Float[np.ndarray, "9 9"]


def calibration_covariance(
    views: Sequence[BoardView],
    board: Board,
    cameras: CameraPair,
    relative: RelativePose,
    size: tuple[int, int],
) -> CalibrationCovariance:
    """Covariance of both cameras and their relative pose.

    Parameters
    ----------
    views, board, cameras : Sequence[BoardView] and Board and CameraPair
        As calibrated, the poses of the cameras being those of the views.
    size : tuple[int, int]
        Of the images, px.
    """
    sides = [
        _linearise_views(views, board, camera, right)
        for camera, right in zip(cameras, (False, True), strict=True)
    ]
    levels = np.array([_error_levels(side) for side in sides])
    ratios = np.array([_heterogeneity(side, level.sum()) for side, level in zip(sides, levels, strict=True)])
    pairs = [_pair_view(view, board, sides, cameras, relative, g) for g, view in enumerate(views)]
    G = _influence(sides, pairs)
    # of left and right: variance of what differs between views, and of what all have in common
    variances = _student_factor(N * (len(views) - 1)) ** 2 * np.column_stack(
        [levels[:, 0] * ratios, levels[:, 1]]
    )
    first = _propagate_errors(G, variances)
    widening = np.array(
        [
            _widening_factor(views, board, camera, size, right, first[N * right :, N * right :][:2, :2])
            for camera, right in zip(cameras, (False, True), strict=True)
        ]
    )
    covariance = _propagate_errors(G, variances * widening[:, None] ** 2)
    shown = _joint_step(pairs) ** 2
    if len(views) >= FEWEST_LEFT_OUT:
        shown = np.maximum(shown, _jackknife_variances(sides, pairs))
    factor = np.sqrt(np.maximum(shown / np.maximum(np.diag(first), _TINY), 1.0))
    covariance = factor[:, None] * covariance * factor
    independent, common = np.sqrt(levels).T
    return CalibrationCovariance(covariance, independent, common, ratios, widening)


def _linearise_views(
    views: Sequence[BoardView], board: Board, camera: CameraCalibration, right: bool
) -> _LinearisedViews:
    residuals, seen, intrinsics, poses, reduced = [], [], [], [], []
    for view, pose in zip(views, camera.poses, strict=True):
        pixels, J = cv2.projectPoints(board.points, pose[:3], pose[3:], camera.K, camera.distortion)
        rows = np.repeat(view.seen, 2)
        measured = view.right if right else view.left
        B, A = J[:, :6] * rows[:, None], J[:, 6 : 6 + N] * rows[:, None]
        residuals.append(np.where(rows, measured.ravel() - pixels.ravel(), 0.0))
        seen.append(rows)
        poses.append(B)
        intrinsics.append(A)
        reduced.append(_project_out(A, B))
    A = np.array(reduced)
    information = np.einsum("gmi,gmj->ij", A, A)
    return _LinearisedViews(
        np.array(residuals), np.array(seen), np.array(intrinsics), np.array(poses), A, information
    )


def _project_out(A: Float[np.ndarray, "m a"], B: Float[np.ndarray, "m b"]) -> Float[np.ndarray, "m a"]:
    """A less its projection on the columns of B: eliminates the unknowns of B."""
    Q = np.linalg.qr(B).Q
    return A - Q @ (Q.T @ A)


def _covariance_of_information(information: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "k k"]:
    """Covariance of an information matrix, very large, not zero, in directions that it does not determine."""
    scale = _scale_of(information)
    values, vectors = np.linalg.eigh(scale[:, None] * information * scale)
    return scale[:, None] * ((vectors / np.maximum(values, _FLAT)) @ vectors.T) * scale


def _scale_of(information: Float[np.ndarray, "k k"]) -> Float[np.ndarray, " k"]:
    """Sizes of the parameters in which the information has a unit diagonal."""
    diagonal = np.diag(information)
    return 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))


def _error_levels(side: _LinearisedViews) -> tuple[float, float]:
    """Variances of corner errors, px^2: what differs between views, and what every view has in common.

    r_gi = c_i + e_gi of view g and coordinate i: the mean over views estimates c. The fit has taken up six numbers of every view
    and nine of all; of the mean, at most six and nine.
    """
    count = side.seen.sum(axis=0)
    mean = side.residuals.sum(axis=0) / np.maximum(count, 1)
    shared = np.where(side.seen, mean, 0.0)
    rows, places = int(side.seen.sum()), int((count > 0).sum())
    freedom = rows - places - 6 * (len(side.residuals) - 1) - N
    within = float(((side.residuals - shared) ** 2).sum()) / max(freedom, 1)
    noise_of_mean = float((within / np.maximum(count, 1))[count > 0].mean())
    common = float((mean[count > 0] ** 2).sum()) / max(places - 6 - N, 1) - noise_of_mean
    return within, max(common, 0.0)


def _heterogeneity(side: _LinearisedViews, variance: float) -> float:
    """Birge ratio of the views: chi^2 of their separate intrinsics about the joint ones, per degree of freedom, at least 1."""
    scale = _scale_of(side.information)
    chi2, freedom = 0.0, -N
    for A, r in zip(side.reduced, side.residuals, strict=True):
        U, values, _ = np.linalg.svd(A * scale, full_matrices=False)
        seen = values > _SEEN * values[0]
        chi2 += float(((U[:, seen].T @ r) ** 2).sum())
        freedom += int(seen.sum())
    return max(chi2 / variance / max(freedom, 1), 1.0) if variance > 0 else 1.0


@dataclass(frozen=True, eq=False)
class _PairedView:
    """A view in both images about the relative pose with intrinsics fixed, the board's pose eliminated.

    Attributes
    ----------
    relative : ndarray of shape (k, 6)
        Jacobian of the relative pose, (4n, 6).
    intrinsics : ndarray of shape (k, 18)
        Of both intrinsics, the board's pose kept, (4n, 18).
    joint : ndarray of shape (k, 24)
        Of all parameters, (4n, 24).
    residuals : ndarray of shape (k,)
        (4n,) px.
    """

    relative: Float[np.ndarray, "k 6"]
    intrinsics: Float[np.ndarray, "k 18"]
    joint: Float[np.ndarray, "k 24"]
    residuals: Float[np.ndarray, " k"]


def _pair_view(
    view: BoardView,
    board: Board,
    sides: Sequence[_LinearisedViews],
    cameras: CameraPair,
    relative: RelativePose,
    g: int,
) -> _PairedView:
    left, right = sides
    m, pose, seen = left.residuals.shape[1], cameras.left.poses[g], right.seen[g]
    composed = cv2.composeRT(pose[:3], pose[3:], relative.turn, relative.place)
    r_of_r1, r_of_t1, r_of_r2, r_of_t2, t_of_r1, t_of_t1, t_of_r2, t_of_t2 = composed[2:]
    pixels, J = cv2.projectPoints(
        board.points, composed[0], composed[1], cameras.right.K, cameras.right.distortion
    )
    J = J * seen[:, None]
    by_board = J[:, :6] @ np.block([[r_of_r1, r_of_t1], [t_of_r1, t_of_t1]])
    by_relative = J[:, :6] @ np.block([[r_of_r2, r_of_t2], [t_of_r2, t_of_t2]])
    B = np.vstack([left.pose[g], by_board])
    D = np.zeros((2 * m, 2 * N))
    D[:m, :N], D[m:, N:] = left.intrinsics[g], J[:, 6 : 6 + N]
    missed = np.where(seen, view.right.ravel() - pixels.ravel(), 0.0)
    residuals = np.concatenate([left.residuals[g], missed])[:, None]
    joint = _project_out(np.hstack([D, np.vstack([np.zeros((m, 6)), by_relative])]), B)
    return _PairedView(joint[:, RELATIVE], D, joint, _project_out(residuals, B)[:, 0])


def _student_factor(freedom: int) -> float:
    """Factor on deviations whose level has so many degrees of freedom, so that four of them cover what four Gaussian ones do.

    The level of errors that are smooth within a view is known from nine numbers of each view, less the nine that all have.
    """
    return float(-stdtrit(freedom, ndtr(-PROFILE)) / PROFILE)


def _influence(
    sides: Sequence[_LinearisedViews], pairs: Sequence[_PairedView]
) -> Float[np.ndarray, "v 24 k"]:
    """G_g of every view: dx = sum_g G_g [errors of its left corners | of its right ones], (v, 24, 4n)."""
    count, m = sides[0].residuals.shape
    G = np.zeros((count, 2 * N + 6, 2 * m))
    # Intrinsics: H dk = sum_g A_g' e_g with A_g the Jacobian without the view's pose, for each camera by itself.
    for k, side in enumerate(sides):
        solve = _covariance_of_information(side.information)
        G[:, k * N : (k + 1) * N, k * m : (k + 1) * m] = solve @ side.reduced.transpose(0, 2, 1)
    # Relative pose with intrinsics fixed: (sum C_g' C_g) db = sum_g C_g' (e_g - D_g dk). C_g is the Jacobian without the pose of
    # the board in the left camera, D_g the one with respect to both intrinsics, whose errors dk are those above.
    solve = _covariance_of_information(
        sum((each.relative.T @ each.relative for each in pairs), np.zeros((6, 6)))
    )
    coupling = sum((each.relative.T @ each.intrinsics for each in pairs), np.zeros((6, 2 * N)))
    for g, each in enumerate(pairs):
        G[g, RELATIVE] = solve @ (each.relative.T - coupling @ G[g, : 2 * N])
    return G


def _joint_step(pairs: Sequence[_PairedView]) -> Float[np.ndarray, " 24"]:
    """Step from the estimate to that of all parameters together, (sum J_g' J_g) dx = sum_g J_g' r_g, the boards' poses eliminated.

    The pair sees each board in one place, which intrinsics of each camera by itself do not use. So the step is the part of their
    error that the views show.
    """
    information = sum((each.joint.T @ each.joint for each in pairs), np.zeros((2 * N + 6,) * 2))
    gradient = sum((each.joint.T @ each.residuals for each in pairs), np.zeros(2 * N + 6))
    return _covariance_of_information(information) @ gradient


def _jackknife_variances(
    sides: Sequence[_LinearisedViews], pairs: Sequence[_PairedView]
) -> Float[np.ndarray, " 24"]:
    """Variances of the parameters from linearised calibrations that each leave out one view (Efron and Stein 1981).

    Without view g the normal equations lose its terms: (H - H_g) dk = -A_g' r_g, then with the couplings X = sum C' D of the
    relative pose (K - K_g) db = -C_g' r_g - (X - X_g) dk.
    """
    count = len(pairs)
    moved = np.zeros((count, 2 * N + 6))
    K = sum((each.relative.T @ each.relative for each in pairs), np.zeros((6, 6)))
    X = sum((each.relative.T @ each.intrinsics for each in pairs), np.zeros((6, 2 * N)))
    for g, each in enumerate(pairs):
        for k, side in enumerate(sides):
            A = side.reduced[g]
            without = _covariance_of_information(side.information - A.T @ A)
            moved[g, k * N : (k + 1) * N] = -without @ (A.T @ side.residuals[g])
        C, D = each.relative, each.intrinsics
        rest = -C.T @ each.residuals - (X - C.T @ D) @ moved[g, : 2 * N]
        moved[g, RELATIVE] = _covariance_of_information(K - C.T @ C) @ rest
    return (count - 1) / count * ((moved - moved.mean(axis=0)) ** 2).sum(axis=0)


def _propagate_errors(
    G: Float[np.ndarray, "v p k"], variances: Float[np.ndarray, "2 2"]
) -> Float[np.ndarray, "p p"]:
    """sum_g G_g V G_g' + (sum_g G_g) W (sum_g G_g)': errors of single views, and those that all have in common."""
    half = G.shape[2] // 2
    single = G * np.sqrt(np.repeat(variances[:, 0], half))
    together = G.sum(axis=0) * np.sqrt(np.repeat(variances[:, 1], half))
    return np.einsum("gik,gjk->ij", single, single) + together @ together.T


def _widening_factor(
    views: Sequence[BoardView],
    board: Board,
    camera: CameraCalibration,
    size: tuple[int, int],
    right: bool,
    covariance: Float[np.ndarray, "2 2"],
) -> float:
    """Factor on the standard deviations by which the cost rises less than to first order, at least 1.

    The cost with the focal lengths f fixed at f exp(+-d) should rise by m' C^-1 m, with m = f (exp(+-d) - 1) and C the covariance
    of fx and fy for independent errors of 1 px; the smaller of both sides counts. d is `PROFILE` deviations of ``covariance``, that
    of fx and fy with all errors.
    """
    focal = np.diag(camera.K)[:2]
    deviation = float(np.sqrt(np.diag(covariance) / focal**2).max())
    if not LINEAR < deviation < np.inf:
        return 1.0
    step = min(PROFILE * deviation, LARGEST_STEP)
    side = _linearise_views(views, board, camera, right)
    plain = _covariance_of_information(side.information)[:2, :2]
    least = 1.0
    for factor in (np.exp(step), np.exp(-step)):
        moved = focal * (factor - 1)
        expected = float(moved @ np.linalg.solve(plain, moved))
        rise = _cost_at(views, board, camera, size, right, factor) - float((side.residuals**2).sum())
        least = min(least, max(rise / expected, LEAST_RISE))
    return float(1 / np.sqrt(least))


def _cost_at(
    views: Sequence[BoardView],
    board: Board,
    camera: CameraCalibration,
    size: tuple[int, int],
    right: bool,
    factor: float,
) -> float:
    """Least sum of squares, px^2, with the focal lengths times a factor."""
    points, pixels = _seen_corners(views, board, right)
    K = camera.K.copy()
    K[[0, 1], [0, 1]] *= factor
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_FOCAL_LENGTH
    try:
        rms = cv2.calibrateCamera(
            points, pixels, size, K, camera.distortion.copy(), flags=flags, criteria=ITERATIONS
        )[0]
    except (
        cv2.error
    ):  # a principal point outside the image: this is no camera, so nothing speaks against others
        return 0.0
    return rms**2 * sum(map(len, points))
