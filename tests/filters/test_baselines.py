"""filterpy's plain filters as baselines: the chart they live on, their agreement with ours, their honest failures."""

from collections.abc import Callable

import numpy as np
import pytest

from spinfilters.filters.baselines import FilterpyEkf, FilterpyUkf, GlobalCoordinates
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Estimator, ProcessModel
from spinfilters.filters.measurement_prediction import SigmaPointOptions
from spinfilters.filters.timeline import run
from spinfilters.filters.ukf import MultiplicativeUkf
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import ROTATION_BLOCKS, Gaussian, StateLayout
from spinfilters.models.status import Verdict
from tests.filters.filter_samples import FULL, PROCESS, START, embedded, run_on, started
from tests.filters.linear_samples import log_density

ROTATION = StateLayout(ROTATION_BLOCKS)
CHART = GlobalCoordinates(FULL)
A = FULL.slice("a")
Build = Callable[[ProcessModel], Estimator]


def _coordinates(seed: int, turn: float) -> np.ndarray:
    """Coordinates with an MRP of this size."""
    xi = 0.5 * np.random.default_rng(seed).standard_normal(20)
    xi[A] *= turn / np.linalg.norm(xi[A])
    return xi


@pytest.mark.parametrize("turn", [1e-9, 1.0, 3.9999, 4.0, 4.0001, 7.0])
def test_coordinates_come_back_from_their_point_on_the_same_branch(turn: float) -> None:
    xi = _coordinates(1, turn)
    np.testing.assert_allclose(CHART.coordinates(CHART.point(xi)), xi, atol=1e-12)


@pytest.mark.parametrize("turn", [1e-9, 1.0, 3.9, 5.0])
def test_the_chart_s_derivative_is_that_with_respect_to_the_multiplicative_error(turn: float) -> None:
    xi, h = _coordinates(2, turn), 1e-6
    x, steps = CHART.point(xi), h * np.eye(20)
    ahead, behind = (CHART.coordinates(FULL.retract(x, sign * steps)) for sign in (1, -1))
    np.testing.assert_allclose(CHART.derivative(xi), (ahead - behind).T / (2 * h), atol=1e-8)


def _shadow(a: np.ndarray) -> np.ndarray:
    """The other 4 x MRP of the same attitude."""
    return -16 * a / (a @ a)


def test_beyond_half_a_revolution_mean_and_covariance_switch_to_the_shadow_set() -> None:
    root = np.random.default_rng(3).standard_normal((20, 20))
    P, xi, h = root @ root.T, _coordinates(3, 4.5), 1e-6
    switched, moved = CHART.shortened(xi, P)
    np.testing.assert_allclose(switched[A], _shadow(xi[A]))
    assert np.linalg.norm(switched[A]) == pytest.approx(16 / 4.5)
    jacobian = np.eye(20)
    jacobian[A, A] = [(_shadow(xi[A] + h * e) - _shadow(xi[A] - h * e)) / (2 * h) for e in np.eye(3)]
    np.testing.assert_allclose(moved, jacobian.T @ P @ jacobian, atol=1e-7 * np.abs(moved).max())
    short, same = CHART.shortened(_coordinates(3, 3.9), P)
    np.testing.assert_array_equal(short, _coordinates(3, 3.9))
    np.testing.assert_array_equal(same, P)


