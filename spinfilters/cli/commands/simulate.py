"""The command ``simulate``: a simulated recording as a data set, or rendered stereo images of it."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from spinfilters.cli.command import Command
from spinfilters.cli.common_options import FigureOptions, draw, print_document
from spinfilters.core.errors import InputError
from spinfilters.io.stated_values import Argument, ArgumentGroup, NumberRange
from spinfilters.simulation.scenario_record import IMAGE_KIND, Scenario

if TYPE_CHECKING:
    from spinfilters.io.dataset import Dataset


@dataclass(frozen=True, kw_only=True)
class SimulateArguments:
    """Arguments of ``simulate``: a scenario, and where it goes."""

    output: Annotated[str, Argument("folder of the data set", short="-o", metavar="DATASET")]
    scenario: Annotated[Scenario, ArgumentGroup()] = field(default_factory=Scenario)
    known_map: Annotated[bool, Argument("write landmarks.csv, the map of the tracks")] = False
    shape: Annotated[
        str | None,
        Argument(
            "shape of the body in stereo-images: spheres (default), box, octahedron, or a mesh (.obj, binary .stl, .tab, .txt)"
        ),
    ] = None
    foil: Annotated[
        float | None,
        NumberRange(0, 1),
        Argument("share of the surface that is crinkled metal foil, in stereo-images (default 0)"),
    ] = None


def simulate(options: SimulateArguments) -> int:
    """Write a simulated data set and a picture of its true rates, or images."""
    from spinfilters.api.simulation import simulated_dataset
    from spinfilters.cli.console import progress_bars, wide_console
    from spinfilters.evaluation.estimated_motion import true_rates
    from spinfilters.io.dataset_folder import write_dataset
    from spinfilters.io.output_files import output_folder, refuse_foreign
    from spinfilters.plots.time_courses import rates_figure

    folder, scenario = Path(options.output), options.scenario
    refuse_foreign(folder, COMMAND.name)
    if scenario.kind == IMAGE_KIND:
        return _simulate_images(options, folder)
    if options.shape is not None or options.foil is not None:
        raise InputError(f"--shape and --foil are for --kind {IMAGE_KIND}; a {scenario.kind} has no images")
    with progress_bars() as report:
        dataset = simulated_dataset(
            scenario, options.known_map, lambda done, total: report("motion", done, total)
        )
    truth = dataset.truth
    assert truth is not None
    with output_folder(folder, COMMAND.name) as place:
        write_dataset(dataset, place)
        draw(lambda: rates_figure([true_rates(truth)]), place / "truth.png")
    wide_console().print(_sentence(dataset, folder, scenario.epochs), highlight=False, soft_wrap=True)
    print_document(
        {
            "dataset": str(folder),
            "description": dataset.description,
            "measurements": {stream.sensor: len(stream) for stream in dataset.log.streams},
            "epochs_in_view": _epochs_in_view(dataset),
            "epochs": scenario.epochs,
        }
    )
    return 0


def _sentence(dataset: "Dataset", folder: Path, frames: int) -> str:
    """Written files, and the number of epochs without observations, in words."""
    count, epochs = sum(map(len, dataset.log.streams)), _epochs_in_view(dataset)
    lost = "" if epochs == frames else f"; the body is in view in {epochs} of {frames} epochs"
    return f"{dataset.description}: {count} measurements in {folder}{lost}"


def _epochs_in_view(dataset: "Dataset") -> int:
    """Number of epochs in which the first sensor measures."""
    return len(set(dataset.log.streams[0].time.tolist()))


def _simulate_images(options: SimulateArguments, folder: Path) -> int:
    """Render the motion's stereo images."""
    from spinfilters.cli.console import progress_bars, wide_console
    from spinfilters.io.output_files import output_folder
    from spinfilters.simulation.image_sequence import IMAGE_RADIUS_M, ImageScenario, render

    scenario = options.scenario
    if options.known_map or any(scenario.gyro_bias) or scenario.inspector_errors or scenario.sensor_noise:
        raise InputError(
            f"--known-map, --gyro-bias, --noise of a sensor, --beside and --inspector-error are not for --kind {IMAGE_KIND}; "
            "leave them out"
        )
    images = ImageScenario(
        replace(scenario, radius_m=IMAGE_RADIUS_M),
        shape=options.shape or ImageScenario.shape,
        foil=options.foil or ImageScenario.foil,
    )
    with progress_bars() as report, output_folder(folder, COMMAND.name) as place:
        description = render(images, place, lambda done, total: report("images", done, total))
    wide_console().print(f"{description}: in {folder}", highlight=False, soft_wrap=True)
    print_document({"dataset": str(folder), "description": description, "epochs": scenario.epochs})
    return 0


COMMAND = Command("simulate", SimulateArguments, simulate, common=FigureOptions)
