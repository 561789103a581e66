"""Does the verdict notice wrong models? Every kind by size: verdicts, errors in stated deviations, which errors are named.

    python -m experiments.honesty [--sensors pose,gyro,tracks] [--seeds 10] [--clean 100] [-o runs/honesty]

Runs the campaigns ``experiments/studies/honesty-*.toml``, or goes on with their rows in the folder, and draws the map: rows are
wrong models, columns sizes, colours the largest error among runs called ``ok``, numbers how many of these there are of how many.
Printed are of each wrong model its runs with an effect (an error of the estimates beyond 5 stated deviations): how many of them
are ``ok``, in how many it is named first and among the first two; and how many right recordings are doubted. A run that is ``ok``
with an error beyond 4 deviations is a defect.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from spinfilters.api.campaigns import campaign_rows
from spinfilters.campaigns.rows_folder import read_rows
from spinfilters.campaigns.stated_errors import LARGEST
from spinfilters.campaigns.study import Study, read_study, study_from
from spinfilters.data.atomic_write import make_folder
from spinfilters.plots.style import save_figure

STUDIES: Final = Path(__file__).parent / "studies"
EFFECT: Final = 5.0
"""Stated deviations of an error from which a wrong model ought to be found."""
DRAWN: Final = (0.5, 32.0)
"""Limits of the colours, stated deviations; 4 is in the middle."""


@dataclass(frozen=True)
class SensorStudy:
    """Rows of one sensor: of recordings with wrong models, and of right ones."""

    sensor: str
    faulty: pd.DataFrame
    clean: pd.DataFrame

    @property
    def faults(self) -> list[str]:
        """In the order of the study."""
        return list(self.faulty["fault.model"].unique())

    @property
    def sizes(self) -> list[str]:
        """Multiples of a plain size, ascending."""
        return sorted(self.faulty["fault.model_size"].unique(), key=float)


def main() -> None:
    """Run what is missing, print, draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sensors", default="pose,gyro,tracks")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--clean", type=int, default=100)
    parser.add_argument("--workers", type=int, default=None)
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/honesty"))
    options = parser.parse_args()
    make_folder(options.output)
    studies = []
    for sensor in options.sensors.split(","):
        counts = {f"honesty-{sensor}": options.seeds, f"honesty-{sensor}-clean": options.clean}
        faulty, clean = (
            _rows(name, seeds, options.output, options.workers) for name, seeds in counts.items()
        )
        studies.append(SensorStudy(sensor, faulty, clean))
        for line in lines_of(studies[-1]):
            print(line, flush=True)
    save_figure(figure(studies), options.output / "honesty.png")
    print(f"map: {options.output / 'honesty.png'}")


def _rows(name: str, seeds: int, folder: Path, workers: int | None) -> pd.DataFrame:
    """Of a campaign with so many seeds; those that its folder has are not made again."""
    document = dict(read_study(STUDIES / f"{name}.toml").document)
    document["study"] = {**document["study"], "seeds": seeds}
    study: Study = study_from(document, name)
    campaign_rows(document, folder / name, workers=workers, resume=(folder / name).exists())
    rows = read_rows(folder / name, study.columns).to_pandas()
    rows = rows[rows["seed"] < seeds].copy()
    rows["named"] = rows["model_errors"].fillna("").str.split()
    rows["ok"] = rows["verdict"] == "ok"
    return rows


def lines_of(study: SensorStudy) -> Iterator[str]:
    """A line of false alarms for each way to state noise, a line for each wrong model, and one for all of these."""
    for stated, rows in study.clean.groupby("noise.stated"):
        done, told = rows[rows["outcome"] == "done"], "stated" if stated == "true" else "not stated"
        named = int((rows["named"].str.len() > 0).sum())
        wrong = int((rows["ok"] & ~(rows["worst_error"] <= LARGEST)).sum())
        yield (
            f"{study.sensor}: right models, noise {told}: {len(rows)} runs, {len(rows) - int(done['ok'].sum())} not ok, {named} "
            f"with a model error named, {wrong} ok and beyond {LARGEST:g} deviations"
        )
    for fault in study.faults:
        yield _line(fault, study.faulty[study.faulty["fault.model"] == fault])
    yield _line(f"all of {study.sensor}", study.faulty)


