"""Views and images of a chessboard at drawn poses, with the truth: still, held by a hand, few, good."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from spinfilters.core.attitude_conversions import matrix_from_rotation_vector
from spinfilters.vision.calibration_images import Board, BoardView
from spinfilters.vision.rectification import RawCamera, RawRig

BoardPose = tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]
MARGIN_PX = 8
TILTS = {"good": 0.55, "few": 0.55, "slanted": 0.15, "flat": 0.01}
"""Largest angle about both axes of the board, rad."""


def drawn_poses(
    kind: str, count: int, rig: RawRig, board: Board, generator: np.random.Generator
) -> list[BoardPose]:
    """Rotation and place (m) of the board in the left camera.

    Parameters
    ----------
    kind : str
        "still", "jitter" (a hand: 0.3 deg, 1 mm), "flat" (facing the cameras, at many distances), "slanted" (tilted by at most
        8 deg), "good" (by at most 32 deg) or "few" (alike, drawn otherwise).
    count : int
        Number of poses.
    rig : RawRig
        Both of whose images hold the whole board.
    board : Board
        Its corners.
    generator : Generator
        What is drawn.
    """
    first = _pose_in_view(rig, board, generator, tilt=0.55)
    poses = []
    for _ in range(count):
        if kind in TILTS:
            poses.append(_pose_in_view(rig, board, generator, TILTS[kind]))
        elif kind == "jitter":
            turn = matrix_from_rotation_vector(np.deg2rad(0.3) * generator.standard_normal(3))
            centre = first[0] @ board.points.mean(axis=0) + first[1] + 1e-3 * generator.standard_normal(3)
            poses.append((turn @ first[0], centre - turn @ first[0] @ board.points.mean(axis=0)))
        else:
            poses.append(first)
    return poses


def _pose_in_view(rig: RawRig, board: Board, generator: np.random.Generator, tilt: float) -> BoardPose:
    width, height = rig.size
    while True:
        R = matrix_from_rotation_vector(generator.uniform(-1, 1, 3) * [tilt, tilt, 0.3])
        place = generator.uniform([-0.1, -0.08, 0.4], [0.14, 0.08, 0.75]) - R @ board.points.mean(axis=0)
        corners = np.vstack(projected(rig, board.points, (R, place)))
        if (corners > MARGIN_PX).all() and (corners < [width - MARGIN_PX, height - MARGIN_PX]).all():
            return R, place


def projected(
    rig: RawRig, points: Float[np.ndarray, "n 3"], pose: BoardPose
) -> list[Float[np.ndarray, "n 2"]]:
    """Pixels of points of the board in the left and the right image."""
    at_left = points @ pose[0].T + pose[1]
    at_right = at_left @ rig.relative_rotation.T + rig.relative_position
    return [
        cv2.projectPoints(seen, np.zeros(3), np.zeros(3), camera.camera_matrix, camera.distortion)[0].reshape(
            -1, 2
        )
        for camera, seen in ((rig.left, at_left), (rig.right, at_right))
    ]


def drawn_views(kind: str, count: int, rig: RawRig, board: Board, seed: int) -> list[BoardView]:
    """Views with corner errors of 0.05 to 0.25 px.

    They are independent, smooth within each view (as of blur), and common to all views (as of printing), of levels drawn.
    """
    generator = np.random.default_rng([seed, len(kind)])
    level = np.exp(generator.uniform(np.log(0.05), np.log(0.25)))
    within, common = level * generator.choice([0.0, 0.5, 1.0], 2)
    printed = common * generator.standard_normal((2, len(board.points), 2))
    views = []
    for k, pose in enumerate(drawn_poses(kind, count, rig, board, generator)):
        left, right = (
            pixels
            + level * generator.standard_normal(pixels.shape)
            + within * _smooth_field(board, generator)
            + printed[side]
            for side, pixels in enumerate(projected(rig, board.points, pose))
        )
        views.append(BoardView(f"left{k:02d}.png", left, right, np.ones(len(board.points), dtype=bool)))
    return views


def _smooth_field(board: Board, generator: np.random.Generator) -> Float[np.ndarray, "n 2"]:
    """Cubic polynomial over the board with drawn coefficients, of unit rms."""
    x, y = (2 * (board.points[:, :2] / board.points[:, :2].max(axis=0)) - 1).T
    field = np.column_stack(
        [x, y, x * y, x**2 - 0.4, y**2 - 0.4, x**3, y**3, x**2 * y, x * y**2]
    ) @ generator.standard_normal((9, 2))
    return field / np.sqrt(np.mean(field**2))


def write_board_images(
    folder: Path, poses: list[BoardPose], rig: RawRig, board: Board, generator: np.random.Generator
) -> None:
    """Write images left00.png, right00.png and so on of the board, with blur and grey noise of 2."""
    folder.mkdir(parents=True, exist_ok=True)
    for side, images in zip(("left", "right"), board_images(poses, rig, board, generator), strict=True):
        for k, image in enumerate(images):
            cv2.imwrite(str(folder / f"{side}{k:02d}.png"), image)


def board_images(
    poses: list[BoardPose], rig: RawRig, board: Board, generator: np.random.Generator
) -> tuple[list[UInt8[np.ndarray, "h w"]], list[UInt8[np.ndarray, "h w"]]]:
    """Images of the board in the left and the right camera, with blur and grey noise of 2."""
    images: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    for side, camera in enumerate((rig.left, rig.right)):
        rays = _rays(camera)
        for R, place in poses:
            pose = (R, place)
            if side:
                pose = rig.relative_rotation @ R, rig.relative_rotation @ place + rig.relative_position
            noise = 2 * generator.standard_normal((camera.height, camera.width))
            images[side].append(np.clip(_render_board(rays, board, pose) + noise, 0, 255).astype(np.uint8))
    return images


def _rays(camera: RawCamera, finer: int = 2) -> Float[np.ndarray, "h f w f 3"]:
    """Directions of ``finer`` squared parts of each pixel."""
    part = (np.arange(finer) + 0.5) / finer - 0.5
    u, v = np.meshgrid(
        (np.arange(camera.width)[:, None] + part).ravel(), (np.arange(camera.height)[:, None] + part).ravel()
    )
    rays = cv2.undistortPoints(
        np.column_stack([u.ravel(), v.ravel()]).reshape(-1, 1, 2), camera.camera_matrix, camera.distortion
    ).reshape(-1, 2)
    return np.column_stack([rays, np.ones(len(rays))]).reshape(camera.height, finer, camera.width, finer, 3)


def _render_board(
    rays: Float[np.ndarray, "h f w f 3"], board: Board, pose: BoardPose
) -> Float[np.ndarray, "h w"]:
    """Grey values of a chessboard on a white sheet."""
    R, place = pose
    distance = (R[:, 2] @ place) / (rays @ R[:, 2])
    x, y = np.moveaxis((rays * distance[..., None] - place) @ R[:, :2], -1, 0) / board.square + 1.0
    inside = (x > 0) & (y > 0) & (x < board.columns + 1) & (y < board.rows + 1)
    black = inside & ((np.floor(x) + np.floor(y)) % 2 == 0)
    return cv2.GaussianBlur(np.where(black, 30.0, 220.0).mean(axis=(1, 3)), (0, 0), 0.8)
