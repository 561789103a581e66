"""Faults of landmarks: new ids, and few seen at first."""

from dataclasses import dataclass, replace

import numpy as np

from spinfilters.data.dataset import Dataset
from spinfilters.errors import InputError
from spinfilters.simulation.faults import Fault, landmark_stream, stream_rows, with_stream


@dataclass(frozen=True)
class NewIds(Fault):
    """Landmarks bear new ids from ``start`` to before ``end`` (s).

    Each bears an id that it bears at no other time.
    """

    start: float
    end: float = np.inf

    def __post_init__(self) -> None:
        if not self.start < self.end:
            raise InputError(f"new ids from {self.start} s to {self.end} s; give an end after the start")

    def apply(self, dataset: Dataset, generator: np.random.Generator) -> Dataset:
        """The data set with other ids in the interval."""
        stream = landmark_stream(dataset)
        assert stream.ids is not None
        hit = (stream.time >= self.start) & (stream.time < self.end)
        return with_stream(dataset, replace(stream, ids=stream.ids + hit * (stream.ids.max() + 1)))


@dataclass(frozen=True)
class FewAtFirst(Fault):
    """Before ``end`` (s) only a ``fraction`` of the landmarks is seen.

    Rounded; at least one.
    """

    fraction: float
    end: float

    def __post_init__(self) -> None:
        if not 0 < self.fraction <= 1:
            raise InputError(f"fraction {self.fraction} of landmarks seen at first must lie in (0, 1]")

    def apply(self, dataset: Dataset, generator: np.random.Generator) -> Dataset:
        """The data set with few landmarks before the end."""
        stream = landmark_stream(dataset)
        assert stream.ids is not None
        ids = np.unique(stream.ids)
        seen = generator.choice(ids, max(round(self.fraction * len(ids)), 1), replace=False)
        kept = np.flatnonzero((stream.time >= self.end) | np.isin(stream.ids, seen))
        return with_stream(dataset, stream_rows(stream, kept))
