"""Table of a live run in the terminal."""

import math
import time
from types import TracebackType

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.table import Table

from spinfilters.live.answer import Answer, LiveSummary
from spinfilters.models.body import body_estimate
from spinfilters.models.state_blocks import MASS_DISTRIBUTION
from spinfilters.models.state_layout import Gaussian

INTERVAL = 0.25
"""Seconds between tables: to make one takes longer than to answer an epoch."""
_MOST_DECIMALS = 9


class TerminalView:
    """Shows the latest answer and the counts, on standard error."""

    def __init__(self, summary: LiveSummary) -> None:
        self._summary, self._next = summary, -math.inf
        self._latest: Answer | None = None
        self._live = Live(console=Console(stderr=True), auto_refresh=False)

    def __enter__(self) -> "TerminalView":
        self._live.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        if self._latest is not None:
            self._draw(self._latest)
        self._live.__exit__(kind, error, where)

    def show(self, answer: Answer) -> None:
        """Redraw, where the last table is old enough."""
        self._latest = answer
        if time.monotonic() >= self._next:
            self._draw(answer)
            self._next = time.monotonic() + INTERVAL

    def _draw(self, answer: Answer) -> None:
        self._live.update(answer_table(answer, self._summary), refresh=True)


def answer_table(answer: Answer, summary: LiveSummary) -> Table:
    """State with deviations, moments, prediction, verdict, latency and counts."""
    table = Table(title=f"t = {answer.time:.3f} s   {answer.status.verdict}   ({answer.source})")
    table.add_column("state")
    table.add_column("value", justify="right")
    table.add_column("std", justify="right")
    _add_belief(table, answer.belief, "")
    if answer.belief.layout.has(MASS_DISTRIBUTION):
        body = body_estimate(answer.belief, intervals=False)
        table.add_row("J1/J3, J2/J3", *_columns(body.principal_moments[:2], body.principal_moments_std[:2]))
    if answer.ahead is not None:
        table.add_section()
        _add_belief(table, answer.ahead[1], f" at {answer.ahead[0]:.3f} s", moving=True)
    table.add_section()
    latency = 1e3 * np.array(summary.latencies[-100:] or [np.nan])
    table.add_row("latency (ms)", f"{1e3 * answer.latency:.2f}", f"largest of 100: {latency.max():.2f}")
    table.add_row("measurements", f"{answer.used} used", f"{answer.left_out} left out")
    for name, count in sorted(summary.events.items()):
        table.add_row(name, str(count), "")
    if answer.status.reasons:
        table.caption = "[yellow]" + "\n".join(map(escape, answer.status.reasons))
    return table


def _add_belief(table: Table, belief: Gaussian, when: str, moving: bool = False) -> None:
    """A row for every block, or for those that move."""
    layout, std = belief.layout, belief.std
    for block in layout.members:
        if not (moving and block.constant):
            value = belief.mean[layout.mean_slice(block.name)]
            table.add_row(
                f"{block.label}{when} ({block.unit})", *_columns(value, std[layout.slice(block.name)])
            )


def _columns(values: np.ndarray, std: np.ndarray) -> tuple[str, str]:
    """Values and deviations with as many decimals as the smallest deviation needs for two digits."""
    least = float(std.min())
    decimals = 1 - math.floor(math.log10(least)) if math.isfinite(least) and least > 0 else 4
    decimals = max(0, min(decimals, _MOST_DECIMALS))
    value, spread = (" ".join(f"{number:.{decimals}f}" for number in row.tolist()) for row in (values, std))
    return value, spread
