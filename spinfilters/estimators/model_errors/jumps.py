"""Jumps amid a recording.

A touch, a push of the camera, samples that are missing under an even clock.

A jump is a kick of the state in one step, of any step. With rho = M y what the solution leaves (see `linear_rows`) and H_k the
kicks of step k as its whitened rows see them, the score of every step is u_k = H_k'rho with the information H_k'M H_k, of which
the covariances of neighbouring epochs tell everything (de Jong and Penzer 1998). The step of the largest statistic is tested like
every error of the models, and its probability is that of the largest among so many steps.

When it happened is known from the same statistics: the steps whose statistic falls short of the largest by less than chance
explains. About the place of a jump that fall behaves as the largest of two random walks with drift, one on each side, of which each
stays below c with the probability 1 - exp(-c/2) (Hansen 2000).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.identification.residuals import StepsAfter, steps_after
from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.estimators.smoothing.linear.marginals import Marginals
from spinfilters.state.block import StateBlock
from spinfilters.state.blocks.rigid_body import ATTITUDE, POSITION, RATE, VELOCITY

Kicks = Callable[[SmoothedMotion], Float[np.ndarray, "k n m"]]
"""Changes of the state's error at every epoch per unit of m sizes, components in the order of the layout."""
LEAST_TOLD: Final = 1e-9
"""Share of a kick's information that states must leave; with less it is rounding."""
FEWEST_STEPS: Final = 4
"""Before and behind a jump: nearer to the ends it is contact there."""
LARGEST_FALL: Final = float(-2 * np.log(1 - np.sqrt(0.99)))
"""Of the statistic from the likeliest step to one that contains the jump all the same, with a probability of 0.99."""


@dataclass(frozen=True)
class Jump(Alternative):
    """A kick of the state at the end of one step.

    Attributes
    ----------
    kicks: of every epoch.   step: of them the one that is kicked.
    """

    kicks: Kicks
    step: int
    name: str
    phrase: str
    unit: str
    cure: str
    trials: int
    moving_cure: str = ""

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Columns of the kick as all later measurements see it."""
        return motion.kicked(self.kicks(motion)[self.step + 1], self.step)


@dataclass(frozen=True)
class _Kind:
    """Kind of jump with its words.

    The time of the jump follows the phrase; the cure may name the interval from ``begin`` to ``end`` that contains it, s.
    """

    name: str
    phrase: str
    unit: str
    cure: str
    kicks: Kicks
    moving_cure: str = ""


def jumps(motion: SmoothedMotion) -> Iterator[Jump]:
    """Of every kind the jump at its likeliest step; none in recordings too short for one."""
    count = len(motion.time) - 1
    if count <= 2 * FEWEST_STEPS:
        return
    after = _steps_after(motion)
    for kind in KINDS:
        among = step_statistics(motion, kind.kicks, after)[FEWEST_STEPS:-FEWEST_STEPS]
        if among.max(initial=0.0) > 0:
            step = FEWEST_STEPS + int(among.argmax())
            begin, end = interval_of_jump(motion.time, among)
            phrase = (
                f"{kind.phrase} at t = {motion.time[step + 1]:.4g} s, between {begin:.6g} and {end:.6g} s"
            )
            cure, moving_cure = (
                each.format(begin=f"{begin:.6g}", end=f"{end:.6g}") for each in (kind.cure, kind.moving_cure)
            )
            yield Jump(kind.kicks, step, kind.name, phrase, kind.unit, cure, len(among), moving_cure)


def interval_of_jump(time: Float[np.ndarray, " k"], among: Float[np.ndarray, " j"]) -> tuple[float, float]:
    """Time from the beginning of the first step that may contain the jump to the end of the one behind the last, s.

    The kick of a step is at its end: one early in the next step is as near to it.

    Parameters
    ----------
    among: statistics of the steps, without `FEWEST_STEPS` at each end.
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
    after: what the solution leaves of the steps, where it is known already.
    """
    after = after or _steps_after(motion)
    H = motion.kicks_of_steps(kicks(motion))
    across = np.swapaxes(H, 1, 2)
    whole, spread = across @ H, across @ after.spread
    scale = np.sqrt(np.einsum("kmm->km", whole))
    unit = np.where(scale > 0, 1 / np.where(scale > 0, scale, 1.0), 0.0)
    F = (whole - spread @ np.swapaxes(spread, 1, 2)) * unit[:, :, None] * unit[:, None, :]
    u = np.einsum("kdm,kd->km", H, after.rest) * unit
    if not (np.isfinite(F).all() and np.isfinite(u).all()):
        return np.zeros(len(H))
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
    _Kind(
        "contact-amid",
        "contact",
        "rad/s and m/s",
        "use the recording before {begin} s or after {end} s (--segment)",
        _of_blocks(RATE, VELOCITY),
    ),
    _Kind(
        "frame-jump",
        "a jump of the camera, or of the frame that is tracked,",
        "rad and m",
        "use the recording before {begin} s or after {end} s (--segment), or give the camera's motion (inspector.tum)",
        _of_blocks(ATTITUDE, POSITION),
        "use the recording before {begin} s or after {end} s (--segment), or give poses without a jump (inspector.tum)",
    ),
    _Kind(
        "clock-jump",
        "a jump of the clock, as where samples are lost,",
        "s",
        "give every sample its own time stamp",
        lambda motion: motion.change[:, :, None],
    ),
)
