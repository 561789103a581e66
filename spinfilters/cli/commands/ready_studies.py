"""The command ``study``: ready comparisons of filters with smoothers."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from spinfilters.api.arguments import CampaignArguments
from spinfilters.cli.command import Command, Panels, PrintWidth
from spinfilters.cli.common_options import PrintingOptions, print_document
from spinfilters.core.errors import InputError
from spinfilters.io.stated_values import Argument, NumberRange


@dataclass(frozen=True, kw_only=True)
class ReadyStudyArguments:
    """Arguments of ``study``."""

    names: Annotated[
        tuple[str, ...],
        Argument("names of ready studies, all, or list to print them", positional=True, metavar="NAME"),
    ]
    output: Annotated[
        str,
        Argument(
            "folder of the page, with a campaign's folder for each; goes on with what is there",
            short="-o",
            metavar="FOLDER",
        ),
    ] = "runs/studies"
    seeds: Annotated[
        int | None,
        NumberRange(1, 100_000, whole=True),
        Argument("runs of every cell in place of the study's own number"),
    ] = None
    workers: Annotated[
        int | None, NumberRange(1, 1024, whole=True), Argument("processes, by default one per processor")
    ] = None
    format: Annotated[
        Literal["png", "svg", "pdf"] | None,
        Argument("print the figures for a paper too, in this file format"),
    ] = None
    panels: Panels = False
    width: PrintWidth = None


def make_studies(options: ReadyStudyArguments) -> int:
    """Run what the chosen studies lack, then write the page over all of the folder."""
    from spinfilters.api.campaign_frames import require_installed

    for package in ("pyarrow", "pandas", "distributed"):
        require_installed(package)
    from rich.table import Table

    from spinfilters.campaigns.filter_comparison import (
        NAMES,
        PICTURE,
        ready_study,
        study_file,
        write_comparison_page,
    )
    from spinfilters.cli.campaign_progress import rows_with_bar
    from spinfilters.cli.console import wide_console
    from spinfilters.plots.printing import PrintStyle

    if options.format is None and (options.panels or options.width is not None):
        raise InputError("--panels and --width are of printed figures; give their --format")
    style = None if options.format is None else PrintStyle(options.format, options.width, options.panels)
    console = wide_console()
    if options.names == ("list",):
        found = Table("name", "runs", "what it compares")
        for name in NAMES:
            study = ready_study(name)
            found.add_row(name, str(len(study)), study.options.description)
        console.print(found)
        print_document([{"name": name, "runs": len(ready_study(name))} for name in NAMES])
        return 0
    names = NAMES if "all" in options.names else tuple(dict.fromkeys(options.names))
    for name in names:
        study_file(name)  # refuses before anything is run
    folder, made = Path(options.output), {}
    for name in names:
        document = dict(ready_study(name).document)
        if options.seeds is not None:
            document["study"] = {**document["study"], "seeds": options.seeds}
        how = CampaignArguments(workers=options.workers, resume=True)
        done = rows_with_bar(document, folder / name, how, name)
        made[name] = {"done": done.done, "total": done.total, "without_result": done.faulty}
        console.print(f"{name}: look at {folder / name / PICTURE}", highlight=False, soft_wrap=True)
    page = write_comparison_page(folder, print_style=style)
    console.print(f"written to {folder}; look at {page}", highlight=False, soft_wrap=True)
    print_document({"page": str(page), "studies": made})
    return 0


COMMAND = Command(
    "study",
    ReadyStudyArguments,
    make_studies,
    "Compares filters with smoothers over sensors, motions, rates, noise, lags, initial errors and iterations. One page says "
    "which of them to fly when, each number with its 95 % interval. An interrupted call goes on where it ended.",
    common=PrintingOptions,
)
