"""Whitened measurement rows by epoch, and their products with per-epoch vectors."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True)
class EpochRows:
    """Rows [J | y] of measurements in the order of their epochs.

    Products are those of whole epochs: of single landmarks, added up afterwards, they take ten to fifty times as long.

    Attributes
    ----------
    rows: (r, i, c + 1), contiguous.   epoch: (r,) ascending.
    """

    rows: Float[np.ndarray, "r i c1"]
    epoch: Int[np.ndarray, " r"]

    @property
    def jacobian(self) -> Float[np.ndarray, "r i c"]:
        """J."""
        return self.rows[:, :, :-1]

    @cached_property
    def first(self) -> Int[np.ndarray, " f"]:
        """First row of every epoch that has any."""
        return np.flatnonzero(np.diff(self.epoch, prepend=-1))

    @property
    def are_single(self) -> bool:
        """Whether no epoch has more than one measurement."""
        return len(self.first) == len(self.rows)

    @property
    def information(self) -> Float[np.ndarray, "f c1 c1"]:
        """[J | y]'[J | y] of the epochs of `first`."""
        if self.are_single:
            return self.rows.swapaxes(1, 2) @ self.rows
        found = np.empty((len(self.first), self.rows.shape[2], self.rows.shape[2]))
        whole = self.rows.reshape(-1, self.rows.shape[2])
        for k, part in enumerate(self._parts):
            np.matmul(whole[part].T, whole[part], out=found[k])
        return found

    def gradient(self, right: Float[np.ndarray, "r i m"], count: int) -> Float[np.ndarray, "k c m"]:
        """J'u of each of ``count`` epochs, for m right-hand sides u."""
        m, J = right.shape[2], self.jacobian
        found = np.zeros((count, J.shape[2], m))
        if self.are_single:
            found[self.epoch] = J.swapaxes(1, 2) @ right
            return found
        flat, by_row = self._flat, right.reshape(-1, m)
        for part, k in zip(self._parts, self._epochs, strict=True):
            np.matmul(flat[part].T, by_row[part], out=found[k])
        return found

    def products(self, errors: Float[np.ndarray, "k c m"]) -> Float[np.ndarray, "r i m"]:
        """J e with the errors e of each row's epoch."""
        J = self.jacobian
        if self.are_single:
            return J @ errors[self.epoch]
        found = np.empty((J.shape[0] * J.shape[1], errors.shape[2]))
        for part, k in zip(self._parts, self._epochs, strict=True):
            np.matmul(self._flat[part], errors[k], out=found[part])
        return found.reshape(*J.shape[:2], -1)

    @property
    def _flat(self) -> Float[np.ndarray, "q c"]:
        return self.rows.reshape(-1, self.rows.shape[2])[:, :-1]

    @property
    def _epochs(self) -> list[int]:
        return self.epoch[self.first].tolist()

    @cached_property
    def _parts(self) -> list[slice]:
        """Lines of `_flat` of each epoch that has any."""
        ends = (self.rows.shape[1] * np.append(self.first, len(self.rows))).tolist()
        return [slice(begin, end) for begin, end in pairwise(ends)]
