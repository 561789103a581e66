"""How a smoother's estimates settle: what it says of every frame, again after every frame.

Rows are solves, columns frames (Tweddle 2013, section 6.7, Figures 6-33 to 6-41: iterations and time). There is no estimate of a
frame before it came, nor after it left the window: the surfaces are triangles or bands, not a number elsewhere.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.errors import NUMERICAL_ERRORS, InputError
from spinfilters.estimators.smoothing.sliding import SlidingSmoother
from spinfilters.estimators.smoothing.sliding_records import Retired
from spinfilters.estimators.timeline import Timeline
from spinfilters.state.status import Verdict

MOST_FRAMES = 600
"""Of a recording: a surface grows with their square."""

Told = Callable[[Sequence[Retired]], Mapping[str, Float[np.ndarray, "k q"]]]
"""What is kept of the k smoothed frames of a window, by name."""
OnFrame = Callable[[int, int], None]
"""Called with frames done and frames in all."""


@dataclass(frozen=True)
class Surfaces:
    """Everything that was said.

    Attributes
    ----------
    time: (f,) s, of the frames; solve number k took in frame number k.
    values: by name (f, f, q), solves by frames by components; not a number where the frame was not in the window.
    newest: the frame that each solve took in, as that solve saw it; it holds the constants of the solve.
    trusted: (f,) whether the smoother vouched for its solve; before, it may sit in a wrong minimum.
    """

    time: Float[np.ndarray, " f"]
    values: dict[str, Float[np.ndarray, "f f q"]]
    newest: tuple[Retired, ...]
    trusted: Bool[np.ndarray, " f"]


def states(window: Sequence[Retired]) -> dict[str, Float[np.ndarray, "k q"]]:
    """The states themselves: ``mean`` (k, m), and standard deviations of their errors ``std`` (k, n)."""
    factor = np.array([row.factor for row in window])
    return {"mean": np.array([row.mean for row in window]), "std": np.linalg.norm(factor, axis=2)}


def record_surfaces(
    smoother: SlidingSmoother, timeline: Timeline, told: Told = states, on_frame: OnFrame = lambda *_: None
) -> Surfaces:
    """Feed a smoother that has seen nothing frame by frame, and keep what it says after each.

    After a solve whose numbers lead nowhere there is none: from there on nothing is a number.
    The error of a first solve is raised.

    Raises
    ------
    InputError: no frame, or more than `MOST_FRAMES`.
    """
    count = len(timeline)
    if not 1 <= count <= MOST_FRAMES:
        raise InputError(
            f"the recording has {count} frames; convergence is shown of 1 to {MOST_FRAMES}: give a part of it"
        )
    values: dict[str, np.ndarray] = {}
    newest: list[Retired] = []
    trusted = np.zeros(count, dtype=bool)
    for solve, frame in enumerate(timeline):
        try:
            smoother.add(frame)
            window = smoother.smoothed()
            said = told(window)
        except NUMERICAL_ERRORS:
            if not newest:
                raise
            break
        trusted[solve] = smoother.status.verdict is Verdict.OK
        for name, rows in said.items():
            surface = values.setdefault(name, np.full((count, count, rows.shape[1]), np.nan))
            surface[solve, solve + 1 - len(rows) : solve + 1] = rows
        newest.append(window[-1])
        on_frame(solve + 1, count)
    nothing = replace(newest[-1], mean=newest[-1].mean * np.nan, factor=newest[-1].factor * np.nan)
    newest += [replace(nothing, time=frame.time) for frame in timeline[len(newest) :]]
    times = np.array([frame.time for frame in timeline])
    return Surfaces(times, values, tuple(newest), trusted)
