"""Order of the errors of many frames in one vector.

Moving ones frame after frame, then once those of the constants.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from experiments.benchmarks.motion_rows import MOVING
from spinfilters.models.state_layout import StateLayout


@dataclass(frozen=True)
class StackedErrors:
    """Of ``epochs`` frames over the full layout."""

    layout: StateLayout
    epochs: int

    @property
    def size(self) -> int:
        """Size of the vector: 12 per epoch, and the constants."""
        return MOVING * self.epochs + self.layout.error_dim - MOVING

    def state(self, frame: int) -> Int[np.ndarray, " n"]:
        """Indices of one epoch's whole error."""
        first = MOVING * frame
        return np.r_[first : first + MOVING, MOVING * self.epochs : self.size]

    def errors(self, stacked: Float[np.ndarray, " N"]) -> Float[np.ndarray, "k n"]:
        """Each frame's error."""
        moving = stacked[: MOVING * self.epochs].reshape(self.epochs, MOVING)
        constant = np.tile(stacked[MOVING * self.epochs :], (self.epochs, 1))
        return np.concatenate([moving, constant], axis=1)
