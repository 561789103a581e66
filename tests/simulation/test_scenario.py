"""Simulated data: the same from the same seed, with the noise that was asked for, of the motion that it says."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.errors import InputError
from spinfilters.core.mass_distribution import inertia_matrix
from spinfilters.evaluation.consistency import true_states
from spinfilters.io.dataset import Dataset
from spinfilters.io.sensor_format import dataset_kinds
from spinfilters.models.camera_landmarks import StereoLandmark, camera_parameters
from spinfilters.models.feature_tracks import RIG, EveryAppearance, SomeAppearances, stays_in_view
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.simulation.scenario import (
    RICH_RPM,
    THESIS_RPM,
    Motion,
    Scenario,
    simulate,
    simulate_motion,
    without_map,
)

FULL = StateLayout(FULL_BLOCKS)
SHORT = Scenario.simplified(epochs=20)


def _states(dataset: Dataset) -> np.ndarray:
    assert dataset.truth is not None
    return true_states(dataset.truth, FULL)


@pytest.mark.parametrize("kind", dataset_kinds())
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
    assert dataset.truth is not None
    rows = np.searchsorted(dataset.truth.time, stream.time)
    if scenario.kind == "gyro":
        return (stream.values - states[:, FULL.mean_slice("w")]) / scenario.gyro_std
    if scenario.kind == "pose":
        small = StateLayout(("t", "a"))
        exact = np.concatenate([states[:, FULL.mean_slice("t")], states[:, FULL.mean_slice("a")]], axis=1)
        std = np.repeat([scenario.position_std, scenario.rotation_std], 3)
        return small.local(exact, stream.values) / std
    assert dataset.known_map is not None
    assert stream.ids is not None
    parameters = camera_parameters(dataset.known_map.points[stream.ids], RIG.calibration, 1.0)
    return (stream.values - StereoLandmark(FULL).predict(states[rows], parameters)) / scenario.pixel_std


@pytest.mark.parametrize(
    "scenario",
    [
        Scenario.simplified(epochs=40, pixel_std=0.6),
        Scenario.simplified(kind="pose", epochs=400, position_std=0.002, rotation_std=0.03),
        Scenario.simplified(kind="gyro", epochs=400, gyro_std=0.01),
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


def test_a_motion_is_kicked_before_and_after_every_step() -> None:
    process, h = TorqueFreeProcess(FULL, ProcessNoise(4e-4, 1e-2)), 0.05
    x = np.tile(_states(simulate(SHORT))[0], (3, 1))
    normal = np.random.default_rng(2).standard_normal((5, 3, 2, 6))
    expected, where = x.copy(), np.r_[FULL.mean_slice("w"), FULL.mean_slice("v")]
    std = np.repeat(np.sqrt([1e-2 * h / 2, 4e-4 * h / 2]), 3)
    for kick in std * normal:
        expected[:, where] += kick[:, 0]
        expected = process.step(expected, h)
        expected[:, where] += kick[:, 1]
    np.testing.assert_allclose(process.disturbed_steps(x, h, normal), expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(process.disturbed_steps(x[0], h, normal[:, 0]), expected[0], atol=1e-13)


def test_a_kick_that_makes_a_body_fast_is_followed_to_the_tolerance() -> None:
    """At first it rests, so that a step's substeps would be far too few."""
    process, x = TorqueFreeProcess(FULL, ProcessNoise(0.0, 2.0)), _states(simulate(SHORT))[0]
    x[FULL.mean_slice("w")] = 0.0
    normal = np.zeros((2, 2, 6))
    normal[0, 0, :3] = [20.0, 10.0, 5.0]
    after = process.disturbed_steps(x, 1.0, normal)
    kicked = x.copy()
    kicked[FULL.mean_slice("w")] = normal[0, 0, :3]
    fine = TorqueFreeProcess(FULL, ProcessNoise(), 1e-12)
    np.testing.assert_allclose(after, fine.step(fine.step(kicked, 1.0), 1.0), atol=1e-7)


def test_a_simulation_tells_how_far_it_is() -> None:
    told: list[tuple[int, int]] = []
    simulate(SHORT, lambda done, total: told.append((done, total)))
    assert told == [(k, 20) for k in range(2, 21)]


def test_only_landmarks_that_face_the_camera_inside_both_images_are_seen() -> None:
    dataset = simulate(replace(SHORT, detection=1.0, pixel_std=1e-9))
    stream, states = dataset.log.stream("stereo"), _states(dataset)
    assert dataset.known_map is not None
    assert stream.ids is not None
    u_left, v, u_right = stream.values.T
    assert (u_right >= 0).all()
    assert (u_left <= RIG.left.width).all()
    assert ((v >= 0) & (v <= RIG.left.height)).all()
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
        {"kind": "radar"},
        {"epochs": 1},
        {"interval": 0.0},
        {"interval": np.nan},
        {"detection": 0.0},
        {"detection": 1.1},
        {"landmarks": 3},
        {"candidates": 0},
        {"facing_cosine": 1.0},
        {"fewest_observations": -1},
        {"range_m": 0.1},
        {"principal_moments": (3.0, 1.0, 1 / 3)},
    ],
    ids=str,
)
def test_a_scenario_that_cannot_be_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(InputError):
        simulate(Scenario.simplified(**wrong))  # pyright: ignore[reportArgumentType]


