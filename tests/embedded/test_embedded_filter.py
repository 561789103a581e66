"""The C filter against the Python filters, in both precisions."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float

from spinfilters.core.c_library import compiler
from spinfilters.embedded.embedded_estimator import EmbeddedFilter
from spinfilters.embedded.embedded_options import EmbedOptions
from spinfilters.embedded.folder import CALIBRATION, STD, OwnLandmark, ReferenceFilter, make_vectors
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Estimator, LandmarkBelief, Measurement, UpdateReport
from spinfilters.filters.iterated_update import IterationOptions
from spinfilters.models.camera_landmarks import StereoLandmark, camera_parameters
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensors.gyro import Gyro, gyro_parameters
from spinfilters.models.sensors.pose import Pose, pose_parameters
from spinfilters.models.state_layout import Gaussian

pytestmark = pytest.mark.skipif(
    compiler() is None, reason="the embedded filter is C and there is no compiler"
)

INTERVAL = 0.1
OPTIONS = EmbedOptions("stereo", 400, "double", 4)
FULL = TorqueFreeProcess(OPTIONS.layout, ProcessNoise(1e-6, 1e-6))
POSE_COVARIANCE = np.diag([1.6e-5] * 3 + [2.5e-5] * 3)


def first_belief(process: TorqueFreeProcess, wide: float = 1.0) -> tuple[np.ndarray, Gaussian]:
    """A true state that stays before the camera, and a belief drawn about it.

    The deviations of place and centre of mass are stated ``wide`` times as large as they are.
    """
    layout = process.layout
    rng = np.random.default_rng(5)
    truth = make_vectors(OPTIONS if layout.translates else EmbedOptions("gyro")).arrays["x"].copy()
    if layout.translates:
        truth[layout.mean_slice("v")] = 0.0
    std = np.concatenate([np.full(block.dimension, STD[block.name]) for block in layout.members])
    mean = layout.retract(truth, std * rng.normal(size=layout.error_dim))
    for block in layout.members:
        if block.translational:
            std[layout.slice(block.name)] *= wide
    return truth, Gaussian(layout, mean, np.diag(std))


def departure(one: Estimator, other: Estimator) -> tuple[float, float]:
    """Largest difference of mean and covariance, in standard deviations of the first."""
    a, b = one.belief, other.belief
    difference = one.layout.local(a.mean, b.mean) / a.std
    return float(np.abs(difference).max()), float(
        np.abs((b.covariance - a.covariance) / np.outer(a.std, a.std)).max()
    )


def poses(truth: np.ndarray, rng: np.random.Generator) -> Measurement:
    model = Pose(FULL.layout)
    error = np.zeros(FULL.layout.error_dim)
    error[FULL.layout.slice("t")], error[FULL.layout.slice("a")] = (
        0.004 * rng.normal(size=3),
        0.005 * rng.normal(size=3),
    )
    parameters = pose_parameters(POSE_COVARIANCE[None])
    return Measurement(
        model, model.predict(FULL.layout.retract(truth, error), parameters[0])[None], parameters
    )


def observations(
    truth: np.ndarray, points: Float[np.ndarray, "k 3"], rng: np.random.Generator
) -> Measurement:
    model = StereoLandmark(FULL.layout)
    parameters = camera_parameters(points, np.array(CALIBRATION), 1.0)
    values = model.predict(truth, parameters) + rng.normal(size=(len(points), 3))
    return Measurement(model, values, parameters)


def ball(count: int) -> Float[np.ndarray, "k 3"]:
    normals = np.random.default_rng(2).normal(size=(count, 3))
    return 0.1 * normals / np.linalg.norm(normals, axis=1, keepdims=True)


def plain_ekf(process: TorqueFreeProcess) -> MultiplicativeEkf:
    return MultiplicativeEkf(process, iteration=IterationOptions(iterations=1))


def test_in_double_it_is_the_python_filter_on_poses_and_a_known_map() -> None:
    """At most 1e-9 standard deviations and correlations; 60 s of it were looked at once, a tenth is here."""
    rng, points = np.random.default_rng(0), ball(40)
    truth, belief = first_belief(FULL)
    ours, theirs = EmbeddedFilter(FULL, OPTIONS), plain_ekf(FULL)
    worst = np.zeros(2)
    for estimator in (ours, theirs):
        estimator.start(belief)
    for epoch in range(60):
        truth = FULL.step(truth, INTERVAL)
        measurement = poses(truth, rng) if epoch % 2 else observations(truth, points, rng)
        for estimator in (ours, theirs):
            estimator.predict(INTERVAL)
            estimator.update(measurement)
        if epoch % 5 == 0:
            worst = np.maximum(worst, departure(theirs, ours))
    assert (worst < 1e-9).all()


def test_in_double_it_is_the_python_filter_on_a_gyro() -> None:
    options = EmbedOptions("gyro", real="double", substeps=4)
    process = TorqueFreeProcess(options.layout, ProcessNoise(1e-6, 1e-6))
    rng, model = np.random.default_rng(0), Gyro(process.layout)
    truth, belief = first_belief(process)
    ours, theirs = EmbeddedFilter(process, options), plain_ekf(process)
    for estimator in (ours, theirs):
        estimator.start(belief)
    for _ in range(100):
        truth = process.step(truth, INTERVAL)
        values = truth[process.layout.mean_slice("w")] + 0.01 * rng.normal(size=(1, 3))
        for estimator in (ours, theirs):
            estimator.predict(INTERVAL)
            estimator.update(Measurement(model, values, gyro_parameters(1, 0.01, 0.01)))
    assert max(departure(theirs, ours)) < 1e-9


def test_landmarks_of_their_own_are_those_of_the_reference() -> None:
    rng, points = np.random.default_rng(1), ball(60)
    truth, belief = first_belief(FULL)
    ours, reference = (
        EmbeddedFilter(FULL, OPTIONS),
        ReferenceFilter(FULL, belief.mean, belief.covariance),
    )
    known = np.arange(30)
    for place in known.tolist():
        reference.landmarks[place] = OwnLandmark(points[place].copy(), 1e-6 * np.eye(3))
    n = FULL.layout.error_dim
    factor = np.zeros((n + 1, n + 1))
    factor[:n, :n], factor[n, n] = belief.factor, 1.0
    roots = np.tile(1e-3 * np.eye(3), (30, 1, 1))
    ours.start(
        LandmarkBelief(
            FULL.layout, belief.mean, known, points[:30], np.zeros((30, 3, 1)), roots, factor, np.zeros(6)
        )
    )
    for epoch in range(20):
        truth = FULL.step(truth, INTERVAL)
        seen = observations(truth, points, rng)
        if epoch == 7:
            seen.values[:4] += 30.0  # wrong associations
        report = ours_report(ours, seen)
        reference.predict(INTERVAL)
        reference.observe(StereoLandmark(FULL.layout), seen.values, seen.parameters[0, 3:], np.arange(60))
        assert report.accepted == (56 if epoch == 7 else report.accepted)
    belief = ours.belief
    difference = FULL.layout.local(reference.mean, belief.mean) / belief.std
    assert np.abs(difference).max() < 1e-7
    np.testing.assert_allclose(belief.covariance, reference.covariance, rtol=1e-6, atol=1e-12)
    expected = np.array([reference.landmarks[place].point for place in range(60)])
    np.testing.assert_allclose(ours.points, expected, atol=1e-9)


def ours_report(ours: EmbeddedFilter, seen: Measurement) -> UpdateReport:
    ours.predict(INTERVAL)
    return ours.update(replace(seen, ids=np.arange(len(seen.values))))


@pytest.mark.parametrize(("wide", "epochs", "bound"), [(1.0, 200, 0.1), (1e4, 60, 0.3)])
def test_float_stays_near_double(wide: float, epochs: int, bound: float) -> None:
    """50 s, as in the ten minutes that were looked at once; and from a prior of 2e10 times the variances that are left."""
    rng, points = np.random.default_rng(3), ball(20)
    truth, belief = first_belief(FULL, wide)
    narrow = EmbeddedFilter(FULL, replace(OPTIONS, real="float"))
    double = EmbeddedFilter(FULL, OPTIONS)
    worst = np.zeros(2)
    for estimator in (double, narrow):
        estimator.start(belief)
    for epoch in range(epochs):
        truth = FULL.step(truth, 0.25)
        measurement = observations(truth, points, rng) if epoch % 10 == 9 else poses(truth, rng)
        for estimator in (double, narrow):
            estimator.predict(0.25)
            estimator.update(measurement)
        if epoch % 20 == 0:
            worst = np.maximum(worst, departure(double, narrow))
    assert worst[0] < bound
    assert worst[1] < bound
    if wide > 1.0:
        assert (belief.std / double.belief.std).max() ** 2 > 2e10


def test_the_covariance_of_float_stays_positive_in_random_runs() -> None:
    """Priors over six decades in every direction, steps of any length: what would break it is left out."""
    rng = np.random.default_rng(8)
    truth, belief = first_belief(FULL)
    n, filter_ = FULL.layout.error_dim, EmbeddedFilter(FULL, replace(OPTIONS, real="float"))
    for _ in range(50):
        factor = belief.factor * 10 ** rng.uniform(-3, 3, size=(n, 1))
        filter_.start(Gaussian(FULL.layout, belief.mean, factor))
        for _ in range(5):
            filter_.predict(10 ** rng.uniform(-3, 0))
            filter_.update(poses(truth, rng))
        assert (filter_.belief.std > 0).all()
        assert np.isfinite(filter_.belief.mean).all()


def test_a_measurement_that_is_not_finite_changes_nothing() -> None:
    truth, belief = first_belief(FULL)
    filter_ = EmbeddedFilter(FULL, OPTIONS)
    filter_.start(belief)
    before = filter_.belief
    broken = poses(truth, np.random.default_rng(0))
    broken.values[0, 2] = np.nan
    report = filter_.update(broken)
    assert (report.accepted, report.rejected) == (0, 1)
    np.testing.assert_array_equal(filter_.belief.mean, before.mean)
    np.testing.assert_array_equal(filter_.belief.factor, before.factor)


@pytest.mark.parametrize("step", [1e3, 1e6])
def test_a_step_whose_deviations_would_not_be_finite_is_left_out_and_said(step: float) -> None:
    """The place's variance is beyond float: that of the velocity, which is not, times the square of the step."""
    _, belief = first_belief(FULL)
    factor = belief.factor.copy()
    factor[FULL.layout.slice("v")] *= 1e18
    filter_ = EmbeddedFilter(FULL, replace(OPTIONS, real="float"))
    filter_.start(Gaussian(FULL.layout, belief.mean, factor))
    before = filter_.belief
    filter_.predict(step)
    assert np.isfinite(filter_.belief.std).all()
    np.testing.assert_array_equal(filter_.belief.factor, before.factor)
    assert any("would not have stayed finite" in reason for reason in filter_.status.reasons)


def test_it_goes_on_from_a_snapshot_to_the_same_bits() -> None:
    rng, points = np.random.default_rng(1), ball(30)
    truth, belief = first_belief(FULL)
    filter_ = EmbeddedFilter(FULL, OPTIONS)
    filter_.start(belief)
    ours_report(filter_, observations(truth, points, rng))
    kept, seen = filter_.snapshot(), observations(truth, points, rng)
    ours_report(filter_, seen)
    first = filter_.belief
    filter_.restore(kept)
    ours_report(filter_, seen)
    np.testing.assert_array_equal(filter_.belief.mean, first.mean)
    np.testing.assert_array_equal(filter_.belief.factor, first.factor)
