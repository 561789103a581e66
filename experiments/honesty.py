"""Verdicts on recordings of wrong models, by kind and size.

Verdicts, errors in stated deviations, which errors are named.
    python -m experiments.honesty [--sensors pose,gyro,tracks] [--seeds 10] [--clean 100] [--root-seed 0] [--report]
        [-o runs/honesty]

Runs the campaigns ``experiments/studies/honesty-*.toml``, or goes on with their rows in the folder (``--report``: takes these as
they are), and draws the map: rows are wrong models, columns sizes, colours the largest error among runs called ``ok``, numbers how
many of these there are of how many. Printed are of each wrong model its runs with an effect (an error of the estimates beyond 5
stated deviations): how many of them are ``ok``, in how many it is named first and among the first two; and how many right
recordings are doubted. A run that is ``ok`` with an error beyond 4 deviations is a defect.

Of some of these nothing could tell, and they are counted apart: made once more with the true noise stated, the score test of the
very error that is in the data is within chance at the level of a verdict that asks for all errors. Units of lengths and of a clock
leave no residual, for free motion has no scale of its own. The answers are kept in ``NAME-told.json`` of the folder.
"""

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from experiments.command_line import run_study
from spinfilters.api.arguments import CampaignArguments
from spinfilters.api.campaign_frames import campaign_rows
from spinfilters.campaigns.rows_folder import read_rows
from spinfilters.campaigns.runner import Runner
from spinfilters.campaigns.study import read_study, study_from
from spinfilters.core.errors import SpinfiltersError
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR
from spinfilters.io.output_files import make_folder, write_text
from spinfilters.plots.style import save_figure
from spinfilters.verdict.model_errors.alternatives import table

STUDIES: Final = Path(__file__).parent / "studies"
EFFECT: Final = 5.0
"""Stated deviations of an error from which a wrong model ought to be found."""
WITHOUT_RESIDUAL: Final = ("clock-unit", "length-unit")
"""Wrong models of which no residual can tell."""
NAMED_AS: Final = {"gyro-unit": "gyro-scale"}
"""Wrong models that are another one by their size: a rate in another unit has another scale, and the cure says so."""
NORM: Final = LogNorm(0.5, 32.0)
"""Stated deviations by colour; 4 is in the middle."""
COLOURS: Final = ScalarMappable(NORM, "RdYlGn_r")
TICKS: Final = (0.5, 1, 2, 4, 8, 16, 32)


@dataclass(frozen=True)
class FaultOutcome:
    """Of one run.

    Attributes
    ----------
    fault, size: what is wrong, in multiples of a plain size.   error: the largest, in stated deviations; NaN without estimates.
    named: model errors in the verdict, the likeliest first, those that look alike together.
    stated: whether estimators were told the noise.   told: whether a test could tell it at all (see the module).
    """

    fault: str
    size: float
    is_ok: bool
    is_refused: bool
    error: float
    named: tuple[tuple[str, ...], ...]
    stated: bool
    told: bool = True

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> "FaultOutcome":
        """A row of a campaign."""
        error = row["worst_error"]
        return cls(
            str(row.get("fault.model", "")),
            float(row.get("fault.model_size", "0")),
            row["verdict"] == "ok",
            row["outcome"] == "refused",
            np.nan if error is None else float(error),
            tuple(tuple(own.split("/")) for own in (row["model_errors"] or "").split()),
            row.get("noise.stated") == "true",
        )

    @property
    def is_dishonest(self) -> bool:
        """Whether it is called ``ok`` and is not."""
        return self.is_ok and self.error > LARGEST_STATED_ERROR

    @property
    def has_effect(self) -> bool:
        """Whether the estimates are wrong."""
        return self.error > EFFECT

    @property
    def is_silent_or_unnamed(self) -> bool:
        """Whether it is a defect, unless nothing could tell."""
        return self.is_dishonest or (self.has_effect and not self.is_named)

    @property
    def is_named(self) -> bool:
        """Whether what is wrong is among the first two."""
        return self.is_among(2)

    def is_among(self, count: int) -> bool:
        """Whether what is wrong is among so many that are named first."""
        names = {self.fault, NAMED_AS.get(self.fault, self.fault)}
        return any(names.intersection(own) for own in self.named[:count])


