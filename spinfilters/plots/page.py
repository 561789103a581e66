"""HTML pages: their frame and style, and a rotating view of a body's model."""

import base64
import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from importlib.resources import files
from typing import Final

import numpy as np
from jaxtyping import Float, Int

STYLE: Final = """
:root{color-scheme:light dark;--ink:#1d2328;--soft:#55606a;--paper:#fff;--shade:#f4f6f7;--line:#d5dade;--good:#1f7a4d;
--doubt:#a35b00;--bad:#b3261e}
@media (prefers-color-scheme:dark){:root{--ink:#e3e7ea;--soft:#a4aeb6;--paper:#15191d;--shade:#20262b;--line:#39424a;--good:#5cc08b;
--doubt:#e8a94c;--bad:#ff8a80}
img.drawn{filter:invert(.91) hue-rotate(180deg)}}
body{font:15px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--paper);max-width:1700px;margin:1.5rem auto;padding:0 1rem}
h1{font-size:1.5rem;margin-bottom:.2rem;overflow-wrap:anywhere}
h2{font-size:1.2rem;margin-top:2rem;border-bottom:1px solid var(--line);padding-bottom:.2rem}
main{display:grid;grid-template-columns:minmax(0,1fr);gap:0 2rem}section{grid-column:1/-1;min-width:0}
@media (min-width:1100px){main{grid-template-columns:fit-content(65%) minmax(0,1fr)}section.half{grid-column:auto}}
.pictures{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,560px),1fr));gap:0 2rem}.pictures>div{min-width:0}
table{border-collapse:collapse;font-size:.86rem;font-variant-numeric:tabular-nums;margin:.6rem 0}
th,td{padding:.22rem .6rem;border-bottom:1px solid var(--line);text-align:right;white-space:nowrap}
th:first-child,td:first-child{text-align:left}thead th{border-bottom:2px solid var(--soft);vertical-align:bottom}
.i{color:var(--soft);font-size:.9em}.bad{color:var(--bad);font-weight:600}.scroll{overflow-x:auto}
img{max-width:100%;height:auto;border-radius:4px}
.badge{display:inline-block;border-radius:4px;padding:.05rem .5rem;font-weight:600;color:var(--paper);background:var(--soft)}
.ok{background:var(--good)}.degraded{background:var(--doubt)}.failed{background:var(--bad)}.lead{font-size:1.15rem;margin:.5rem 0}
pre,code{font:.83rem/1.45 ui-monospace,monospace;background:var(--shade);border-radius:4px}pre{padding:.7rem;overflow-x:auto}
table.facts td{text-align:left;white-space:normal;overflow-wrap:anywhere}table.facts td:first-child{white-space:nowrap}
code{padding:.1rem .3rem}details{margin:.15rem 0}summary{cursor:pointer}p.note{color:var(--soft);max-width:80ch}
figure{margin:1rem 0}figcaption{color:var(--soft);max-width:80ch}
canvas{background:#14181c;border-radius:4px;max-width:100%;height:auto;touch-action:none}
.controls{display:flex;gap:.6rem;align-items:center;flex-wrap:wrap}
.controls input{flex:1 1 8rem;min-width:0;max-width:min(24rem,100%)}
@media (max-width:480px){body{padding:0 .6rem}th,td{padding:.2rem .4rem}
.scroll th:first-child,.scroll td:first-child{white-space:normal;min-width:6.5rem;position:sticky;left:0;background:var(--paper)}}
"""


DRAWN: Final = "png"
"""Format of figures; photographs and animations have others."""


def page(parts: Mapping[str, str], title: str, script: str = "", beside: Collection[str] = ()) -> str:
    """HTML of sections by their headings; sections are HTML already.

    Parameters
    ----------
    parts : Mapping[str, str]
        HTML of each section, by its heading.
    title : str
        Of the page.
    script : str
        The only one that a browser runs on the page; its hash stands in the page's policy.
    beside : Collection[str]
        Headings of sections that take half the width of a wide window, so that two stand side by side.

    Returns
    -------
    str
        The whole document.
    """
    body = "".join(
        f"<section{' class=half' if head in beside else ''}><h2>{escape(head)}</h2>{inner}</section>"
        for head, inner in parts.items()
    )
    body = f"<main>{body}</main>"
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    if script:
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        policy += f"; script-src 'sha256-{digest}'"
        body += f"<script>{script}</script>"
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        f'<meta name="viewport" content="width=device-width,initial-scale=1"><style>{STYLE}</style></head>'
        f"<body><h1>{escape(title)}</h1>{body}</body></html>\n"
    )


