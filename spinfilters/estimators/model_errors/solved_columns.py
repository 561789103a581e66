"""What the columns of right-hand sides become while a linearised smoothing problem is solved for them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


def flat(part: Float[np.ndarray, "a b m"]) -> Float[np.ndarray, "c m"]:
    """All rows of a part below one another."""
    return part.reshape(-1, part.shape[2])


@dataclass(frozen=True)
class Gradient:
    """J'H: (k, d, m) of moving components, (c, m) of constants, (L, 3, m) of landmarks."""

    moving: Float[np.ndarray, "k d m"]
    constant: Float[np.ndarray, "c m"]
    landmarks: Float[np.ndarray, "L 3 m"]

    @classmethod
    def joined(cls, parts: "Sequence[Gradient]") -> "Gradient":
        """Side by side."""
        return cls(
            np.concatenate([each.moving for each in parts], axis=2),
            np.concatenate([each.constant for each in parts], axis=1),
            np.concatenate([each.landmarks for each in parts], axis=2),
        )


@dataclass(frozen=True)
class HalfSolved:
    """A^-1 b with J'J = A A', by blocks.

    (L, 3, m) of landmarks, (k, v, m) of chained errors, (n, m) of poses and constants.
    """

    landmarks: Float[np.ndarray, "L 3 m"]
    chained: Float[np.ndarray, "k v m"]
    kept: Float[np.ndarray, "n m"]

    @property
    def gram(self) -> Float[np.ndarray, "m m"]:
        """b'P b."""
        parts = (flat(self.landmarks), flat(self.chained), self.kept)
        return sum((part.T @ part for part in parts), np.zeros((self.kept.shape[1],) * 2))


@dataclass(frozen=True)
class Sensitivity:
    """Errors of a solution by m right-hand sides.

    Attributes
    ----------
    states: (k, n, m) of every epoch, components in the order of the layout.   landmarks: (L, 3, m), zero of those not told.
    """

    states: Float[np.ndarray, "k n m"]
    landmarks: Float[np.ndarray, "L 3 m"]
