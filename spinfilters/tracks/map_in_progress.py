"""Map under construction from observations with wrong associations."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

AGREEMENT = 6.0
"""Mahalanobis distance within which an observation belongs to a candidate; it leaves room for the drift of poses."""
CHOSEN, ALTERNATIVE = 0, 1


@dataclass
class MapInProgress:
    """Information sums of every landmark. Its point is the information-weighted mean of the observations that agree.

    An observation is poor along its line of sight, so points seen from several sides are far better than any one observation. Each
    landmark has two candidates. An observation joins the chosen one if it agrees with it, else the alternative, else it becomes the
    alternative of
    a landmark whose alternative nothing has confirmed. The one with more observations is the chosen one: a landmark whose first
    observation was
    a wrong association is so found again as soon as two later ones agree.

    Attributes
    ----------
    ids: (n,) ascending.   information: (n, 2, 3, 3) 1/m^2, frame g.   weighted: (n, 2, 3) information times point.
    hits: (n, 2) observations of each candidate.
    """

    ids: Int[np.ndarray, " n"]
    information: Float[np.ndarray, "n 2 3 3"]
    weighted: Float[np.ndarray, "n 2 3"]
    hits: Int[np.ndarray, "n 2"]

    @classmethod
    def empty(cls, ids: Int[np.ndarray, " n"]) -> "MapInProgress":
        """Map without an observation."""
        n = len(ids)
        return cls(ids, np.zeros((n, 2, 3, 3)), np.zeros((n, 2, 3)), np.zeros((n, 2), dtype=int))

    @property
    def seen(self) -> Bool[np.ndarray, " n"]:
        """Which landmarks have a point."""
        return self.hits[:, CHOSEN] > 0

    def points(
        self, where: Int[np.ndarray, " k"]
    ) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3 3"]]:
        """Points (m, frame g) and covariances of landmarks that have one."""
        return self._candidates(where, CHOSEN)

    def add(
        self,
        where: Int[np.ndarray, " k"],
        information: Float[np.ndarray, "k 3 3"],
        points: Float[np.ndarray, "k 3"],
    ) -> None:
        """Observations of distinct landmarks ``where``, as points in g with their information."""
        vacant = self.hits[where] == 0
        chosen = vacant[:, CHOSEN] | self._agrees(where, CHOSEN, information, points)
        alternative = ~chosen & self._agrees(where, ALTERNATIVE, information, points)
        fresh = ~chosen & ~alternative & (self.hits[where, ALTERNATIVE] <= 1)
        self.information[where[fresh], ALTERNATIVE] = 0.0
        self.weighted[where[fresh], ALTERNATIVE] = 0.0
        self.hits[where[fresh], ALTERNATIVE] = 0
        weighted = (information @ points[..., None])[..., 0]
        for candidate, rows in ((CHOSEN, chosen), (ALTERNATIVE, alternative | fresh)):
            self.information[where[rows], candidate] += information[rows]
            self.weighted[where[rows], candidate] += weighted[rows]
            self.hits[where[rows], candidate] += 1
        self._elect(where)

    def _elect(self, where: Int[np.ndarray, " k"]) -> None:
        better = where[self.hits[where, ALTERNATIVE] > self.hits[where, CHOSEN]]
        for sums in (self.information, self.weighted, self.hits):
            sums[better] = sums[better][:, ::-1]

    def _candidates(self, where: np.ndarray, candidate: int) -> tuple[np.ndarray, np.ndarray]:
        covariance = np.linalg.inv(self.information[where, candidate])
        return (covariance @ self.weighted[where, candidate][..., None])[..., 0], covariance

    def _agrees(
        self, where: np.ndarray, candidate: int, information: np.ndarray, points: np.ndarray
    ) -> Bool[np.ndarray, " k"]:
        result = self.hits[where, candidate] > 0
        held = np.flatnonzero(result)
        there, covariance = self._candidates(where[held], candidate)
        away = points[held] - there
        spread = covariance + np.linalg.inv(information[held])
        distance = np.einsum("ki,ki->k", away, np.linalg.solve(spread, away[..., None])[..., 0])
        result[held] = distance < AGREEMENT**2
        return result
