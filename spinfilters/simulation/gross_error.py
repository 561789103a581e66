"""One gross error: a single measurement of one epoch that is wrong altogether, or missing."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import multiply, quaternion_from_rotation_vector
from spinfilters.data.dataset import Dataset
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.errors import InputError
from spinfilters.sensors.sensor_registry import sensor_of
from spinfilters.simulation.faults import Fault, epoch_rows, landmark_stream, stream_rows, with_stream

MISSING: Final = "missing"
"""Kind that leaves out the measurement that the others spoil: what is left if an error is refused perfectly."""
KINDS: Final = ("outlier", "flipped", "turned", "identity", MISSING)
TURNED: Final = (0.3, np.pi)
"""Least and largest angle of a pose that is turned, rad."""
FLIPPED: Final[Mapping[str, Callable[[Float[np.ndarray, " v"]], Float[np.ndarray, " v"]]]] = MappingProxyType(
    {
        "gyro": np.negative,
        "pose": lambda pose: np.append(-pose[:3], pose[3:]),
        "stereo": lambda pixels: pixels[[2, 1, 0]],
    }
)
"""Values with a sign wrong, by sensor: rates, a place, a disparity."""


def _turned_pose(
    pose: Float[np.ndarray, "7"], rotation_vector: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "7"]:
    return np.append(pose[:3], multiply(pose[3:], quaternion_from_rotation_vector(rotation_vector)))


TURNS: Final[
    Mapping[str, Callable[[Float[np.ndarray, " v"], Float[np.ndarray, "3"]], Float[np.ndarray, " v"]]]
] = MappingProxyType({"pose": _turned_pose})
"""Values turned by a rotation vector, by sensor."""


@dataclass(frozen=True)
class GrossError(Fault):
    """One measurement of an epoch is wrong altogether.

    Attributes
    ----------
    kind: "outlier" (of the sensor's own distribution), "flipped" (a sign), "turned" (a pose), "identity" (two exchanged),
        "missing" (the measurement that these are of is left out; an epoch that has no other goes too).
    epoch: its number; negative ones count from the last.
    """

    kind: str
    epoch: int

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"a gross error {self.kind!r}; give one of {', '.join(KINDS)}")

    def apply(self, dataset: Dataset, generator: np.random.Generator) -> Dataset:
        """The data set with the error.

        InputError: an epoch or a kind that it does not have.
        """
        stream = landmark_stream(dataset) if self.kind == "identity" else dataset.log.stream(dataset.sensor)
        epochs = epoch_rows(stream)
        if not -len(epochs) <= self.epoch < len(epochs):
            raise InputError(
                f"epoch {self.epoch} is none of the {len(epochs)} of {stream.sensor} measurements"
            )
        rows = epochs[self.epoch]
        if self.kind == "identity":
            return with_stream(dataset, _exchanged(stream, rows, generator))
        values, row = stream.values.copy(), int(generator.choice(rows))
        if self.kind == MISSING:
            return with_stream(dataset, stream_rows(stream, np.delete(np.arange(len(stream)), row)))
        values[row] = self._wrong(dataset, stream, row, generator)
        return with_stream(dataset, replace(stream, values=values))

    def _wrong(
        self, dataset: Dataset, stream: MeasurementStream, row: int, generator: np.random.Generator
    ) -> Float[np.ndarray, " v"]:
        """Values in the place of a row's."""
        right, sensor = stream.values[row], stream.sensor
        if self.kind == "outlier":
            return sensor_of(sensor).outliers(1, dataset.rig, generator)[0]
        if self.kind == "flipped" and sensor in FLIPPED:
            return FLIPPED[sensor](right)
        if self.kind == "turned" and sensor in TURNS:
            axis, angle = generator.standard_normal(3), generator.uniform(*TURNED)
            return TURNS[sensor](right, angle * axis / np.linalg.norm(axis))
        raise InputError(f"no measurement of {sensor} is {self.kind}; choose another gross error")


def _exchanged(
    stream: MeasurementStream, rows: np.ndarray, generator: np.random.Generator
) -> MeasurementStream:
    """Two landmarks of these rows with each other's ids."""
    if len(rows) < 2:
        raise InputError("an epoch of one landmark has no two to exchange; choose another epoch")
    assert stream.ids is not None
    ids, two = stream.ids.copy(), generator.choice(rows, 2, replace=False)
    ids[two] = ids[two[::-1]]
    return replace(stream, ids=ids)
