"""Views of a board that show it at different places."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from spinfilters.vision.calibration_images import BoardView

SAME_PLACE: Final = 0.003
"""Of the image's width, rms over the corners: views that differ by less show the board at one place.

Two pixels of 640: a hand that holds still. Corners there share the errors of blur, sampling and lens, so that more such views
repeat the first and tell little of the camera."""


def distinct_views(
    views: Sequence[BoardView], size: tuple[int, int]
) -> tuple[list[BoardView], dict[str, str]]:
    """Views at different places, each the mean of those at its place, and which were counted with which.

    Parameters
    ----------
    size: of the images, px.

    Returns
    -------
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
