"""Jumps amid a recording: a kick of the state at the end of one step, sought at the step where it is likeliest."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.evaluation.epoch_spans import clock_text, time_text
from spinfilters.inference.noise_model import StepsAfter, steps_after
from spinfilters.models.state_blocks import ATTITUDE, POSITION, RATE, VELOCITY, StateBlock
from spinfilters.smoother.linear_system import Marginals
from spinfilters.verdict.model_errors.alternatives import Alternative
from spinfilters.verdict.model_errors.linear_rows import Columns
from spinfilters.verdict.model_errors.smoothed_motion import SmoothedMotion

Kicks = Callable[[SmoothedMotion], Float[np.ndarray, "k n m"]]
"""Changes of the state's error at every epoch per unit of m sizes, components in the order of the layout."""
LEAST_TOLD: Final = 1e-9
"""Share of a kick's information that states must leave; with less it is rounding."""
FEWEST_STEPS: Final = 4
"""Before and after a jump: nearer to the ends it is contact there."""
LARGEST_FALL: Final = float(-2 * np.log(1 - np.sqrt(0.99)))
"""Of the statistic from the likeliest step to one that contains the jump all the same, with a probability of 0.99."""


@dataclass(frozen=True)
class JumpKind:
    """Kind of jump with its words.

    Attributes
    ----------
    name, phrase, unit : str
        As of an `Alternative`; the time of the jump follows the phrase.
    cure, moving_cure : str
        Likewise; they may name the interval from ``begin`` to ``end`` that contains the jump, s.
    kicks : Kicks
        Of the state at every epoch.
    """

    name: str
    phrase: str
    unit: str
    cure: str
    kicks: Kicks
    moving_cure: str = ""


def jumps(motion: SmoothedMotion) -> Iterator[Alternative]:
    """Of every kind the jump at its likeliest step; none in recordings too short for one."""
    count = len(motion.time) - 1
    if count <= 2 * FEWEST_STEPS:
        return
    after = _steps_after(motion)
    for kind in KINDS:
        among = step_statistics(motion, kind.kicks, after)[FEWEST_STEPS:-FEWEST_STEPS]
        if among.max(initial=0.0) > 0:
            step = FEWEST_STEPS + int(among.argmax())
            first = float(motion.time[0])
            begin, end = (clock_text(each) for each in interval_of_jump(motion.time, among))
            yield Alternative(
                kind.name,
                f"{kind.phrase} at {time_text(float(motion.time[step + 1]), first)}, between {begin} and {end} s",
                kind.unit,
                partial(kick_of_step, kicks=kind.kicks, step=step),
                kind.cure.format(begin=begin, end=end),
                kind.moving_cure.format(begin=begin, end=end),
                trials=len(among),
            )


def kick_of_step(motion: SmoothedMotion, kicks: Kicks, step: int) -> Columns:
    """Right-hand sides of the kick at the end of a step, as all later measurements see it."""
    return motion.kicked(kicks(motion)[step + 1], step)


def interval_of_jump(time: Float[np.ndarray, " k"], among: Float[np.ndarray, " j"]) -> tuple[float, float]:
    """Time from the beginning of the first step that may contain the jump to the end of the one after the last, s.

    The kick of a step is at its end: one early in the next step is as near to it.

    Parameters
    ----------
    among : (j,) float array
        Statistics of the steps, without `FEWEST_STEPS` at each end.
    """
    possible = FEWEST_STEPS + np.flatnonzero(among >= among.max() - LARGEST_FALL)
    return float(time[possible[0]]), float(time[possible[-1] + 2])


def _steps_after(motion: SmoothedMotion) -> StepsAfter:
    rows = motion.rows
    return steps_after(rows.problem, rows.here, Marginals(rows.solution, rows.normal.eliminated))


def step_statistics(
    motion: SmoothedMotion, kicks: Kicks, after: StepsAfter | None = None
) -> Float[np.ndarray, " j"]:
    """Score statistic of a kick in every step.

    Parameters
    ----------
    after : StepsAfter or None
        What the solution leaves of the steps, where it is known already.
    """
    after = after or _steps_after(motion)
    H = motion.kicks_of_steps(kicks(motion))
    # per step: information F = H'H - H'(J P J')H and score u = H'r of its kicks, in units of their own size
    across = np.swapaxes(H, 1, 2)
    whole, spread = across @ H, across @ after.spread
    scale = np.sqrt(np.einsum("kmm->km", whole))
    unit = np.where(scale > 0, 1 / np.where(scale > 0, scale, 1.0), 0.0)
    F = (whole - spread @ np.swapaxes(spread, 1, 2)) * unit[:, :, None] * unit[:, None, :]
    u = np.einsum("kdm,kd->km", H, after.rest) * unit
    if not (np.isfinite(F).all() and np.isfinite(u).all()):
        return np.zeros(len(H))
    # u' F^+ u over the directions that the measurements show
    values, vectors = np.linalg.eigh(F)
    along = np.einsum("kmv,km->kv", vectors, u)
    told = values > LEAST_TOLD
    return np.where(told, along**2 / np.where(told, values, 1.0), 0.0).sum(axis=1)


def _of_blocks(*blocks: StateBlock) -> Kicks:
    """Every component of those of some blocks that a state has."""

    def kicks(motion: SmoothedMotion) -> Float[np.ndarray, "k n m"]:
        """The same at every epoch."""
        layout = motion.rows.problem.layout
        every = np.eye(layout.error_dim)
        chosen = np.concatenate([every[:, layout.slice(b.name)] for b in blocks if layout.has(b)], axis=1)
        return np.broadcast_to(chosen, (len(motion.time), *chosen.shape))

    return kicks


KINDS: Final = (
    JumpKind(
        "contact-amid",
        "contact",
        "rad/s and m/s",
        "use the recording before {begin} s or after {end} s (--segment)",
        _of_blocks(RATE, VELOCITY),
    ),
    JumpKind(
        "frame-jump",
        "a jump of the camera, or of the frame that is tracked,",
        "rad and m",
        "use the recording before {begin} s or after {end} s (--segment), or give the camera's motion (inspector.tum)",
        _of_blocks(ATTITUDE, POSITION),
        "use the recording before {begin} s or after {end} s (--segment), or give poses without a jump (inspector.tum)",
    ),
    JumpKind(
        "clock-jump",
        "a jump of the clock, as where samples are lost,",
        "s",
        "give every sample its own time stamp",
        lambda motion: motion.change[:, :, None],
    ),
)
