"""The command ``fuse``: one inertia of several runs of one body."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from spinfilters.cli.command import Command
from spinfilters.cli.common_options import PrintingOptions, print_document
from spinfilters.io.stated_values import Argument


@dataclass(frozen=True, kw_only=True)
class FuseArguments:
    """Arguments of ``fuse``."""

    runs: Annotated[
        tuple[str, ...],
        Argument(
            "folders made by compare or estimate, whose first estimator counts, or of an estimator in one, as runs/a/smoother",
            positional=True,
            metavar="RUN",
        ),
    ]
    same_axes: Annotated[
        bool,
        Argument("axes g are fixed to the body in the same way in all recordings: fuse principal axes too"),
    ] = False
    output: Annotated[str, Argument("fused.json and inertia.toml", short="-o", metavar="FOLDER")] = (
        "runs/fused"
    )


def fuse(options: FuseArguments) -> int:
    """Fuse the runs, write the result, print a line for each and the result."""
    from rich.table import Table

    from spinfilters.cli.console import wide_console
    from spinfilters.io.output_files import output_folder, refuse_foreign
    from spinfilters.run.segment_runs import fuse_runs, write_fused

    folder = Path(options.output)
    refuse_foreign(folder, COMMAND.name)
    document = fuse_runs([Path(run) for run in options.runs], options.same_axes)
    with output_folder(folder, COMMAND.name) as place:
        write_fused(place, document)
    table = Table("run", "J1/J3", "J2/J3")
    for name, found in (*document["runs"].items(), ("fused", document)):
        table.add_row(name, *_cells(found))
    console = wide_console()
    console.print(table)
    for name, status in document["left_out"].items():
        console.print(f"left out: {name}, which is {status}", highlight=False)
    console.print(_agreement(document), highlight=False, soft_wrap=True)
    console.print(f"written to {folder}", highlight=False, soft_wrap=True)
    print_document(document)
    return 0


def _cells(found: dict[str, Any]) -> list[str]:
    pairs = zip(found["principal_moments"][:2], found["principal_moments_std"][:2], strict=True)
    return [f"{value:.5f} ± {std:.2g}" for value, std in pairs]


def _agreement(document: dict[str, Any]) -> str:
    """How well the runs agree, in words."""
    if not document["degrees_of_freedom"]:
        return "one run determines the inertia: nothing says whether the runs agree"
    words = (
        f"chi-square {document['chi_square']:.1f} of {document['degrees_of_freedom']} degrees of freedom "
        f"(p {document['probability']:.2g})"
    )
    if document["widening"] > 1:
        words += (
            f": the runs disagree beyond their deviations, which are widened {document['widening']:.1f} times"
        )
    return words


COMMAND = Command(
    "fuse",
    FuseArguments,
    fuse,
    "Weighs the inertias of several recordings of one body by their covariances. Moments need no common axes. With --same-axes, "
    "as for a gyro that stayed mounted, axes are fused too, and a motion that shows a part of the inertia adds that part. The "
    "prior that is in every run counts once.",
    common=PrintingOptions,
)
