"""Corners of a chessboard in calibration images, and which views differ enough to count."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text, require_folder, value_text
from spinfilters.vision.calibration_arguments import CalibrateArguments
from spinfilters.vision.image_folder import CAMERAS, IMAGES, SUFFIXES, LossCount, read_image, stamped_pairs

STAGE: Final = "board images"
FEWEST_PAIRS: Final = 4
NO_BOARD: Final = "without the board"
REFINEMENT: Final = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
MARKER_SHARE: Final = 0.75
"""Side of a ChArUco board's marker over that of a square."""
DICTIONARY: Final = "DICT_5X5_250"


@dataclass(frozen=True)
class Board:
    """A chessboard, or a ChArUco board.

    Attributes
    ----------
    columns, rows : int
        Of inner corners.
    square : float
        Side, m.
    charuco : bool
        Whether markers stand in its white squares (`DICTIONARY`).
    window : int
        Half width of the patch that a corner is refined in, px.
    """

    columns: int
    rows: int
    square: float
    charuco: bool = False
    window: int = CalibrateArguments.window

    @classmethod
    def of(
        cls, corners: str, square: float, charuco: bool = False, window: int = CalibrateArguments.window
    ) -> "Board":
        """Board of a text such as "9x6". InputError: no such text."""
        match = re.fullmatch(r"(\d{1,3})[xX](\d{1,3})", corners)
        if match is None or min(int(match[1]), int(match[2])) < 3:
            raise InputError(
                f"corners {value_text(corners)} are none; give inner corners of the board such as 9x6, at least 3x3"
            )
        return cls(int(match[1]), int(match[2]), square, charuco, window)

    @property
    def points(self) -> Float[np.ndarray, "n 3"]:
        """Corners in the board's frame, m, row by row."""
        grid = np.mgrid[: self.columns, : self.rows].T.reshape(-1, 2)
        return np.column_stack([grid * self.square, np.zeros(len(grid))])

    def corners(
        self, image: UInt8[np.ndarray, "h w"]
    ) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, " n"]] | None:
        """Places of the corners, and which are seen; None where the board is not found."""
        return self._charuco_corners(image) if self.charuco else self._chess_corners(image)

    def _chess_corners(
        self, image: UInt8[np.ndarray, "h w"]
    ) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, " n"]] | None:
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE
        found, corners = cv2.findChessboardCorners(image, (self.columns, self.rows), flags=flags)
        if not found:
            return None
        refined = cv2.cornerSubPix(image, corners, (self.window, self.window), (-1, -1), REFINEMENT)
        return refined.reshape(-1, 2).astype(float), np.ones(self.columns * self.rows, dtype=bool)

    def _charuco_corners(
        self, image: UInt8[np.ndarray, "h w"]
    ) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, " n"]] | None:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
        size = (self.columns + 1, self.rows + 1)
        board = cv2.aruco.CharucoBoard(size, self.square, self.square * MARKER_SHARE, dictionary)
        corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(image)
        if ids is None or len(ids) < 8:
            return None
        places, seen = np.zeros((self.columns * self.rows, 2)), np.zeros(self.columns * self.rows, dtype=bool)
        rows = np.asarray(ids).ravel().astype(int)
        places[rows], seen[rows] = np.asarray(corners).reshape(-1, 2), True
        return places, seen


@dataclass(frozen=True)
class BoardView:
    """A pair in which both cameras see the board.

    Attributes
    ----------
    name : str
        Of the left image.
    left, right : ndarray of shape (n, 2)
        px.
    seen : ndarray of shape (n,)
        Corners that both see.
    """

    name: str
    left: Float[np.ndarray, "n 2"]
    right: Float[np.ndarray, "n 2"]
    seen: Bool[np.ndarray, " n"]


class BoardImages(NamedTuple):
    """Files of a pair of images."""

    left: Path
    right: Path


def image_pairs(folder: Path) -> list[BoardImages]:
    """Files `left*` and `right*` of one number or name, or the EuRoC layout.

    Raises
    ------
    InputError
        No pairs, or a left image without its right one.
    """
    require_folder(folder)
    if (folder / CAMERAS[0] / IMAGES).is_dir():
        return [BoardImages(pair.left, pair.right) for pair in stamped_pairs(folder, LossCount())]
    files = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES]
    left, right = (
        {p.stem[len(side) :]: p for p in files if p.stem.startswith(side)} for side in ("left", "right")
    )
    alone = sorted(left.keys() ^ right.keys())
    if alone:
        path = left.get(alone[0], right.get(alone[0], folder))
        raise InputError(
            f"{path_text(path)}: has no partner of the same name on the other side; add it, or take this one away"
        )
    if len(left) < FEWEST_PAIRS:
        raise InputError(
            f"{path_text(folder)}: has {len(left)} pairs of images; give at least {FEWEST_PAIRS}, "
            "named left1.png and right1.png and so on"
        )
    return [BoardImages(left[key], right[key]) for key in sorted(left)]


