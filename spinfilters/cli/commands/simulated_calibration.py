"""The command ``calibration``: do truths lie in stated posteriors as often as they should?"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from spinfilters.cli.command import Command
from spinfilters.cli.common_options import PrintingOptions, print_json_file
from spinfilters.io.stated_values import Argument, NumberRange


@dataclass(frozen=True, kw_only=True)
class CalibrationArguments:
    """Arguments of ``calibration``."""

    sensor: Annotated[
        str,
        Argument("gyro, attitude, pose, lidar-points or stereo-tracks", positional=True, metavar="SENSOR"),
    ]
    output: Annotated[
        str,
        Argument(
            "folder of draws, numbers and pictures; goes on with what is there", short="-o", metavar="FOLDER"
        ),
    ] = "runs/calibration"
    draws: Annotated[int, NumberRange(1, 100_000, whole=True), Argument("recordings in all")] = 500
    first: Annotated[int, NumberRange(0, 1_000_000, whole=True), Argument("seed of the first of them")] = 0
    estimators: Annotated[str, Argument("estimators, separated by commas", metavar="NAMES")] = "mekf,smoother"
    state_noise: Annotated[
        bool, Argument("state the true noise in each recording; else it is identified from it")
    ] = False


def calibrate_by_simulation(options: CalibrationArguments) -> int:
    """Make the draws that the folder lacks, then write its report."""
    from spinfilters.campaigns.calibration_draws import (
        CalibrationStudy,
        add_draw,
        claim_folder,
        drawn_scenario,
        made_draws,
        read_draws,
    )
    from spinfilters.campaigns.calibration_report import PAGE_FILE, RESULT_FILE, write_report
    from spinfilters.cli.campaign_progress import interruption
    from spinfilters.cli.console import progress_bars, wide_console
    from spinfilters.cli.interrupts import require_uninterrupted
    from spinfilters.io.output_files import made_folder
    from spinfilters.run.run_lock import locked_run
    from spinfilters.settings.run_settings import Settings, names_in

    console, folder = wide_console(), Path(options.output)
    asked = range(options.first, options.first + options.draws)
    names = names_in(options.estimators)
    drawn_scenario(options.sensor, 0)  # refuses a sensor without a prior, and then an estimator that is none,
    Settings(estimators=names)  # before anything is written
    study = CalibrationStudy(options.sensor, names, "stated" if options.state_noise else "identified")
    is_interrupted = False
    with made_folder(folder), locked_run(folder):
        claim_folder(folder, study)
        draws = read_draws(folder, study)
        try:
            with progress_bars() as report:
                for seed in (seed for seed in asked if seed not in draws):
                    report("draws", sum(each in draws for each in asked), len(asked))
                    made = made_draws(options.sensor, seed, names, options.state_noise)
                    require_uninterrupted()  # a library may have taken a Ctrl-C for an error of the recording
                    add_draw(folder, study, seed, made)
                    draws[seed] = made
        except KeyboardInterrupt:
            is_interrupted = True
        draws = read_draws(folder, study)
        total = len(draws.keys() | set(asked))  # the folder may hold more than are asked for
        if draws:
            for picture in write_report(folder, study, draws, total):
                console.print(f"look at {picture}", highlight=False, soft_wrap=True)
    if is_interrupted:
        raise interruption(f"{len(draws)} of {total} draws", folder)
    console.print(f"written to {folder / PAGE_FILE}", highlight=False, soft_wrap=True)
    print_json_file(folder / RESULT_FILE)
    return 0


COMMAND = Command(
    "calibration",
    CalibrationArguments,
    calibrate_by_simulation,
    "Simulates recordings from a stated prior, and tests whether the truth lies in stated intervals as often as it should. "
    "The result has ranks with their band, coverage, scores, and how often the verdict is right. An interrupted call goes on "
    "where it ended.",
    common=PrintingOptions,
)
