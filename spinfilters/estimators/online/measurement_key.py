"""Identity of a measurement, whenever it arrives."""

import hashlib
from typing import NamedTuple

from spinfilters.estimators.estimator import Measurement


class MeasurementKey(NamedTuple):
    """Sensor and digest of all numbers of a measurement.

    The same for the same bits only, and an order that does not depend on arrival.
    """

    sensor: str
    digest: bytes

    @classmethod
    def of(cls, measurement: Measurement) -> "MeasurementKey":
        """Key of a measurement."""
        digest = hashlib.blake2b(digest_size=16)
        for array in (measurement.values, measurement.parameters, measurement.ids):
            digest.update(b"none" if array is None else f"{array.shape}".encode() + array.tobytes())
        return cls(measurement.model.name, digest.digest())
