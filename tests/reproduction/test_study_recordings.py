"""What the thesis' comparisons are made of: stabilised tracks, published noise, sizes of a map."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import rotate
from spinfilters.reproduction.tweddle.camera_checkout import DELIVERY, TURN, rigs
from spinfilters.reproduction.tweddle.comparative_studies import stabilised
from spinfilters.reproduction.tweddle.noise_and_charts import published_covariance
from spinfilters.reproduction.tweddle.replaced_recordings import landmark_bounds
from spinfilters.simulation.scenario import Scenario, simulate
from spinfilters.vision.calibration_checkout import rotation_change


def test_stabilised_tracks_are_those_of_the_first_camera() -> None:
    scenario = Scenario.simplified(epochs=8, landmarks=60, inspector="dead-band")
    dataset = simulate(replace(scenario, pixel_std=1e-6))
    truth, known, rig = dataset.truth, dataset.known_map, dataset.rig
    assert truth is not None
    assert known is not None
    assert rig is not None
    assert truth.center_of_mass_g is not None
    stream = stabilised(dataset).log.stream("stereo")
    assert stream.ids is not None
    assert stabilised(dataset).inspector is None
    rows = np.searchsorted(truth.time, stream.time - 1e-9)
    points = known.points[np.searchsorted(known.ids, stream.ids)] - truth.center_of_mass_g
    seen = rotate(truth.q_ig[rows], points) + truth.center_of_mass[rows]
    fx, fy, cx, cy, baseline = rig.calibration[:5]
    u, v = fx * seen[:, 0] / seen[:, 2] + cx, fy * seen[:, 1] / seen[:, 2] + cy
    expected = np.column_stack([u, v, u - fx * baseline / seen[:, 2]])
    np.testing.assert_allclose(stream.values, expected, atol=1e-3)


def test_a_recording_without_an_inspector_stays_as_it_is() -> None:
    dataset = simulate(Scenario.simplified(epochs=5, landmarks=40))
    assert stabilised(dataset) is dataset


def test_the_rigs_of_the_checkout_differ_as_printed() -> None:
    before, after = rigs()
    assert before.relative_position[0] == pytest.approx(1e-2 * DELIVERY[2][0])
    angle, axis = rotation_change(before, after)
    np.testing.assert_allclose(angle * axis, TURN, atol=1e-12)


def test_the_published_noise_of_a_short_step_is_that_of_a_random_walk() -> None:
    Q = published_covariance(1e-3)
    np.testing.assert_allclose(np.diag(Q)[3:], 1e-6 * 1e-3, rtol=1e-3)
    np.testing.assert_allclose(np.diag(Q)[:3], 1e-6 * 1e-9 / 3, rtol=1e-3)


def test_the_bound_of_a_landmark_is_that_of_its_pixels_at_known_poses() -> None:
    dataset = simulate(Scenario(epochs=12, landmarks=200))
    truth, known, rig = dataset.truth, dataset.known_map, dataset.rig
    assert truth is not None
    assert known is not None
    assert rig is not None
    assert truth.center_of_mass_g is not None
    stream = dataset.log.stream("stereo")
    assert stream.ids is not None
    one = int(np.bincount(stream.ids).argmax())
    place = known.points[np.searchsorted(known.ids, one)] - truth.center_of_mass_g
    rows = np.searchsorted(truth.time, stream.time[stream.ids == one] - 1e-9)
    fx, fy, _, _, baseline = rig.calibration[:5]

    def pixels(point: np.ndarray) -> np.ndarray:
        seen = rotate(truth.q_ig[rows], np.tile(point, (len(rows), 1))) + truth.center_of_mass[rows]
        x, y, z = seen.T
        return np.concatenate([fx * x / z, fy * y / z, fx * (x - baseline) / z])

    size = 1e-6
    slopes = np.stack(
        [(pixels(place + e) - pixels(place - e)) / (2 * size) for e in size * np.eye(3)], axis=1
    )
    expected = np.linalg.inv(slopes.T @ slopes) * Scenario().pixel_std ** 2
    np.testing.assert_allclose(landmark_bounds(dataset, np.array([one]))[0], expected, rtol=1e-6)
