"""Simulated recordings with one wrong model, and the table of all that can be wrong."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.dataset import Dataset
from spinfilters.simulation.faults import with_stream
from spinfilters.simulation.model_faults import (
    body_disturbances,
    camera_faults,
    clock_faults,
    front_end_faults,
    gyro_faults,
    pose_faults,
)
from spinfilters.simulation.model_faults.faulty_motion import Physics, faulty_motion, motion_at
from spinfilters.simulation.model_faults.model_fault import FaultyRates, FaultyView, ModelFault
from spinfilters.simulation.motion import Motion
from spinfilters.simulation.scenario import Scenario, measured

MODEL_FAULTS: Final[tuple[ModelFault, ...]] = (
    *body_disturbances.FAULTS,
    *camera_faults.FAULTS,
    *clock_faults.FAULTS,
    *front_end_faults.FAULTS,
    *gyro_faults.FAULTS,
    *pose_faults.FAULTS,
)
"""Every model of a recording that can be wrong."""
STEP = 1e-3
"""Between two views that tell how fast points move, s."""


def model_faults() -> Mapping[str, ModelFault]:
    """All by name."""
    return MappingProxyType({fault.name: fault for fault in MODEL_FAULTS})


def faulty_recording(
    scenario: Scenario, fault: ModelFault, size: float, seeds: tuple[np.random.SeedSequence, ...]
) -> Dataset:
    """A recording with a fault of a size in its unit.

    What is drawn comes from (motion, measurements, faults).
    The motion, the surface and the sensors' noise are drawn alike whatever the fault.
    """
    motion, values, own = seeds
    time, drawn = scenario.interval * np.arange(scenario.epochs), np.random.default_rng(own)
    late = np.zeros(len(time)) if fault.late is None else size * fault.late(time, drawn)
    physics = Physics.of(fault.physics, size)
    fine = faulty_motion(scenario, physics, np.random.default_rng(motion), max(float(late.max()), 0.0))
    truth = motion_at(fine, time)
    dataset = measured(scenario, truth, np.random.default_rng(values))
    if fault.late is not None:
        moved = Motion(truth.layout, time, motion_at(fine, np.maximum(time + late, fine.time[0])).states)
        dataset = replace(dataset, log=measured(scenario, moved, np.random.default_rng(values)).log)
    if fault.seen is not None:
        taken = fault.seen(truth, size, drawn)
        dataset = replace(dataset, log=measured(scenario, taken, np.random.default_rng(values)).log)
    stream = dataset.log.streams[0]
    if fault.rates is not None:
        rates = FaultyRates(time, truth.block("w"), fine, size)
        dataset = with_stream(dataset, replace(stream, values=stream.values + fault.rates(rates)))
    if fault.pixels is not None:
        pixels = fault.pixels(_view(dataset, fine, size, drawn))
        dataset = with_stream(dataset, replace(stream, values=stream.values + pixels))
    return dataset if fault.recording is None else fault.recording(dataset, size)


def _view(dataset: Dataset, fine: Motion, size: float, generator: np.random.Generator) -> FaultyView:
    stream, known, rig = dataset.log.streams[0], dataset.known_map, dataset.rig
    assert known is not None
    assert rig is not None
    assert stream.ids is not None
    own = known.points[np.searchsorted(known.ids, stream.ids)]
    points = _seen(motion_at(fine, stream.time), own)
    later = _seen(motion_at(fine, stream.time + STEP), own)
    epoch = np.searchsorted(np.unique(stream.time), stream.time)
    return FaultyView(points, (later - points) / STEP, epoch, rig.calibration, size, generator)


def _seen(motion: Motion, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return motion.block("t") + np.einsum("kij,kj->ki", motion.rotations, points)
