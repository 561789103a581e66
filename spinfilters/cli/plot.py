"""``spinfilters plot``."""

import argparse
from pathlib import Path

from rich.console import Console

from spinfilters.cli.console import progress_bars
from spinfilters.workflow.figures import Pictured, draw_run


def plot(options: argparse.Namespace) -> int:
    """Draw the figures of a run folder again."""
    folder = Path(options.run)
    with progress_bars() as report:
        paths = draw_run(
            Pictured.from_folder(folder), folder, lambda done, total: report("figures", done, total)
        )
    Console().print(f"{len(paths)} figures in {folder}", highlight=False)
    return 0
