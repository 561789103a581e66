"""Covariances of filters without a map stay positive definite at any time step, prior and precision; conventional ones do not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from experiments.arithmetic_methods import CONVENTIONAL, forms_definite, is_definite, lower
from experiments.arithmetic_runs import FilterStep
from experiments.arithmetic_sweep import RATIO, check, inspect, noise_error
from spinfilters.filters.estimator import Measurement
from spinfilters.filters.iterated_update import IterationOptions
from spinfilters.filters.outlier_rejection import RobustOptions
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.models.state_layout import Gaussian
from tests.filters.landmark_samples import FILTERS, LAYOUT, PROCESS, recording, started

RUNS = 150
LARGEST_ERROR = {"float64": 1e-6, "float32": 0.1}
"""Relative, of a standard deviation after three cycles; variance ratios of 1e12 cost six digits."""


@cache
def swept():
    return [check(seed, every=2) for seed in range(RUNS)]


def test_no_covariance_is_indefinite_and_nothing_is_nan():
    assert not [(seed, one.failures) for seed, one in enumerate(swept()) if one.failures]


def test_the_sweep_reaches_what_it_is_about():
    ratios, steps = [one.ratio for one in swept()], [one.run.dt for one in swept()]
    assert max(ratios) > 0.1 * RATIO
    assert min(steps) < 3e-4
    assert max(steps) > 5
    assert {(one.run.estimator, one.run.precision) for one in swept()} == {
        (name, precision) for name in ("mekf", "ukf") for precision in LARGEST_ERROR
    }


@pytest.mark.parametrize("precision", LARGEST_ERROR)
def test_standard_deviations_are_those_of_extended_precision(precision):
    errors = [one.std_error for one in swept() if one.solved_again and one.run.precision == precision]
    assert len(errors) > 10
    assert max(errors) < LARGEST_ERROR[precision]


@pytest.mark.parametrize("form", CONVENTIONAL)
def test_the_same_problems_make_conventional_covariances_indefinite(form):
    again = [one for one in swept() if one.solved_again and one.run.precision == "float32"]
    assert np.mean([one.indefinite[form] for one in again]) > 0.3


def test_the_check_tells_a_singular_and_an_indefinite_covariance():
    generator = np.random.default_rng(0)
    factor = np.tril(generator.standard_normal((6, 6)))
    assert forms_definite(factor)
    assert is_definite(factor @ factor.T)
    factor[3, 3] = 0.0
    assert not forms_definite(factor)
    assert not is_definite(np.diag([1.0, 1.0, -1e-12]))
    assert not is_definite(np.array([[1.0, 1.0 + 1e-12], [1.0 + 1e-12, 1.0]]))


def test_correlations_of_all_but_one_are_told_from_one():
    assert forms_definite(np.array([[1.0, 0.0], [1.0, 1e-30]]))


def test_the_reference_triangularises():
    rows = np.random.default_rng(1).standard_normal((5, 9)).astype(np.longdouble)
    L = lower(rows)
    np.testing.assert_allclose((L @ L.T - rows @ rows.T).astype(float), 0, atol=1e-17)
    assert not np.triu(L, 1).any()


@pytest.mark.parametrize("dt", [1e-4, 1e-3, 1e-2, 0.1, 0.2, 0.5, 2.0, 10.0])
def test_process_noise_over_a_step_is_that_of_many_short_ones(dt):
    assert noise_error(dt) < 1e-6


def turned(length, precision="float64", name="mekf"):
    """A filter with a map that is all but known, before and after observations that turn it by 4 x MRP of this length."""
    recorded = recording()
    epoch = recorded.timeline[0].measurements[0]
    once = {"iteration": IterationOptions(iterations=1)} if name == "mekf" else {}
    estimator = started()
    estimator.start(Gaussian(LAYOUT, recorded.states[0], 1e-6 * np.eye(20)))
    estimator.update(epoch)
    known = estimator.landmark_belief
    factor = np.eye(len(known.factor))
    factor[:20, :20] *= 1e-4
    factor[3:6, 3:6] = 100 * np.eye(3)
    roots = np.tile(1e-4 * np.eye(3), (len(known.ids), 1, 1))
    wide = replace(known, factor=factor, modes=0 * known.modes, roots=roots)
    options = LandmarkOptions(precision=precision)
    result = FILTERS[name](PROCESS, landmarks=options, robust=RobustOptions(gate_probability=1.0), **once)
    result.start(wide)
    before = result.snapshot()
    result.update(_observations_of_a_turn(epoch, known, length * np.array([0.6, -0.64, 0.48])))
    return before, result


def _observations_of_a_turn(epoch, known, turn):
    """What the linear model expects to see after the turn."""
    rows = [epoch.ids.tolist().index(i) for i in known.ids]
    parameters = epoch.parameters[rows].copy()
    parameters[:, :3] = known.points
    at = epoch.model.linearise_landmarks(known.mean, parameters, epoch.values[rows])
    moved = at.jacobian[:, :, 3:] @ turn
    values = epoch.model.predict(known.mean, parameters) + moved * parameters[0, 8]
    return Measurement(epoch.model, values, parameters, known.ids)


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("length", [3.9, 4.0, 4.1, 12.0, 400.0])
def test_an_error_of_half_a_turn_and_more_folds_into_a_regular_covariance(length, precision):
    """4 x MRP of length 4 is 180 degrees."""
    before, estimator = turned(length, precision)
    angle = np.linalg.norm(LAYOUT.local(before["mean"], estimator.belief.mean)[3:6])
    short = length if length <= 4 else 16 / length
    assert angle == pytest.approx(short, rel=0.05)
    factor = estimator.snapshot()["factor"]
    assert np.isfinite(factor).all()
    assert forms_definite(factor[:20])


def test_half_a_turn_is_survived_by_the_unscented_filter():
    _, estimator = turned(4.0, name="ukf")
    assert forms_definite(estimator.snapshot()["factor"][:20])


@pytest.mark.parametrize("length", [0.0, 3.999999, 4.0, 4.000001, 40.0, 4000.0])
def test_the_reset_is_regular_for_turns_of_any_size(length):
    d = np.zeros(20)
    d[3:6] = length * np.array([0.6, -0.64, 0.48])
    block = LAYOUT.reset_jacobian(d)[3:6, 3:6]
    values = np.linalg.svd(block, compute_uv=False)
    np.testing.assert_allclose(values, 1 / (1 + (length / 4) ** 2), rtol=1e-9)


def test_the_inspection_reports_what_is_wrong():
    """A factor that is not finite, or singular; a landmark whose own covariance is."""
    one = check(0, every=10**9)
    before, estimator = turned(1.0)
    good = estimator.snapshot()
    singular, lost, flat = good["factor"].copy(), good["factor"].copy(), good["map.roots"].copy()
    singular[3], lost[4, 1], flat[0, 2, 2] = 0.0, np.nan, 0.0
    wrong = {
        "singular": {"factor": singular},
        "not finite": {"factor": lost},
        "a landmark is singular": {"map.roots": flat},
    }
    for word, bad in wrong.items():
        one.failures.clear()
        inspect(one, FilterStep(before, good | bad, None, None, 0))
        assert word in one.failures