@dataclass(frozen=True)
class SensorStudy:
    """Runs of one sensor: with wrong models, and with right ones."""

    sensor: str
    faulty: Sequence[FaultOutcome]
    clean: Sequence[FaultOutcome]

    @property
    def faults(self) -> list[str]:
        """In the order of the study."""
        return list(dict.fromkeys(each.fault for each in self.faulty))

    @property
    def sizes(self) -> list[float]:
        """Ascending."""
        return sorted({each.size for each in self.faulty})


def main() -> None:
    """Run what is missing, print, draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sensors", default="pose,gyro,tracks")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--clean", type=int, default=100)
    parser.add_argument("--root-seed", type=int, default=0, help="of all randomness, a folder each")
    parser.add_argument("--workers", type=int, default=None)
    parser.add_argument("--report", action="store_true", help="of the rows that are there")
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/honesty"))
    options = parser.parse_args()
    make_folder(options.output)
    studies = []
    for sensor in options.sensors.split(","):
        counts = {f"honesty-{sensor}": options.seeds, f"honesty-{sensor}-clean": options.clean}
        faulty, clean = (_runs(name, seeds, options) for name, seeds in counts.items())
        studies.append(SensorStudy(sensor, faulty, clean))
        for line in lines_of(studies[-1]):
            print(line, flush=True)
    save_figure(figure(studies), options.output / "honesty.png")
    print(f"map: {options.output / 'honesty.png'}")


def _runs(name: str, seeds: int, options: argparse.Namespace) -> list[FaultOutcome]:
    """Of a campaign with so many seeds; those that its folder has are not made again."""
    document = dict(read_study(STUDIES / f"{name}.toml").document)
    document["study"] = {**document["study"], "seeds": seeds, "root_seed": options.root_seed}
    folder = options.output / name
    if not options.report:
        campaign_rows(document, folder, CampaignArguments(workers=options.workers, resume=folder.exists()))
    rows = read_rows(folder, study_from(document, name).columns).to_pylist()
    rows = [row for row in rows if row["seed"] < seeds]
    return _with_told(document, rows, options.output / f"{name}-told.json")


def _with_told(
    document: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], path: Path
) -> list[FaultOutcome]:
    """Outcomes of rows, with whether a test could tell.

    What is wrong, of those in which that is asked.
    """
    known: dict[str, bool] = json.loads(path.read_text()) if path.exists() else {}
    outcomes = [FaultOutcome.of(row) for row in rows]
    asked = [k for k, each in enumerate(outcomes) if each.fault and each.is_silent_or_unnamed]
    if asked:
        stated = {**document, "noise": {"base": {**document["noise"]["base"], "stated": True}}}
        runner = Runner(study_from(stated, "told"))
        for k in asked:
            run = rows[k]["run"]
            if str(run) not in known:
                known[str(run)] = is_told(runner, run, outcomes[k].fault)
            outcomes[k] = replace(outcomes[k], told=known[str(run)])
        write_text(path, json.dumps(known, indent=1) + "\n")
    return outcomes


def is_told(runner: Runner, index: int, fault: str) -> bool:
    """Whether the test of the very error is beyond chance.

    In a run that states the true noise; True where there is none.
    """
    if fault in WITHOUT_RESIDUAL:
        return False
    if fault not in table():
        return True
    try:
        models = runner.compared(runner.study.run(index), with_bound=False).models
    except SpinfiltersError:
        return True
    return bool(models.trouble) or any(each.error.name == fault for each in models.beyond_chance)


def lines_of(study: SensorStudy) -> Iterator[str]:
    """Lines of false alarms, of each wrong model, and of all.

    A line of false alarms for each way to state noise.
    """
    for stated in (False, True):
        runs = [each for each in study.clean if each.stated is stated]
        if runs:
            yield (
                f"{study.sensor}: right models, noise {'stated' if stated else 'not stated'}: {len(runs)} runs, "
                f"{sum(not each.is_ok for each in runs)} not ok, {sum(bool(each.named) for each in runs)} with a model error "
                f"named, {sum(each.is_dishonest for each in runs)} ok and beyond {LARGEST_STATED_ERROR:g} deviations"
            )
    for fault in study.faults:
        yield _line(fault, [each for each in study.faulty if each.fault == fault])
    yield _line(f"all of {study.sensor}", study.faulty)


def _line(name: str, runs: Sequence[FaultOutcome]) -> str:
    wrong = [each for each in runs if each.has_effect and each.told]
    first, two = (sum(each.is_among(count) for each in wrong) for count in (1, 2))
    silent = [each for each in runs if each.is_dishonest]
    untold = [each for each in runs if not each.told]
    return (
        f"  {name:20s} {len(runs):4d} runs, {sum(each.is_ok for each in runs):4d} ok, "
        f"{sum(each.told for each in silent):3d} ok and wrong; with effect {len(wrong):4d}: {first:4d} named first, "
        f"{two:4d} among two, {sum(each.is_ok for each in wrong):3d} ok; beside {len(untold):3d} of which nothing could tell; "
        f"{sum(each.is_refused for each in runs)} refused"
    )


def figure(studies: Sequence[SensorStudy]) -> Figure:
    """The map, a panel for each sensor."""
    longest = max(len(study.faults) for study in studies)
    drawn = Figure(figsize=(1.0 + 4.4 * len(studies), 2.2 + 0.3 * longest), layout="constrained")
    panels = list(np.atleast_1d(np.array(drawn.subplots(1, len(studies)))))
    for axes, study in zip(panels, studies, strict=True):
        _draw(axes, study)
    bar = drawn.colorbar(COLOURS, ax=panels, location="bottom", shrink=0.5, extend="both", aspect=40)
    bar.set_ticks(list(TICKS), labels=[f"{each:g}" for each in TICKS])
    bar.set_label(
        "largest error of the runs called ok\n[stated standard deviations]\ngrey: none is ok, *: nothing could tell"
    )
    return drawn


def _draw(axes: Axes, study: SensorStudy) -> None:
    faults, sizes = study.faults, study.sizes
    worst = np.full((len(faults), len(sizes)), np.nan)
    for row, fault in enumerate(faults):
        for column, size in enumerate(sizes):
            runs = [each for each in study.faulty if (each.fault, each.size) == (fault, size)]
            ok = [each.error for each in runs if each.is_ok]
            worst[row, column] = np.clip(max(ok, default=np.nan), 1e-3, 1e6)
            untold = "*" * any(each.is_dishonest and not each.told for each in runs)
            axes.text(column, row, f"{len(ok)}/{len(runs)}{untold}", ha="center", va="center", fontsize=7)
    axes.set_facecolor("0.88")
    axes.imshow(worst, norm=NORM, cmap=COLOURS.cmap, aspect="auto")
    axes.set_xticks(range(len(sizes)), [f"{size:g}" for size in sizes])
    axes.set_yticks(range(len(faults)), [_label(study, fault) for fault in faults], fontsize=8)
    alarms = sum(not each.is_ok for each in study.clean)
    axes.set_title(f"{study.sensor}: {alarms} of {len(study.clean)} right recordings doubted", fontsize=9)
    axes.set_xlabel("size, in multiples of a plain one")


def _label(study: SensorStudy, fault: str) -> str:
    """Name and number of runs that name it.

    In how many of its runs with an effect it is among the two that are named.
    """
    wrong = [each for each in study.faulty if each.fault == fault and each.has_effect and each.told]
    if not wrong:
        return f"{fault} (-)"
    return f"{fault} ({np.mean([each.is_named for each in wrong]):.0%})"


if __name__ == "__main__":
    run_study(main)
