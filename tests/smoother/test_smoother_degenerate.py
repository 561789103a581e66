"""Systems that do not determine everything: nothing is raised from inside, and what is not determined does not look determined."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.core.robust_losses import Gate
from spinfilters.filters.timeline import Epoch, Timeline
from spinfilters.simulation.scenario import Scenario
from spinfilters.smoother.linear_system import latest_factor
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.smoother.problem import Stage, problem_of
from spinfilters.smoother.sliding_smoother import SlidingSmoother, SmootherOptions
from spinfilters.smoother.solver import (
    Dogleg,
    GaussNewton,
    SolverOptions,
    StepRule,
    solve,
)
from spinfilters.smoother.window import (
    DETERMINED,
    FixedLag,
    FullSmoothing,
    LandmarkMarginalization,
    WindowPolicy,
)
from tests.smoother.smoothing_samples import (
    LAYOUT,
    LONG,
    MIDDLE,
    PLAIN,
    PROCESS,
    SMALL,
    SOON,
    STD,
    perturbed,
    run,
    sample,
    smoother,
    solved,
)

MODES = (FullSmoothing(), FixedLag(4, SOON), LandmarkMarginalization())
NO_IDS, NO_POINTS = np.zeros(0, dtype=int), np.zeros((0, 3))
RULES = (GaussNewton(), Dogleg())


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_one_epoch_alone_is_its_prior(mode: WindowPolicy) -> None:
    sliding = run(smoother(sample(LONG), mode), sample(LONG).epochs[:1])
    belief = sliding.belief
    np.testing.assert_allclose(belief.mean, sample(LONG).truth[0], atol=1e-12)
    np.testing.assert_allclose(belief.factor @ belief.factor.T, np.diag(STD**2), rtol=1e-6, atol=1e-16)
    assert sliding.mass_std > DETERMINED
    assert len(sliding.smoothed()) == 1


def test_one_epoch_in_a_batch_takes_no_observations() -> None:
    here = sample(SMALL)
    problem = problem_of(PROCESS, here.epochs[:1], here.known.ids, here.prior, 2)
    assert problem.observations is None
    found = solve(problem, problem.at(here.truth[:1], here.known.points), SolverOptions())
    assert found.converged
    assert found.costs[-1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("mode", MODES, ids=str)
@pytest.mark.parametrize("rate", [(0.0, 10.0, 0.0), (0.0, 0.0, 0.0), (0.0, 1e-6, 0.0)], ids=str)
def test_a_body_that_does_not_tumble_keeps_its_inertia_unknown(
    mode: WindowPolicy, rate: tuple[float, float, float]
) -> None:
    scenario = Scenario.simplified(rate_rpm=rate, epochs=12, landmarks=120, axes_euler_g=(0.0, 0.0, 0.0))
    here = sample(scenario)
    sliding = run(smoother(here, mode), here.epochs)
    belief = sliding.belief
    assert np.isfinite(belief.mean).all()
    assert np.isfinite(belief.factor).all()
    assert sliding.mass_std > DETERMINED
    error = LAYOUT.local(belief.mean, here.truth[-1])
    assert np.abs(error / belief.std).max() < 6.0


def _blind(epochs: Timeline) -> Timeline:
    return tuple(Epoch(epoch.time, ()) for epoch in epochs)


@pytest.mark.parametrize("mode", MODES, ids=str)
@pytest.mark.parametrize("has_landmarks", [True, False])
def test_nothing_measured_at_all_is_the_prediction(mode: WindowPolicy, has_landmarks: bool) -> None:
    here = sample(LONG)
    std = np.repeat([0.01, 0.01, 0.01, 0.02, 0.01, 0.02], [3, 3, 3, 3, 3, 5])
    sliding = SlidingSmoother(
        PROCESS, FirstStatePrior(here.truth[0], std), SmootherOptions(mode), has_landmarks
    )
    run(sliding, _blind(here.epochs[:8]))
    x, P = here.truth[0], np.diag(std**2)
    for _ in range(7):
        x, transition, noise = PROCESS.linearise(x, 0.5)
        P = transition @ P @ transition.T + noise @ noise.T
    belief, scale = sliding.belief, np.sqrt(np.outer(np.diag(P), np.diag(P)))
    np.testing.assert_allclose(LAYOUT.local(x, belief.mean), 0.0, atol=1e-6)
    np.testing.assert_allclose(belief.factor @ belief.factor.T / scale, P / scale, atol=1e-4)


@pytest.mark.parametrize("rule", RULES, ids=str)
def test_weights_that_are_all_zero_leave_the_prior_and_the_dynamics(rule: StepRule) -> None:
    here, trial = sample(MIDDLE), perturbed(sample(MIDDLE), 0)
    found = solved(
        here, trial, rule, Gate(5.0, 5.0, np.zeros(len(here.problem.observations or ()), dtype=bool))
    )
    assert found.normal.used is not None
    assert not found.normal.used.any()
    np.testing.assert_array_equal(found.point.points, trial.points)
    assert np.isfinite(found.costs).all()
    assert found.costs[-1] < 1.0


def test_no_prior_leaves_the_frame_undetermined() -> None:
    here = sample(MIDDLE)
    problem = replace(here.problem, motion=replace(here.problem.motion, prior=None))
    point = problem.at(here.truth, here.known.points)
    found = solve(problem, point, SolverOptions(3))
    assert np.isfinite(found.point.trajectory).all()
    solution = found.normal.solution
    assert solution is None or np.linalg.norm(latest_factor(solution), axis=1).max() > 1.0


def test_no_prior_and_no_observations_are_not_solved() -> None:
    here = sample(MIDDLE)
    problem = problem_of(PROCESS, _blind(here.epochs), NO_IDS, None, 2)
    for rule in RULES:
        found = solve(problem, problem.at(here.truth, NO_POINTS), SolverOptions(5, rule=rule))
        assert np.isfinite(found.point.trajectory).all()


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_a_prior_that_is_not_a_number_gives_a_belief_that_is_not_finite(mode: WindowPolicy) -> None:
    here = sample(LONG)
    sliding = smoother(here, mode, np.where(np.arange(20) == 7, np.nan, STD))
    for epoch in here.epochs[:8]:
        sliding.add(epoch)
    assert not np.isfinite(sliding.belief.factor).any()
    assert sliding.mass_std == np.inf
    assert all(not np.isfinite(row.factor).any() for row in sliding.smoothed())


@pytest.mark.parametrize("rule", RULES, ids=str)
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
def test_a_trial_that_is_not_finite_is_reported_and_not_raised(rule: StepRule, value: float) -> None:
    here, trial = sample(SMALL), perturbed(sample(SMALL), 0)
    trajectory = trial.trajectory.copy()
    trajectory[2, LAYOUT.mean_slice("w")] = value
    found = solved(here, replace(trial, trajectory=trajectory), rule)
    assert not found.converged


def test_measured_values_that_are_not_numbers_do_not_count() -> None:
    here = sample(MIDDLE)
    (m,) = here.epochs[4].measurements
    values = m.values.copy()
    values[::2] = np.nan
    epochs = (*here.epochs[:4], Epoch(here.epochs[4].time, (replace(m, values=values),)), *here.epochs[5:])
    problem = problem_of(PROCESS, epochs, here.known.ids, here.prior, 2)
    point = problem.at(here.truth, here.known.points)
    normal = problem.normal(point, PLAIN)
    assert problem.observations is not None
    assert normal.solved
    assert normal.used is not None
    assert np.count_nonzero(normal.used) < len(problem.observations)
    assert np.isfinite(point.cost(normal.used, PLAIN))


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_a_frame_of_values_that_are_not_numbers_is_as_good_as_blind(mode: WindowPolicy) -> None:
    here, epochs = sample(LONG), list(sample(LONG).epochs[:12])
    (m,) = epochs[7].measurements
    epochs[7] = Epoch(epochs[7].time, (replace(m, values=np.full_like(m.values, np.nan)),))
    sliding = smoother(here, mode)
    taken = [sliding.add(epoch) for epoch in epochs]
    assert taken[7].accepted == 0
    assert np.isfinite(sliding.belief.factor).all()
    error = LAYOUT.local(sliding.belief.mean, here.truth[11])
    assert np.abs(error / sliding.belief.std).max() < 6.0


def test_landmarks_that_are_all_unbelieved_are_not_told() -> None:
    here = sample(SMALL)
    problem = here.problem
    point = problem.at(here.truth, here.known.points + 10.0)
    normal = problem.normal(point, Stage(Gate(5.0, 5.0)))
    assert normal.solved
    assert normal.eliminated is not None
    assert not normal.eliminated.is_constrained.any()
