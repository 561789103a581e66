"""report.html of a run, one page: verdict, numbers, the model to turn or a box of equal inertia, and every picture."""

import json
from collections.abc import Iterator
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.errors import InputError
from spinfilters.core.inertia_charts import box_of_equal_inertia
from spinfilters.evaluation.comparison_table import comparison_cells
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.metrics import held_text
from spinfilters.evaluation.spin_regime import spin_verdict
from spinfilters.io.input_file import printable, read_bytes, read_settings_text
from spinfilters.io.output_files import write_text
from spinfilters.io.ply_files import read_ply
from spinfilters.io.sensor_format import sensor_format
from spinfilters.models.status import Holds
from spinfilters.plots.figures import FigureData, figure_entries
from spinfilters.plots.page import (
    ShownModel,
    ShownMotion,
    details,
    facts,
    image,
    model_script,
    model_view,
    note,
    page,
    shown_box,
    table,
)
from spinfilters.run.run_folder import (
    ANIMATION_FILE,
    CONFIG_FILE,
    CONVERGENCE_PICTURE,
    MODEL_FILE,
    PREDICTION_ERRORS_PICTURE,
    PREDICTION_PICTURE,
    RACE_PICTURE,
    RECONSTRUCTION_FILE,
    RECONSTRUCTION_FOLDER,
    REPORT_FILE,
    reference_pictures,
)

LARGEST_PICTURE: Final = 20_000_000
"""Bytes; a larger one stays a file next to the page."""
FEWEST_POINTS: Final = 4
MAP_GREY: Final = 200.0


def write_run_report(figure_data: FigureData, folder: Path) -> Path:
    """Write the page of a run folder whose numbers and pictures are written; its path.

    Raises
    ------
    InputError
        The page cannot be written.
    """
    with np.errstate(all="ignore"):  # what a failed estimator left is shown as it is
        model = _model_section(figure_data, folder)
        sections = {
            "Verdict": _lead(figure_data) + _verdict_section(figure_data),
            "Numbers": _numbers_section(figure_data),
            **({"Body": model} if model else {}),
            **_dense_sections(folder),
            "Pictures": _all_pictures(figure_data, folder) or note("None was drawn."),
            "What it was made with": _made_section(folder),
        }
    sections = {head: inner for head, inner in sections.items() if inner}
    title = f"Run: {printable(figure_data.dataset.description or figure_data.dataset.kind)}"
    path = folder / REPORT_FILE
    write_text(path, page(sections, title, model_script() if model else "", beside=("Numbers", "Body")))
    return path


def _verdict_section(figure_data: FigureData) -> str:
    """Status of every estimator with its reasons."""
    rows = []
    for evaluation in figure_data.evaluations:
        status = evaluation.history.status
        verdict = escape(str(status.verdict))
        marked = f'<span class="badge {verdict}">{verdict}</span>'
        reasons = escape(printable("; ".join(status.reasons))) or "nothing speaks against it"
        holds = escape(held_text(evaluation)) or "not judged"
        wide = (f'<span style="white-space:normal">{text}</span>' for text in (holds, reasons))
        rows.append([escape(evaluation.name), marked, *wide])
    log = figure_data.dataset.log
    best = figure_data.most_exact
    spin = None if best is None else spin_verdict(best)
    told = {
        "motion": "" if spin is None else spin.sentence,
        "measurements": ", ".join(
            f"{len(stream)} of {sensor_format(stream.sensor).kind}" for stream in log.streams
        ),
        "epochs": str(max(len(each.history.time) for each in figure_data.evaluations)),
        "noise": " ".join(figure_data.conditions),
    }
    return table(["estimator", "status", "what holds", "reasons"], rows, 4) + facts(
        {k: v for k, v in told.items() if v}
    )


def _numbers_section(figure_data: FigureData) -> str:
    """The summary table."""
    cells = comparison_cells(figure_data.evaluations)
    rows = [[_cell(text) for text in row] for section in cells.sections for row in section]
    above, below = (note(" ".join(lines)) if lines else "" for lines in (cells.title, cells.captions))
    return above + table(["", *cells.headings], rows, 1) + below


