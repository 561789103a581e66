"""The command ``embed``: the filter as C for a microcontroller."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from spinfilters.cli.command import Command
from spinfilters.cli.common_options import PrintingOptions, print_document
from spinfilters.embedded.embedded_options import EmbedOptions
from spinfilters.io.stated_values import Argument, ArgumentGroup


@dataclass(frozen=True, kw_only=True)
class EmbedArguments:
    """Arguments of ``embed``: the filter, and where its C goes."""

    output: Annotated[str, Argument("folder of the library", short="-o", metavar="DIR")]
    from_run: Annotated[
        str | None,
        Argument(
            "run whose last state and noise the filter starts from: a run folder (its first estimator) or an estimator's folder",
            metavar="RUN",
        ),
    ] = None
    chosen: Annotated[EmbedOptions, ArgumentGroup()] = field(default_factory=EmbedOptions)


def embed(options: EmbedArguments) -> int:
    """Write the C library."""
    from spinfilters.cli.console import wide_console
    from spinfilters.embedded.first_program import operation_counts, start_from_belief
    from spinfilters.embedded.folder import memory_sizes, write_library
    from spinfilters.io.output_files import output_folder, refuse_foreign
    from spinfilters.run.run_folder import last_belief

    folder = Path(options.output)
    chosen = options.chosen
    refuse_foreign(folder, COMMAND.name)
    start = None
    if options.from_run is not None:
        last = last_belief(Path(options.from_run))
        chosen.require_further_blocks_of(last.belief.layout.blocks, last.source)
        start = start_from_belief(last.belief, chosen.layout, last.source, last.noise)
    with output_folder(folder, COMMAND.name) as place:
        files = write_library(chosen, place, start)
    size = sum(len((folder / file.name).read_bytes()) for file in files)
    wide_console().print(
        f"{len(files)} files, {size / 1024:.0f} KiB of C for {chosen.sensor} in {chosen.real}: {folder}; "
        f"try `make -C {folder} run`",
        highlight=False,
        soft_wrap=True,
    )
    sizes = {what.strip("`"): count for what, count in memory_sizes(chosen).items()}
    memory = ", ".join(f"{what} {count} bytes" for what, count in sizes.items())
    counts = operation_counts(chosen)
    prediction = counts["substep"] * chosen.substeps + counts["inertia"] + counts["transition"]
    wide_console().print(
        f"memory: {memory}; arithmetic operations of the generated models: {prediction} a prediction, "
        f"{counts['correction']} a correction; `make -C {folder} emulate` counts instructions and stack",
        highlight=False,
        soft_wrap=True,
    )
    print_document(
        {
            "folder": str(folder),
            "files": [file.name for file in files],
            "bytes": size,
            "memory_bytes": sizes,
            "operations": {"prediction": prediction, "correction": counts["correction"]},
        }
    )
    return 0


COMMAND = Command(
    "embed",
    EmbedArguments,
    embed,
    "Writes a small C library with the light filter: no heap, no libm, fixed work. It has test vectors from Python: compare with "
    "them by `make test`, or on an emulated Cortex-M4F by `make emulate`, which counts instructions.",
    common=PrintingOptions,
)
