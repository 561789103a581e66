"""The command ``reproduce``: tables and figures of the sources, printed and ours."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from spinfilters.cli.command import Command, Panels, PrintWidth
from spinfilters.cli.common_options import PrintingOptions, print_document
from spinfilters.core.errors import InputError
from spinfilters.io.stated_values import Argument


@dataclass(frozen=True, kw_only=True)
class ReproduceArguments:
    """Arguments of ``reproduce``."""

    names: Annotated[
        tuple[str, ...],
        Argument(
            "names of tables and figures, or beginnings such as tweddle-table or decoust; all, or list",
            positional=True,
            metavar="NAME",
        ),
    ]
    output: Annotated[
        str, Argument("folder of the results; existing ones are kept", short="-o", metavar="FOLDER")
    ] = "runs/reproduce"
    again: Annotated[bool, Argument("make existing ones again")] = False
    record: Annotated[
        str | None,
        Argument("also write a summary with date and hash of the code", metavar="FILE"),
    ] = None
    format: Annotated[
        Literal["svg", "pdf"] | None,
        Argument("print the figures for a paper too, in this file format"),
    ] = None
    panels: Panels = False
    width: PrintWidth = None


def reproduce_items(options: ReproduceArguments) -> int:
    """Make the chosen items, their page and table, and print how they compare."""
    from datetime import UTC, datetime

    from rich.table import Table

    from spinfilters.cli.console import wide_console
    from spinfilters.io.output_files import write_json
    from spinfilters.plots.printing import PrintStyle
    from spinfilters.reproduction.item import Item
    from spinfilters.reproduction.items import ITEMS, chosen_items
    from spinfilters.reproduction.results import FAILED, PAGE_FILE, Finished, counted, record_of, reproduce

    if options.format is None and (options.panels or options.width is not None):
        raise InputError("--panels and --width are of printed figures; give their --format")
    style = None if options.format is None else PrintStyle(options.format, options.width, options.panels)
    console = wide_console()
    if options.names == ("list",):
        table = Table("name", "printed as", "what it shows", "about")
        for item in ITEMS:
            table.add_row(item.name, f"{item.source}, {item.number}", item.title, f"{item.seconds:.0f} s")
        console.print(table)
        print_document(
            [
                {"name": item.name, "source": item.source, "number": item.number, "title": item.title}
                for item in ITEMS
            ]
        )
        return 0
    items, folder = chosen_items(options.names), Path(options.output)

    def report(item: Item, done: Finished | None) -> None:
        """Print how an item compares, once it is made."""
        if done is not None:
            kept = " (kept)" if done.kept else f", {done.document['processor_s']:.0f} s"
            console.print(f"{item.name}: {done.agreement}{kept}", highlight=False)

    found = reproduce(items, folder, options.again, report, style)
    if options.record is not None:
        write_json(Path(options.record), record_of(found, datetime.now(UTC).isoformat(timespec="seconds")))
    documents = [each.document for each in found]
    console.print(f"items: {counted(documents)}", highlight=False)
    console.print(f"rows: {counted(row for each in documents for row in each['rows'])}", highlight=False)
    console.print(f"written to {folder}; look at {folder / PAGE_FILE}", highlight=False, soft_wrap=True)
    print_document({each.name: {"agreement": each.agreement, **each.document} for each in found})
    return 2 if any(each.agreement == FAILED for each in found) else 0


COMMAND = Command(
    "reproduce",
    ReproduceArguments,
    reproduce_items,
    "Makes the tables and figures with results of both theses from this package alone, and compares them with the printed ones. "
    "Existing items are kept, so an interrupted call continues where it ended.",
    common=PrintingOptions,
)
