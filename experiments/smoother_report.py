"""Tables of the smoother's Monte Carlo, each figure beside its bar."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from rich.table import Table

from experiments.smoother_runs import Arrays, root_mean_square
from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.models.state_blocks import BLOCKS
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.reproduction.tweddle.final_deviations import QUANTITIES, THESIS

DOF: Final = StateLayout(FULL_BLOCKS).error_dim
BOUND_RATIO, MOMENTS_RATIO, THESIS_NEES, LINEARISATIONS = 1.10, 1.3, 22.5, 12
"""Bars: position and velocity over the bound; moments over it on rich motion; NEES on the thesis' motion; linearisations from the
closed form."""
AFTER_FIRST: Final = slice(1, None)
"""Frames of a batch whose NEES counts: the first one's pose is exact by definition."""
Motions = Mapping[str, list[Arrays]]


def stacked(runs: list[Arrays], name: str) -> np.ndarray:
    """An array of every run."""
    return np.array([run[name] for run in runs])


def batch_table(motions: Motions) -> Table:
    """Errors beside the bound, and NEES of the whole state."""
    count = len(next(iter(motions.values())))
    table = _table(f"All frames at once, {count} seeds", ("motion", "figure", "value", "bar", ""))
    for motion, runs in motions.items():
        for what, unit in (("position", "mm"), ("velocity", "mm/s")):
            error, bound = (root_mean_square(stacked(runs, name)) for name in (what, f"{what}_bound"))
            told = f"{1e3 * error:.4f} {unit}, bound {1e3 * bound:.4f}, ratio {error / bound:.3f}"
            table.add_row(motion, what, told, f"<= {BOUND_RATIO:g}", _verdict(error / bound <= BOUND_RATIO))
        table.add_row(motion, "moments", *_moments(motion, runs))
        table.add_row(motion, f"NEES, {DOF} dof", *_nees(motion, runs))
        table.add_section()
    return table


def _moments(motion: str, runs: list[Arrays]) -> tuple[str, str, str]:
    error, bound = (
        np.sqrt(np.square(stacked(runs, name)[:, :2]).mean()) for name in ("moments", "moments_bound")
    )
    told = f"{error:.5f}, bound {bound:.5f}, ratio {error / bound:.3f}"
    return (
        (told, f"<= {MOMENTS_RATIO:g}", _verdict(error / bound <= MOMENTS_RATIO))
        if motion == "rich"
        else (told, "", "")
    )


def _nees(motion: str, runs: list[Arrays]) -> tuple[str, str, str]:
    epochs = stacked(runs, "nees")[:, AFTER_FIRST].mean(axis=0)
    low, high = _band(DOF, len(runs))
    mean = float(epochs.mean())
    told = f"mean {mean:.2f}, middle frame {epochs[len(epochs) // 2]:.2f}, last {epochs[-1]:.2f}; band {low:.2f} .. {high:.2f}"
    if motion == "rich":
        return told, "in band", _verdict(low <= mean <= high)
    return told, f"<= {THESIS_NEES:g}", _verdict(mean <= THESIS_NEES)


def block_table(motions: Motions) -> Table:
    """NEES by block with standard errors.

    It is of the estimate, and of the linear one about the truth; by the scatter of the runs' means.
    """
    count = len(next(iter(motions.values())))
    columns = (
        "motion",
        "block",
        "dof",
        "NEES",
        "std. error",
        "linear, about truth",
        "std. error",
        "band of the mean over runs",
    )
    table = _table(f"NEES by block, all frames at once, {count} seeds", columns)
    for motion, runs in motions.items():
        for block in ("all", *FULL_BLOCKS):
            name, dof = ("nees", DOF) if block == "all" else (f"nees_{block}", BLOCKS[block].dimension)
            cells = []
            for each in (name, f"linear_{name}"):
                means = stacked(runs, each)[:, AFTER_FIRST].mean(axis=1)
                cells += [f"{means.mean():.2f}", f"{means.std() / np.sqrt(len(means)):.2f}"]
            low, high = _band(dof, len(runs))
            table.add_row(motion, block, str(dof), *cells, f"{low:.2f} .. {high:.2f}")
        table.add_section()
    return table


def thesis_table(runs: list[Arrays]) -> Table:
    """Table 6.4 beside ours on the thesis' motion.

    x, y, z about the major, intermediate and minor axis where it is a rotation.
    """
    columns = ("quantity", "unit", "thesis", "ours", "Cramer-Rao", "actual error, rms")
    table = _table(
        f"Tweddle (2013), Table 6.4: standard deviations after 115 frames, {len(runs)} seeds", columns
    )
    ours, bound = (np.sqrt(np.square(stacked(runs, name)).mean(axis=0)) for name in ("std", "std_bound"))
    actual = np.sqrt(stacked(runs, "square").mean(axis=0))
    for row, (name, unit, scale) in enumerate(QUANTITIES):
        cells = (THESIS[row], *(scale * each[row] for each in (ours, bound, actual)))
        table.add_row(name, unit, *("  ".join(f"{v:.3g}" for v in cell if np.isfinite(v)) for cell in cells))
    return table


def start_table(motions: Motions) -> Table:
    """Linearisations from the closed form to the end, of both schedules."""
    columns = ("motion", "schedule", "seeds", "median", "most", "at most 12", "converged", "finite", "")
    table = _table("From the closed form, all frames at once", columns)
    for motion, runs in motions.items():
        for schedule in ("plain", "drawn"):
            numbers = stacked(runs, f"linearisations_{schedule}")
            within = int((numbers <= LINEARISATIONS).sum())
            converged, finite = (int(stacked(runs, n).sum()) for n in (f"converged_{schedule}", "finite"))
            told = (f"{np.median(numbers):g}", str(numbers.max()), str(within), str(converged), str(finite))
            good = within == converged == finite == len(runs)
            table.add_row(motion, schedule, str(len(runs)), *told, _verdict(good))
    return table


def _band(dof: int, runs: int) -> tuple[float, float]:
    low, high = chi_square_band(dof, runs)
    return float(low), float(high)


def _verdict(good: bool) -> str:
    return "[green]pass[/green]" if good else "[red]FAIL[/red]"


def _table(title: str, columns: tuple[str, ...]) -> Table:
    return Table(*columns, title=title, title_justify="left", caption_justify="left")
