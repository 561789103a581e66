"""The command ``calibration``: do truths lie in stated posteriors as often as they should?"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from spinfilters.cli.command import Command
from spinfilters.io.stated_values import Argument, NumberRange


@dataclass(frozen=True, kw_only=True)
class CalibrationArguments:
    """Arguments of ``calibration``."""

    sensor: Annotated[str, Argument("gyro, pose or stereo-tracks", positional=True, metavar="SENSOR")]
    output: Annotated[
        str,
        Argument(
            "folder of draws, numbers and pictures; goes on with what is there", short="-o", metavar="FOLDER"
        ),
    ] = "runs/calibration"
    draws: Annotated[int, NumberRange(1, 100_000, whole=True), Argument("recordings in all")] = 500
    estimators: Annotated[str, Argument("estimators, separated by commas", metavar="NAMES")] = "mekf,smoother"
    state_noise: Annotated[
        bool, Argument("state the true noise in each recording; else it is identified from it")
    ] = False


def calibrate_by_simulation(options: CalibrationArguments) -> int:
    """Make the draws that the folder lacks, then write its report."""
    from spinfilters.campaigns.calibration_draws import add_draws, drawn_scenario, read_draws
    from spinfilters.campaigns.calibration_report import (
        PAGE_FILE,
        CalibrationStudy,
        claim_folder,
        write_report,
    )
    from spinfilters.cli.console import wide_console
    from spinfilters.io.output_files import make_folder
    from spinfilters.settings.run_settings import names_in

    console, folder = wide_console(), Path(options.output)
    drawn_scenario(options.sensor, 0)  # refuses a sensor without a prior before anything is written
    names = tuple(names_in(options.estimators))
    study = CalibrationStudy(options.sensor, names, "stated" if options.state_noise else "identified")
    make_folder(folder)
    claim_folder(folder, study)
    try:
        for made in add_draws(folder, options.sensor, options.draws, names, options.state_noise):
            console.print(f"{made} of {options.draws} draws", end="\r", highlight=False)
    except KeyboardInterrupt:
        console.print("stopped; the same command goes on from here", highlight=False)
    for picture in write_report(folder, study, read_draws(folder)):
        console.print(f"look at {picture}", highlight=False, soft_wrap=True)
    console.print(f"written to {folder / PAGE_FILE}", highlight=False, soft_wrap=True)
    return 0


COMMAND = Command(
    "calibration",
    CalibrationArguments,
    calibrate_by_simulation,
    "Simulates recordings from a stated prior, and tests whether the truth lies in what estimators state as often as it should: "
    "ranks with their band, coverage, scores, and the verdict as a classifier. An interrupted call goes on where it ended.",
)
