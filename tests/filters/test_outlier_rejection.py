"""Outliers are left out or weighed down, repeated images are recognised, and a filter that went astray finds back."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from spinfilters.core.errors import InputError
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Measurement
from spinfilters.filters.filter import MultiplicativeFilter
from spinfilters.filters.outlier_rejection import (
    RECOVERY_COUNT,
    RobustOptions,
    SensorOutlierRejection,
    innovation_covariance,
    sparing_weights,
    squared_distances,
    weights,
)
from spinfilters.filters.ukf import MultiplicativeUkf
from spinfilters.models.state_layout import Gaussian
from tests.filters.filter_samples import FULL, PROCESS, START, embedded, started
from tests.filters.linear_samples import linear_belief, linear_process, linear_sensor

OURS = (MultiplicativeEkf, MultiplicativeUkf)
Build = type[MultiplicativeEkf] | type[MultiplicativeUkf]


@pytest.mark.parametrize("d", [1, 2, 3, 6])
def test_squared_distances_are_those_of_a_solved_system(d: int) -> None:
    generator = np.random.default_rng(d)
    rho = generator.standard_normal((50, d))
    S = innovation_covariance(generator.standard_normal((50, d, 9)))
    reference = [r @ np.linalg.solve(s, r) for r, s in zip(rho, S, strict=True)]
    np.testing.assert_allclose(squared_distances(rho, S), reference, rtol=1e-10)


def test_the_gate_lets_through_the_stated_share_of_true_values() -> None:
    rho, S = np.random.default_rng(1).standard_normal((100_000, 3)), np.tile(np.eye(3), (100_000, 1, 1))
    assert weights(rho, S, RobustOptions(0.9)).mean() == pytest.approx(0.9, abs=0.005)
    edge = np.sqrt(chi2.ppf(0.9, 3)) * np.array([[0.999, 0, 0], [1.001, 0, 0]])
    np.testing.assert_array_equal(weights(edge, S[:2], RobustOptions(0.9)), [1, 0])


def test_what_is_not_finite_or_has_no_covariance_weighs_nothing() -> None:
    rho, S = np.zeros((5, 2)), np.tile(np.eye(2), (5, 1, 1))
    rho[0, 1], rho[1, 0] = np.nan, np.inf
    S[2], S[3, 0, 0] = 1.0, np.nan
    for options in (RobustOptions(), RobustOptions(1.0), RobustOptions(1.0, "barron")):
        np.testing.assert_array_equal(weights(rho, S, options), [0, 0, 0, 0, 1])


@pytest.mark.parametrize(
    ("loss", "shape"), [("huber", 0.0), ("barron", 1.0), ("barron", 0.0), ("barron", -2.0)]
)
def test_a_kernel_s_weight_is_one_at_zero_and_falls(loss: str, shape: float) -> None:
    rho, S = np.linspace(0, 40, 81)[:, np.newaxis], np.ones((81, 1, 1))
    found = weights(rho, S, RobustOptions(1.0, loss, 2.5, shape))
    assert found[0] == 1
    assert (np.diff(found) <= 0).all()
    assert found[-1] < 0.3
    if shape == 0 and loss == "barron":
        np.testing.assert_allclose(found, 1 / (1 + (rho[:, 0] / 2.5) ** 2 / 2))


def test_least_squares_is_barron_s_loss_of_shape_two() -> None:
    rho, S = 9 * np.ones((3, 2)), np.tile(np.eye(2), (3, 1, 1))
    np.testing.assert_array_equal(weights(rho, S, RobustOptions(1.0, "barron", shape=2.0)), 1)


@pytest.mark.parametrize("loss", ["none", "huber"])
def test_sparing_weights_are_the_weights(loss: str) -> None:
    generator = np.random.default_rng(2)
    rho, Y = 3 * generator.standard_normal((200, 3)), generator.standard_normal((200, 3, 4))
    options = RobustOptions(0.99, loss)
    found = sparing_weights(rho, lambda chosen: Y[chosen], options)
    assert found is not None
    np.testing.assert_allclose(found, weights(rho, innovation_covariance(Y), options), rtol=1e-12)
    assert sparing_weights(0.01 * rho, lambda chosen: Y[chosen], RobustOptions()) is None


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"gate_probability": 0.0}, "gate_probability is 0.0"),
        ({"gate_probability": np.nan}, "gate_probability"),
        ({"loss": "tukey"}, "'tukey' is unknown"),
        ({"width": 0.0}, "width is 0.0"),
        ({"shape": 2.5}, "shape is 2.5"),
    ],
)
def test_an_option_out_of_range_is_refused(options: dict, text: str) -> None:
    with pytest.raises(InputError, match=text):
        RobustOptions(**options)


@pytest.mark.parametrize("build", OURS)
def test_without_outliers_the_gate_changes_no_bit(build: Build) -> None:
    ends = []
    for options in (RobustOptions(), RobustOptions(1.0)):
        estimator, generator = (
            build(linear_process(np.random.default_rng(1)), robust=options),
            np.random.default_rng(2),
        )
        sensor = linear_sensor(3, generator)
        estimator.start(linear_belief(generator))
        for _ in range(10):
            estimator.predict(0.1)
            exact = sensor.predict(estimator.belief.mean, np.ones((4, 1)))
            assert (
                estimator.update(sensor.measurement(exact + 0.1 * generator.standard_normal((4, 3)))).accepted
                == 4
            )
        ends.append(estimator.belief)
    np.testing.assert_array_equal(ends[0].mean, ends[1].mean)
    np.testing.assert_array_equal(ends[0].factor, ends[1].factor)


def _ready(build: Build, options: RobustOptions | None = None) -> MultiplicativeFilter:
    estimator = build(PROCESS, robust=options)
    estimator.start(started(0).belief)
    estimator.predict(0.5)
    return estimator


@pytest.mark.parametrize("build", OURS)
def test_outliers_are_counted_and_leave_the_belief_as_if_they_were_not_there(build: Build) -> None:
    epoch = embedded(0).timeline[START.epochs].measurements[0]
    spoilt = epoch.values.copy()
    spoilt[:20] += 40.0
    clean, dirty = _ready(build), _ready(build)
    wanted = clean.update(replace(epoch, values=epoch.values[20:], parameters=epoch.parameters[20:]))
    report = dirty.update(replace(epoch, values=spoilt))
    assert (report.accepted, report.rejected) == (wanted.accepted, wanted.rejected + 20)
    assert report.nis == pytest.approx(wanted.nis, rel=1e-12)
    shift = FULL.local(clean.belief.mean, dirty.belief.mean) / clean.belief.std
    np.testing.assert_allclose(shift, 0, atol=1e-9)


@pytest.mark.parametrize("build", OURS)
def test_a_kernel_leaves_most_of_what_is_said_when_no_value_is_wrong(build: Build) -> None:
    epoch = embedded(0).timeline[START.epochs].measurements[0]
    plain, robust = _ready(build), _ready(build, RobustOptions(loss="huber"))
    plain.update(epoch)
    robust.update(epoch)
    shift = FULL.local(plain.belief.mean, robust.belief.mean) / plain.belief.std
    assert np.abs(shift).max() < 0.5


@pytest.mark.parametrize("build", OURS)
def test_a_measurement_given_twice_at_one_instant_counts_once(build: Build) -> None:
    epoch = embedded(0).timeline[START.epochs].measurements[0]
    estimator = _ready(build)
    estimator.update(epoch)
    once = estimator.belief
    report = estimator.update(epoch)
    assert (report.accepted, report.rejected, report.dof) == (0, len(epoch.values), 0)
    np.testing.assert_array_equal(estimator.belief.mean, once.mean)
    np.testing.assert_array_equal(estimator.belief.factor, once.factor)


@pytest.mark.parametrize("build", OURS)
def test_a_frozen_camera_is_not_believed(build: Build) -> None:
    epoch = embedded(0).timeline[START.epochs].measurements[0]
    estimator = _ready(build)
    estimator.update(epoch)
    for _ in range(3):
        estimator.predict(0.5)
        assert estimator.update(epoch).accepted == 0
    estimator.predict(0.5)
    assert estimator.update(embedded(0).timeline[START.epochs + 4].measurements[0]).accepted > 0


def test_after_refusing_most_values_often_enough_the_gate_is_lifted_and_closes_again() -> None:
    guard, Y = SensorOutlierRejection(RobustOptions()), np.zeros((10, 2, 1))
    far, near = 100 + np.zeros((10, 2)), np.zeros((10, 2))
    far[9] = 1e5
    for _ in range(RECOVERY_COUNT):
        found = guard.weights(far, lambda chosen: Y[chosen])
        assert found is not None
        assert not found.any()
    lifted = guard.weights(far, lambda chosen: Y[chosen])
    assert lifted is not None
    assert (lifted[:9] > 0.9).all()
    assert 0 < lifted[9] < 1e-4
    guard.weights(near, lambda chosen: Y[chosen])
    again = guard.weights(far, lambda chosen: Y[chosen])
    assert again is not None
    assert not again.any()


def test_a_gate_that_two_of_five_values_pass_is_not_lifted() -> None:
    guard, Y, values = SensorOutlierRejection(RobustOptions()), np.zeros((10, 2, 1)), np.zeros((10, 2))
    values[4:] = 100.0
    for _ in range(3 * RECOVERY_COUNT):
        found = guard.weights(values, lambda chosen: Y[chosen])
        assert found is not None
        np.testing.assert_array_equal(found, np.repeat([1, 0], [4, 6]))


def _exchanged(epoch: Measurement, share: float, generator: np.random.Generator) -> Measurement:
    """With a share of the landmarks exchanged in a ring."""
    values = epoch.values.copy()
    rows = generator.choice(len(values), round(share * len(values)), replace=False)
    values[rows] = values[np.roll(rows, 1)]
    return replace(epoch, values=values)


@pytest.mark.parametrize("build", OURS)
def test_sixty_percent_of_wrong_associations_do_not_lead_a_filter_astray(build: Build) -> None:
    timeline, truth, n = embedded(0).timeline, embedded(0).truth, START.epochs
    estimator, generator = build(PROCESS), np.random.default_rng(1)
    estimator.start(started(0).belief)
    for epoch in timeline[n : n + 10]:
        estimator.predict(0.5)
        estimator.update(_exchanged(epoch.measurements[0], 0.6, generator))
    error = np.linalg.solve(estimator.belief.factor, FULL.local(estimator.belief.mean, truth[n + 9]))
    assert error @ error < chi2.ppf(0.999, 20)


@pytest.mark.parametrize("wrong", [0.0, 0.3])
@pytest.mark.parametrize("build", OURS)
def test_a_filter_that_went_astray_finds_back(build: Build, wrong: float) -> None:
    timeline, truth, n = embedded(0).timeline, embedded(0).truth, START.epochs
    belief = started(0).belief
    away = np.zeros(20)
    away[FULL.slice("a")] = 0.2
    estimator, generator = build(PROCESS), np.random.default_rng(1)
    estimator.start(Gaussian(FULL, FULL.retract(belief.mean, away), belief.factor))
    accepted = []
    for epoch in timeline[n : n + 30]:
        estimator.predict(0.5)
        seen = _exchanged(epoch.measurements[0], wrong, generator)
        accepted.append(estimator.update(seen).accepted / len(seen.values))
    assert accepted[0] < 0.5
    assert min(accepted[-5:]) > 0.95 - wrong
    error = FULL.local(estimator.belief.mean, truth[n + 29])[FULL.slice("a")]
    assert np.linalg.norm(error) < 0.01


@pytest.mark.parametrize("build", OURS)
def test_a_restored_filter_goes_on_bit_for_bit_in_the_middle_of_refusals(build: Build) -> None:
    epochs = [epoch.measurements[0] for epoch in embedded(0).timeline[START.epochs : START.epochs + 6]]
    spoilt = [replace(epoch, values=epoch.values + 50.0) for epoch in epochs]
    first, second = build(PROCESS), build(PROCESS)
    first.start(started(0).belief)
    for k, epoch in enumerate(spoilt):
        if k == 2:
            second.restore(first.snapshot())
        first.predict(0.5)
        first.update(epoch)
        if k >= 2:
            second.predict(0.5)
            second.update(epoch)
    np.testing.assert_array_equal(first.belief.mean, second.belief.mean)
    np.testing.assert_array_equal(first.belief.factor, second.belief.factor)
