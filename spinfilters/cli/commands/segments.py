"""The command ``segments``: the free flights of a recording."""

from dataclasses import dataclass, field
from typing import Annotated

from spinfilters.cli.command import Command
from spinfilters.cli.common_options import PrintingOptions, print_document
from spinfilters.io.stated_values import Argument, ArgumentGroup, ReadingOptions


@dataclass(frozen=True, kw_only=True)
class SegmentsArguments:
    """Arguments of ``segments``."""

    dataset: Annotated[
        str, Argument("gyro .csv, phone export, poses, data set folder", positional=True, metavar="RECORDING")
    ]
    reading: Annotated[ReadingOptions, ArgumentGroup("what the recording does not state")] = field(
        default_factory=ReadingOptions
    )


def list_segments(options: SegmentsArguments) -> int:
    """Print the free flights of a recording and how to compare one."""
    from rich.table import Table

    from spinfilters.cli.console import wide_console
    from spinfilters.run.free_flight import find_flights
    from spinfilters.run.readers import read_whole
    from spinfilters.run.segment_choice import has_marks, no_flight

    whole = read_whole(options.dataset, options.reading)
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
    print_document([{**vars(flight), "number": number} for number, flight in enumerate(flights, start=1)])
    marked = has_marks(options.dataset, options.reading)
    one = "its times" if marked else "its number or times"
    console.print(
        f"compare all with --segment auto, one with --segment and {one} (START:END)", highlight=False
    )
    if marked:
        console.print(
            "segments are marked, too: --segment all takes them, --segment N one of them", highlight=False
        )
    return 0


COMMAND = Command(
    "segments",
    SegmentsArguments,
    list_segments,
    "Finds free flight. In body rates, some inertia tensor conserves the angular momentum; in poses, some point of the body falls "
    "on a parabola. The inertia need not be known.",
    common=PrintingOptions,
)
