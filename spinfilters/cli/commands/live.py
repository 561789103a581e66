"""The command ``live``."""

import argparse

from spinfilters.cli.command import Command, Subparsers, number
from spinfilters.io.stated_values import NumberRange


def add_live(commands: Subparsers) -> argparse.ArgumentParser:
    """Parser of ``spinfilters live``."""
    live = commands.add_parser(
        "live",
        help="filter and smoother side by side on measurements as they arrive",
        description="DATASET tells sensors, noise, camera and the initialisation. Without --input its own measurements after that "
        "follow at their own pace; with it, lines `sensor,time_s,columns...` come from a pipe, a socket or a growing file. Answers "
        "go to standard output, counts to standard error in the end.",
    )
    _add_input(live)
    live.add_argument(
        "--filter",
        choices=("mekf", "ukf", "embedded", "embedded-double"),
        default="mekf",
        help="that answers (default mekf)",
    )
    _add_smoother(live)
    _add_answers(live)
    live.add_argument("--config", metavar="FILE", help="TOML file with settings")
    live.add_argument("--summary", metavar="FILE", help="write the counts as JSON, too")
    live.add_argument("--view", action="store_true", help="show a table in the terminal")
    return live


def _add_input(live: argparse.ArgumentParser) -> None:
    live.add_argument("dataset", metavar="DATASET", help="data set folder, gyro .csv or TUM .tum")
    live.add_argument(
        "--input",
        metavar="PLACE",
        help="- (standard input), tcp:HOST:PORT, unix:PATH, a named pipe or a growing file",
    )
    live.add_argument(
        "--speed", type=number(NumberRange(1e-3, 1e6)), default=1.0, help="of the replay (default 1)"
    )


def _add_smoother(live: argparse.ArgumentParser) -> None:
    live.add_argument("--no-smoother", action="store_true", help="the filter alone")
    live.add_argument(
        "--patience",
        type=number(NumberRange(0.05, 1e4, "s")),
        default=5.0,
        metavar="SECONDS",
        help="without a word of the smoother, after which it begins anew (default 5)",
    )
    live.add_argument(
        "--smoother-memory",
        type=number(NumberRange(64, 1e7, "MiB")),
        metavar="MIB",
        help="address space of the smoother's process (default: no limit)",
    )


def _add_answers(live: argparse.ArgumentParser) -> None:
    live.add_argument("--format", choices=("lines", "tum"), default="lines", help="JSON lines or TUM")
    live.add_argument(
        "--predict",
        type=number(NumberRange(0, 1e4, "s")),
        default=0.0,
        metavar="SECONDS",
        help="say every answer so far ahead too",
    )
    live.add_argument(
        "--deadline-ms", type=number(NumberRange(1e-3, 1e6, "ms")), default=20.0, help="default 20"
    )


def run_live(options: argparse.Namespace) -> int:
    """Estimate every epoch until measurements end."""
    from spinfilters.cli.live_run import live

    return live(options)


LIVE = Command(add_live, run_live)