def test_a_recording_in_which_nothing_is_ever_seen_is_refused() -> None:
    with pytest.raises(InputError, match="ever visible"):
        simulate(replace(SHORT, epochs=2, landmarks=4, detection=1e-9))


@pytest.mark.parametrize("rate_rpm", [THESIS_RPM, RICH_RPM], ids=["thesis", "rich"])
def test_a_recording_like_disam115_has_its_statistics(rate_rpm: tuple[float, float, float]) -> None:
    dataset = simulate(Scenario.common_workload(rate_rpm, seed=4))
    stream = dataset.log.stream("stereo")
    assert stream.ids is not None
    assert dataset.known_map is not None
    observations, per_frame = np.bincount(stream.ids), np.diff(stream.epoch_offsets)
    assert len(stream) == pytest.approx(24723, rel=0.1)
    assert len(dataset.known_map.ids) == len(observations) == pytest.approx(2447, rel=0.1)
    assert observations.min() == 2
    assert len(per_frame) == 115
    assert np.median(per_frame) == pytest.approx(215, rel=0.1)
    assert per_frame.min() > 150
    np.testing.assert_allclose(np.percentile(observations, [10, 50, 90, 99]), [2.5, 8, 22, 36], rtol=0.25)


def runs_and_gaps(dataset: Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Lengths in epochs of the contiguous observations of a landmark, and of what lies between two of them."""
    stream = dataset.log.stream("stereo")
    assert stream.ids is not None
    frame = np.searchsorted(stream.epoch_times, stream.time)
    order = np.lexsort((frame, stream.ids))
    step, landmark = np.diff(frame[order]), np.diff(stream.ids[order])
    ends = np.append(np.flatnonzero((step != 1) | (landmark != 0)), len(frame) - 1)
    return np.diff(ends, prepend=-1), step[(landmark == 0) & (step > 1)] - 1


def test_landmarks_of_disam115_stay_for_a_few_epochs_and_come_back_after_a_revolution() -> None:
    runs, gaps = runs_and_gaps(simulate(Scenario.common_workload(seed=2)))
    assert runs.max() <= 6
    np.testing.assert_allclose(np.bincount(runs)[1:5] / len(runs), 0.25, atol=0.08)
    assert np.mean((gaps > 1) & (gaps < 6)) < 0.05
    assert 0.4 < np.mean((gaps >= 7) & (gaps <= 11)) < 0.9


def test_the_body_of_disam115_stays_in_view_though_its_force_would_take_it_out() -> None:
    scenario = Scenario.common_workload(seed=5)
    for candidates, expected in ((scenario.candidates, True), (1, False)):
        states = _states(simulate(replace(scenario, candidates=candidates)))
        motion = Motion(FULL, np.arange(115.0), states)
        assert stays_in_view(motion, scenario.radius_m) == expected


def test_a_landmark_is_known_again_for_a_whole_appearance() -> None:
    visible = np.tile(np.array([1, 1, 0, 1, 1, 1, 0, 0, 1], dtype=bool)[:, np.newaxis], (1, 20000))
    known = SomeAppearances(2.0, 6.0).known(visible, np.random.default_rng(0))
    assert not known[~visible].any()
    for rows in ([0, 1], [3, 4, 5], [8]):
        assert (known[rows] == known[rows[0]]).all()
        assert known[rows[0]].mean() == pytest.approx(0.25, abs=0.02)
    both = np.mean(known[0] & known[3])
    assert both == pytest.approx(2 * 3 / (8 * 9), abs=0.01)  # of a Beta: E p^2; independent would be 1/16
    np.testing.assert_array_equal(EveryAppearance().known(visible, np.random.default_rng(0)), visible)


@pytest.mark.parametrize("shapes", [(0.0, 1.0), (1.0, -1.0), (np.nan, 1.0)])
def test_shapes_of_recognition_are_positive(shapes: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="shapes"):
        SomeAppearances(*shapes)


def test_landmarks_seen_too_rarely_are_left_out_and_the_map_still_fits_the_tracks() -> None:
    scenario = replace(SHORT, landmarks=300, fewest_observations=9)
    dataset = simulate(scenario)
    stream = dataset.log.stream("stereo")
    assert stream.ids is not None
    assert dataset.known_map is not None
    assert np.bincount(stream.ids).min() >= 9
    assert 4 < len(dataset.known_map.ids) < 300
    noise = _whitened_noise(dataset, scenario)
    assert noise.std() == pytest.approx(1.0, abs=4 / np.sqrt(2 * noise.size))


def test_a_data_set_without_its_map_is_otherwise_the_same() -> None:
    dataset = simulate(SHORT)
    blind = without_map(dataset)
    assert blind.known_map is None
    for name in ("log", "truth", "rig", "kind", "options"):
        assert getattr(blind, name) is getattr(dataset, name)


def test_the_rich_motion_is_the_default_one_with_other_rates() -> None:
    assert Scenario.rich(7) == Scenario.simplified(rate_rpm=(4.0, 9.0, 3.0), seed=7)
    truth = simulate(replace(Scenario.rich(), epochs=2)).truth
    assert truth is not None
    turning = np.linalg.norm(truth.rate_i[0])
    assert turning == pytest.approx(np.linalg.norm(RICH_RPM) * 2 * np.pi / 60)
