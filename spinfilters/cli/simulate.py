"""``spinfilters simulate``."""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console

from spinfilters.errors import InputError
from spinfilters.evaluation.rates import true_rates
from spinfilters.logs.dataset import DATASET_FILE
from spinfilters.logs.dataset_writing import write_dataset
from spinfilters.plots.rates import rates_figure
from spinfilters.plots.style import save_figure
from spinfilters.simulation.scenario import Scenario, without_map
from spinfilters.simulation.scenario import simulate as simulate_scenario

MOST_TURNS = 100


def simulate(options: argparse.Namespace) -> int:
    """Write a simulated data set and a picture of its true rates."""
    if options.seed < 0:
        raise InputError(f"--seed {options.seed} is negative; give a whole number of at least 0")
    _refuse_blur(options)
    folder, scenario = Path(options.output), _scenario(options)
    _refuse_foreign(folder)
    dataset = simulate_scenario(scenario)
    write_dataset(dataset if options.known_map else without_map(dataset), folder)
    assert dataset.truth is not None
    save_figure(rates_figure([true_rates(dataset.truth)]), folder / "truth.png")
    (stream,) = dataset.log.streams
    count, epochs = len(stream), len(np.unique(stream.time))
    lost = (
        "" if epochs == scenario.frames else f"; the body is in view in {epochs} of {scenario.frames} epochs"
    )
    Console().print(
        f"{dataset.description}: {count} measurements in {folder}{lost}", highlight=False, soft_wrap=True
    )
    return 0


def _scenario(options: argparse.Namespace) -> Scenario:
    """The bundled example, with what the command line changes; only a camera can lose the body from view."""
    tracks = options.kind == "stereo-tracks"
    if options.known_map and not tracks:
        raise InputError(f"--known-map needs --kind stereo-tracks; a {options.kind} has no map")
    thesis = Scenario.disam115(tuple(options.rate_rpm), options.seed)
    return replace(
        thesis,
        kind=options.kind,
        frames=options.frames,
        interval=options.interval,
        principal_moments=tuple(options.moments),
        candidates=thesis.candidates if tracks else 1,
    )


def _refuse_blur(options: argparse.Namespace) -> None:
    """Between two frames a body may turn often, but not so often that rounding decides where it points."""
    turns = max(map(abs, options.rate_rpm)) * abs(options.interval) / 60
    if turns > MOST_TURNS:
        raise InputError(
            f"--rate-rpm {' '.join(map(str, options.rate_rpm))} at --interval {options.interval} s is {turns:.3g} turns "
            f"from frame to frame; give less than {MOST_TURNS}"
        )


def _refuse_foreign(folder: Path) -> None:
    if folder.is_dir() and any(folder.iterdir()) and not (folder / DATASET_FILE).is_file():
        raise InputError(f"{folder}: is not empty and no data set; choose another folder with -o")
