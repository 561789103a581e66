"""A wrong model of a recording: of its motion, its clock, its sensor or a unit."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.data.dataset import Dataset
from spinfilters.simulation.motion import Motion

AXIS: Final = np.array([0.5, -0.7, 0.5])
"""Of errors with a direction: none of the frames' axes."""
POSE, GYRO, TRACKS = "pose", "gyro", "stereo-tracks"


@dataclass(frozen=True)
class FaultyRates:
    """True body rates (s, rad/s) at and between epochs, and the error's size."""

    time: Float[np.ndarray, " k"]
    rates: Float[np.ndarray, "k 3"]
    fine: Motion
    size: float


@dataclass(frozen=True)
class FaultyView:
    """Observations of a pair of cameras, and the size of the error.

    Attributes
    ----------
    points: in the left camera at every row, m.   per_second: their velocities, m/s.   epoch: of every row.
    calibration: (fx, fy, cx, cy px, baseline m).   generator: of what is drawn by image.
    """

    points: Float[np.ndarray, "n 3"]
    per_second: Float[np.ndarray, "n 3"]
    epoch: Int[np.ndarray, " n"]
    calibration: Float[np.ndarray, " c"]
    size: float
    generator: np.random.Generator


@dataclass(frozen=True)
class ModelFault:
    """One wrong model.

    Attributes
    ----------
    name: of the alternative that describes it.   size: a plain one, in the unit of that.   kinds: of data sets that can have it.
    physics: of `faulty_motion`, per unit.   late: of epochs, s per unit, from (time, generator).
    seen: what a front end takes the true motion for, from (motion, size, generator).
    pixels, rates: change of the measured values.   recording: what becomes of the data set, at a size.
    """

    name: str
    size: float
    kinds: tuple[str, ...]
    physics: Mapping[str, Float[np.ndarray, " n"] | float] = field(default_factory=dict)
    late: Callable[[Float[np.ndarray, " k"], np.random.Generator], Float[np.ndarray, " k"]] | None = None
    seen: Callable[[Motion, float, np.random.Generator], Motion] | None = None
    pixels: Callable[[FaultyView], Float[np.ndarray, "n 3"]] | None = None
    rates: Callable[[FaultyRates], Float[np.ndarray, "k 3"]] | None = None
    recording: Callable[[Dataset, float], Dataset] | None = None
