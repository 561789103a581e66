"""What a camera sees of a mesh (depth buffer), and the animation of the model in the left camera's view."""

from dataclasses import dataclass
from io import BytesIO
from typing import Final, NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from PIL import Image

from spinfilters.io.camera import StereoRig
from spinfilters.vision.body_model import BodyModel

PAIRS_AT_ONCE = 2_000_000


@dataclass(frozen=True)
class VisibleSurface:
    """Visible triangle at each of h x w samples.

    Attributes
    ----------
    face : ndarray of shape (h, w)
        Row of the mesh's faces, -1 where nothing is.
    nearness : ndarray of shape (h, w)
        Of the surface there; 0 where nothing is.
    weights : ndarray of shape (k, 3)
        Barycentric weights in the image plane of the samples ``face >= 0``, row by row.
    """

    face: Int[np.ndarray, "h w"]
    nearness: Float[np.ndarray, "h w"]
    weights: Float[np.ndarray, "k 3"]

    @property
    def seen(self) -> Bool[np.ndarray, "h w"]:
        """Samples with a surface."""
        return self.face >= 0


def visible_surface(
    corners: Float[np.ndarray, "f 3 2"], nearness: Float[np.ndarray, "f 3"], shape: tuple[int, int]
) -> VisibleSurface:
    """The nearest triangle of each sample.

    Triangles that run the other way round in the image are seen from behind and left out.

    Parameters
    ----------
    corners : ndarray of shape (f, 3, 2)
        (column, row) of the triangles' corners, in samples.
    nearness : ndarray of shape (f, 3)
        Of the corners, positive, linear over the image plane: 1/z in perspective, a constant minus z in a
        parallel view.
    shape : tuple[int, int]
        Rows and columns of samples.
    """
    height, width = shape
    best, face = np.zeros(height * width), np.full(height * width, -1)
    buffers = _Buffers(best, face, width)
    front = np.flatnonzero(
        (_doubled_area(corners) < 0) & (nearness > 0).all(axis=1) & np.isfinite(corners).all(axis=(1, 2))
    )
    low = np.clip(np.ceil(corners[front].min(axis=1)), 0, [width, height]).astype(int)
    high = np.clip(np.floor(corners[front].max(axis=1)) + 1, 0, [width, height]).astype(int)
    size = np.maximum(high - low, 0)
    ends = np.cumsum(size.prod(axis=1))
    begin = 0
    while begin < len(front):
        end = max(begin + 1, int(np.searchsorted(ends, (ends[begin - 1] if begin else 0) + PAIRS_AT_ONCE)))
        part = slice(begin, end)
        _draw_triangles(corners, nearness, _Boxes(front[part], low[part], size[part]), buffers)
        begin = end
    seen = np.flatnonzero(face >= 0)
    place = np.stack([seen % width, seen // width], axis=1).astype(float)
    return VisibleSurface(
        face.reshape(shape), best.reshape(shape), _barycentric_weights(corners[face[seen]], place)
    )


class _Boxes(NamedTuple):
    """Triangles with first sample and size of their boxes, columns and rows."""

    faces: Int[np.ndarray, " k"]
    first: Int[np.ndarray, "k 2"]
    size: Int[np.ndarray, "k 2"]


class _Buffers(NamedTuple):
    """Nearness and face of every sample, row after row of this width."""

    nearness: Float[np.ndarray, " s"]
    face: Int[np.ndarray, " s"]
    width: int


def _draw_triangles(
    corners: Float[np.ndarray, "f 3 2"],
    nearness: Float[np.ndarray, "f 3"],
    boxes: _Boxes,
    buffers: _Buffers,
) -> None:
    """Draw triangles into the buffers."""
    (faces, low, size), (best, face, width) = boxes, buffers
    count = size.prod(axis=1)
    item = np.repeat(np.arange(len(faces)), count)
    within = np.arange(len(item)) - np.repeat(np.cumsum(count) - count, count)
    column = low[item, 0] + within % size[item, 0]
    row = low[item, 1] + within // size[item, 0]
    planes = _barycentric_planes(corners[faces])[item]
    first = planes[:, 0, 0] * column + planes[:, 0, 1] * row + planes[:, 0, 2]
    second = planes[:, 1, 0] * column + planes[:, 1, 1] * row + planes[:, 1, 2]
    inside = (first >= 0) & (second >= 0) & (first + second <= 1)
    item, sample, first, second = item[inside], (row * width + column)[inside], first[inside], second[inside]
    corner = nearness[faces[item]]
    near = first * corner[:, 0] + second * corner[:, 1] + (1 - first - second) * corner[:, 2]
    np.maximum.at(best, sample, near)
    winners = near == best[sample]
    face[sample[winners]] = faces[item[winners]]


def _barycentric_planes(corners: Float[np.ndarray, "f 3 2"]) -> Float[np.ndarray, "f 2 3"]:
    """First two barycentric weights, linear in the sample: factors of column and row, and a constant."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    area = _cross(b - a, c - a)[:, None]
    first = np.stack([b[:, 1] - c[:, 1], c[:, 0] - b[:, 0], _cross(b, c)], axis=1) / area
    second = np.stack([c[:, 1] - a[:, 1], a[:, 0] - c[:, 0], _cross(c, a)], axis=1) / area
    return np.stack([first, second], axis=1)


def _barycentric_weights(
    corners: Float[np.ndarray, "k 3 2"], place: Float[np.ndarray, "k 2"]
) -> Float[np.ndarray, "k 3"]:
    """Barycentric weights of places in triangles."""
    planes = _barycentric_planes(corners)
    first, second = np.einsum("kwi,ki->wk", planes[..., :2], place) + planes[..., 2].T
    return np.stack([first, second, 1 - first - second], axis=1)


def _doubled_area(corners: Float[np.ndarray, "f 3 2"]) -> Float[np.ndarray, " f"]:
    """Signed; negative for a triangle that runs anticlockwise to an observer, rows pointing down."""
    return _cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _cross(a: Float[np.ndarray, "k 2"], b: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, " k"]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


HEIGHT_PX: Final = 240
"""Of the animation."""
MOST_FRAMES: Final = 60
GREY_LEVELS: Final = 32
FRAME_MS: Final = 120

Picture = UInt8[np.ndarray, "h w"]


def reprojection(
    model: BodyModel, rig: StereoRig, R_cp: Float[np.ndarray, "3 3"], t_cp: Float[np.ndarray, " 3"]
) -> Picture:
    """Image of the model in its own grey values at a pose.

    The pose is of the principal axes in the left camera, the height `HEIGHT_PX`.
    """
    scale = HEIGHT_PX / rig.left.height
    shape = HEIGHT_PX, round(rig.left.width * scale)
    at = (model.vertices @ R_cp.T + t_cp)[model.triangles]
    with np.errstate(divide="ignore", invalid="ignore"):
        column = rig.left.fx * at[..., 0] / at[..., 2] + rig.left.cx
        row = rig.left.fy * at[..., 1] / at[..., 2] + rig.left.cy
        surface = visible_surface(
            (np.stack([column, row], axis=-1) + 0.5) * scale - 0.5, 1 / at[..., 2], shape
        )
    image, seen = np.zeros(shape), surface.seen
    image[seen] = (surface.weights * model.grey[model.triangles[surface.face[seen]]]).sum(axis=1)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def beside(image: UInt8[np.ndarray, "r c"], drawn: Picture) -> UInt8[np.ndarray, "h both"]:
    """An image, made as high as a reprojection, and that reprojection."""
    small = cv2.resize(image, drawn.shape[::-1], interpolation=cv2.INTER_AREA)
    return np.hstack([small, np.full((len(drawn), 2), 255, np.uint8), drawn])


def animation(pictures: list[Picture]) -> bytes:
    """Pictures of one size as a GIF that repeats."""
    step = 256 // GREY_LEVELS
    frames = [Image.fromarray((picture // step) * step) for picture in pictures]
    stream = BytesIO()
    frames[0].save(
        stream, "GIF", save_all=True, append_images=frames[1:], duration=FRAME_MS, loop=0, optimize=False
    )
    return stream.getvalue()
