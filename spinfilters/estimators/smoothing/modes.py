"""How long a smoother keeps what: everything, everything but landmarks that went out of sight, or a window."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.errors import InputError
from spinfilters.estimators.smoothing.window import Window
from spinfilters.state.layout import StateLayout

DETERMINED = 0.03
"""Standard deviation of the mass distribution (logarithm of second moments) above which no frame leaves a window: a linear model of
the inertia made while it is hardly known would be kept for ever."""
LONGEST_STARTUP = 120
"""Frames after which even an undetermined inertia must leave: a body in pure spin never tells it."""

SHARE, AT_ONCE = 5, 16
"""A fifth of a window leaves together, so that its frames share a decomposition; so many at most, also of a window that was longer
while it started up."""

TOGETHER = 100
"""Landmarks that are frozen at once, at least: each time costs a decomposition."""


class Mode(ABC):
    """What leaves after a frame has been taken in.

    Attributes
    ----------
    determined: standard deviation of the mass distribution above which no frame leaves.
    """

    determined: float

    @abstractmethod
    def frozen(self, window: Window, layout: StateLayout) -> Bool[np.ndarray, " L"]:
        """Landmarks whose sightings are turned into what is carried."""

    @abstractmethod
    def leaving(self, frames: int, mass_std: float) -> int:
        """How many of so many frames leave, the oldest first."""


@dataclass(frozen=True)
class Full(Mode):
    """Everything stays (the thesis' way)."""

    determined: float = DETERMINED

    def frozen(self, window: Window, layout: StateLayout) -> Bool[np.ndarray, " L"]:
        return np.zeros(len(window.ids), dtype=bool)

    def leaving(self, frames: int, mass_std: float) -> int:
        return 0


@dataclass(frozen=True)
class FrozenVision(Mode):
    """Landmarks unseen for some revolutions are eliminated once; every frame's dynamics stay live, up to a longest window.

    Attributes
    ----------
    revolutions: of the body, since a landmark was last seen.   frames: that stay, at least.
    """

    revolutions: float = 8.0
    frames: int = 180
    determined: float = DETERMINED

    def __post_init__(self) -> None:
        if not self.revolutions > 0:
            raise InputError(f"revolutions is {self.revolutions}; give a positive number")
        _enough(self.frames)

    def frozen(self, window: Window, layout: StateLayout) -> Bool[np.ndarray, " L"]:
        if not len(window.frames):
            return np.zeros(len(window.ids), dtype=bool)
        time = np.array([frame.time for frame in window.frames])
        turn = _turns(window.trajectory[:, layout.mean_slice("w")], time)
        last = window.last_seen()
        gone = (last >= 0) & (turn[-1] - turn[last] > self.revolutions)
        return gone if np.count_nonzero(gone) >= TOGETHER else np.zeros_like(gone)

    def leaving(self, frames: int, mass_std: float) -> int:
        return _leaving(self, self.frames, frames, mass_std)


@dataclass(frozen=True)
class FixedLag(Mode):
    """The newest frames; older ones are marginalised, some together, once the inertia is determined.

    Attributes
    ----------
    frames: that stay, at least.
    """

    frames: int = 20
    determined: float = DETERMINED

    def __post_init__(self) -> None:
        _enough(self.frames)

    def frozen(self, window: Window, layout: StateLayout) -> Bool[np.ndarray, " L"]:
        return np.zeros(len(window.ids), dtype=bool)

    def leaving(self, frames: int, mass_std: float) -> int:
        return _leaving(self, self.frames, frames, mass_std)


def _leaving(mode: Mode, kept: int, frames: int, mass_std: float) -> int:
    """Frames beyond those that are kept, once there are enough of them; more are kept while the inertia is not determined."""
    over = frames - (kept if mass_std <= mode.determined else max(kept, LONGEST_STARTUP))
    return min(over, AT_ONCE) if over >= together(kept) else 0


def together(kept: int) -> int:
    """How many frames beyond those that are kept gather before they leave."""
    return min(AT_ONCE, max(1, kept // SHARE))


def _turns(rates: Float[np.ndarray, "k 3"], time: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Revolutions since the first frame."""
    speed = np.linalg.norm(rates, axis=1)
    steps = np.diff(time) * (speed[1:] + speed[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(steps)]) / (2 * np.pi)


def _enough(frames: int) -> None:
    if frames < 2:
        raise InputError(f"a window of {frames} frames holds no step; give at least 2")
