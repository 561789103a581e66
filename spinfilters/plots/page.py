"""HTML pages: their frame and style, and a rotating view of a body's model."""

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from typing import Final

import numpy as np
from jaxtyping import Float, Int

STYLE: Final = """
:root{color-scheme:light}body{font:15px/1.5 system-ui,sans-serif;color:#1d2328;max-width:1400px;margin:2rem auto;padding:0 1.2rem}
h1{font-size:1.6rem;margin-bottom:.2rem}h2{font-size:1.2rem;margin-top:2.2rem;border-bottom:1px solid #d5dade;padding-bottom:.2rem}
table{border-collapse:collapse;font-size:.86rem;font-variant-numeric:tabular-nums;margin:.6rem 0}
th,td{padding:.22rem .6rem;border-bottom:1px solid #e4e8eb;text-align:right;white-space:nowrap}
th:first-child,td:first-child{text-align:left}thead th{border-bottom:2px solid #9aa5ad;vertical-align:bottom}
.i{color:#66717a;font-size:.9em}.bad{color:#b23b00;font-weight:600}.scroll{overflow-x:auto}img{max-width:100%;height:auto}
pre,code{font:.83rem/1.45 ui-monospace,monospace;background:#f4f6f7;border-radius:4px}pre{padding:.7rem;overflow-x:auto}
table.facts td{text-align:left;white-space:normal}
code{padding:.1rem .3rem}details{margin:.15rem 0}summary{cursor:pointer}p.note{color:#55606a;max-width:80ch}
figure{margin:1rem 0}figcaption{color:#55606a;max-width:80ch}
canvas{background:#14181c;border-radius:4px;max-width:100%;touch-action:none}
"""


def page(parts: Mapping[str, str], title: str, script: str = "") -> str:
    """HTML of sections by their headings; sections are HTML already.

    Parameters
    ----------
    parts : Mapping[str, str]
        HTML of each section, by its heading.
    title : str
        Of the page.
    script : str
        The only one that a browser runs on the page; its hash stands in the page's policy.

    Returns
    -------
    str
        The whole document.
    """
    body = "".join(f"<section><h2>{escape(head)}</h2>{inner}</section>" for head, inner in parts.items())
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    if script:
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        policy += f"; script-src 'sha256-{digest}'"
        body += f"<script>{script}</script>"
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style></head>'
        f"<body><h1>{escape(title)}</h1>{body}</body></html>\n"
    )


def image(data: bytes, words: str, kind: str = "png") -> str:
    """A picture within the page.

    Parameters
    ----------
    data : bytes
        Content of a picture file.
    words : str
        Text in place of the picture.
    kind : str
        Its format.

    Returns
    -------
    str
        HTML of the picture.
    """
    return (
        f'<p><img alt="{escape(words)}" src="data:image/{kind};base64,{base64.b64encode(data).decode()}"></p>'
    )


def facts(told: Mapping[str, str]) -> str:
    """Table of names with their values.

    Parameters
    ----------
    told : Mapping[str, str]
        Values by their names.

    Returns
    -------
    str
        HTML of the table.
    """
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>" for name, value in told.items()
    )
    return f'<table class="facts"><tbody>{rows}</tbody></table>'


def table(head: Sequence[str], rows: Sequence[Sequence[str]], words: int) -> str:
    """A table of cells that are HTML already; the first ``words`` columns are text.

    Parameters
    ----------
    head : sequence of str
        Cells of the heading.
    rows : Sequence[sequence of str]
        Cells of every row.
    words : int
        Number of leading columns that are text.

    Returns
    -------
    str
        HTML of the table.
    """
    left = ' style="text-align:left"'
    top = "".join(f"<th{left if k < words else ''}>{escape(name)}</th>" for k, name in enumerate(head))
    body = "".join(
        "<tr>"
        + "".join(f"<td{left if k < words else ''}>{cell}</td>" for k, cell in enumerate(row))
        + "</tr>"
        for row in rows
    )
    return f'<div class="scroll"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def details(words: str, text: str) -> str:
    """Collapsible text.

    Parameters
    ----------
    words : str
        Heading that unfolds it.
    text : str
        What it holds, plain text.

    Returns
    -------
    str
        HTML of both.
    """
    return f"<details><summary>{escape(words)}</summary><pre>{escape(text)}</pre></details>"


def note(text: str) -> str:
    """A remark.

    Parameters
    ----------
    text : str
        Plain text.

    Returns
    -------
    str
        HTML of a paragraph.
    """
    return f'<p class="note">{escape(text)}</p>'


MOST_POSES: Final = 400
MOST_TRIANGLES: Final = 400_000
MOST_POINTS: Final = 100_000
_LARGEST = 32_000  # of the whole numbers that hold coordinates
_SIZE = 900, 640


@dataclass(frozen=True, eq=False)
class ShownMotion:
    """Poses of the principal axes in frame i.

    Attributes
    ----------
    time : ndarray of float, shape (n,)
        Stamps, s.
    rotation : ndarray of float, shape (n, 3, 3)
        R_ip, from principal axes to i.
    position : ndarray of float, shape (n, 3)
        Of the centre of mass, m.
    """

    time: Float[np.ndarray, " n"]
    rotation: Float[np.ndarray, "n 3 3"]
    position: Float[np.ndarray, "n 3"]


@dataclass(frozen=True, eq=False)
class ShownModel:
    """Points, or a surface where there are triangles.

    Attributes
    ----------
    vertices : ndarray of float, shape (v, 3)
        In principal axes, m.
    triangles : ndarray of int, shape (f, 3)
        Anticlockwise seen from outside, or none.
    grey : ndarray of float, shape (v,)
        From 0 to 255.
    """

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "f 3"]
    grey: Float[np.ndarray, " v"]


def model_script() -> str:
    """The script of a page with a model, for `spinfilters.plots.page.page`.

    Returns
    -------
    str
        JavaScript.
    """
    return files("spinfilters.plots").joinpath("model_view.js").read_text(encoding="utf-8")


def model_view(model: ShownModel, motion: ShownMotion) -> str:
    """HTML of a canvas, its buttons and its data; a page has one at most.

    Parameters
    ----------
    model : ShownModel
        Vertices and triangles in principal axes.
    motion : ShownMotion
        Rotation and position over time.

    Returns
    -------
    str
        HTML of the canvas.
    """
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
    """Finite points, no more than a page holds; of a surface with more triangles its vertices alone."""
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
