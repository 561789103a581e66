"""Recordings in which landmarks are lost, few or many, and a picture of what became of filters without a map."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from spinfilters.data.dataset import Dataset
from spinfilters.data.measurement_log import MeasurementLog
from spinfilters.plots.style import BLUE, GREEN, GREY, RED
from spinfilters.sensors.feature_tracks import EveryAppearance
from spinfilters.simulation.faults import Dropout, Fault
from spinfilters.simulation.scenario import Scenario

BEGIN: Final = 40.2
"""s; the initialisation has ended by then."""
REVOLUTION: Final = 6.0
"""s, of the motions in question."""
FAR_OFF: Final = 4.0
"""Stated standard deviations beyond which a run that is ``ok`` is not."""


@dataclass(frozen=True)
class NewNumbers(Fault):
    """From a time on, until another (s), each landmark bears an id that it did not bear before."""

    begin: float
    end: float = np.inf

    def apply(self, dataset: Dataset, generator: np.random.Generator) -> Dataset:
        stream = dataset.log.stream("stereo")
        assert stream.ids is not None
        ids = stream.ids + np.where(
            (stream.time >= self.begin) & (stream.time < self.end), stream.ids.max() + 1, 0
        )
        return replace(dataset, log=MeasurementLog((replace(stream, ids=ids),)))


@dataclass(frozen=True)
class FewAtFirst(Fault):
    """Until a time (s) no other landmarks are seen than ``share`` of them."""

    share: float
    end: float

    def apply(self, dataset: Dataset, generator: np.random.Generator) -> Dataset:
        stream = dataset.log.stream("stereo")
        assert stream.ids is not None
        ids = np.unique(stream.ids)
        seen = generator.choice(ids, round(self.share * len(ids)), replace=False)
        keep = (stream.time >= self.end) | np.isin(stream.ids, seen)
        covariance = None if stream.covariance is None else stream.covariance[keep]
        left = replace(
            stream,
            time=stream.time[keep],
            values=stream.values[keep],
            ids=stream.ids[keep],
            covariance=covariance,
        )
        return replace(dataset, log=MeasurementLog((left,)))


@dataclass(frozen=True)
class HardCase:
    """What it says, the faults of the filters' recording, and how the scenario differs from the usual one."""

    description: str
    faults: tuple[Fault, ...] = ()
    scenario: Callable[[Scenario], Scenario] = lambda usual: usual


CASES: Final = {
    "usual": HardCase("nothing is wrong"),
    "dropout": HardCase("nothing is measured for 5 s", (Dropout(BEGIN, BEGIN + 5.0),)),
    "revolution": HardCase("nothing is measured for a revolution", (Dropout(BEGIN, BEGIN + REVOLUTION),)),
    "renumbered": HardCase("no landmark is known again after 40 s", (NewNumbers(BEGIN),)),
    "lost": HardCase(
        "nothing is measured for a revolution, and no landmark is known again",
        (Dropout(BEGIN, BEGIN + REVOLUTION), NewNumbers(BEGIN)),
    ),
    "returned": HardCase("all landmarks are new for a revolution", (NewNumbers(BEGIN, BEGIN + REVOLUTION),)),
    "twenty": HardCase("20 landmarks an epoch", (), lambda usual: replace(usual, landmarks=400)),
    "growing": HardCase("20 landmarks an epoch in the initialisation, then all", (FewAtFirst(0.1, 30.0),)),
    "many": HardCase("5,000 landmarks", (), lambda usual: replace(usual, landmarks=8700)),
    "crowd": HardCase(
        "5,000 landmarks an epoch",
        (),
        lambda usual: replace(usual, landmarks=25_500, recognition=EveryAppearance(), epochs=70),
    ),
}
"""By name."""


def case_figure(runs: Sequence[dict[str, np.ndarray]], names: Sequence[str], title: str) -> Figure:
    """Position errors of every run and what is stated of them, and errors of the whole state in standard deviations."""
    figure = Figure(figsize=(11.0, 6.5), layout="constrained")
    panels = figure.subplots(2, len(names), sharex=True, sharey="row", squeeze=False)
    for name, (errors, deviations) in zip(names, panels.T, strict=True):
        for run in runs:
            time = run[f"{name}/time"]
            errors.semilogy(time, 1e3 * run[f"{name}/position_error"], color=BLUE, linewidth=0.8)
            errors.semilogy(time, 1e3 * run[f"{name}/position_std"], color=GREY, linewidth=0.8)
            deviations.semilogy(time, run[f"{name}/deviations"], color=RED, linewidth=0.8)
        deviations.axhline(FAR_OFF, color=GREEN, linewidth=1.0)
        errors.set_title(f"{name}, {len(runs)} runs: error (blue), standard deviation (grey)")
        deviations.set_xlabel("time [s]")
    panels[0, 0].set_ylabel("position [mm]")
    panels[1, 0].set_ylabel("largest error of a block [standard deviations]")
    figure.suptitle(title)
    return figure
