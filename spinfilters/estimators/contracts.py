"""Contract of a recursive estimator, and an estimator that holds its latest belief."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Estimator, Measurement, ProcessModel, Snapshot, UpdateReport
from spinfilters.state.gaussian import Gaussian


@dataclass(frozen=True)
class Updated:
    """A belief after an update, and what the update did."""

    belief: Gaussian
    report: UpdateReport


class RecursiveEstimator(Protocol):
    """Recursive estimator as functions of immutable beliefs.

    The same arguments give the same belief, bit for bit.
    """

    @property
    def name(self) -> str:
        """Name of the estimator in tables and files."""
        ...

    def predict(self, belief: Gaussian, dt: float) -> Gaussian:
        """The belief dt > 0 seconds later."""
        ...

    def update(self, belief: Gaussian, measurement: Measurement) -> Updated:
        """The belief given one sensor's values at its time."""
        ...


class LatestBelief(Estimator):
    """A recursive estimator with its latest belief: what runs, checkpoints and late measurements take."""

    def __init__(self, process: ProcessModel, recursive: RecursiveEstimator) -> None:
        super().__init__(process)
        self.name, self._recursive = recursive.name, recursive
        self._belief = Gaussian(
            self.layout, self.layout.origin(), np.full((self.layout.error_dim,) * 2, np.nan)
        )

    def start(self, belief: Gaussian) -> None:
        """Begin with a belief. InputError: blocks other than the process'."""
        if belief.layout != self.layout:
            raise InputError(
                f"belief has the blocks {belief.layout.blocks}, the process has {self.layout.blocks}"
            )
        self._belief = belief

    @property
    def belief(self) -> Gaussian:
        """Latest belief."""
        return self._belief

    def predict(self, dt: float) -> None:
        """Replace the belief by its prediction ``dt`` seconds ahead."""
        self._belief = self._recursive.predict(self._belief, dt)

    def update(self, measurement: Measurement) -> UpdateReport:
        """Replace the belief by its update, and report that."""
        updated = self._recursive.update(self._belief, measurement)
        self._belief = updated.belief
        return updated.report

    def snapshot(self) -> Snapshot:
        """Copies of the belief's mean and covariance factor."""
        return {"mean": self._belief.mean.copy(), "factor": self._belief.factor.copy()}

    def restore(self, snapshot: Snapshot) -> None:
        """Take mean and covariance factor from a `snapshot`."""
        self._belief = Gaussian(self.layout, snapshot["mean"].copy(), snapshot["factor"].copy())
