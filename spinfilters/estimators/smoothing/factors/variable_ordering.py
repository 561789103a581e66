"""Variable ordering of the errors of many epochs.

Separator (poses that observations connect), block-tridiagonal part (velocities that only the dynamics connect), constants.

Landmarks tie the poses of all epochs that saw them, so poses make a dense system. Velocities meet only their neighbours in time and
are eliminated along the chain. Without observations nothing is tied, and whole states are chained.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from spinfilters.errors import InputError
from spinfilters.state.block import StateBlock
from spinfilters.state.layout import POSE_BLOCKS, StateLayout


@dataclass(frozen=True)
class VariableOrdering:
    """Errors of ``epochs`` epochs over a layout.

    Attributes
    ----------
    has_landmarks: whether observations tie the poses together.
    """

    layout: StateLayout
    epochs: int
    has_landmarks: bool

    def __post_init__(self) -> None:
        if self.has_landmarks and self.layout.blocks[:2] != POSE_BLOCKS:
            raise InputError(
                f"landmarks need a state that begins with blocks t, a; the layout has {self.layout.blocks}"
            )

    @cached_property
    def pose(self) -> Int[np.ndarray, " p"]:
        """Error components of an epoch coupled by landmark observations."""
        return self._of([block for block in self.layout.moving if self._is_separator(block)])

    @cached_property
    def tridiagonal(self) -> Int[np.ndarray, " v"]:
        """Error components of an epoch coupled only to its neighbours in time."""
        return self._of([block for block in self.layout.moving if not self._is_separator(block)])

    @cached_property
    def constant(self) -> Int[np.ndarray, " c"]:
        """Error components that are the same in every epoch."""
        return self._of(self.layout.constant)

    @cached_property
    def moving(self) -> Int[np.ndarray, " d"]:
        """Pose components, then tridiagonal ones."""
        return np.concatenate([self.pose, self.tridiagonal])

    @cached_property
    def order(self) -> Int[np.ndarray, " n"]:
        """All components of an epoch: pose, tridiagonal, constant.

        Chains are eliminated first, where each meets only its neighbours; poses stay because landmarks tie them to one another, and
        constants come last because every epoch meets them: what is eliminated before them stays sparse.
        """
        return np.concatenate([self.moving, self.constant])

    @property
    def separator_dim(self) -> int:
        """Dimension of the separator: all poses, then the constants."""
        return self.epochs * len(self.pose) + len(self.constant)

    def errors(
        self, separator_step: Float[np.ndarray, " r"], tridiagonal_step: Float[np.ndarray, "k v"]
    ) -> Float[np.ndarray, "k n"]:
        """Each epoch's error in the order of the layout."""
        p = len(self.pose)
        result = np.empty((self.epochs, self.layout.error_dim))
        result[:, self.pose] = separator_step[: self.epochs * p].reshape(self.epochs, p)
        result[:, self.tridiagonal] = tridiagonal_step
        result[:, self.constant] = separator_step[self.epochs * p :]
        return result

    def _is_separator(self, block: StateBlock) -> bool:
        return self.has_landmarks and block.name in POSE_BLOCKS

    def _of(self, blocks: Sequence[StateBlock]) -> Int[np.ndarray, " b"]:
        every = np.arange(self.layout.error_dim)
        return np.concatenate([every[:0], *[every[self.layout.slice(block.name)] for block in blocks]])
