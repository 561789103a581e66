"""The command ``segments``."""

import argparse

from spinfilters.cli.command import Command, Subparsers, add_reading, reading_options


def add_segments(commands: Subparsers) -> argparse.ArgumentParser:
    """Parser of ``spinfilters segments``."""
    segments = commands.add_parser(
        "segments",
        help="list the free flights of a recording",
        description="Finds where a body flies freely: in body rates, where some inertia tensor keeps the angular momentum; in "
        "poses, where some point of the body falls on a parabola. No inertia need be known.",
    )
    segments.add_argument(
        "dataset", metavar="RECORDING", help="gyro .csv, phone export, poses, data set folder"
    )
    add_reading(segments)
    return segments


def list_segments(options: argparse.Namespace) -> int:
    """Print the free flights of a recording and how to compare one."""
    from rich.table import Table

    from spinfilters.cli.console import wide_console
    from spinfilters.run.free_flight import find_flights
    from spinfilters.run.readers import read_whole
    from spinfilters.run.segment_choice import has_marks, no_flight

    whole = read_whole(options.dataset, reading_options(options))
    flights = find_flights(whole)
    if not flights:
        raise no_flight(whole)
    table = Table(title=f"Free flights in {whole.name}", title_justify="left")
    for heading in ("segment", "start s", "end s", "epochs", "turned rad", "evidence"):
        table.add_column(heading)
    for number, flight in enumerate(flights, start=1):
        cells = (f"{flight.start:.3f}", f"{flight.end:.3f}", str(flight.epochs), f"{flight.rotation:.1f}")
        table.add_row(str(number), *cells, flight.evidence)
    console = wide_console()
    console.print(table)
    marked = has_marks(options.dataset, reading_options(options))
    one = "its times" if marked else "its number or times"
    console.print(
        f"compare all with --segment auto, one with --segment and {one} (START:END)", highlight=False
    )
    if marked:
        console.print(
            "segments are marked, too: --segment all takes them, --segment N one of them", highlight=False
        )
    return 0


SEGMENTS = Command(add_segments, list_segments)
