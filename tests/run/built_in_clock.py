"""A program that runs all estimators on kinds of data, and prints of each what was built while a clock ran."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from types import ModuleType
from typing import Any

import casadi as ca

from spinfilters.core import c_library
from spinfilters.core.compiled import Compiled
from spinfilters.evaluation.recording_bound import without_bounds
from spinfilters.filters import timeline as run
from spinfilters.inference import smoother_run
from spinfilters.io.dataset import Dataset
from spinfilters.run.estimation import ComparisonExtent, compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import FILTER, Settings, estimator_names
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.smoother import mass_posterior, posterior

FEW = 16
"""Samples of a mass distribution: those after the first build nothing more."""
running: set[str] = set()
"""Modules whose clock has been looked at once, and not yet again."""
looks, built = [0], list[str]()


def watch_clock(module: ModuleType) -> None:
    """Two looks at a module's clock are the begin and the end of a time."""
    clock: Callable[[], float] = module.working_seconds

    def look() -> float:
        looks[0] += 1
        running.symmetric_difference_update({module.__name__})
        return clock()

    setattr(module, "working_seconds", look)  # noqa: B010


def watch_building() -> None:
    """Of expressions, and of libraries."""
    construct, building = Compiled.__init__, c_library.building

    def constructed(self: Compiled, function: ca.Function, *loading: Any, **named: Any) -> None:
        noted(function.name())
        construct(self, function, *loading, **named)

    @contextmanager
    def watched() -> Iterator[None]:
        noted("a library")
        with building():
            yield

    Compiled.__init__ = constructed
    c_library.building = watched


def noted(name: str) -> None:
    """Remember what is built at the wrong time."""
    if running:
        built.append(name)


def dataset(kind: str) -> Dataset:
    """Thirty epochs; "map" and "tracks" are stereo tracks with a map and without."""
    stereo = kind in {"map", "tracks"}
    scenario = Scenario.simplified(
        kind="stereo-tracks" if stereo else kind, rate_rpm=RICH_RPM, epochs=30, landmarks=60
    )
    found = simulate(scenario)
    return replace(found, known_map=None) if kind == "tracks" else found


def main(kind: str) -> None:
    """Run, then print."""
    left_out = {"smoother-latest"}  # of tracks without a map alone
    # A window's rate moves as it is solved again, and with it how many steps an interval is integrated in: a function for another
    # number of steps is built then, while the working time stands still.
    left_out |= {name for name in estimator_names() if name.startswith("smoother-lag-")}
    if c_library.compiler() is None:
        left_out |= {name for name in estimator_names() if name.startswith("embedded")}  # they are C
    every = [name for name in estimator_names() if name not in left_out]
    names = every if kind != "tracks" else ("mekf", "ukf", "smoother")
    mass_posterior.SAMPLES, mass_posterior.TRIED, mass_posterior.MOST_NODES = FEW, FEW, 2
    options = posterior.SamplingOptions(FEW, walkers=FEW, steps=2, settling=1)
    posterior.sample_posterior = partial(posterior.sample_posterior, options=options)
    settings = Settings(estimators=tuple(names), verdict=FILTER)
    setup = prepare(dataset(kind), settings)
    watch_clock(run)
    watch_clock(smoother_run)
    watch_building()
    compare_estimators(setup, settings, lambda *_: None, extent=ComparisonExtent(bounding=without_bounds))
    print(f"{looks[0]} looks at clocks; built while they ran: {', '.join(built) or 'nothing'}")


for each in sys.argv[1:]:
    # in a process of its own, in which nothing has been built
    child = os.fork()
    if child == 0:
        main(each)
        sys.stdout.flush()
        os._exit(0)
    if os.waitpid(child, 0)[1] != 0:
        sys.exit(f"{each} failed")
