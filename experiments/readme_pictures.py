"""The pictures of README: the summary of the bundled example, and an animation of a body whose inertia a filter finds.

    python -m experiments.readme_pictures [-o docs]

writes ``example-summary.png`` and ``tumbling-body.gif``; ``make pictures`` does so into ``docs``. The animation shows simulated
poses of a tumbling body, and the MEKF from a vague belief about the truth.
"""

import argparse
from io import BytesIO
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from PIL import Image

import spinfilters
from experiments.command_line import run_study
from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.inertia_charts import box_of_equal_inertia
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.io.output_files import write_bytes
from spinfilters.models.body import BodyHistory, bodies_of
from spinfilters.plots.style import BLACK, BLUE, GREY, ORANGE, SIGMAS, save_figure

SUMMARY, ANIMATION = "example-summary.png", "tumbling-body.gif"
MOMENTS = (0.45, 0.8, 1.0)
RATE_RPM = (2.0, 9.0, 2.0)
FRAMES, INTERVAL = 90, 0.25
SEED = 4
FRAME_MS, COLOURS, DPI = 100, 48, 80
VIEW = np.array([[0.86, -0.5, 0.1], [0.15, 0.43, 0.89]])
"""Axes of the picture, right and up, in i; about orthonormal."""
CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)))
FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
EPILOGUE = 12
"""Times that the last frame stands."""


class TrueBody(NamedTuple):
    """Principal moments (3,) of any scale, and at every epoch the rotation (n, 3, 3) from its principal axes to i."""

    moments: Float[np.ndarray, " 3"]
    R_ib: Float[np.ndarray, "n 3 3"]


def main() -> None:
    """Draw both pictures into a folder."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("docs"), help="folder, which exists")
    parser.add_argument("--only", choices=("summary", "animation"), help="leave the other one out")
    chosen = parser.parse_args()
    if chosen.only != "animation":
        save_figure(spinfilters.compare(spinfilters.simulate()).figure("summary"), chosen.output / SUMMARY)
    if chosen.only != "summary":
        write_bytes(chosen.output / ANIMATION, animation(*found_inertia()))
    print(chosen.output)


def found_inertia() -> tuple[Evaluation, TrueBody]:
    """The MEKF on simulated poses from a vague belief about the truth."""
    dataset = spinfilters.simulate(
        kind="pose", seed=SEED, frames=FRAMES, interval=INTERVAL, rate_rpm=RATE_RPM, moments=MOMENTS
    )
    start = {"from_truth": True, "draw": SEED, "std": {"s": 0.4}}
    run = spinfilters.compare(dataset, "mekf", {"initialisation": start}, no_figures=True, verdict="filter")
    truth = dataset.truth
    assert truth is not None
    assert truth.principal_moments is not None
    assert truth.principal_axes_g is not None
    R_ib = matrix_from_quaternion(truth.q_ig) @ truth.principal_axes_g.T
    return run["mekf"].evaluation, TrueBody(truth.principal_moments, R_ib)


def animation(found: Evaluation, truth: TrueBody) -> bytes:
    """A GIF that repeats: the body with its estimated box, and the moments so far with their deviations."""
    history = found.history
    bodies = bodies_of(history.layout, history.time, history.mean, history.factor)
    frames = [_frame(found, bodies, truth, epoch) for epoch in range(len(history.time))]
    palette = frames[len(frames) // 2].quantize(COLOURS)
    flat = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    stream = BytesIO()
    times = [FRAME_MS] * (len(flat) - 1) + [FRAME_MS * EPILOGUE]
    flat[0].save(stream, "GIF", save_all=True, append_images=flat[1:], duration=times, loop=0, optimize=True)
    return stream.getvalue()


def _frame(found: Evaluation, bodies: BodyHistory, truth: TrueBody, epoch: int) -> Image.Image:
    figure = Figure(figsize=(8.0, 3.4), dpi=DPI, layout="constrained")
    body, course = figure.subplots(1, 2, width_ratios=(1.0, 1.4))
    time = found.history.time
    R_ig = matrix_from_quaternion(found.trajectory.q_ig[epoch])
    _draw_box(body, truth.R_ib[epoch], truth.moments, GREY, BLACK, 0.35)
    _draw_box(body, R_ig @ bodies.principal_axes_g[epoch].T, bodies.principal_moments[epoch], "none", BLUE, 1)
    body.set(xlim=(-0.85, 0.85), ylim=(-0.85, 0.85), aspect="equal", title="grey: true body   blue: estimate")
    body.set_axis_off()
    past = slice(0, epoch + 1)
    moments, std = bodies.principal_moments[past], SIGMAS * bodies.principal_moments_std[past]
    for k, colour in enumerate((BLUE, ORANGE)):
        course.fill_between(
            time[past], moments[:, k] - std[:, k], moments[:, k] + std[:, k], color=colour, alpha=0.25, lw=0
        )
        course.plot(time[past], moments[:, k], color=colour)
        true = np.sort(truth.moments)[k] / np.max(truth.moments)
        course.axhline(true, color=BLACK, linestyle="--", linewidth=1)
    course.set(xlim=(time[0], time[-1]), ylim=(0, 1.05), xlabel="time [s]")
    course.set_title("smaller moments of inertia / largest, band 3 σ", fontsize="medium")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())


def _draw_box(
    axes: Axes,
    R: Float[np.ndarray, "3 3"],
    moments: Float[np.ndarray, " 3"],
    face: str,
    edge: str,
    alpha: float,
) -> None:
    """Box of equal inertia, seen from the side of the viewer: faces that look away are hidden."""
    corners = CORNERS * box_of_equal_inertia(moments) @ R.T
    towards = np.cross(*VIEW)
    shown = [list(face_) for face_ in FACES if corners[list(face_)].mean(axis=0) @ towards > 0]
    polygons = [corners[each] @ VIEW.T for each in shown]
    axes.add_collection(
        PolyCollection(polygons, facecolors=face, edgecolors=edge, alpha=alpha, linewidths=1.5)
    )


if __name__ == "__main__":
    run_study(main)
