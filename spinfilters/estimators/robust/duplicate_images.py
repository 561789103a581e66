"""Detection of duplicate images and duplicate rows.

A frozen camera sends its last image again; it holds no new information.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Num

DUPLICATE_SHARE = 0.9
"""Of the landmarks common to two epochs, bit by bit the same in a repeated image; a tracker may find a few others in it."""
FEWEST_DUPLICATES = 4
"""Landmarks that must be the same: fewer, or a gyro's coarse digits, repeat by chance."""

SAMPLE = 12
"""Rows, spread over an epoch, none of which is found again in another image; of a repeated one nearly all are."""


class DuplicateImages:
    """Recognises repeated values of one sensor, from the raw numbers alone.

    After time has gone on an epoch repeats the one before when nearly all values of the common landmarks are bit by bit the same
    (a camera with noise never measures the same twice). Without time going on, it repeats when every value has been there already.
    """

    def __init__(self) -> None:
        self._keys = np.zeros((0, 1))
        self._values = np.zeros((0, 1))
        self._time_passed = True

    def pass_time(self) -> None:
        """Mark that time has advanced, so that a new epoch follows."""
        self._time_passed = True

    def is_duplicate(self, keys: Num[np.ndarray, "k ..."], values: Float[np.ndarray, "k v"]) -> bool:
        """Whether values only repeat what was there, and remember them.

        Parameters
        ----------
        keys: (k,) ids of landmarks or (k, p) parameters of the rows, by which a landmark is known again.
        """
        if not len(values):
            return False
        keys = keys.reshape(len(values), -1)
        before = _Image(self._keys, self._values)
        if (
            self._time_passed
            or keys.shape[1:] + values.shape[1:] != self._keys.shape[1:] + self._values.shape[1:]
        ):
            self._time_passed = False
            self._keys, self._values = keys.copy(), values.copy()
            return _frozen(_Image(keys, values), before)
        if _rows(keys, values) <= _rows(*before):
            return True
        self._keys, self._values = (
            np.concatenate([before.keys, keys]),
            np.concatenate([before.values, values]),
        )
        return False

    def snapshot(self) -> dict[str, np.ndarray]:
        """Its whole state as arrays."""
        return {
            "keys": self._keys.copy(),
            "values": self._values.copy(),
            "time_passed": np.array(self._time_passed),
        }

    def restore(self, snapshot: dict[str, np.ndarray]) -> None:
        """Go on from a `snapshot`."""
        self._keys, self._values = snapshot["keys"].copy(), snapshot["values"].copy()
        self._time_passed = bool(snapshot["time_passed"])


class _Image(NamedTuple):
    """Rows of one image: keys (k, q) of its landmarks, and values (k, v)."""

    keys: np.ndarray
    values: np.ndarray


def _frozen(now: _Image, before: _Image) -> bool:
    if min(len(now.keys), len(before.keys)) < FEWEST_DUPLICATES:
        return False
    sample = now.values[:: -(-len(now.values) // SAMPLE), :1]
    if not np.count_nonzero(
        sample == before.values[:, 0]
    ):  # the usual case, a twentieth of the time of comparing rows
        return False
    same = len(_rows(*now) & _rows(*before))
    common = len(_rows(now.keys) & _rows(before.keys))
    return same >= max(FEWEST_DUPLICATES, DUPLICATE_SHARE * common)


def _rows(*arrays: np.ndarray) -> set[bytes]:
    """Rows of arrays side by side as their bytes."""
    rows = np.concatenate([np.ascontiguousarray(array).view(np.uint8) for array in arrays], axis=1)
    return set(rows.view(np.dtype((np.void, rows.shape[1]))).ravel().tolist())
