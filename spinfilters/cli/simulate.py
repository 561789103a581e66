"""``spinfilters simulate``."""

import argparse
from pathlib import Path

from rich.console import Console

from spinfilters.errors import InputError
from spinfilters.evaluation.rates import true_rates
from spinfilters.logs.dataset_writing import write_dataset
from spinfilters.plots.rates import rates_figure
from spinfilters.plots.style import save_figure
from spinfilters.simulation.scenario import Scenario
from spinfilters.simulation.scenario import simulate as simulate_scenario


def simulate(options: argparse.Namespace) -> int:
    """Write a simulated data set and a picture of its true rates."""
    if options.seed < 0:
        raise InputError(f"--seed {options.seed} is negative; give a whole number of at least 0")
    scenario = Scenario(
        kind=options.kind,
        seed=options.seed,
        frames=options.frames,
        interval=options.interval,
        rate_rpm=tuple(options.rate_rpm),
        principal_moments=tuple(options.moments),
    )
    dataset, folder = simulate_scenario(scenario), Path(options.output)
    write_dataset(dataset, folder)
    assert dataset.truth is not None
    save_figure(rates_figure([true_rates(dataset.truth)]), folder / "truth.png")
    count = len(dataset.log.streams[0])
    Console().print(f"{dataset.description}: {count} measurements in {folder}", highlight=False, soft_wrap=True)
    return 0
