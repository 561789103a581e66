"""Rows [J | y] of measurements that depend on the state of one epoch alone, and their products, by whole epochs: `epoch_rows.c`.

NumPy does the same without a compiler, to rounding.
"""

import ctypes
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.c_library import LANES
from spinfilters.core.compiled import address
from spinfilters.smoother.kernels import kernels

WIDEST: Final = 3 * LANES
"""Numbers of a row of `epoch_rows.c`, at most."""
FLOAT: Final = np.dtype(np.float64)


@dataclass(frozen=True)
class EpochRows:
    """Rows [J | y] of measurements in the order of their epochs.

    Products are those of whole epochs: of single landmarks, added up afterwards, they take ten to fifty times as long.

    Attributes
    ----------
    rows : ndarray of float, shape (r, i, c1)
        Contiguous.
    epoch : ndarray of int, shape (r,)
        Ascending.
    known : ndarray of float, shape (f, c1, c1), or None
        What `information` gives, where it is known already.
    """

    rows: Float[np.ndarray, "r i c1"]
    epoch: Int[np.ndarray, " r"]
    known: Float[np.ndarray, "f c1 c1"] | None = None

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

    @cached_property
    def information(self) -> Float[np.ndarray, "f c1 c1"]:
        """[J | y]'[J | y] of the epochs of `first`."""
        if self.known is not None:
            return self.known
        if self.are_single:  # one product [J | y]'[J | y] a row
            return self.rows.swapaxes(1, 2) @ self.rows
        width = self.rows.shape[2]
        found = np.empty((len(self.first), width, width))
        if (library := self._library) is not None:
            begin = address(self._begin)
            library.row_products(len(found), begin, width, address(self.rows), address(found))
            return found
        # all rows of an epoch as one tall matrix, whose product is the sum over them
        whole = self.rows.reshape(-1, width)
        for k, part in enumerate(self._parts):
            np.matmul(whole[part].T, whole[part], out=found[k])
        return found

    def gradient(self, right: Float[np.ndarray, "r i m"], count: int) -> Float[np.ndarray, "k c m"]:
        """J'u of each of ``count`` epochs, for m right-hand sides u."""
        m, J = right.shape[2], self.jacobian
        # epochs without a row keep a gradient of zero
        found = np.zeros((count, J.shape[2], m))
        if self.are_single:
            found[self.epoch] = J.swapaxes(1, 2) @ right
            return found
        # J'u of all rows of an epoch at once, u stacked as the rows are
        flat, by_row = self._flat, right.reshape(-1, m)
        for part, k in zip(self._parts, self._epochs, strict=True):
            np.matmul(flat[part].T, by_row[part], out=found[k])
        return found

    def products(self, errors: Float[np.ndarray, "k c m"]) -> Float[np.ndarray, "r i m"]:
        """J e with the errors e of each row's epoch."""
        J = self.jacobian
        if self.are_single:
            return J @ errors[self.epoch]
        # the stacked rows of an epoch times its one error, then back to a block per row
        flat, found = self._flat, np.empty((J.shape[0] * J.shape[1], errors.shape[2]))
        for part, k in zip(self._parts, self._epochs, strict=True):
            np.matmul(flat[part], errors[k], out=found[part])
        return found.reshape(*J.shape[:2], -1)

    def variances(self, covariance: Float[np.ndarray, "k c c"]) -> Float[np.ndarray, "r i"]:
        """Diagonal of J P J' with the covariances P of each row's epoch."""
        J, library = self.jacobian, self._library
        if library is None:
            return np.einsum("rij,rij->ri", self.products(covariance), J)
        own, sizes = (
            np.ascontiguousarray(covariance[self.epoch[self.first]], FLOAT),
            (len(self.first), address(self._begin)),
        )
        found = np.empty(J.shape[:2])
        library.row_variances(*sizes, J.shape[2], address(self.rows), address(own), address(found))
        return found

    @property
    def _library(self) -> ctypes.PyDLL | None:
        """The loops in C; None without, or where rows are not as these take them."""
        plain = self.rows.dtype is FLOAT and self.rows.flags.c_contiguous and self.rows.size > 0
        return kernels() if plain and self.rows.shape[2] <= WIDEST else None

    @cached_property
    def _begin(self) -> Int[np.ndarray, " f1"]:
        """Lines of `_flat` with which epochs begin that have any, and the number of all."""
        # every row has i lines, so that an epoch's lines go from i times its first row to i times the next epoch's
        return self.rows.shape[1] * np.append(self.first, len(self.rows))

    @property
    def _flat(self) -> Float[np.ndarray, "q c"]:
        return self.rows.reshape(-1, self.rows.shape[2])[:, :-1]

    @property
    def _epochs(self) -> list[int]:
        return self.epoch[self.first].tolist()

    @cached_property
    def _parts(self) -> list[slice]:
        """Lines of `_flat` of each epoch that has any."""
        return [slice(begin, end) for begin, end in pairwise(self._begin.tolist())]


def weigh_rows(
    innovation: Float[np.ndarray, "r i"],
    jacobian: Float[np.ndarray, "r i c"],
    scale: Float[np.ndarray, " i"] | None,
    weight: Float[np.ndarray, " r"],
    epoch: Int[np.ndarray, " r"],
) -> EpochRows:
    """Rows [J | y] over the scale of their components, if any, times the weight of each measurement; zero without a weight.

    Their `EpochRows.information` is known.
    """
    r, i, c = jacobian.shape
    library = kernels() if r and c < WIDEST else None
    if library is None:
        return EpochRows(weigh_rows_in_numpy(innovation, jacobian, scale, weight), epoch)
    innovation, jacobian, weight = (np.ascontiguousarray(a, FLOAT) for a in (innovation, jacobian, weight))
    stated = None if scale is None else np.ascontiguousarray(scale, FLOAT)
    made = EpochRows(np.empty((r, i, c + 1)), epoch)
    products = np.empty((len(made.first), c + 1, c + 1))
    library.weigh_rows(
        *(len(made.first), address(made._begin), i, c, address(innovation), address(jacobian)),
        *(None if stated is None else address(stated), *map(address, (weight, made.rows, products))),
    )
    return replace(made, known=products)


def weigh_rows_in_numpy(
    innovation: np.ndarray, jacobian: np.ndarray, scale: np.ndarray | None, weight: np.ndarray
) -> np.ndarray:
    """The rows of `weigh_rows` for machines without a compiler."""
    rows = np.concatenate([jacobian, innovation[..., None]], axis=2)
    if scale is not None:
        rows /= scale[:, None]
    other = np.flatnonzero(weight != 1.0)
    if len(other):
        rows[other] *= weight[other, None, None]
        rows[np.flatnonzero(weight == 0.0)] = 0.0
    return rows
