"""Simulated data: the same from the same seed, with the noise that was asked for, of the motion that it says."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.attitude.conversions import matrix_from_quaternion
from spinfilters.dynamics.mass_distribution import inertia_matrix
from spinfilters.errors import InputError
from spinfilters.evaluation.consistency import true_states
from spinfilters.logs.dataset import Dataset
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensors.stereo_landmark import StereoLandmark, stereo_parameters
from spinfilters.simulation.motion import simulate_motion
from spinfilters.simulation.scenario import KINDS, RIG, Scenario, simulate
from spinfilters.state.layout import FULL_BLOCKS, StateLayout

FULL = StateLayout(FULL_BLOCKS)
SHORT = Scenario(frames=20)


def _states(dataset: Dataset) -> np.ndarray:
    assert dataset.truth is not None
    return true_states(dataset.truth, FULL)


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_gives_the_same_data_again_and_another_seed_other_data(kind: str) -> None:
    scenario = replace(SHORT, kind=kind)
    first, again, other = simulate(scenario), simulate(scenario), simulate(replace(scenario, seed=1))
    for here, there in zip(first.log.streams, again.log.streams, strict=True):
        np.testing.assert_array_equal(here.time, there.time)
        np.testing.assert_array_equal(here.values, there.values)
    np.testing.assert_array_equal(_states(first), _states(again))
    count = min(len(first.log.streams[0].values), len(other.log.streams[0].values))
    assert not np.allclose(first.log.streams[0].values[:count], other.log.streams[0].values[:count])
    assert not np.allclose(_states(first), _states(other))


def _whitened_noise(dataset: Dataset, scenario: Scenario) -> np.ndarray:
    """Measured minus true over the standard deviation asked for."""
    stream, states = dataset.log.streams[0], _states(dataset)
    rows = np.searchsorted(np.unique(stream.time), stream.time)
    if scenario.kind == "gyro":
        return (stream.values - states[:, FULL.mean_slice("w")]) / scenario.gyro_std
    if scenario.kind == "pose":
        small = StateLayout(("t", "a"))
        exact = np.concatenate([states[:, FULL.mean_slice("t")], states[:, FULL.mean_slice("a")]], axis=1)
        std = np.repeat([scenario.position_std, scenario.rotation_std], 3)
        return small.local(exact, stream.values) / std
    assert dataset.known_map is not None
    assert stream.ids is not None
    parameters = stereo_parameters(dataset.known_map.points[stream.ids], RIG.calibration, 1.0)
    return (stream.values - StereoLandmark(FULL).predict(states[rows], parameters)) / scenario.pixel_std


@pytest.mark.parametrize(
    "scenario",
    [
        Scenario(frames=40, pixel_std=0.6),
        Scenario(kind="pose", frames=400, position_std=0.002, rotation_std=0.03),
        Scenario(kind="gyro", frames=400, gyro_std=0.01),
    ],
    ids=lambda scenario: scenario.kind,
)
def test_measurements_carry_the_noise_that_was_asked_for(scenario: Scenario) -> None:
    noise = _whitened_noise(simulate(scenario), scenario)
    count = noise.size
    assert abs(noise.mean()) < 4 / np.sqrt(count)
    assert noise.std() == pytest.approx(1.0, abs=4 / np.sqrt(2 * count))
    correlation = np.corrcoef(noise.T) - np.eye(noise.shape[1])
    assert np.abs(correlation).max() < 4.5 / np.sqrt(len(noise))
    assert np.mean(np.abs(noise) < 1.0) == pytest.approx(0.6827, abs=2 / np.sqrt(count))


def test_without_disturbance_momentum_stays_and_the_centre_of_mass_moves_straight() -> None:
    dataset = simulate(replace(SHORT, noise=ProcessNoise(0.0, 0.0)))
    truth, states = dataset.truth, _states(dataset)
    assert truth is not None
    J = inertia_matrix(states[0, FULL.mean_slice("s")])
    momentum = matrix_from_quaternion(truth.q_ig) @ (states[:, FULL.mean_slice("w")] @ J)[..., np.newaxis]
    np.testing.assert_allclose(momentum[..., 0], np.broadcast_to(momentum[0, :, 0], (20, 3)), atol=1e-6)
    straight = truth.center_of_mass[0] + truth.time[:, np.newaxis] * np.array(SHORT.velocity)
    np.testing.assert_allclose(truth.center_of_mass, straight, atol=1e-12)


def test_disturbances_spread_the_motion_as_their_densities_say() -> None:
    noise = ProcessNoise(4e-6, 1e-4)
    process, x = TorqueFreeProcess(FULL, noise), FULL.origin()
    end = simulate_motion(process, np.tile(x, (4000, 1)), np.array([0.0, 2.0]), np.random.default_rng(0))[-1]
    for block, psd in (("v", noise.force_psd), ("w", noise.torque_psd)):
        values = end[:, FULL.mean_slice(block)]
        np.testing.assert_allclose(values.T @ values / 4000, 2.0 * psd * np.eye(3), atol=0.1 * 2.0 * psd)
    t = end[:, FULL.mean_slice("t")]
    np.testing.assert_allclose(
        t.T @ t / 4000, 8 / 3 * noise.force_psd * np.eye(3), atol=0.3 * noise.force_psd
    )


def test_only_landmarks_that_face_the_camera_inside_both_images_are_seen() -> None:
    dataset = simulate(replace(SHORT, detection=1.0, pixel_std=1e-9))
    stream, states = dataset.log.stream("stereo"), _states(dataset)
    assert dataset.known_map is not None
    assert stream.ids is not None
    u_left, v, u_right = stream.values.T
    assert (u_right >= 0).all()
    assert (u_left <= RIG.width).all()
    assert ((v >= 0) & (v <= RIG.height)).all()
    rows = np.searchsorted(np.unique(stream.time), stream.time)
    outward = dataset.known_map.points[stream.ids]
    R = matrix_from_quaternion(states[rows][:, FULL.mean_slice("a")])
    place = (R @ outward[..., np.newaxis])[..., 0]
    sight = place + states[rows][:, FULL.mean_slice("t")]
    assert (np.einsum("ij,ij->i", place, sight) < 0).all()


def test_detection_is_the_probability_that_a_visible_landmark_is_found() -> None:
    every = len(simulate(replace(SHORT, detection=1.0)).log.streams[0].time)
    half = len(simulate(replace(SHORT, detection=0.5)).log.streams[0].time)
    assert half / every == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(every))


def test_the_truth_says_the_inertia_that_was_asked_for() -> None:
    truth = simulate(SHORT).truth
    assert truth is not None
    assert truth.principal_moments is not None
    assert truth.center_of_mass_g is not None
    np.testing.assert_allclose(truth.principal_moments * 1.0322, np.sort(SHORT.principal_moments), rtol=1e-12)
    np.testing.assert_allclose(truth.center_of_mass_g, SHORT.center_of_mass_g)


@pytest.mark.parametrize(
    "wrong",
    [
        {"kind": "lidar"},
        {"frames": 1},
        {"interval": 0.0},
        {"interval": np.nan},
        {"detection": 0.0},
        {"detection": 1.1},
        {"landmarks": 3},
        {"range_m": 0.1},
        {"principal_moments": (3.0, 1.0, 1 / 3)},
    ],
    ids=str,
)
def test_a_scenario_that_cannot_be_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(InputError):
        simulate(Scenario(**wrong))  # pyright: ignore[reportArgumentType]


def test_a_recording_in_which_nothing_is_ever_seen_is_refused() -> None:
    with pytest.raises(InputError, match="ever visible"):
        simulate(replace(SHORT, frames=2, landmarks=4, detection=1e-9))
