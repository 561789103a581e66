"""Animation of the model in the left camera's view, beside the images."""

from io import BytesIO
from typing import Final

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from spinfilters.data.camera import StereoRig
from spinfilters.vision.reconstruction.body_model import BodyModel
from spinfilters.vision.rendering.visible_surface import visible_surface

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
