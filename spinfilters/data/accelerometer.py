"""Accelerometer measurements beside the sensors of a log."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.data.measurement_log import freeze_arrays


@dataclass(frozen=True, eq=False)
class Acceleration:
    """Specific force at the sensor's place, axes of the gyro; read-only copies.

    Acceleration without gravity.

    Attributes
    ----------
    time: s, increasing, on the clock of the log.   values: (n, 3) m/s^2.
    """

    time: Float[np.ndarray, " n"]
    values: Float[np.ndarray, "n 3"]

    def __post_init__(self) -> None:
        freeze_arrays(self, ("time", "values"))

    def slice(self, start: float, end: float) -> "Acceleration | None":
        """The samples with start <= time <= end (s), None where there are none."""
        rows = np.s_[np.searchsorted(self.time, start, "left") : np.searchsorted(self.time, end, "right")]
        return Acceleration(self.time[rows], self.values[rows]) if len(self.time[rows]) else None
