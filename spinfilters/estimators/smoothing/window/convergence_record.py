"""Convergence of a smoother: estimates of all epochs after every solve.

Rows are solves, columns epochs (Tweddle 2013, section 6.7, Figures 6-33 to 6-41: iterations and time). There is no estimate of a
epoch before it came, nor after it left the window: the surfaces are triangles or bands, not a number elsewhere.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.errors import NUMERICAL_ERRORS, InputError
from spinfilters.estimators.smoothing.window.sliding_smoother import SlidingSmoother
from spinfilters.estimators.smoothing.window.smoother_records import MarginalizedState
from spinfilters.estimators.timeline import Timeline, times_of
from spinfilters.state.status import Verdict

MOST_EPOCHS = 600
"""Of a recording: a surface grows with their square."""

SelectedQuantities = Callable[[Sequence[MarginalizedState]], Mapping[str, Float[np.ndarray, "k q"]]]
"""What is kept of the k smoothed epochs of a window, by name."""
OnEpoch = Callable[[int, int], None]
"""Called with epochs done and epochs in all."""


@dataclass(frozen=True)
class ConvergenceRecord:
    """Beliefs of every solve, for figures of convergence.

    Attributes
    ----------
    time: (f,) s, of the epochs; solve number k took in epoch number k.
    values: by name (f, f, q), solves by epochs by components; not a number where the epoch was not in the window.
    latest: the epoch that each solve took in, as that solve saw it; it holds the constants of the solve.
    trusted: (f,) whether the smoother vouched for its solve; before, it may sit in a wrong minimum.
    """

    time: Float[np.ndarray, " f"]
    values: dict[str, Float[np.ndarray, "f f q"]]
    latest: tuple[MarginalizedState, ...]
    trusted: Bool[np.ndarray, " f"]


def states(window: Sequence[MarginalizedState]) -> dict[str, Float[np.ndarray, "k q"]]:
    """The states themselves: ``mean`` (k, m), and standard deviations of their errors ``std`` (k, n)."""
    factor = np.array([row.factor for row in window])
    return {"mean": np.array([row.mean for row in window]), "std": np.linalg.norm(factor, axis=2)}


def record_convergence(
    smoother: SlidingSmoother,
    timeline: Timeline,
    quantities: SelectedQuantities = states,
    on_epoch: OnEpoch = lambda *_: None,
) -> ConvergenceRecord:
    """Convergence record of a smoother fed epoch by epoch.

    The smoother must have seen nothing before.
    After a solve whose numbers lead nowhere there is none: from there on nothing is a number.
    The error of a first solve is raised.

    Raises
    ------
    InputError: no epoch, or more than `MOST_EPOCHS`.
    """
    count = len(timeline)
    if not 1 <= count <= MOST_EPOCHS:
        raise InputError(
            f"the recording has {count} epochs; convergence is shown of 1 to {MOST_EPOCHS}: give a part of it"
        )
    values: dict[str, np.ndarray] = {}
    latest: list[MarginalizedState] = []
    trusted = np.zeros(count, dtype=bool)
    for solve, epoch in enumerate(timeline):
        try:
            smoother.add(epoch)
            window = smoother.smoothed()
            said = quantities(window)
        except NUMERICAL_ERRORS:
            if not latest:
                raise
            break
        trusted[solve] = smoother.status.verdict is Verdict.OK
        _record(values, solve, count, said)
        latest.append(window[-1])
        on_epoch(solve + 1, count)
    nothing = replace(latest[-1], mean=latest[-1].mean * np.nan, factor=latest[-1].factor * np.nan)
    latest += [replace(nothing, time=epoch.time) for epoch in timeline[len(latest) :]]
    return ConvergenceRecord(times_of(timeline), values, tuple(latest), trusted)


def _record(
    values: dict[str, np.ndarray], solve: int, count: int, said: Mapping[str, Float[np.ndarray, "w q"]]
) -> None:
    """Enter what a solve says of the latest epochs; others stay NaN."""
    for name, rows in said.items():
        record = values.setdefault(name, np.full((count, count, rows.shape[1]), np.nan))
        record[solve, solve + 1 - len(rows) : solve + 1] = rows
