"""Free flights in poses."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import spinfilters
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.run.free_flight import find_flights, flying_unit
from spinfilters.run.pose_flights import PoseLog, acceleration_of, leads_on, pose_flights, turns_on
from spinfilters.run.readers import read_dataset
from tests.run.throws import FLIGHTS, INTERVAL, carried

HALF_EDGE = 0.0524
NOISE = 5e-4


def thrown(noise: float, seed: int) -> PoseLog:
    """Poses of a frame 5 cm beside the centre of mass."""
    generator = np.random.default_rng(seed)
    log = carried(0.0, generator)
    position = log.position - log.attitude.apply([0.05, 0.0, 0.02])
    noisy = position + noise * generator.standard_normal(position.shape)
    return PoseLog.of(log.time, np.hstack([noisy, log.attitude.as_quat()]), noise)


def test_flights_are_found_with_their_bounds_and_gravity() -> None:
    log = thrown(NOISE, 3)
    found = pose_flights(log)
    assert len(found) == len(FLIGHTS)
    for stretch, (start, end) in zip(found, FLIGHTS, strict=True):
        assert log.time[stretch.start] == pytest.approx(start, abs=8 * INTERVAL)
        assert log.time[stretch.end - 1] == pytest.approx(end, abs=8 * INTERVAL)
        acceleration, error = acceleration_of(log, stretch)
        np.testing.assert_allclose(acceleration, [0, 0, -9.81], atol=0.1)
        assert error < 2 * NOISE


def test_a_body_at_rest_or_in_a_hand_does_not_fly() -> None:
    time = np.arange(0, 4, INTERVAL)
    generator = np.random.default_rng(4)
    still = np.hstack(
        [NOISE * generator.standard_normal((len(time), 3)), np.tile([0, 0, 0, 1.0], (len(time), 1))]
    )
    assert pose_flights(PoseLog.of(time, still, NOISE)) == []
    waving = still.copy()
    waving[:, :3] += 0.2 * np.sin(time[:, None] * [3.0, 4.0, 5.0])
    waving[:, 3:] = Rotation.from_rotvec(np.outer(time, [1.0, 2.0, 0.5])).as_quat()
    assert pose_flights(PoseLog.of(time, waving, NOISE)) == []


@pytest.mark.parametrize(("length", "advice"), [(1e3, "in mm"), (1e7, "")])
def test_poses_in_another_unit_are_told_from_those_without_flight(length: float, advice: str) -> None:
    log = thrown(NOISE, 3)
    values = np.hstack([length * log.position, Rotation.from_matrix(log.attitude).as_quat()])
    stream = MeasurementStream("pose", log.time, values)
    dataset = Dataset(kind="pose", log=MeasurementLog((stream,)))
    assert not find_flights(dataset)
    assert advice in flying_unit(dataset)
    assert bool(advice) == bool(flying_unit(dataset))


def test_a_body_in_orbit_flies_all_the_time() -> None:
    stream = spinfilters.simulate("pose", seed=5, frames=60).log.stream("pose")
    (stretch,) = pose_flights(PoseLog.of(stream.time, stream.values, 0.005))
    assert len(stretch) == 60


def test_a_rotation_that_jumps_ends_a_flight_before_its_place_tells() -> None:
    time, generator = 0.01 * np.arange(40), np.random.default_rng(2)
    angle = np.where(time < 0.355, 3.0 * time, 3.0 * time + 1.0 * (time - 0.355))
    turned = np.outer(angle, [0.6, 0.0, 0.8]) + 1e-4 * generator.standard_normal((40, 3))
    attitude = Rotation.from_rotvec(turned).as_matrix()
    good = turns_on(time, attitude, 6)
    assert good[:36].all()
    assert not good[36]
    assert turns_on(time[:36], attitude[:36], 6).all()


@pytest.mark.parametrize("backwards", [False, True])
def test_a_hand_that_lets_go_slowly_is_no_part_of_a_flight(backwards: bool) -> None:
    time, generator = 0.0068 * np.arange(22), np.random.default_rng(3)
    rate = np.where(time < 0.02, 4.0 - 1.0 * (0.02 - time) / 0.02, 4.0)
    angle = np.concatenate([[0.0], np.cumsum(rate[:-1] * np.diff(time))])
    turned = np.outer(angle, [0.6, 0.0, 0.8]) + 2e-4 * generator.standard_normal((22, 3))
    attitude = Rotation.from_rotvec(turned[::-1] if backwards else turned).as_matrix()
    good = leads_on(time, attitude, 4)
    assert (good[::-1] if backwards else good).tolist() == 3 * [False] + 19 * [True]


def test_a_rotation_that_wobbles_leads_on_to_its_ends() -> None:
    time = 0.01 * np.arange(60)
    for speed in (0.5, 5.0, 20.0):
        wobble = np.stack([np.cos(0.4 * speed * time), np.sin(0.4 * speed * time), 0 * time], axis=1)
        step = Rotation.from_rotvec(speed * 0.01 * (0.5 * wobble + [0.0, 0.0, 0.8]))
        attitude = [Rotation.identity()]
        for each in step[:-1]:
            attitude.append(attitude[-1] * each)
        log = Rotation.concatenate(attitude).as_matrix()
        assert leads_on(time, log, 8).all()


def test_a_thrown_cube_flies_until_it_touches_the_ground(shared_data: Callable[[str], Path]) -> None:
    folder = shared_data("contactnets_cube_tosses")
    corners = HALF_EDGE * np.array(json.loads((folder / "experiment.json").read_text())["vertices"])
    late, gravity = [], []
    for path in sorted(folder.glob("*.csv"))[::3]:
        stream = read_dataset(path).log.stream("pose")
        log = PoseLog.of(stream.time, stream.values, None)
        first = pose_flights(log)[0]
        heights = [(log.attitude @ corner + log.position)[:, 2] for corner in corners]
        lowest = np.min(heights, axis=0)
        contact = int(np.flatnonzero(lowest < np.median(lowest[-15:]) + 0.0015)[0])
        late.append(first.end - contact)
        gravity.append(np.linalg.norm(acceleration_of(log, first)[0]))
    print(f"end of flight after contact, samples: {late}; acceleration {np.mean(gravity):.2f}")
    assert np.abs(late).max() <= 1
    assert np.median(late) == 0
    assert np.mean(gravity) == pytest.approx(9.81, rel=0.03)