def _line(name: str, rows: pd.DataFrame) -> str:
    with_effect = rows[rows["worst_error"] > EFFECT]
    wrong = int((rows["ok"] & (rows["worst_error"] > LARGEST)).sum())
    first, two = (
        sum(
            own in named[:count]
            for own, named in zip(with_effect["fault.model"], with_effect["named"], strict=True)
        )
        for count in (1, 2)
    )
    nees = rows.loc[rows["ok"], "nees"].median()
    return (
        f"  {name:20s} {len(rows):4d} runs, {int(rows['ok'].sum()):4d} ok, {wrong:3d} ok and wrong, NEES of ok {nees:5.2f}; with effect "
        f"{len(with_effect):4d}: {first:4d} named first, {two:4d} among two, {int(with_effect['ok'].sum()):3d} ok; "
        f"{int((rows['outcome'] == 'refused').sum())} refused"
    )


def figure(studies: list[SensorStudy]) -> Figure:
    """The map, a panel for each sensor."""
    longest = max(len(study.faults) for study in studies)
    drawn = Figure(figsize=(1.0 + 4.4 * len(studies), 2.2 + 0.3 * longest), layout="constrained")
    panels = np.atleast_1d(drawn.subplots(1, len(studies)))
    for axes, study in zip(panels, studies, strict=True):
        image = _draw(axes, study)
    bar = drawn.colorbar(image, ax=list(panels), location="bottom", shrink=0.5, extend="both", aspect=40)
    bar.set_ticks([0.5, 1, 2, 4, 8, 16, 32], labels=["0.5", "1", "2", "4", "8", "16", "32"])
    bar.set_label("largest error of the runs called ok [stated standard deviations]; grey: none is ok")
    return drawn


def _draw(axes: Axes, study: SensorStudy):
    faults, sizes = study.faults, study.sizes
    worst, ok, every = (np.full((len(faults), len(sizes)), np.nan) for _ in range(3))
    for (fault, size), rows in study.faulty.groupby(["fault.model", "fault.model_size"]):
        at = faults.index(str(fault)), sizes.index(str(size))
        every[at], ok[at] = len(rows), rows["ok"].sum()
        worst[at] = rows.loc[rows["ok"], "worst_error"].max()
    axes.set_facecolor("0.88")
    image = axes.imshow(np.clip(worst, 1e-3, 1e6), norm=LogNorm(*DRAWN), cmap="RdYlGn_r", aspect="auto")
    for (row, column), count in np.ndenumerate(ok):
        axes.text(column, row, f"{count:.0f}/{every[row, column]:.0f}", ha="center", va="center", fontsize=7)
    axes.set_xticks(range(len(sizes)), [f"{float(size):g}" for size in sizes])
    axes.set_yticks(range(len(faults)), [_label(study, fault) for fault in faults], fontsize=8)
    alarms, runs = int((~study.clean["ok"]).sum()), len(study.clean)
    axes.set_title(f"{study.sensor}: {alarms} of {runs} right recordings doubted", fontsize=9)
    axes.set_xlabel("size, in multiples of a plain one")
    return image


def _label(study: SensorStudy, fault: str) -> str:
    """Name, and in how many of its runs with an effect it is among the two that are named."""
    rows = study.faulty[(study.faulty["fault.model"] == fault) & (study.faulty["worst_error"] > EFFECT)]
    if not len(rows):
        return f"{fault} (-)"
    return f"{fault} ({np.mean([fault in named[:2] for named in rows['named']]):.0%})"


if __name__ == "__main__":
    main()
