"""A model turned with the mouse, at rest or in motion."""

import base64
import json
from dataclasses import dataclass
from importlib.resources import files
from typing import Final

import numpy as np
from jaxtyping import Float, Int

MOST_POSES: Final = 400
MOST_TRIANGLES: Final = 400_000
MOST_POINTS: Final = 100_000
_LARGEST = 32_000  # of the whole numbers that hold coordinates
_SIZE = 900, 640


@dataclass(frozen=True, eq=False)
class ShownMotion:
    """Poses of the principal axes in frame i.

    ``time`` (n,) s, ``rotation`` (n, 3, 3) R_ip, ``position`` (n, 3) m.
    """

    time: Float[np.ndarray, " n"]
    rotation: Float[np.ndarray, "n 3 3"]
    position: Float[np.ndarray, "n 3"]


@dataclass(frozen=True, eq=False)
class ShownModel:
    """Points, or a surface where there are triangles.

    Attributes
    ----------
    vertices: (v, 3) m, principal axes.   triangles: (f, 3), anticlockwise seen from outside, or none.   grey: (v,) 0..255.
    """

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "f 3"]
    grey: Float[np.ndarray, " v"]


def model_script() -> str:
    """The script of a page with a model, for `spinfilters.pages.page.page`."""
    return files("spinfilters.pages").joinpath("model_view.js").read_text(encoding="utf-8")


def model_view(model: ShownModel, motion: ShownMotion) -> str:
    """HTML of a canvas, its buttons and its data; a page has one at most."""
    document = json.dumps(_document(model, motion), allow_nan=False)
    width, height = _SIZE
    return (
        f'<p><canvas id="model-view" width="{width}" height="{height}"></canvas></p>'
        '<p><button id="model-play">play</button> <input id="model-epoch" type="range" min="-1" value="-1" style="width:24rem"> '
        '<span id="model-time" class="i"></span></p>'
        f'<script type="application/json" id="model-data">{document}</script>'
    )


def _document(model: ShownModel, motion: ShownMotion) -> dict[str, object]:
    model, motion = _limited(model), _at(motion, _finite_rows(motion))
    distance = np.linalg.norm(model.vertices, axis=1)
    radius = float(np.quantile(distance, 0.99)) * 1.1
    held = np.clip(model.vertices, -3 * radius, 3 * radius)
    unit = 3 * radius / _LARGEST
    low, high = (
        (motion.position.min(axis=0), motion.position.max(axis=0)) if len(motion.time) else (np.zeros(3),) * 2
    )
    poses = np.hstack([motion.time[:, None], motion.rotation.reshape(-1, 9), motion.position])
    return {
        "vertices": _packed(np.rint(held / unit), "<i2"),
        "triangles": _packed(model.triangles, "<u4"),
        "grey": _packed(np.clip(model.grey, 0, 255), "u1"),
        "unit": unit,
        "radius": radius,
        "middle": ((low + high) / 2).tolist(),
        "reach": radius + float(np.linalg.norm(high - low)) / 2,
        "poses": [[round(value, 5) for value in pose] for pose in poses.tolist()],
    }


def _limited(model: ShownModel) -> ShownModel:
    """Finite points, no more than a page holds.

    Of a surface with more triangles the vertices.
    """
    if 0 < len(model.triangles) <= MOST_TRIANGLES:
        return model
    rows = np.flatnonzero(np.isfinite(model.vertices).all(axis=1))
    rows = rows[:: max(1, -(-len(rows) // MOST_POINTS))]
    return ShownModel(model.vertices[rows], np.zeros((0, 3), int), model.grey[rows])


def _finite_rows(motion: ShownMotion) -> Int[np.ndarray, " k"]:
    numbers = np.hstack([motion.time[:, None], motion.rotation.reshape(-1, 9), motion.position])
    rows = np.flatnonzero(np.isfinite(numbers).all(axis=1))
    return rows[:: max(1, -(-len(rows) // MOST_POSES))]


def _at(motion: ShownMotion, rows: Int[np.ndarray, " k"]) -> ShownMotion:
    return ShownMotion(motion.time[rows], motion.rotation[rows], motion.position[rows])


def _packed(values: np.ndarray, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values.astype(kind)).tobytes()).decode()
