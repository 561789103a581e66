"""Recordings whose models are wrong in one known way."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from spinfilters.core.mass_distribution import inertia_matrix
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.models.process import ProcessNoise
from spinfilters.simulation.model_faults import (
    GYRO,
    POSE,
    TRACKS,
    Physics,
    faulty_motion,
    faulty_recording,
    model_faults,
)
from spinfilters.simulation.scenario import RICH_RPM, Scenario
from spinfilters.verdict.model_errors.alternatives import table

SCENARIO = Scenario.simplified(
    kind=POSE, principal_moments=(1.0, 0.8, 0.55), rate_rpm=RICH_RPM, epochs=8, interval=0.4, landmarks=30
)
UNITS = {"clock-unit", "gyro-unit", "length-unit"}
PLACED = {"contact-amid", "slip"}
"""Faults that are looked for where a recording shows them."""


def recording(name: str, kind: str, size: float) -> Dataset:
    """With a fault of a size in its unit, always of the same draws."""
    seeds = tuple(np.random.SeedSequence(5).spawn(3))
    return faulty_recording(replace(SCENARIO, kind=kind), model_faults()[name], size, seeds)


def test_every_fault_is_one_that_a_verdict_can_name() -> None:
    assert len(model_faults()) >= 25
    assert set(model_faults()) <= set(table()) | UNITS | PLACED
    for fault in model_faults().values():
        assert fault.size > 0
        assert set(fault.kinds) <= {POSE, GYRO, TRACKS}


@cache
def right(kind: str) -> MeasurementStream:
    """Measurements of right models."""
    (stream,) = recording("torque", kind, 1e-12).log.streams
    return stream


@pytest.mark.parametrize("name", list(model_faults()))
def test_a_fault_changes_what_is_recorded(name: str) -> None:
    fault = model_faults()[name]
    dataset = recording(name, fault.kinds[0], 3 * fault.size)
    (stream,), plain = dataset.log.streams, right(fault.kinds[0])
    later = not np.array_equal(stream.time, plain.time)
    assert later or np.abs(stream.values - plain.values).max() > 1e-5


@pytest.mark.parametrize("name", ["rotor", "clock-drift", "gyro-low-pass", "distortion"])
def test_a_fault_of_no_size_changes_nothing(name: str) -> None:
    kind = model_faults()[name].kinds[-1]
    (stream,) = recording(name, kind, 1e-12).log.streams
    np.testing.assert_allclose(stream.values, right(kind).values, atol=1e-5)


@pytest.mark.parametrize("name", ["loss", "hinge"])
def test_what_moves_inside_keeps_the_size_of_the_momentum(name: str) -> None:
    value = {"loss": 0.3, "hinge": 0.3 * np.diag([0.5, -0.2, 0.1]).ravel()}[name]
    quiet = replace(SCENARIO, noise=ProcessNoise(0.0, 0.0))
    physics = Physics.of({name: value}, 1.0)
    fine = faulty_motion(quiet, physics, np.random.default_rng(0))
    J, end = inertia_matrix(fine.block("s")[0]), quiet.interval * (quiet.epochs - 1)
    inside = (fine.time >= 0) & (fine.time <= end)
    share, w = fine.time[inside] / end - 0.5, fine.block("w")[inside]
    opened = J + share[:, None, None] * np.max(J) * physics.hinge.reshape(3, 3)
    h = np.einsum("kij,kj->ki", opened, w)
    sizes, energy = np.linalg.norm(h, axis=1), np.einsum("ki,ki->k", h, w)
    assert np.ptp(sizes) < 1e-3 * sizes[0]
    assert np.ptp(energy) > 3e-3 * energy[0]


def test_a_late_clock_reads_the_motion_behind_the_last_epoch() -> None:
    scenario, motion = replace(SCENARIO, kind=GYRO), np.random.SeedSequence(5).spawn(3)[0]
    (stream,) = recording("clock-drift", GYRO, 3.0).log.streams
    short, long = (
        faulty_motion(scenario, Physics(), np.random.default_rng(motion), more) for more in (0.0, 3.0)
    )
    np.testing.assert_array_equal(long.states[: len(short.time)], short.states)
    late = np.searchsorted(long.time, stream.time[-1] + 3.0 - 1e-9)
    assert np.abs(stream.values[-1] - long.block("w")[late]).max() < 5 * scenario.gyro_std
    assert np.abs(stream.values[-1] - short.block("w")[-1]).max() > 0.1
