"""A motion along many times at once: the nonlinear one by folded functions of CasADi, its slopes for all steps together.

Only the motion itself has to go from step to step. Blocks of steps run within one call; the slopes of all their steps are then
evaluated together and multiplied up, interval by interval.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.core.compiled import Compiled

BLOCK: Final = 512
"""Steps of one call."""
MOST_STEPS: Final = 5000
"""Of an interval."""
ROOM: Final = 1.25
"""Over the steps that the fastest mode needs, once these were too few."""


@dataclass(frozen=True)
class SteppedIntervals:
    """Some intervals, each of equally many steps.

    Attributes
    ----------
    first : int
        Index of the first interval.
    begins : ndarray of shape (i, s, n)
        Unknowns where each step begins.
    ends : ndarray of shape (i, n)
        Unknowns where each interval ends.
    given : ndarray of shape (i, s, p)
        What each step is given (`SteppedMotion`).
    """

    first: int
    begins: Float[np.ndarray, "i s n"]
    ends: Float[np.ndarray, "i n"]
    given: Float[np.ndarray, "i s p"]


@dataclass(frozen=True)
class SteppedMotion:
    """One step of a motion, (z, p) -> z; p holds inputs at begin, middle and end, and the width.

    Attributes
    ----------
    step : casadi.Function
        (z, p) -> z at the end.
    slopes : casadi.Function
        (z, p) -> transition, and covariance of the process noise that enters.
    modes : casadi.Function
        (z, p) -> Jacobian of the states' rates where the step begins.
    """

    step: ca.Function
    slopes: ca.Function
    modes: ca.Function

    @property
    def size(self) -> int:
        """Unknowns."""
        return self.step.numel_in(0)

    @cached_property
    def folded(self) -> ca.Function:
        """A block of steps."""
        return self.step.mapaccum("folded", BLOCK)

    @cached_property
    def compiled_slopes(self) -> Compiled:
        """Slopes of many steps."""
        return Compiled.interpreted(self.slopes)

    @cached_property
    def compiled_modes(self) -> Compiled:
        """Jacobians of many steps."""
        return Compiled.interpreted(self.modes)

    def fastest(
        self, z: Float[np.ndarray, "i n"], given: Float[np.ndarray, "i p"]
    ) -> Float[np.ndarray, " i"]:
        """Largest eigenvalue of the states' motion, 1/s; 0 where it is not finite."""
        count = self.modes.size1_out(0)
        slopes = self.compiled_modes(z, given)[0].reshape(len(z), count, count)
        finite = np.isfinite(slopes).all(axis=(1, 2))
        slopes[~finite] = 0.0
        return np.abs(np.linalg.eigvals(slopes)).max(axis=1, initial=0.0)

    def run(
        self, z: Float[np.ndarray, "*b n"], given: Float[np.ndarray, "s p"], folded: ca.Function | None = None
    ) -> Float[np.ndarray, "s *b n"]:
        """Ends of all steps, one after the other; of several starts with a function of them."""
        function, found = folded or self.folded, []
        for first in range(0, len(given), BLOCK):
            part = given[first : first + BLOCK]
            padded = np.concatenate([part, np.repeat(part[-1:], BLOCK - len(part), axis=0)])
            ends = np.array(function(z.T, padded.T)).T.reshape(BLOCK, *z.shape)[: len(part)]
            found.append(ends)
            z = ends[-1]
        return np.concatenate(found)

    def run_several(
        self, z: Float[np.ndarray, "b n"], blocks: Sequence[Float[np.ndarray, "i s p"]]
    ) -> Iterator[Float[np.ndarray, "i b n"]]:
        """Ends of intervals of several starts at once, block by block, in given steps."""
        count = len(z)
        states, given = ca.MX.sym("z", self.size, count), ca.MX.sym("p", self.step.numel_in(1))
        every = self.step.map(count)(states, ca.repmat(given, 1, count))
        folded = ca.Function("several", [states, given], [every]).mapaccum("folded", BLOCK)
        for block in blocks:
            intervals, steps, width = block.shape
            ends = self.run(z, block.reshape(intervals * steps, width), folded)
            z = ends[-1]
            yield ends[steps - 1 :: steps]

    def transitions(
        self, block: SteppedIntervals
    ) -> tuple[Float[np.ndarray, "i n n"], Float[np.ndarray, "i n n"]]:
        """Transition over each interval, and the covariance of the process noise that enters in it."""
        intervals, steps, size = block.begins.shape
        each = self.compiled_slopes(
            block.begins.reshape(intervals * steps, size), block.given.reshape(intervals * steps, -1)
        )
        slope, noise = (part.reshape(intervals, steps, size, size) for part in each)
        broken = ~(np.isfinite(slope) & np.isfinite(noise)).all(axis=(1, 2, 3))
        slope[broken] = noise[broken] = 0.0
        while steps > 1:  # neighbours together, until one is left
            odd = steps % 2
            first, second = slope[:, : steps - odd : 2], slope[:, 1::2]
            merged = second @ noise[:, : steps - odd : 2] @ second.swapaxes(-1, -2) + noise[:, 1::2]
            slope, noise = (
                np.concatenate([pairs, rest[:, steps - odd :]], axis=1)
                for pairs, rest in ((second @ first, slope), (merged, noise))
            )
            steps = steps // 2 + odd
        slope[broken] = np.nan
        return slope[:, 0], noise[:, 0]

    def blocks(
        self,
        z: Float[np.ndarray, " n"],
        intervals: int,
        steps_needed: Callable[[int, Float[np.ndarray, "i n"]], np.ndarray],
        given: Callable[[int, int, int], Float[np.ndarray, "i s p"]],
        recorded: Callable[[int, Float[np.ndarray, "i n"]], Float[np.ndarray, "i n"]],
    ) -> Iterator[SteppedIntervals]:
        """The motion, some intervals at a time.

        Parameters
        ----------
        z : ndarray of shape (n,)
            At the begin.
        intervals : int
            All of them.
        steps_needed : callable
            (first interval, z where each begins) -> steps that each of these intervals needs.
        given : callable
            (first, number of intervals, steps in each) -> what the steps are given.
        recorded : callable
            (first interval, z where each begins) -> z with what was recorded.
        """
        first, count = 0, int(steps_needed(0, z[np.newaxis])[0])
        while first < intervals:
            number = min(intervals - first, max(1, BLOCK // count))
            block_given = given(first, number, count)
            raw = self.run(z, block_given.reshape(number * count, -1)).reshape(number, count, len(z))
            ends = raw[:, -1]
            starts = recorded(first, np.concatenate([z[np.newaxis], ends[:-1]]))
            broken = np.flatnonzero(~np.isfinite(starts).all(axis=1))
            known = int(broken[0]) if len(broken) else number
            needed = steps_needed(first, starts[:known])
            few = np.flatnonzero(needed > count)
            accepted = int(few[0]) if len(few) else number
            if accepted:
                begins = np.concatenate([starts[:, np.newaxis], raw[:, :-1]], axis=1)
                yield SteppedIntervals(first, begins[:accepted], ends[:accepted], block_given[:accepted])
                z, first = ends[accepted - 1], first + accepted
            count = int(needed.max(initial=1))
            if len(few):
                exact = int(needed[few[0]])
                count = max(exact, min(int(np.ceil(ROOM * exact)), MOST_STEPS))
