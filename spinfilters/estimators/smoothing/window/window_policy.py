"""Window policies: full smoothing, landmark marginalization, fixed lag."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.errors import InputError
from spinfilters.state.layout import StateLayout

if TYPE_CHECKING:
    from spinfilters.estimators.smoothing.window.smoother_window import Window

DETERMINED = 0.03
"""Standard deviation of the mass distribution (logarithm of second moments) above which no epoch leaves a window: a linear model of
the inertia made while it is hardly known would be kept for ever."""
LONGEST_STARTUP = 120
"""Epochs after which even an undetermined inertia must leave: a body in pure spin never tells it."""

SHARE, LARGEST_BATCH = 5, 16
"""A fifth of a window leaves together, so that its epochs share a decomposition; so many at most, also of a window that was longer
while it started up."""

SMALLEST_LANDMARK_BATCH = 100
"""Landmarks that are frozen at once, at least: each time costs a decomposition."""


class WindowPolicy(ABC):
    """Policy of what leaves a window after an epoch was added.

    Attributes
    ----------
    determined: standard deviation of the mass distribution above which no epoch leaves.
    """

    determined: float

    @abstractmethod
    def marginalized_landmarks(self, window: "Window", layout: StateLayout) -> Bool[np.ndarray, " L"]:
        """Landmarks to marginalize."""

    @abstractmethod
    def batch_size(self, epochs: int, mass_std: float) -> int:
        """Number of oldest epochs to marginalize, of so many."""


@dataclass(frozen=True)
class FullSmoothing(WindowPolicy):
    """Window policy of full smoothing: nothing leaves."""

    determined: float = DETERMINED

    def marginalized_landmarks(self, window: "Window", layout: StateLayout) -> Bool[np.ndarray, " L"]:
        """None."""
        return np.zeros(len(window.ids), dtype=bool)

    def batch_size(self, epochs: int, mass_std: float) -> int:
        """None."""
        return 0


@dataclass(frozen=True)
class LandmarkMarginalization(WindowPolicy):
    """Marginalize landmarks that were unobserved for some revolutions.

    The dynamics of every epoch stay, up to a largest window.

    Attributes
    ----------
    revolutions: of the body, since a landmark was last seen.   epochs: that stay, at least.
    """

    revolutions: float = 8.0
    epochs: int = 180
    determined: float = DETERMINED

    def __post_init__(self) -> None:
        if not self.revolutions > 0:
            raise InputError(f"revolutions is {self.revolutions}; give a positive number")
        _require_a_step(self.epochs)

    def marginalized_landmarks(self, window: "Window", layout: StateLayout) -> Bool[np.ndarray, " L"]:
        """Landmarks unobserved for so many revolutions, once they are enough."""
        if not len(window.epochs):
            return np.zeros(len(window.ids), dtype=bool)
        time = np.array([epoch.time for epoch in window.epochs])
        turn = _turns(window.trajectory[:, layout.mean_slice("w")], time)
        last = window.last_seen()
        gone = (last >= 0) & (turn[-1] - turn[last] > self.revolutions)
        return gone if np.count_nonzero(gone) >= SMALLEST_LANDMARK_BATCH else np.zeros_like(gone)

    def batch_size(self, epochs: int, mass_std: float) -> int:
        """Epochs beyond the window, once enough have gathered."""
        return _batch_size(self, self.epochs, epochs, mass_std)


@dataclass(frozen=True)
class FixedLag(WindowPolicy):
    """The latest epochs; older ones are marginalized, some together, once the inertia is determined.

    Attributes
    ----------
    epochs: that stay, at least.
    """

    epochs: int = 20
    determined: float = DETERMINED

    def __post_init__(self) -> None:
        _require_a_step(self.epochs)

    def marginalized_landmarks(self, window: "Window", layout: StateLayout) -> Bool[np.ndarray, " L"]:
        """No landmarks but those of marginalized epochs."""
        return np.zeros(len(window.ids), dtype=bool)

    def batch_size(self, epochs: int, mass_std: float) -> int:
        """Epochs beyond the window, once enough have gathered."""
        return _batch_size(self, self.epochs, epochs, mass_std)


def _batch_size(policy: WindowPolicy, kept: int, epochs: int, mass_std: float) -> int:
    """Number of epochs to remove at once, 0 until enough.

    More are kept while the inertia is not determined.
    """
    over = epochs - (kept if mass_std <= policy.determined else max(kept, LONGEST_STARTUP))
    return min(over, LARGEST_BATCH) if over >= smallest_batch(kept) else 0


def smallest_batch(kept: int) -> int:
    """Number of excess epochs gathered before marginalization."""
    return min(LARGEST_BATCH, max(1, kept // SHARE))


def _turns(rates: Float[np.ndarray, "k 3"], time: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Revolutions since the first epoch."""
    speed = np.linalg.norm(rates, axis=1)
    steps = np.diff(time) * (speed[1:] + speed[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(steps)]) / (2 * np.pi)


def _require_a_step(epochs: int) -> None:
    if epochs < 2:
        raise InputError(f"a window of {epochs} epochs holds no step; give at least 2")
