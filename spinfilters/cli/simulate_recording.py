"""``spinfilters simulate``."""

import argparse
from pathlib import Path

import numpy as np

from spinfilters.api.recordings import simulate as simulated
from spinfilters.cli.console import progress_bars, wide_console
from spinfilters.core.errors import InputError
from spinfilters.evaluation.estimated_motion import true_rates
from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.io.input_file import value_text
from spinfilters.io.output_files import output_folder, refuse_foreign
from spinfilters.io.sensor_format import dataset_kinds
from spinfilters.plots.style import save_figure
from spinfilters.plots.time_courses import rates_figure

COMMAND = "simulate"
IMAGE_KIND = "stereo-images"


def simulate(options: argparse.Namespace) -> int:
    """Write a simulated data set and a picture of its true rates."""
    folder = Path(options.output)
    refuse_foreign(folder, COMMAND)
    if options.kind == IMAGE_KIND:
        return _simulate_images(options, folder)
    kinds = [*dataset_kinds(), IMAGE_KIND]
    if options.kind not in kinds:
        raise InputError(f"--kind {value_text(options.kind)} is unknown; use one of {', '.join(kinds)}")
    if options.shape is not None or options.foil is not None:
        raise InputError(f"--shape and --foil are for --kind {IMAGE_KIND}; a {options.kind} has no images")
    with progress_bars() as report:
        dataset = simulated(
            options.kind,
            seed=options.seed,
            frames=options.frames,
            interval=options.interval,
            rate_rpm=options.rate_rpm,
            moments=options.moments,
            known_map=options.known_map,
            gyro_bias=options.gyro_bias,
            inspector=options.inspector,
            inspector_errors=_inspector_errors(options),
            beside=_beside(options),
            progress=lambda done, total: report("motion", done, total),
        )
    assert dataset.truth is not None
    with output_folder(folder, COMMAND) as place:
        write_dataset(dataset, place)
        save_figure(rates_figure([true_rates(dataset.truth)]), place / "truth.png")
    wide_console().print(_described(dataset, folder, options.frames), highlight=False, soft_wrap=True)
    return 0


def _described(dataset: Dataset, folder: Path, frames: int) -> str:
    """Written files, and the number of epochs without observations, in words."""
    stream = dataset.log.streams[0]
    count, epochs = sum(map(len, dataset.log.streams)), len(np.unique(stream.time))
    lost = "" if epochs == frames else f"; the body is in view in {epochs} of {frames} epochs"
    return f"{dataset.description}: {count} measurements in {folder}{lost}"


def _beside(options: argparse.Namespace) -> dict[str, float]:
    """Interval by kind. InputError: no number, a kind twice."""
    beside: dict[str, float] = {}
    for kind, text in options.beside or ():
        try:
            step = float(text)
        except ValueError:
            raise InputError(
                f"--beside {kind} {value_text(text)}: give its interval in s, such as 0.01"
            ) from None
        if kind in beside:
            raise InputError(f"--beside {kind} is given twice; give it once")
        beside[kind] = step
    return beside


def _inspector_errors(options: argparse.Namespace) -> dict[str, float]:
    """Size by name, 0 of an error without one. InputError: no number, too many, a name twice."""
    errors: dict[str, float] = {}
    for name, *size in options.inspector_error or ():
        if name in errors:
            raise InputError(f"--inspector-error {name} is given twice; give it once")
        try:
            errors[name] = float(size[0]) if size else 0.0
        except ValueError:
            raise InputError(
                f"--inspector-error {name} {value_text(size[0])}: give its size as a number, such as 0.1"
            ) from None
        if len(size) > 1:
            raise InputError(f"--inspector-error {name} {' '.join(size)}: give one size; repeat the option")
    return errors


def _simulate_images(options: argparse.Namespace, folder: Path) -> int:
    """Render the motion's stereo images."""
    from spinfilters.api.image_recordings import ImageScenario, render

    if options.known_map or options.gyro_bias is not None or options.beside or options.inspector_error:
        raise InputError(
            f"--known-map, --gyro-bias, --beside and --inspector-error are not for --kind {IMAGE_KIND}; leave them out"
        )
    scenario = ImageScenario(
        shape=options.shape or ImageScenario.shape,
        rate_rpm=tuple(options.rate_rpm),
        moments=tuple(options.moments),
        frames=options.frames,
        interval=options.interval,
        seed=options.seed,
        foil=options.foil or 0.0,
        inspector=options.inspector,
    )
    with progress_bars() as report, output_folder(folder, COMMAND) as place:
        description = render(scenario, place, lambda done, total: report("images", done, total))
    wide_console().print(f"{description}: in {folder}", highlight=False, soft_wrap=True)
    return 0
