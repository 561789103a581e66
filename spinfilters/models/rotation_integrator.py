"""Rotation integrator: steps and their linearisation, step-doubled until a tolerance is met."""

from functools import lru_cache
from math import hypot
from sys import float_info

import numpy as np
from jaxtyping import Float, Int

from spinfilters.errors import InputError, SpinfiltersError
from spinfilters.models.linearised_step import LinearisedStep
from spinfilters.models.rotation_substeps import Acceleration, RotationSubsteps
from spinfilters.state.layout import StateLayout
from spinfilters.symbolic.compiled import Compiled
from spinfilters.symbolic.working_time import building

MAX_SUBSTEPS = 1 << 14
"""Budget of one step, in substeps: forty revolutions at a tolerance of 1e-8. What needs more raises `IntegrationError`."""
FEWEST = 4
"""Substeps of a step: a panel of Boole's rule."""
BOOLE_ERROR, NOISE_ERROR = 0.1, 1e-6
"""Relative error of the noise covariance per rad^4 of turn and sixth power of the number of substeps, and what is allowed of it."""
STEP_ERROR = 6e-4
"""Error of a turn per rad and per fourth power of the substep's angle: where the step control starts. A guess that proves too
coarse costs one more evaluation, one that is too fine would cost every one."""


class IntegrationError(SpinfiltersError, np.linalg.LinAlgError):
    """Step beyond the budget of substeps."""


