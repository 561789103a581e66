"""``spinfilters simulate``."""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from spinfilters.cli.console import wide_console
from spinfilters.errors import InputError
from spinfilters.evaluation.rates import true_rates
from spinfilters.logs.dataset_writing import write_dataset
from spinfilters.logs.output_folder import output_folder, refuse_foreign
from spinfilters.logs.sensor_format import dataset_kinds
from spinfilters.plots.rates import rates_figure
from spinfilters.plots.style import save_figure
from spinfilters.simulation.scenario import Scenario, without_map
from spinfilters.simulation.scenario import simulate as simulate_scenario

COMMAND = "simulate"
MOST_TURNS = 100


def simulate(options: argparse.Namespace) -> int:
    """Write a simulated data set and a picture of its true rates."""
    _refuse_blur(options)
    folder, scenario = Path(options.output), _scenario(options)
    refuse_foreign(folder, COMMAND)
    dataset = simulate_scenario(scenario)
    assert dataset.truth is not None
    with output_folder(folder, COMMAND) as place:
        write_dataset(dataset if options.known_map else without_map(dataset), place)
        save_figure(rates_figure([true_rates(dataset.truth)]), place / "truth.png")
    (stream,) = dataset.log.streams
    count, epochs = len(stream), len(np.unique(stream.time))
    lost = (
        "" if epochs == scenario.frames else f"; the body is in view in {epochs} of {scenario.frames} epochs"
    )
    wide_console().print(
        f"{dataset.description}: {count} measurements in {folder}{lost}", highlight=False, soft_wrap=True
    )
    return 0


def _scenario(options: argparse.Namespace) -> Scenario:
    """The bundled example, with what the command line changes; only a camera can lose the body from view."""
    seeing = [kind for kind, form in dataset_kinds().items() if form.has_landmarks]
    tracks = options.kind in seeing
    if options.known_map and not tracks:
        raise InputError(f"--known-map needs --kind {' or '.join(seeing)}; a {options.kind} has no map")
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
