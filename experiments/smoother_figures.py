"""Pictures of the smoother's Monte Carlo."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from experiments.smoother_report import DOF, Motions, stacked
from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.models.state_blocks import BLOCKS
from spinfilters.models.state_layout import FULL_BLOCKS
from spinfilters.plots.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY, legend_below, tidy

BLOCK_COLOURS: Final = dict(zip(FULL_BLOCKS, (BLUE, SKY, GREEN, ORANGE, PURPLE, RED), strict=True))
BAND: Final = "95 % band of the mean over runs"


def nees_figure(motions: Motions) -> Figure:
    """Mean NEES over runs against the frame: of the whole state, and by block."""
    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    panels = figure.subplots(2, len(motions), sharex=True, sharey="row", squeeze=False)
    for (motion, runs), (whole, blocks) in zip(motions.items(), panels.T, strict=True):
        means = {name: np.nanmean(stacked(runs, name)[:, 1:], axis=0) for name in ("nees", "linear_nees")}
        epochs = np.arange(1, 1 + len(means["nees"]))
        _band(whole, DOF, len(runs))
        whole.plot(epochs, means["linear_nees"] / DOF, color=GREY, linewidth=3.2)
        whole.plot(epochs, means["nees"] / DOF, color=BLACK, linewidth=1.2)
        whole.set_title(f"{motion} motion, {len(runs)} runs; mean {means['nees'].mean():.2f} of {DOF}")
        for block, color in BLOCK_COLOURS.items():
            values = np.nanmean(stacked(runs, f"nees_{block}")[:, 1:], axis=0) / BLOCKS[block].dimension
            blocks.plot(epochs, values, color=color, linewidth=1.2)
        _band(blocks, 3, len(runs))
        blocks.set_xlabel("frame [-]")
    panels[0, 0].set_ylabel("NEES / dof, whole state [-]")
    panels[1, 0].set_ylabel("NEES / dof, by block [-]")
    _finish(panels)
    lines = {"smoother": BLACK, "linear, about the truth": GREY} | {
        f"block {block}": color for block, color in BLOCK_COLOURS.items()
    }
    legend_below(figure, [*_handles(lines), Patch(color=GREEN, alpha=0.2, label=f"{BAND} (below: 3 dof)")])
    return figure


def bound_figure(motions: Motions) -> Figure:
    """Errors of position and velocity over runs against the frame, with the bound."""
    figure = Figure(figsize=(11.0, 6.2), layout="constrained")
    panels = figure.subplots(2, len(motions), sharex=True, sharey="row", squeeze=False)
    for (motion, runs), column in zip(motions.items(), panels.T, strict=True):
        for axes, what in zip(column, ("position", "velocity"), strict=True):
            for name, color in ((what, BLUE), (f"{what}_bound", BLACK)):
                rms = np.sqrt(np.square(stacked(runs, name)).sum(axis=2).mean(axis=0))
                axes.plot(1e3 * rms, color=color, linewidth=1.4)
        column[0].set_title(f"{motion} motion, {len(runs)} runs")
        column[1].set_xlabel("frame [-]")
    panels[0, 0].set_ylabel("position, rms over runs [mm]")
    panels[1, 0].set_ylabel("velocity, rms over runs [mm/s]")
    _finish(panels)
    legend_below(figure, _handles({"smoother, all frames at once": BLUE, "Cramer-Rao bound": BLACK}))
    return figure


def _band(axes: Axes, dof: int, runs: int) -> None:
    low, high = chi_square_band(dof, runs)
    axes.axhspan(float(low) / dof, float(high) / dof, color=GREEN, alpha=0.2, linewidth=0, zorder=0)
    axes.axhline(1.0, color=GREY, linewidth=0.8)


def _finish(panels: np.ndarray) -> None:
    for axes in panels.ravel():
        tidy(axes)
        axes.set_ylim(bottom=0.0)


def _handles(lines: Mapping[str, str]) -> list[Line2D]:
    return [Line2D([], [], color=color, label=name) for name, color in lines.items()]
