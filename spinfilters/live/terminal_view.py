"""A live table in the terminal."""

from types import TracebackType

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.table import Table

from spinfilters.live.answer import Answer
from spinfilters.live.summary import LiveSummary


class TerminalView:
    """Shows the latest answer and the counts, on standard error."""

    def __init__(self, summary: LiveSummary) -> None:
        self._summary = summary
        self._live = Live(console=Console(stderr=True), refresh_per_second=5)

    def __enter__(self) -> "TerminalView":
        self._live.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._live.__exit__(kind, error, where)

    def show(self, answer: Answer) -> None:
        """Redraw."""
        self._live.update(answer_table(answer, self._summary))


def answer_table(answer: Answer, summary: LiveSummary) -> Table:
    """State with deviations, verdict, latency and counts."""
    table = Table(title=f"t = {answer.time:.3f} s   {answer.status.verdict}   ({answer.source})")
    table.add_column("state")
    table.add_column("value", justify="right")
    table.add_column("std", justify="right")
    layout, belief = answer.belief.layout, answer.belief
    for block in layout.members:
        value = np.array2string(belief.mean[layout.mean_slice(block.name)], precision=4, suppress_small=True)
        std = np.array2string(belief.std[layout.slice(block.name)], precision=2)
        table.add_row(f"{block.label} ({block.unit})", value, std)
    latency = 1e3 * np.array(summary.latencies[-100:] or [np.nan])
    table.add_row("latency (ms)", f"{1e3 * answer.latency:.2f}", f"largest of 100: {latency.max():.2f}")
    table.add_row("measurements", f"{answer.used} used", f"{answer.left_out} left out")
    for name, count in sorted(summary.events.items()):
        table.add_row(name, str(count), "")
    if answer.status.reasons:
        table.caption = "[yellow]" + "\n".join(map(escape, answer.status.reasons))
    return table