def board_views(
    pairs: list[BoardImages], board: Board, losses: LossCount
) -> tuple[list[BoardView], tuple[int, int]]:
    """Pairs in which both cameras see the board, and the size of the images (width, height).

    Raises
    ------
    InputError
        Images of different sizes, too few pairs with a board.
    """
    views, size = [], None
    for left, right in pairs:
        found = []
        for path in (left, right):
            image, cause = read_image(path)
            if image is None:
                losses.lose(STAGE, cause or "not an image")
                break
            if size is not None and image.shape != size:
                raise InputError(
                    f"{path_text(path)}: is {image.shape[1]} x {image.shape[0]} px, "
                    f"others {size[1]} x {size[0]}; give one size"
                )
            size, corners = image.shape, board.corners(image)
            if corners is None:
                losses.lose(STAGE, NO_BOARD)
                break
            found.append(corners)
        if len(found) == 2:
            (a, seen_a), (b, seen_b) = found
            views.append(BoardView(left.name, a, _order_alike(a, b, board), seen_a & seen_b))
    losses.keep(STAGE, 2 * len(views))
    if len(views) < FEWEST_PAIRS or size is None:
        raise _too_few(pairs, board, len(views), losses)
    return views, (size[1], size[0])


def _too_few(pairs: list[BoardImages], board: Board, found: int, losses: LossCount) -> InputError:
    folder = path_text(pairs[0].left.parent)
    unread = {cause: n for (stage, cause), n in losses.lost.items() if stage == STAGE and cause != NO_BOARD}
    if unread:
        causes = ", ".join(f"{count} {cause}" for cause, count in unread.items())
        return InputError(
            f"{folder}: images of {sum(unread.values())} of {len(pairs)} pairs cannot be read ({causes}), "
            f"and the board is found in {found}, {FEWEST_PAIRS} are needed; give image files"
        )
    return InputError(
        f"{folder}: the board of {board.columns} x {board.rows} inner corners is found in {found} of "
        f"{len(pairs)} pairs, {FEWEST_PAIRS} are needed; check --corners (inner corners, columns x rows)"
    )


def _order_alike(
    left: Float[np.ndarray, "n 2"], right: Float[np.ndarray, "n 2"], board: Board
) -> Float[np.ndarray, "n 2"]:
    """The right corners in the order of the left ones: a chessboard may be found the other way round."""
    if board.charuco:
        return right
    along_left, along_right = left[-1] - left[0], right[-1] - right[0]
    return right if along_left @ along_right >= 0 else right[::-1]


SAME_PLACE: Final = 0.003
"""Of the image's width, rms over the corners: views that differ by less show the board at one place.

Two pixels of 640: a hand that holds still. Corners there share the errors of blur, sampling and lens, so that more such views
repeat the first and carry little information on the camera."""


def distinct_views(
    views: Sequence[BoardView], size: tuple[int, int]
) -> tuple[list[BoardView], dict[str, str]]:
    """Views at different places, each the mean of those at its place, and which were counted with which.

    Parameters
    ----------
    size : tuple[int, int]
        Of the images, px.

    Returns
    -------
    tuple[list[BoardView], dict[str, str]]
        Views named after the first at their place, and by name of every other view the name of that first one.
    """
    places: list[list[BoardView]] = []
    for view in views:
        for place in places:
            if _is_same_place(place[0], view, SAME_PLACE * size[0]):
                place.append(view)
                break
        else:
            places.append([view])
    repeated = {view.name: place[0].name for place in places for view in place[1:]}
    return [_mean(place) for place in places], repeated


def _is_same_place(one: BoardView, other: BoardView, limit: float) -> bool:
    """Whether the corners that both views have are within the limit in both images, and are most of them."""
    both = one.seen & other.seen
    if 2 * int(both.sum()) < max(int(one.seen.sum()), int(other.seen.sum()), 1):
        return False
    moved = (one.left - other.left, one.right - other.right)
    return all(float(np.sqrt((each[both] ** 2).sum(axis=1).mean())) < limit for each in moved)


def _mean(place: Sequence[BoardView]) -> BoardView:
    """Mean corners of views at one place, of those corners that all of them see."""
    if len(place) == 1:
        return place[0]
    seen = np.all([view.seen for view in place], axis=0)
    if int(seen.sum()) < int(place[0].seen.sum()) // 2:
        return place[0]
    left, right = (np.mean([getattr(view, side) for view in place], axis=0) for side in ("left", "right"))
    return replace(place[0], left=left, right=right, seen=seen)
