"""Filters beside an unknown map: exact where they must be, consistent, and no worse for what goes wrong around them."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.filters.estimator import Measurement
from spinfilters.filters.iterated_update import IterationOptions
from spinfilters.filters.noise_levels import AdaptationOptions
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.models.measurement import LandmarkSensor
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensors.gyro import Gyro, gyro_parameters
from spinfilters.models.state_layout import ROTATION_BLOCKS, Gaussian, StateLayout
from tests.filters.landmark_samples import (
    FILTERS,
    LAYOUT,
    PROCESS,
    first_belief,
    nees,
    recording,
    run_through,
    started,
    timeline_of,
    with_values,
)

BOTH = pytest.mark.parametrize("name", FILTERS)
SEEDS = 6


def covariance(belief):
    return belief.factor @ belief.factor.T


def joint(estimator):
    factor = estimator.landmark_belief.joint_factor()
    return factor @ factor.T


def scaled(P, reference):
    std = np.sqrt(np.diag(reference))
    return P / std / std[:, None]


def observation_rows(measured, before, moved, size):
    """Whitened innovations and Jacobian by state and landmarks, of the landmarks that a belief holds."""
    held = before.ids.tolist()
    observations = [(row, held.index(i)) for row, i in enumerate(measured.ids) if i in held]
    H, rho = np.zeros((3 * len(observations), size)), np.zeros(3 * len(observations))
    for k, (row, at) in enumerate(observations):
        parameters = measured.parameters[row : row + 1].copy()
        parameters[:, :3] = before.points[at]
        linear = measured.model.linearise_landmarks(moved, parameters, measured.values[row : row + 1])
        H[3 * k : 3 * k + 3, measured.model.columns] = linear.jacobian[0]
        H[3 * k : 3 * k + 3, 20 + 3 * at : 23 + 3 * at] = linear.by_landmark[0]
        rho[3 * k : 3 * k + 3] = linear.innovation[0]
    return rho, H


def test_prediction_and_update_are_those_of_the_textbook():
    """Dense EKF over state and landmarks, from the same derivatives and the same covariance."""
    recorded = recording()
    estimator = started(iteration=IterationOptions(1))
    run_through(estimator, recorded.timeline[:4])
    before, P = estimator.landmark_belief, joint(estimator)
    moved, Phi, G = PROCESS.linearise(before.mean, 0.5)
    whole = np.eye(len(P))
    whole[:20, :20] = Phi
    P = whole @ P @ whole.T
    P[:20, :20] += G @ G.T
    measured = recorded.timeline[4].measurements[0]
    rho, H = observation_rows(measured, before, moved, len(P))
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.eye(len(H)))
    error = K @ rho
    estimator.predict(0.5)
    report = estimator.update(measured)
    assert report.map_change is not None
    assert report.dof == len(H)
    assert report.accepted == len(H) // 3 + len(report.map_change.added)
    np.testing.assert_allclose(LAYOUT.local(moved, estimator.belief.mean), error[:20], atol=1e-9)
    J = LAYOUT.reset_jacobian(error[:20])
    expected = J @ (P - K @ H @ P)[:20, :20] @ J.T
    np.testing.assert_allclose(
        scaled(covariance(estimator.belief), expected), scaled(expected, expected), atol=1e-7
    )
    after = estimator.landmark_belief
    kept = len(before.ids)
    steps = error[20:].reshape(-1, 3)
    np.testing.assert_allclose(after.points[:kept] - before.points, steps, atol=1e-9)
    own = (P - K @ H @ P)[20:, 20:]
    std, found = np.sqrt(np.diag(own)), np.sqrt(np.diag(joint(estimator)))[20 : 20 + 3 * kept]
    np.testing.assert_allclose(found, std, rtol=1e-6)


def test_a_new_landmark_has_the_correlation_that_one_stereo_pair_gives_it():
    recorded = recording()
    wide = first_belief(recorded.states)
    wide = Gaussian(LAYOUT, wide.mean, 1e-3 * np.tril(np.random.default_rng(2).standard_normal((20, 20))))
    estimator = started()
    estimator.start(wide)
    measured = recorded.timeline[0].measurements[0]
    assert measured.ids is not None
    assert isinstance(measured.model, LandmarkSensor)
    estimator.update(measured)
    belief = estimator.landmark_belief
    rows = [measured.ids.tolist().index(i) for i in belief.ids]
    fresh = measured.model.new_landmarks(wide.mean, measured.parameters[rows], measured.values[rows])
    J = np.zeros((3 * len(rows), 20))
    J[:, measured.model.columns] = fresh.jacobian.reshape(len(J), -1)
    P = joint(estimator)
    np.testing.assert_allclose(belief.points, fresh.points, atol=1e-12)
    np.testing.assert_allclose(P[20:, :20], J @ covariance(wide), atol=1e-12)
    own = np.zeros((len(J), len(J)))
    for k, root in enumerate(fresh.root):
        own[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = root @ root.T
    np.testing.assert_allclose(P[20:, 20:], J @ covariance(wide) @ J.T + own, atol=1e-10)


@BOTH
def test_noise_free_observations_from_the_true_start_give_no_error(name):
    recorded = recording()
    quiet = FILTERS[name](TorqueFreeProcess(LAYOUT, ProcessNoise(0.0, 0.0), 1e-12))
    quiet.start(Gaussian(LAYOUT, recorded.states[0], np.diag(np.full(20, 1e-9))))
    x = recorded.states[0]
    for k, epoch in enumerate(recorded.timeline[:8]):
        if k:
            x = PROCESS.step(x, epoch.time - recorded.timeline[k - 1].time)
            quiet.predict(epoch.time - recorded.timeline[k - 1].time)
        measured = epoch.measurements[0]
        parameters = measured.parameters.copy()
        parameters[:, :3] = recorded.points[measured.ids]
        quiet.update(with_values(epoch, measured.model.predict(x, parameters)).measurements[0])
    assert np.abs(LAYOUT.local(quiet.belief.mean, x)).max() < 1e-6


@BOTH
def test_errors_are_as_large_as_the_covariance_says(name):
    runs = []
    for seed in range(SEEDS):
        recorded = recording(seed)
        estimator = started(name, seed)
        runs.append(nees(run_through(estimator, recorded.timeline)[10:], recorded.states[10:]))
    low, high = chi_square_band(20, SEEDS)
    assert low < np.mean(runs) < high


def test_a_filter_that_believes_in_half_the_pixel_noise_is_caught():
    runs = []
    for seed in range(SEEDS):
        recorded = recording(seed)
        estimator = started(seed=seed)
        wrong = timeline_of(recorded.dataset, pixel_std=0.5)
        runs.append(nees(run_through(estimator, wrong)[10:], recorded.states[10:]))
    assert np.mean(runs) > chi_square_band(20, SEEDS)[1]


def test_both_filters_agree_where_little_is_uncertain():
    beliefs = {name: run_through(started(name), recording().timeline)[-1] for name in FILTERS}
    gap = LAYOUT.local(beliefs["mekf"].mean, beliefs["ukf"].mean) / beliefs["mekf"].std
    assert np.abs(gap).max() < 0.3
    np.testing.assert_allclose(beliefs["mekf"].std, beliefs["ukf"].std, rtol=0.05)


@BOTH
def test_landmarks_without_error_are_a_known_map(name):
    recorded, estimator, other = recording(), started(name), started(name)
    measured = recorded.timeline[0].measurements[0]
    estimator.update(measured)
    held, (mean, std) = estimator.landmark_belief, (first_belief(recorded.states).mean, np.full(20, 0.001))
    points = recorded.points[held.ids]
    certain = {"points": points, "modes": 0 * held.modes, "roots": 0 * held.roots}
    factor = np.diag(np.r_[std, np.ones(len(held.factor) - 20)])
    estimator.start(replace(held, mean=mean, factor=factor, **certain))
    other.start(Gaussian(LAYOUT, mean, np.diag(std)))
    parameters = np.concatenate([recorded.points[measured.ids], measured.parameters[:, 3:]], axis=1)
    found = estimator.update(measured)
    expected = other.update(Measurement(measured.model, measured.values, parameters))
    assert found.rejected == expected.rejected
    np.testing.assert_allclose(estimator.belief.mean, other.belief.mean, rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        np.linalg.norm(estimator.belief.factor, axis=1),
        np.linalg.norm(other.belief.factor, axis=1),
        rtol=0.01,
    )


@BOTH
def test_a_snapshot_goes_on_to_the_same_bits(name):
    recorded, estimator = recording(), started(name)
    run_through(estimator, recorded.timeline[:12])
    kept = estimator.snapshot()
    expected = run_through(estimator, recorded.timeline, 12)
    other = FILTERS[name](PROCESS)
    other.restore({key: value.copy() for key, value in kept.items()})
    found = run_through(other, recorded.timeline, 12)
    for a, b in zip(expected, found, strict=True):
        assert (a.mean == b.mean).all()
        assert (a.factor == b.factor).all()


def test_the_map_never_holds_more_than_its_largest_size():
    recorded = recording(landmarks=400)
    estimator = started(landmarks=LandmarkOptions(largest_map=120))
    estimator.start(first_belief(recorded.states))
    for k, epoch in enumerate(recorded.timeline):
        if k:
            estimator.predict(0.5)
        report = estimator.update(epoch.measurements[0])
        assert len(estimator.held) <= 120
        assert report.map_change is not None
        assert set(estimator.held.tolist()).isdisjoint(report.map_change.removed.tolist())


@BOTH
def test_a_gyro_beside_the_camera_corrects_the_rates_and_with_them_the_map(name):
    recorded, estimator = recording(), started(name)
    run_through(estimator, recorded.timeline[:3])
    rate = recorded.states[2][LAYOUT.mean_slice("w")]
    before = estimator.landmark_belief
    P = joint(estimator)
    report = estimator.update(Measurement(Gyro(LAYOUT), rate[None], gyro_parameters(1, 1e-5, 0.0)))
    assert report.accepted == 1
    belief = estimator.belief
    assert (belief.std[LAYOUT.slice("w")] < 2e-5).all()
    np.testing.assert_allclose(belief.mean[LAYOUT.mean_slice("w")], rate, atol=1e-4)
    w = LAYOUT.slice("w")
    gain = P[20:, w] @ np.linalg.inv(P[w, w] + 1e-10 * np.eye(3))
    step = (gain @ (rate - before.mean[LAYOUT.mean_slice("w")])).reshape(-1, 3)
    np.testing.assert_allclose(estimator.landmark_belief.points - before.points, step, atol=1e-9)


@BOTH
def test_adaptation_finds_the_noise_that_the_pixels_have(name):
    recorded = recording()
    estimator = started(name, adaptation=AdaptationOptions(measurement=30.0))
    beliefs = run_through(estimator, timeline_of(recorded.dataset, pixel_std=0.4))
    left_out = started(name)
    deaf = run_through(left_out, timeline_of(recorded.dataset, pixel_std=0.4))
    scale = np.exp(estimator.snapshot()["noise.sensor.stereo"][0])
    assert scale == pytest.approx((1.0 / 0.4) ** 2, rel=0.2)
    assert nees(beliefs, recorded.states)[-10:].mean() < 0.7 * nees(deaf, recorded.states)[-10:].mean()


def test_single_precision_says_the_same():
    beliefs = {}
    for precision in ("float64", "float32"):
        estimator = started(landmarks=LandmarkOptions(precision=precision))
        beliefs[precision] = run_through(estimator, recording().timeline)[-1]
    np.testing.assert_allclose(beliefs["float32"].std, beliefs["float64"].std, rtol=1e-2)
    gap = LAYOUT.local(beliefs["float64"].mean, beliefs["float32"].mean) / beliefs["float64"].std
    assert np.abs(gap).max() < 0.2


def test_the_map_comes_out_in_metres_where_it_is():
    recorded, estimator = recording(), started()
    run_through(estimator, recorded.timeline)
    belief = estimator.landmark_belief
    errors = belief.points_in_g - recorded.points[belief.ids]
    factor = belief.joint_factor()[20:]
    covariances = (factor @ factor.T).reshape(len(errors), 3, len(errors), 3)
    own = covariances[np.arange(len(errors)), :, np.arange(len(errors))]
    distance = np.einsum("ki,kij,kj->k", errors, np.linalg.inv(own), errors)
    assert 2.0 < distance.mean() < 4.5


def test_misuse_is_named():
    with pytest.raises(InputError, match="modes is 0"):
        LandmarkOptions(modes=0)
    with pytest.raises(InputError, match="explained is nan"):
        LandmarkOptions(explained=np.nan)
    with pytest.raises(InputError, match="precision 'half'"):
        LandmarkOptions(precision="half")
    rotation = StateLayout(ROTATION_BLOCKS)
    other = Gaussian(rotation, rotation.origin(), np.eye(11))
    with pytest.raises(InputError, match="belief has the blocks"):
        FILTERS["ukf"](PROCESS).start(other)
    with pytest.raises(InputError, match="cannot see them"):
        started().update(
            Measurement(Gyro(LAYOUT), np.zeros((1, 3)), gyro_parameters(1, 0.1, 0.0), np.array([4]))
        )
