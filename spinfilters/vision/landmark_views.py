"""Landmarks of a body with descriptors by viewing direction."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

VIEWS: Final = 6
"""Descriptors kept of a landmark."""
NEW_VIEW: Final = float(np.cos(np.deg2rad(12)))
"""Cosine of the angle to all kept views beyond which a view is kept too."""
WIDEST_VIEW: Final = float(np.cos(np.deg2rad(52)))
"""Cosine of the angle between directions from which a descriptor may be recognised."""


class LandmarkViews:
    """Landmarks in frame g with descriptors by viewing direction.

    0, 1, 2 ...; weighted means of their observations.

    Attributes
    ----------
    count: of landmarks.   last_seen: (count,) epoch.   observations: (count,).
    """

    def __init__(self, descriptor_dim: int) -> None:
        self.count = 0
        self._information = np.zeros((0, 3, 3))
        self._vector = np.zeros((0, 3))
        self._points = np.zeros((0, 3))
        self._covariance = np.zeros((0, 3, 3))
        self._descriptors = np.zeros((0, VIEWS, descriptor_dim), dtype=np.float32)
        self._directions = np.zeros((0, VIEWS, 3))
        self._kept = np.zeros(0, dtype=int)
        self._last_seen = np.zeros(0, dtype=int)
        self._observations = np.zeros(0, dtype=int)
        self._retired = np.zeros(0, dtype=bool)

    @property
    def points(self) -> Float[np.ndarray, "k 3"]:
        """Positions, m."""
        return self._points[: self.count]

    @property
    def covariance(self) -> Float[np.ndarray, "k 3 3"]:
        """Covariances of the positions, m^2; errors of the poses are not in them."""
        return self._covariance[: self.count]

    @property
    def last_seen(self) -> Int[np.ndarray, " k"]:
        """Latest epoch of each."""
        return self._last_seen[: self.count]

    @property
    def observations(self) -> Int[np.ndarray, " k"]:
        """Number of observations of each."""
        return self._observations[: self.count]

    @property
    def active(self) -> Bool[np.ndarray, " k"]:
        """Landmarks to be looked for: all that are no second number of another."""
        return ~self._retired[: self.count]

    def retire(self, rows: Int[np.ndarray, " n"]) -> None:
        """Look for these no longer."""
        self._retired[rows] = True

    def add(self, count: int) -> Int[np.ndarray, " n"]:
        """Numbers of so many new landmarks."""
        first, self.count = self.count, self.count + count
        if self.count > len(self._points):
            self._grow(max(self.count, 2 * len(self._points), 512))
        return np.arange(first, self.count)

    def observe(
        self,
        rows: Int[np.ndarray, " n"],
        epoch: int,
        points: Float[np.ndarray, "n 3"],
        covariance: Float[np.ndarray, "n 3 3"],
    ) -> None:
        """Take observations of different landmarks into their means (frame g, m)."""
        information = np.linalg.inv(covariance)
        self._information[rows] += information
        self._vector[rows] += np.einsum("nij,nj->ni", information, points)
        self._covariance[rows] = np.linalg.inv(self._information[rows])
        self._points[rows] = np.einsum("nij,nj->ni", self._covariance[rows], self._vector[rows])
        self._last_seen[rows] = epoch
        self._observations[rows] += 1

    def look(
        self,
        rows: Int[np.ndarray, " n"],
        directions: Float[np.ndarray, "n 3"],
        descriptors: Float[np.ndarray, "n d"],
    ) -> None:
        """Store the landmarks' descriptors from new viewing directions.

        Unit, frame g, from the landmark to the camera.
        """
        cosines = np.einsum("nvi,ni->nv", self._directions[rows], directions)
        new = np.where(np.arange(VIEWS) < self._kept[rows, None], cosines, -1.0).max(axis=1) < NEW_VIEW
        chosen = rows[new]
        place = self._kept[chosen] % VIEWS
        self._descriptors[chosen, place], self._directions[chosen, place] = descriptors[new], directions[new]
        self._kept[chosen] = np.where(self._kept[chosen] < VIEWS, self._kept[chosen] + 1, VIEWS)

    def seen_from(
        self, rows: Int[np.ndarray, " n"], directions: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n d"], Bool[np.ndarray, " n"]]:
        """Descriptors of the views nearest to these directions, and which are near enough to be recognised."""
        cosines = np.einsum("nvi,ni->nv", self._directions[rows], directions)
        cosines = np.where(np.arange(VIEWS) < self._kept[rows, None], cosines, -2.0)
        best = cosines.argmax(axis=1)
        return self._descriptors[rows, best], cosines[np.arange(len(rows)), best] >= WIDEST_VIEW

    def latest_view(self, rows: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n d"]:
        """Descriptors of the views kept last."""
        return self._descriptors[rows, np.maximum(self._kept[rows] - 1, 0)]

    def _grow(self, size: int) -> None:
        for name, array in list(vars(self).items()):
            if isinstance(array, np.ndarray):
                larger = np.zeros((size, *array.shape[1:]), dtype=array.dtype)
                larger[: len(array)] = array
                setattr(self, name, larger)


def second_numbers(
    similarity: Float[np.ndarray, "n m"],
    rows: Int[np.ndarray, " m"],
    expected: Float[np.ndarray, "m 3"],
    least: float,
    farthest: float,
) -> Int[np.ndarray, " k"]:
    """Columns of landmarks that duplicate an older one from another side.

    Both are at one place and look like one feature.
    A point that leaves on one rim and comes back on the other is not recognised at once, and is given a second number there.

    Parameters
    ----------
    similarity: of features to landmarks.   rows: numbers of the landmarks.   expected: their pixels.
    least: similarity.   farthest: largest distance, px.
    """
    feature, column = np.nonzero(similarity >= least)
    best = similarity.argmax(axis=1)[feature]
    apart = np.abs(expected[column] - expected[best]).max(axis=1)
    same = (column != best) & (apart <= farthest)
    return np.unique(np.where(rows[column] > rows[best], column, best)[same])