def _cell(text: str) -> str:
    """A cell whose indentation stays."""
    words = text.lstrip(" ")
    return "&emsp;" * ((len(text) - len(words)) // 2) + escape(words)


def _model_section(figure_data: FigureData, folder: Path) -> str:
    """The dense model, or else the map of landmarks, to turn; nothing where there is neither."""
    evaluation = figure_data.most_exact
    if evaluation is None or not np.isfinite(evaluation.body.principal_axes_g).all():
        return ""
    trajectory, body = evaluation.trajectory, evaluation.body
    R_pg = body.principal_axes_g
    R_ip = matrix_from_quaternion(trajectory.q_ig) @ R_pg.T
    momentum = np.einsum("nij,j,nkj,nk->ni", R_ip, body.principal_moments, R_ip, trajectory.rate_i)
    motion = ShownMotion(
        trajectory.time, R_ip, trajectory.position, trajectory.rate_i, momentum, trajectory.sees_position
    )
    model, what = _dense_model(folder), "The surface"
    if model is None:
        model, what = _map_model(figure_data, evaluation), "The map of landmarks"
    if model is None:
        edge = box_edge(motion.position, motion.sees_position)
        box = shown_box(edge * box_of_equal_inertia(body.principal_moments))
        model, what = replace(box, sized=False), "The uniform box of equal inertia, of no known size,"
    words = (
        f"{what} in principal axes (x red, y green, z blue: moments ascending), with the polhode in orange. Turn it by dragging, "
        f"the wheel makes it larger. The slider shows the motion that {evaluation.name} estimated, with rate and angular momentum."
    )
    return note(words) + model_view(model, motion)


BOX_SHARE: Final = 0.25
"""Longest edge of a box over the extent of the path."""


def box_edge(position: Float[np.ndarray, "n 3"], sees_position: bool) -> float:
    """Length of the longest edge of a box of unknown size: 1, or a share of the path."""
    finite = position[np.isfinite(position).all(axis=1)]
    extent = float(np.linalg.norm(np.ptp(finite, axis=0))) if len(finite) else 0.0
    return BOX_SHARE * extent if sees_position and extent > 0 else 1.0


def _lead(figure_data: FigureData) -> str:
    """The verdict on the most exact estimate, and the body in one line."""
    evaluation = figure_data.most_exact
    if evaluation is None:
        return '<p class="lead"><span class="badge failed">failed</span> No estimator found the motion.</p>'
    status = evaluation.history.status
    verdict = escape(str(status.verdict))
    words = f'<p class="lead"><span class="badge {verdict}">{verdict}</span> {escape(evaluation.name)}'
    moments = evaluation.body.principal_moments
    if np.isfinite(moments).all() and status.holds.get("moments") is not Holds.NOT_DETERMINED:
        ratios = " : ".join(f"{each:.2f}" for each in moments[:2])
        edges = " x ".join(f"{edge:.2f}" for edge in box_of_equal_inertia(moments))
        words += f". Moments {ratios} : 1, as a uniform box of {edges}, its longest edge being 1"
    return words + ".</p>"


def _all_pictures(figure_data: FigureData, folder: Path) -> str:
    """All pictures, two in a row of a wide window."""
    found = "".join(_pictures(figure_data, folder))
    return f'<div class="pictures">{found}</div>' if found else ""


def _map_model(figure_data: FigureData, evaluation: Evaluation) -> ShownModel | None:
    points, centre = figure_data.map_points, evaluation.body.center_of_mass_g
    if points is None or centre is None or len(points) < FEWEST_POINTS:
        return None
    at = (points - centre) @ evaluation.body.principal_axes_g.T
    return ShownModel(at, np.zeros((0, 3), int), np.full(len(at), MAP_GREY))


def _dense_model(folder: Path) -> ShownModel | None:
    path = folder / RECONSTRUCTION_FOLDER / MODEL_FILE
    if not path.is_file():
        return None
    try:
        content = read_ply(path)
        return ShownModel(content.points, content.triangles, content.columns["red"].astype(float))
    except (InputError, KeyError):  # of another program: the page shows the map
        return None


def _dense_sections(folder: Path) -> dict[str, str]:
    """Dimensions of the dense model, and its animation next to the images."""
    place = folder / RECONSTRUCTION_FOLDER
    sections: dict[str, str] = {}
    try:
        document = json.loads(read_settings_text(place / RECONSTRUCTION_FILE))
        sections["Dimensions"] = _dimensions(document)
    except (InputError, ValueError, KeyError, TypeError, RecursionError):
        return sections
    picture = _file(place / ANIMATION_FILE, "left image and the model at the estimated pose")
    if picture:
        sections["Images and reprojected model"] = picture
    return sections


def _dimensions(document: dict[str, Any]) -> str:
    keys = ("dimensions_m", "surface_std_m", "dimensions_std_m")
    sizes = [[f"{1e3 * float(size):.1f}" for size in document[key]] for key in keys]
    rows = [[axis, *of_axis] for axis, *of_axis in zip("xyz", *sizes, strict=True)]
    words = f"Of the surface of {int(document['epochs'])} pairs, voxels of {1e3 * float(document['voxel_m']):.1f} mm."
    heads = [
        "principal axis",
        "extent [mm]",
        "deviation, axes as estimated [mm]",
        "deviation, true axes [mm]",
    ]
    said = "".join(note(f"{sentence}.") for sentence in document["notes"])
    return table(heads, rows, 1) + note(words) + said


def _pictures(figure_data: FigureData, folder: Path) -> Iterator[str]:
    """Every picture of the folder with its caption."""
    names = [evaluation.name for evaluation in figure_data.evaluations]
    captions = {f"{name}.png": entry.caption for entry in figure_entries() for name in entry.names(names)}
    captions |= {
        PREDICTION_PICTURE: "Predicted motion.",
        PREDICTION_ERRORS_PICTURE: "Predicted minus true motion.",
        RACE_PICTURE: "Several inertias from the last state.",
        CONVERGENCE_PICTURE: "How estimates converge.",
    }
    for name in names:
        values, differences = reference_pictures(name)
        captions[values] = f"{name} and the reference, in the same axes."
        captions[differences] = f"{name} minus the reference, before and after its axes are corrected."
    for name, caption in captions.items():
        picture = _file(folder / name, caption)
        if picture:
            yield f"<div><h3>{escape(name.removesuffix('.png'))}</h3>{note(caption)}{picture}</div>"


def _file(path: Path, words: str) -> str:
    """A picture's HTML; nothing where there is none."""
    try:
        data = read_bytes(path, LARGEST_PICTURE)
    except InputError:
        return ""
    return image(data, words, path.suffix[1:]) if data else ""


def _made_section(folder: Path) -> str:
    try:
        return details(CONFIG_FILE, read_settings_text(folder / CONFIG_FILE))
    except InputError:
        return ""
