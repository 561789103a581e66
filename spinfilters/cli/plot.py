"""``spinfilters plot``."""

import argparse
from pathlib import Path

from spinfilters.cli.console import progress_bars, wide_console
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
    wide_console().print(f"{len(drawn)} figures in {folder}", highlight=False, soft_wrap=True)
    return 0
