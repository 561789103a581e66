"""``spinfilters embed``."""

import argparse
from pathlib import Path

from spinfilters.cli.console import wide_console
from spinfilters.data.output_folder import output_folder, refuse_foreign
from spinfilters.embedded.embedded_options import EmbedOptions
from spinfilters.embedded.folder import write_library

COMMAND = "embed"


def embed(options: argparse.Namespace) -> int:
    """Write the C library."""
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
