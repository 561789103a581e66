"""``spinfilters plot``."""

import argparse
from pathlib import Path

from rich.console import Console

from spinfilters.cli.console import progress_bars
from spinfilters.workflow.additions import drawn_additions
from spinfilters.workflow.figures import Pictured, draw_run


def plot(options: argparse.Namespace) -> int:
    """Draw the figures of a run folder again."""
    folder = Path(options.run)
    pictured = Pictured.from_folder(folder)
    histories = [evaluation.history for evaluation in pictured.evaluations]
    additions = drawn_additions(folder, histories, pictured.dataset.truth)
    with progress_bars() as report:
        paths = draw_run(pictured, folder, lambda done, total: report("figures", done, total), additions)
    Console().print(f"{len(paths)} figures in {folder}", highlight=False)
    return 0
