"""Errors of a tracker of poses."""

from dataclasses import replace
from typing import Final

import numpy as np

from spinfilters.attitude.conversions import matrix_from_quaternion
from spinfilters.data.dataset import Dataset
from spinfilters.simulation.faults import with_stream
from spinfilters.simulation.model_faults.model_fault import AXIS, POSE, ModelFault


def _drifting(dataset: Dataset, size: float) -> Dataset:
    """The tracked point moves evenly in the body, by ``size`` m over the recording."""
    (stream,) = dataset.log.streams
    since = (stream.time - stream.time[0]) / (stream.time[-1] - stream.time[0])
    direction = matrix_from_quaternion(stream.values[:, 3:7]) @ (AXIS / np.linalg.norm(AXIS))
    values = stream.values.copy()
    values[:, :3] += size * since[:, None] * direction
    return with_stream(dataset, replace(stream, values=values))


FAULTS: Final = (ModelFault("point-drift", 0.03, (POSE,), recording=_drifting),)