class RotationIntegrator:
    """Steps and linearises a state whose rotation follows ``acceleration``.

    Parameters
    ----------
    layout, acceleration: see `RotationSubsteps`.
    tolerance: bound on the estimated error of attitude (rad) and rate (relative) of one call.

    Raises
    ------
    IntegrationError: by every method that steps, when `MAX_SUBSTEPS` do not meet the tolerance.
    """

    def __init__(self, layout: StateLayout, acceleration: Acceleration, tolerance: float) -> None:
        if not tolerance > 0:
            raise InputError(f"integration tolerance is {tolerance}; give a positive number such as 1e-9")
        self.expressions = RotationSubsteps(layout, acceleration)
        self._layout = layout
        self._tolerance = tolerance
        self._rate = layout.mean_slice("w")
        self._stepper = lru_cache(maxsize=None)(self._build_step)
        self._lineariser = lru_cache(maxsize=None)(self._build_lineariser)

    def step(self, x: Float[np.ndarray, "*batch m"], dt: float) -> Float[np.ndarray, "*batch m"]:
        """Points after dt > 0 seconds."""
        count = self.first_count(x, dt)
        while True:
            after, error = self._stepper(count)(x, dt)
            if self.good(error, count):
                return after
            count *= 2

    def steps(self, x: Float[np.ndarray, "k m"], dt: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k m"]:
        """Points after dt > 0 seconds of their own.

        Points of equal dt take equal numbers of substeps, as in one `step` of theirs.
        """
        if not (np.isfinite(dt) & (dt > 0)).all():
            raise InputError("time steps must be positive and finite")
        intervals, of_interval = np.unique(dt, return_inverse=True)
        fastest = np.zeros(len(intervals))
        np.maximum.at(fastest, of_interval, self.speeds(x))
        counts = np.array(
            [self.count_at(*each) for each in zip(fastest.tolist(), intervals.tolist(), strict=True)]
        )
        after = np.empty_like(x)
        for count in np.unique(counts).tolist():
            rows = np.flatnonzero(counts[of_interval] == count)
            after[rows] = self._stepped(x[rows], dt[rows], of_interval[rows], count)
        return after

    def _stepped(
        self,
        x: Float[np.ndarray, "k m"],
        dt: Float[np.ndarray, " k"],
        of_interval: Int[np.ndarray, " k"],
        count: int,
    ) -> Float[np.ndarray, "k m"]:
        """`steps` with at least so many substeps; the intervals whose error is too large take twice as many."""
        after, error = self._stepper(count)(x, dt[:, None])
        worst = np.zeros(of_interval.max() + 1)
        np.maximum.at(worst, of_interval, error.reshape(len(x), -1).max(axis=1))
        is_coarse = (worst > self._tolerance) & np.isfinite(worst)
        if is_coarse.any() and not self.good(worst[is_coarse], count):
            rows = np.flatnonzero(is_coarse[of_interval])
            after[rows] = self._stepped(x[rows], dt[rows], of_interval[rows], 2 * count)
        return after

    def linearise(
        self, x: Float[np.ndarray, " m"], dt: float, densities: Float[np.ndarray, " 2"]
    ) -> LinearisedStep:
        """The step of dt > 0 seconds under white noise of these densities; see `TorqueFreeProcess.linearise`."""
        count = self.first_count(x, dt)
        while True:
            after, error, transition, factor = self._lineariser(count)(x, dt, densities)
            if self.good(error, count):
                return LinearisedStep(after, transition, factor)
            count *= 2

    @property
    def noise_dim(self) -> int:
        """Columns of the noise factor: rotation (a, w), and where the state translates position and velocity."""
        return 12 if self._layout.translates else 6

    def speeds(self, x: Float[np.ndarray, "k m"]) -> Float[np.ndarray, " k"]:
        """|w| of many states, rad/s; infinite where it is beyond all numbers."""
        return speeds(x[:, self._rate])

    def first_count(self, x: np.ndarray, dt: float) -> int:
        """Substeps with which the step control starts."""
        if not (np.isfinite(dt) and dt > 0):
            raise InputError(f"time step is {dt} s; it must be positive and finite")
        w = x[..., self._rate]
        speed = hypot(*w.tolist()) if w.ndim == 1 else float(np.max(speeds(w), initial=0.0))
        return self.count_at(speed, dt)

    def count_at(self, speed: float, dt: float) -> int:
        """`first_count` at a largest time step dt > 0 (s) and largest rate ``speed`` (rad/s)."""
        turn = speed * dt
        if not np.isfinite(turn):
            return FEWEST  # no step count helps: the caller sees that the result is not finite
        count = substeps(turn, self._tolerance)
        if count > MAX_SUBSTEPS:
            raise IntegrationError(
                f"a step of {dt:.6g} s turns the body by {turn:.3g} rad, which {MAX_SUBSTEPS} substeps do not resolve to "
                f"{self._tolerance:.3g}"
            )
        return count

    def good(self, error: np.ndarray, count: int) -> bool:
        """Whether the tolerance is met, or the result is not finite."""
        worst = float(error.max()) if error.size else 0.0
        if worst <= self._tolerance or not np.isfinite(worst):
            return True
        if count >= MAX_SUBSTEPS:
            raise IntegrationError(
                f"{count} substeps of a step leave an error of {worst:.3g}, the tolerance is {self._tolerance:.3g}"
            )
        return False

    @building()
    def _build_step(self, count: int) -> Compiled:
        return Compiled(self.expressions.step(count))

    @building()
    def _build_lineariser(self, count: int) -> Compiled:
        return Compiled(self.expressions.linearised_step(count))


def speeds(rates: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
    """Length |w| of rates, rad/s.

    Infinite where it is beyond all numbers, which no square on the way is.
    """
    scale = np.abs(rates).max(axis=-1, keepdims=True, initial=float_info.min)
    with np.errstate(over="ignore", invalid="ignore"):
        return scale[..., 0] * np.linalg.norm(rates / scale, axis=-1)


def turns(
    rates: Float[np.ndarray, "*batch 3"], dt: Float[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch"]:
    """Rotation |w| dt of steps, rad; infinite where it is beyond all numbers."""
    with np.errstate(over="ignore", invalid="ignore"):
        return speeds(rates) * dt


def substeps(turn: float, tolerance: float) -> int:
    """Substeps that a rotation (rad) in one step needs.

    A power of two; above `MAX_SUBSTEPS` for what needs more.
    """
    angle = (tolerance / (STEP_ERROR * max(turn, tolerance))) ** 0.25
    noise_angle = (NOISE_ERROR / BOOLE_ERROR) ** (1 / 6) * max(turn, NOISE_ERROR) ** (1 / 3)
    count = FEWEST
    while count * min(angle, noise_angle) < turn and count <= MAX_SUBSTEPS:
        count *= 2
    return count
