"""What a run leaves behind, and how it gathers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from spinfilters.errors import ShapeError
from spinfilters.estimators.estimator import UpdateReport
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import StateLayout
from spinfilters.state.status import EstimatorStatus

COUNTS = ("dof", "accepted", "rejected")
"""Arrays of a history that hold whole numbers."""


class _Row(NamedTuple):
    """One frame of a history."""

    time: float
    mean: Float[np.ndarray, " m"]
    factor: Float[np.ndarray, "e e"]
    nis: float
    log_likelihood: float
    runtime: float
    dof: int
    accepted: int
    rejected: int


FRAME_ARRAYS = _Row._fields
"""Arrays of a history; each has a row per frame."""


@dataclass(frozen=True)
class EstimateHistory:
    """Beliefs after every frame, and what each frame cost.

    Attributes
    ----------
    name: of the estimator.   layout: of its state.
    time: (n,) s.   mean: (n, mean_dim).   factor: (n, error_dim, error_dim), P = factor factor'.
    nis, dof: (n,) normalised innovation squared of each frame and its degrees of freedom.
    log_likelihood: (n,) of each frame's measurements given everything before.
    accepted, rejected: (n,) measurements used and left out.
    runtime: (n,) s per frame, prediction and update.
    """

    name: str
    layout: StateLayout
    time: Float[np.ndarray, " n"]
    mean: Float[np.ndarray, "n m"]
    factor: Float[np.ndarray, "n e e"]
    nis: Float[np.ndarray, " n"]
    dof: Int[np.ndarray, " n"]
    log_likelihood: Float[np.ndarray, " n"]
    accepted: Int[np.ndarray, " n"]
    rejected: Int[np.ndarray, " n"]
    runtime: Float[np.ndarray, " n"]
    status: EstimatorStatus

    def belief(self, index: int) -> Gaussian:
        """Belief after the frame of this index."""
        return Gaussian(self.layout, self.mean[index], self.factor[index])

    @property
    def covariance(self) -> Float[np.ndarray, "n e e"]:
        """Error covariance after every frame."""
        return self.factor @ np.swapaxes(self.factor, 1, 2)

    @property
    def std(self) -> Float[np.ndarray, "n e"]:
        """Standard deviation of every error component after every frame."""
        return np.sqrt(np.einsum("tij,tij->ti", self.factor, self.factor))


class GrowingHistory:
    """The frames of a run so far: grows by one frame at a time, and goes into a file and comes back as plain arrays.

    Parameters
    ----------
    layout: of the state.
    begin: time from which the run sets out, s.
    """

    def __init__(self, layout: StateLayout, begin: float) -> None:
        self.layout, self.begin = layout, begin
        self._rows: list[_Row] = []

    @classmethod
    def from_arrays(
        cls, layout: StateLayout, begin: float, arrays: Mapping[str, np.ndarray]
    ) -> "GrowingHistory":
        """The history whose `arrays` these are. Raises ShapeError when they do not fit together."""
        rows, checked = cls(layout, begin), checked_frames(layout, arrays)
        rows._rows = [_Row(*row) for row in zip(*checked.values(), strict=True)]
        return rows

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def time(self) -> float:
        """Of the last frame, or where the run sets out, s."""
        return float(self._rows[-1].time) if self._rows else self.begin

    @property
    def belief(self) -> Gaussian | None:
        """Belief after the last frame; None before the first."""
        return Gaussian(self.layout, self._rows[-1].mean, self._rows[-1].factor) if self._rows else None

    def append(self, time: float, belief: Gaussian, reports: Sequence[UpdateReport], runtime: float) -> None:
        """Add the frame at ``time`` (s) with what its updates reported; it took ``runtime`` seconds."""
        row = _Row(
            time=time,
            mean=belief.mean,
            factor=belief.factor,
            nis=sum(report.nis for report in reports),
            log_likelihood=sum(report.log_likelihood for report in reports),
            runtime=runtime,
            dof=sum(report.dof for report in reports),
            accepted=sum(report.accepted for report in reports),
            rejected=sum(report.rejected for report in reports),
        )
        self._rows.append(row)  # in one step: Ctrl-C finds the frame there or not

    def arrays(self) -> dict[str, np.ndarray]:
        """Every array of `FRAME_ARRAYS`, a row per frame."""
        shapes = _row_shapes(self.layout)
        columns = zip(*self._rows, strict=True) if self._rows else [()] * len(FRAME_ARRAYS)
        return {
            name: np.array(column, dtype=int if name in COUNTS else float).reshape(-1, *shapes.get(name, ()))
            for name, column in zip(FRAME_ARRAYS, columns, strict=True)
        }

    def ended(self, name: str, status: EstimatorStatus) -> EstimateHistory:
        """The history of the estimator of this name, when its run has come to an end."""
        return EstimateHistory(name=name, layout=self.layout, status=status, **self.arrays())


def checked_frames(layout: StateLayout, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays of a history, each with as many rows as the others.

    Raises
    ------
    ShapeError: one is missing, or has another shape or kind of number than a history over this layout.
    """
    missing = [name for name in FRAME_ARRAYS if name not in arrays]
    if missing:
        raise ShapeError(f"{', '.join(missing)} is missing")
    shapes, count = _row_shapes(layout), arrays["time"].shape[:1]
    for name in FRAME_ARRAYS:
        array, wanted = arrays[name], np.dtype(int if name in COUNTS else float)
        if array.shape != (*count, *shapes.get(name, ())) or array.dtype.kind != wanted.kind or not count:
            raise ShapeError(
                f"{name} is {array.dtype} of shape {array.shape}, which does not fit {layout.blocks}"
            )
        if name in COUNTS and (array < 0).any():
            raise ShapeError(f"{name} counts less than nothing")
    return {name: arrays[name] for name in FRAME_ARRAYS}


def _row_shapes(layout: StateLayout) -> dict[str, tuple[int, ...]]:
    """Shapes of a row of the arrays that hold more than a number per frame."""
    return {"mean": (layout.mean_dim,), "factor": (layout.error_dim, layout.error_dim)}
