"""Noise that is stated wrongly is found out, noise that is stated rightly is left alone."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.evaluation.consistency import chi_square_band, true_states
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Measurement
from spinfilters.filters.noise_levels import (
    BLOCK,
    CYCLE,
    LARGEST_SCALE,
    AdaptationOptions,
    NoiseAdaptation,
    NoiseEvidence,
    NoiseScale,
    raised_logarithm,
    residual_evidence,
)
from spinfilters.filters.square_root import MeasurementPrediction, square_root_update
from spinfilters.filters.timeline import SensorNoise, Timeline, build_timeline, run
from spinfilters.filters.ukf import MultiplicativeUkf
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import ROTATION_BLOCKS, Gaussian, StateLayout
from spinfilters.models.status import Verdict
from spinfilters.simulation.scenario import Scenario, simulate
from tests.filters.filter_samples import FULL

FRAMES, SEEDS, INTERVAL = 110, 6, 0.5
CALM, DISTURBED = ProcessNoise(), ProcessNoise(force_psd=4e-6, torque_psd=1e-3)
"""Poses a few millimetres and milliradians apart can tell only the second from their own noise."""
STD = np.repeat([0.005, 0.01, 0.002, 0.01, 0.002, 0.02], [3, 3, 3, 3, 3, 5])
NONE, SENSORS, DISTURBANCES = AdaptationOptions(), AdaptationOptions(80, 0), AdaptationOptions(0, 80)
BOTH = AdaptationOptions(80, 80)
LOW, HIGH = chi_square_band(FULL.error_dim, SEEDS)
Build = type[MultiplicativeEkf] | type[MultiplicativeUkf]


@dataclass(frozen=True)
class Stated:
    """Covariance of the sensor and density of the disturbances that the filter is told, as multiples of the true ones."""

    sensor: float = 1.0
    disturbance: float = 1.0
    truth: ProcessNoise = CALM


@cache
def _poses(seed: int, noise: ProcessNoise) -> tuple[Timeline, np.ndarray]:
    dataset = simulate(
        Scenario.simplified(
            kind="pose", epochs=FRAMES, interval=INTERVAL, noise=noise, seed=seed, velocity=(0, 0, 0)
        )
    )
    assert dataset.truth is not None
    return build_timeline(dataset.log, FULL, SensorNoise()), true_states(dataset.truth, FULL)


def _started(
    build: Build, seed: int, stated: Stated, options: AdaptationOptions
) -> MultiplicativeEkf | MultiplicativeUkf:
    noise = ProcessNoise(
        stated.disturbance * stated.truth.force_psd, stated.disturbance * stated.truth.torque_psd
    )
    estimator = build(TorqueFreeProcess(FULL, noise), adaptation=options)
    error = STD * np.random.default_rng(100 + seed).standard_normal(20)
    estimator.start(Gaussian(FULL, FULL.retract(_poses(seed, stated.truth)[1][0], error), np.diag(STD)))
    return estimator


def _step(estimator: MultiplicativeEkf | MultiplicativeUkf, seed: int, epoch: int, stated: Stated) -> None:
    (pose,) = _poses(seed, stated.truth)[0][epoch].measurements
    estimator.predict(INTERVAL)
    estimator.update(Measurement(pose.model, pose.values, np.sqrt(stated.sensor) * pose.parameters))


@cache
def _late_nees(build: Build, stated: Stated, options: AdaptationOptions) -> float:
    """Mean NEES of the second half, over seeds."""
    found = []
    for seed in range(SEEDS):
        estimator = _started(build, seed, stated, options)
        for epoch in range(1, FRAMES):
            _step(estimator, seed, epoch, stated)
            error = FULL.local(estimator.belief.mean, _poses(seed, stated.truth)[1][epoch])
            whitened = np.linalg.solve(estimator.belief.factor, error)
            if 2 * epoch > FRAMES:
                found.append(float(whitened @ whitened))
    return float(np.mean(found))


@pytest.mark.parametrize("truth", [CALM, DISTURBED])
def test_with_the_right_noise_nees_stays_in_its_band(truth: ProcessNoise) -> None:
    assert LOW < _late_nees(MultiplicativeEkf, Stated(truth=truth), BOTH) < HIGH


@pytest.mark.parametrize("sensor", [1 / 9, 9.0])
def test_nees_comes_back_into_its_band_when_a_sensor_s_wrong_noise_adapts(sensor: float) -> None:
    plain, adapted = (_late_nees(MultiplicativeEkf, Stated(sensor), options) for options in (NONE, SENSORS))
    assert not LOW < plain < HIGH
    assert LOW < adapted < 1.1 * HIGH


@pytest.mark.parametrize("disturbance", [0.1, 10.0])
def test_nees_comes_near_its_band_when_wrong_disturbances_adapt(disturbance: float) -> None:
    stated = Stated(1.0, disturbance, DISTURBED)
    plain, adapted = (_late_nees(MultiplicativeEkf, stated, options) for options in (NONE, DISTURBANCES))
    assert not LOW < plain < HIGH
    assert LOW < adapted < 1.5 * HIGH


@pytest.mark.parametrize("build", [MultiplicativeEkf, MultiplicativeUkf])
@pytest.mark.parametrize("stated", [Stated(1 / 9), Stated(9.0)])
def test_the_scale_of_a_sensor_becomes_what_it_was_stated_wrongly_by(build: Build, stated: Stated) -> None:
    estimator = _started(build, 0, stated, SENSORS)
    for epoch in range(1, FRAMES):
        _step(estimator, 0, epoch, stated)
    scale = estimator._adaptation.measurement_scale("pose")
    assert np.log(scale * stated.sensor) == pytest.approx(0, abs=0.4)


@pytest.mark.parametrize("build", [MultiplicativeEkf, MultiplicativeUkf])
def test_a_restored_filter_goes_on_adapting_bit_for_bit(build: Build) -> None:
    first, second = (_started(build, 0, Stated(4.0, 4.0), BOTH) for _ in range(2))
    for epoch in range(1, 9):
        if epoch == 5:
            second.restore(first.snapshot())
        _step(first, 0, epoch, Stated(4.0, 4.0))
        if epoch >= 5:
            _step(second, 0, epoch, Stated(4.0, 4.0))
    np.testing.assert_array_equal(first.belief.mean, second.belief.mean)
    np.testing.assert_array_equal(first.belief.factor, second.belief.factor)


def test_the_ukf_adapts_to_a_gyro_which_has_fewer_numbers_than_its_sigma_points_have_columns() -> None:
    process = TorqueFreeProcess(StateLayout(ROTATION_BLOCKS), ProcessNoise())
    gyro = simulate(Scenario.simplified(kind="gyro", epochs=40, interval=0.1)).log
    timeline = build_timeline(gyro, process.layout, SensorNoise(gyro_noise_std=0.002))
    x = process.layout.origin()
    x[process.layout.mean_slice("w")] = gyro.streams[0].values[0]
    ukf = MultiplicativeUkf(process, adaptation=AdaptationOptions(measurement=30))
    ukf.start(Gaussian(process.layout, x, 0.1 * np.eye(process.layout.error_dim)))
    history = run(ukf, timeline[0].time, timeline[1:])
    assert history.status.verdict is Verdict.OK
    assert np.isfinite(ukf.snapshot()["noise.sensor.gyro"]).all()


def test_a_new_start_forgets_what_was_learned() -> None:
    estimator = _started(MultiplicativeEkf, 0, Stated(9.0), BOTH)
    for epoch in range(1, 5):
        _step(estimator, 0, epoch, Stated(9.0))
    assert estimator._adaptation.measurement_scale("pose") != 1
    estimator.start(estimator.belief)
    assert estimator._adaptation.measurement_scale("pose") == 1


def test_without_adaptation_no_number_changes() -> None:
    adaptation, noise = NoiseAdaptation(NONE), np.random.default_rng(0).standard_normal((20, 12))
    assert adaptation.scaled(FULL, noise) is noise
    assert (adaptation.measurement_scale("pose"), adaptation.process_scale("torque")) == (1.0, 1.0)
    assert not adaptation.snapshot()


def test_the_evidence_of_a_residual_is_that_of_the_whole_innovation_covariance() -> None:
    generator = np.random.default_rng(3)
    Y, rho = generator.standard_normal((5, 4)), generator.standard_normal(5)
    correction = square_root_update(MeasurementPrediction(rho, Y, np.eye(4), 7.0, 9, 0.0))
    S = np.eye(5) + Y @ Y.T
    found = residual_evidence(correction)
    residual = np.linalg.solve(S, rho)
    assert found.squared == pytest.approx(residual @ residual + 7.0)
    assert found.expected == pytest.approx(np.trace(np.linalg.inv(S)) + 4)
    assert found.information == pytest.approx(np.trace(np.linalg.inv(S @ S)) + 4)


@pytest.mark.parametrize(("squared", "bound"), [(1e30, LARGEST_SCALE), (0.0, 1 / LARGEST_SCALE)])
def test_a_scale_stays_bounded(squared: float, bound: float) -> None:
    scale = NoiseScale()
    for _ in range(1000):
        scale = scale.after(NoiseEvidence(squared, 6.0, 6.0), 10.0)
    assert np.exp(scale.logarithm) == pytest.approx(bound)


@pytest.mark.parametrize("name", ["measurement", "process"])
@pytest.mark.parametrize("value", [-1.0, 0.5, np.nan, np.inf])
def test_a_horizon_out_of_range_is_refused(name: str, value: float) -> None:
    with pytest.raises(InputError, match=f"adaptation.{name} is"):
        AdaptationOptions(**{name: value})


IDENTIFIED = {
    "process.torque": NoiseScale(np.log(4.0) - raised_logarithm(0.02), 100.0),
    "sensor.pose": NoiseScale(0.0, 200.0),
}


def test_identified_levels_are_scaled_to_their_means_and_go_on_by_a_part_of_the_epochs() -> None:
    estimator = _started(MultiplicativeEkf, 0, Stated(), NONE)
    estimator.adapt_from(IDENTIFIED)
    estimator.start(estimator.belief)
    assert estimator._adaptation.process_scale("torque") == pytest.approx(4.0)
    assert estimator._adaptation.process_scale("force") == 1.0
    for epoch in range(1, FRAMES):
        _step(estimator, 0, epoch, Stated())
    assert estimator.level("process.torque") == IDENTIFIED["process.torque"]
    for epoch in range(CYCLE - FRAMES + 1):
        _step(estimator, 0, 1 + epoch % (FRAMES - 1), Stated())
    assert estimator.level("process.torque").information > IDENTIFIED["process.torque"].information
    assert estimator.level("sensor.pose").information > IDENTIFIED["sensor.pose"].information


@pytest.mark.parametrize("wrong", [0.1, 10.0])
def test_a_filter_goes_on_from_a_wrong_level_to_the_right_one(wrong: float) -> None:
    logarithms = []
    for seed in range(SEEDS):
        estimator = _started(MultiplicativeEkf, seed, Stated(truth=DISTURBED), NONE)
        estimator.adapt_from({"process.torque": NoiseScale(np.log(wrong) - raised_logarithm(1.0), 2.0)})
        estimator.start(estimator.belief)
        estimator._adaptation._predictions = CYCLE - BLOCK
        for epoch in range(1, BLOCK):
            _step(estimator, seed, epoch, Stated(truth=DISTURBED))
        logarithms.append(np.log(estimator._adaptation.process_scale("torque")))
    assert abs(np.mean(logarithms)) < 0.5 * abs(np.log(wrong))


def test_the_information_on_a_disturbance_stays_below_that_of_what_was_measured() -> None:
    """About a mean other than the prediction's a thin covariance may grow in an update, and the evidence with it."""
    dataset = simulate(
        Scenario.simplified(kind="gyro", epochs=115, interval=0.5, noise=ProcessNoise(torque_psd=4e-6))
    )
    process = TorqueFreeProcess(StateLayout(ROTATION_BLOCKS), ProcessNoise(torque_psd=4e-6))
    timeline = build_timeline(dataset.log, process.layout, SensorNoise(gyro_noise_std=0.002))
    x = process.layout.origin()
    x[process.layout.mean_slice("w")] = dataset.log.streams[0].values[0]
    std = np.repeat([1e-6, 0.002, 0.3], [3, 3, 5])
    ekf = MultiplicativeEkf(process, adaptation=AdaptationOptions(process=1e9))
    ekf.start(Gaussian(process.layout, x, np.diag(std)))
    run(ekf, timeline[0].time, timeline[1:])
    assert 0 < ekf.level("process.torque").information < 3 * len(timeline)
