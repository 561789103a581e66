"""The command ``embed``."""

import argparse
from pathlib import Path

from spinfilters.cli.command import Command, Subparsers, number
from spinfilters.io.stated_values import NumberRange

COMMAND, LARGEST_MAP = "embed", 65_535


def add_embed(commands: Subparsers) -> argparse.ArgumentParser:
    """Parser of ``spinfilters embed``."""
    embed = commands.add_parser(
        "embed",
        help="write the filter as C for a microcontroller",
        description="Writes a small C library with the light filter: no heap, no libm, fixed work, with test vectors from Python. "
        "`make test` in it compares with them, `make emulate` does so on an emulated Cortex-M4F and counts instructions.",
    )
    embed.add_argument("-o", "--output", metavar="DIR", required=True, help="folder of the library")
    embed.add_argument(
        "--sensor", choices=("pose", "stereo", "gyro"), default="stereo", help="default stereo"
    )
    embed.add_argument(
        "--landmarks",
        type=number(NumberRange(1, LARGEST_MAP, whole=True)),
        default=200,
        metavar="N",
        help="places in the map of a stereo filter (default 200)",
    )
    embed.add_argument("--real", choices=("float", "double"), default="float", help="default float")
    embed.add_argument(
        "--substeps",
        type=int,
        choices=(2, 4, 8, 16, 32, 64),
        default=2,
        help="Runge-Kutta steps of a prediction: 2 for up to 0.16 rad between epochs (default 2)",
    )
    return embed


def embed(options: argparse.Namespace) -> int:
    """Write the C library."""
    from spinfilters.cli.console import wide_console
    from spinfilters.embedded.embedded_options import EmbedOptions
    from spinfilters.embedded.folder import write_library
    from spinfilters.io.output_files import output_folder, refuse_foreign

    folder = Path(options.output)
    refuse_foreign(folder, COMMAND)
    chosen = EmbedOptions(options.sensor, options.landmarks, options.real, options.substeps)
    with output_folder(folder, COMMAND) as place:
        files = write_library(chosen, place)
    size = sum(len((folder / file.name).read_bytes()) for file in files)
    wide_console().print(
        f"{len(files)} files, {size / 1024:.0f} KiB of C for {chosen.sensor} in {chosen.real}: {folder}; "
        f"try `make -C {folder} test`",
        highlight=False,
        soft_wrap=True,
    )
    return 0


EMBED = Command(add_embed, embed)
