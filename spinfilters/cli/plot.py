"""``spinfilters plot``."""

import argparse
from pathlib import Path

from rich.console import Console

from spinfilters.cli.console import progress_bars
from spinfilters.workflow.additions import draw_additions
from spinfilters.workflow.figures import Pictured, draw_run
from spinfilters.workflow.run_lock import locked_run


def plot(options: argparse.Namespace) -> int:
    """Draw the figures of a run folder again."""
    folder = Path(options.run)
    pictured = Pictured.from_folder(folder)
    histories = [evaluation.history for evaluation in pictured.evaluations]
    with locked_run(folder), progress_bars() as report:
        drawn = draw_run(pictured, folder, lambda done, total: report("figures", done, total))
        drawn += draw_additions(folder, histories, pictured.dataset.truth)
    Console().print(f"{len(drawn)} figures in {folder}", highlight=False)
    return 0