def image(data: bytes, words: str, kind: str = "png") -> str:
    """A picture within the page; of figures, which are PNG on white, a dark page exchanges light and dark, and keeps the hues.

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
    drawn = ' class="drawn"' if kind == DRAWN else ""
    content = base64.b64encode(data).decode()
    return f'<p><img{drawn} alt="{escape(words)}" src="data:image/{kind};base64,{content}"></p>'


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
    rate, momentum : ndarray of float, shape (n, 3), or None
        Angular rate and angular momentum in frame i, of any scale; None draws none.
    sees_position : bool
        Whether positions are measured: then lengths are metres, and the camera at the origin of i is drawn.
    """

    time: Float[np.ndarray, " n"]
    rotation: Float[np.ndarray, "n 3 3"]
    position: Float[np.ndarray, "n 3"]
    rate: Float[np.ndarray, "n 3"] | None = None
    momentum: Float[np.ndarray, "n 3"] | None = None
    sees_position: bool = False


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
    sized : bool
        Whether its size is known. Otherwise only its shape is, and it has no scale bar by itself.
    """

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "f 3"]
    grey: Float[np.ndarray, " v"]
    sized: bool = True


BOX_CORNERS: Final = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
BOX_FACES: Final = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
"""Corners of each face, anticlockwise seen from outside."""
BOX_GREYS: Final = (120.0, 190.0, 140.0, 170.0, 105.0, 205.0)


def shown_box(edges: Float[np.ndarray, "3"]) -> ShownModel:
    """A box along the principal axes.

    Parameters
    ----------
    edges : ndarray of float, shape (3,)
        Lengths along x, y and z.

    Returns
    -------
    ShownModel
        Four corners of each face, so that each has a shade of its own.
    """
    corners = BOX_CORNERS * np.asarray(edges) / 2
    vertices = np.concatenate([corners[list(face)] for face in BOX_FACES])
    first = 4 * np.arange(len(BOX_FACES))[:, None]
    triangles = np.concatenate([first + np.array(corner) for corner in ((0, 1, 2), (0, 2, 3))])
    return ShownModel(vertices, triangles, np.repeat(BOX_GREYS, 4))


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
        '<p class="controls"><button id="model-play">play</button><input id="model-epoch" type="range" min="-1" value="-1" '
        'aria-label="epoch"><span id="model-time" class="i"></span></p>'
        f'<script type="application/json" id="model-data">{document}</script>'
    )


def _document(model: ShownModel, motion: ShownMotion) -> dict[str, object]:
    model, motion = _limit_points(model), _motion_at_rows(motion, _finite_rows(motion))
    distance = np.linalg.norm(model.vertices, axis=1)
    radius = float(np.quantile(distance, 0.99)) * 1.1
    held = np.clip(model.vertices, -3 * radius, 3 * radius)
    unit = 3 * radius / _LARGEST
    low, high = (
        (motion.position.min(axis=0), motion.position.max(axis=0)) if len(motion.time) else (np.zeros(3),) * 2
    )
    poses = np.hstack([motion.time[:, None], motion.rotation.reshape(-1, 9), motion.position])
    return {
        "vertices": _pack_values(np.rint(held / unit), "<i2"),
        "triangles": _pack_values(model.triangles, "<u4"),
        "grey": _pack_values(np.clip(model.grey, 0, 255), "u1"),
        "unit": unit,
        "radius": radius,
        "middle": ((low + high) / 2).tolist(),
        "reach": radius + float(np.linalg.norm(high - low)) / 2,
        "poses": [[round(value, 5) for value in pose] for pose in poses.tolist()],
        "rate": _directions(motion.rate),
        "momentum": _directions(motion.momentum),
        "polhode": []
        if motion.rate is None
        else _directions(np.einsum("nij,ni->nj", motion.rotation, motion.rate)),
        "metric": motion.sees_position,
        "sized": model.sized,
    }


def _directions(vectors: Float[np.ndarray, "n 3"] | None) -> list[list[float]]:
    """Vectors over the longest of them; nothing of vectors that are all zero or not there."""
    longest = 0.0 if vectors is None else float(np.linalg.norm(vectors, axis=1).max(initial=0.0))
    if vectors is None or not longest > 0:
        return []
    return np.round(vectors / longest, 4).tolist()


def _limit_points(model: ShownModel) -> ShownModel:
    """Finite points, no more than a page holds; of a surface with more triangles its vertices alone."""
    if 0 < len(model.triangles) <= MOST_TRIANGLES:
        return model
    rows = np.flatnonzero(np.isfinite(model.vertices).all(axis=1))
    rows = rows[:: max(1, -(-len(rows) // MOST_POINTS))]
    return replace(
        model, vertices=model.vertices[rows], triangles=np.zeros((0, 3), int), grey=model.grey[rows]
    )


def _finite_rows(motion: ShownMotion) -> Int[np.ndarray, " k"]:
    numbers = np.hstack([motion.time[:, None], motion.rotation.reshape(-1, 9), motion.position])
    others = [each for each in (motion.rate, motion.momentum) if each is not None]
    numbers = np.hstack([numbers, *others])
    rows = np.flatnonzero(np.isfinite(numbers).all(axis=1))
    return rows[:: max(1, -(-len(rows) // MOST_POSES))]


def _motion_at_rows(motion: ShownMotion, rows: Int[np.ndarray, " k"]) -> ShownMotion:
    rate, momentum = (None if each is None else each[rows] for each in (motion.rate, motion.momentum))
    return replace(
        motion,
        time=motion.time[rows],
        rotation=motion.rotation[rows],
        position=motion.position[rows],
        rate=rate,
        momentum=momentum,
    )


def _pack_values(values: np.ndarray, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values.astype(kind)).tobytes()).decode()
