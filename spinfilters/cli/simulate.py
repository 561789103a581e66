"""``spinfilters simulate``."""

import argparse
from pathlib import Path

from spinfilters.cli.console import wide_console
from spinfilters.errors import InputError
from spinfilters.evaluation.rates import true_rates
from spinfilters.logs.dataset_writing import write_dataset
from spinfilters.logs.output_folder import output_folder, refuse_foreign
from spinfilters.plots.rates import rates_figure
from spinfilters.plots.style import save_figure
from spinfilters.simulation.scenario import Scenario
from spinfilters.simulation.scenario import simulate as simulate_scenario

COMMAND = "simulate"
MOST_TURNS = 100


def simulate(options: argparse.Namespace) -> int:
    """Write a simulated data set and a picture of its true rates."""
    _refuse_blur(options)
    scenario = Scenario(
        kind=options.kind,
        seed=options.seed,
        frames=options.frames,
        interval=options.interval,
        rate_rpm=tuple(options.rate_rpm),
        principal_moments=tuple(options.moments),
    )
    folder = Path(options.output)
    refuse_foreign(folder, COMMAND)
    dataset = simulate_scenario(scenario)
    assert dataset.truth is not None
    with output_folder(folder, COMMAND) as place:
        write_dataset(dataset, place)
        save_figure(rates_figure([true_rates(dataset.truth)]), place / "truth.png")
    count = len(dataset.log.streams[0])
    wide_console().print(
        f"{dataset.description}: {count} measurements in {folder}", highlight=False, soft_wrap=True
    )
    return 0


def _refuse_blur(options: argparse.Namespace) -> None:
    """Between two frames a body may turn often, but not so often that rounding decides where it points."""
    turns = max(map(abs, options.rate_rpm)) * abs(options.interval) / 60
    if turns > MOST_TURNS:
        raise InputError(
            f"--rate-rpm {' '.join(map(str, options.rate_rpm))} at --interval {options.interval} s is {turns:.3g} turns "
            f"from frame to frame; give less than {MOST_TURNS}"
        )