def test_the_shadow_set_describes_the_same_belief() -> None:
    root = np.random.default_rng(4).standard_normal((20, 20))
    P, xi = root @ root.T + np.eye(20), _coordinates(4, 4.5)
    before, after = CHART.to_belief(xi, P), CHART.to_belief(*CHART.shortened(xi, P))
    np.testing.assert_allclose(FULL.local(before.mean, after.mean), 0.0, atol=1e-12)
    np.testing.assert_allclose(after.covariance, before.covariance, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_belief_survives_the_way_into_the_chart_and_back(sign: float) -> None:
    belief = started(0).belief
    mean = belief.mean.copy()
    mean[FULL.mean_slice("a")] *= sign
    xi, P = CHART.from_belief(Gaussian(FULL, mean, belief.factor))
    assert np.linalg.norm(xi[A]) <= 4.0
    back = CHART.to_belief(xi, P)
    np.testing.assert_allclose(FULL.local(belief.mean, back.mean) / belief.std, 0.0, atol=1e-9)
    scale = np.outer(belief.std, belief.std)
    np.testing.assert_allclose(back.covariance / scale, belief.covariance / scale, atol=1e-8)


@pytest.mark.parametrize("spoil", [-1.0, 0.0, np.nan])
def test_a_covariance_that_is_not_positive_definite_is_not_repaired(spoil: float) -> None:
    P = np.eye(20)
    P[7, 7] = spoil
    with pytest.raises(np.linalg.LinAlgError):
        CHART.to_belief(_coordinates(5, 1.0), P)


@pytest.mark.parametrize(
    ("theirs", "ours"), [(FilterpyEkf, MultiplicativeEkf), (FilterpyUkf, MultiplicativeUkf)]
)
def test_one_epoch_from_a_narrow_belief_is_that_of_the_multiplicative_filter(
    theirs: Build, ours: Build
) -> None:
    """A narrow belief makes every chart alike."""
    belief, epoch = started(0).belief, embedded(0).timeline[START.epochs].measurements[0]
    narrow = Gaussian(FULL, belief.mean, 1e-4 * belief.factor)
    plain, multiplicative = theirs(PROCESS), ours(PROCESS)
    reports = []
    for estimator in (plain, multiplicative):
        estimator.start(narrow)
        estimator.predict(0.5)
        reports.append(estimator.update(epoch))
    std = multiplicative.belief.std
    shift = FULL.local(multiplicative.belief.mean, plain.belief.mean) / std
    np.testing.assert_allclose(shift, 0.0, atol=1e-3)
    np.testing.assert_allclose(plain.belief.std, std, rtol=1e-3)
    assert reports[0].nis == pytest.approx(reports[1].nis, rel=1e-6)
    assert reports[0].log_likelihood == pytest.approx(reports[1].log_likelihood, rel=1e-6)


@pytest.mark.parametrize("build", [FilterpyEkf, FilterpyUkf])
def test_the_likelihood_is_that_of_filterpy_s_innovation_and_its_covariance(
    build: type[FilterpyEkf | FilterpyUkf],
) -> None:
    epoch = embedded(0).timeline[START.epochs].measurements[0]
    estimator = build(PROCESS)
    estimator.start(started(0).belief)
    estimator.predict(0.5)
    report = estimator.update(epoch)
    whitened = log_density(estimator._filter.y, estimator._filter.S)
    log_noise = epoch.model.linearise(estimator.belief.mean, epoch.parameters, epoch.values).log_noise.sum()
    assert report.log_likelihood == pytest.approx(whitened - log_noise, rel=1e-9)


@pytest.mark.parametrize(
    ("theirs", "ours"), [(FilterpyEkf, MultiplicativeEkf), (FilterpyUkf, MultiplicativeUkf)]
)
def test_on_the_known_map_example_a_baseline_tells_much_the_same_story(theirs: Build, ours: Build) -> None:
    timeline = embedded(1).timeline[: START.epochs + 8]
    plain, multiplicative = run_on(theirs(PROCESS), 1, timeline), run_on(ours(PROCESS), 1, timeline)
    assert plain.status.verdict is Verdict.OK
    np.testing.assert_array_equal(plain.dof, multiplicative.dof)
    assert np.abs(FULL.local(multiplicative.mean, plain.mean) / multiplicative.std).max() < 2.0
    np.testing.assert_allclose(plain.nis, multiplicative.nis, rtol=0.02)


@pytest.mark.parametrize("build", [FilterpyEkf, FilterpyUkf])
def test_many_revolutions_pass_through_the_shadow_set_without_a_jump(build: Build) -> None:
    """30 steps of 60 degrees about a principal axis, with a belief so narrow that every chart must agree."""
    process = TorqueFreeProcess(ROTATION, ProcessNoise(torque_psd=1e-14))
    x = ROTATION.origin()
    x[ROTATION.mean_slice("w")] = [0.0, 0.0, np.pi / 3]
    estimator, reference = build(process), MultiplicativeEkf(process)
    for each in (estimator, reference):
        each.start(Gaussian(ROTATION, x, 1e-5 * np.eye(11)))
    for _ in range(30):
        estimator.predict(1.0)
        reference.predict(1.0)
        x = process.step(x, 1.0)
        shift = ROTATION.local(estimator.belief.mean, x)[:6] / reference.belief.std[:6]
        np.testing.assert_allclose(shift, 0.0, atol=0.01)
        np.testing.assert_allclose(estimator.belief.std, reference.belief.std, rtol=1e-3)


def test_sigma_points_that_make_a_covariance_indefinite_fail_the_run() -> None:
    """alpha = 1e-3, filterpy's own example, weights the centre with minus a million."""
    belief = started(0).belief
    wide = Gaussian(
        FULL, belief.mean, 1200 * belief.factor
    )  # in the first epoch: later ones hang on rounding
    timeline = embedded(0).timeline
    estimator = FilterpyUkf(PROCESS, SigmaPointOptions(alpha=1e-3))
    estimator.start(wide)
    with np.errstate(all="ignore"):
        history = run(estimator, timeline[START.epochs - 1].time, timeline[START.epochs : START.epochs + 10])
    assert history.has_failed
    assert "factorised" in history.status.reasons[0]
    assert len(history.time) < 10
