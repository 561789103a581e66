"""The sliding smoother end to end: as good as the batch, honest, and undisturbed by epochs that say nothing or nonsense."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.core.robust_losses import Gate, LeastSquares
from spinfilters.filters.estimator import LandmarkBelief, Measurement
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.filters.timeline import Epoch, SensorNoise, build_timeline
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensors.pose import Pose, pose_parameters
from spinfilters.models.state_layout import ROTATION_BLOCKS, StateLayout
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.smoother.linear_system import Marginals, SchurSystem
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.smoother.problem import Stage
from spinfilters.smoother.sliding_smoother import SlidingSmoother, SmootherOptions, UpdateResult
from spinfilters.smoother.solver import ConstantSchedule, Dogleg, Solve, SolverOptions, Step, solve
from spinfilters.smoother.window import FixedLag, FullSmoothing, LandmarkMarginalization, WindowPolicy
from tests.smoother.smoothing_samples import LAYOUT, LONG, PROCESS, SOON, STD, optimum, run, sample, smoother

GATE = Gate(5.0, 5.0)
MODES = (FullSmoothing(), FixedLag(10, SOON), LandmarkMarginalization())


@cache
def _finished(mode: WindowPolicy) -> tuple[SlidingSmoother, tuple[UpdateResult, ...]]:
    sliding = smoother(sample(LONG), mode)
    return sliding, tuple(sliding.add(epoch) for epoch in sample(LONG).epochs)


def test_smoothing_everything_after_every_epoch_ends_at_the_cost_of_the_batch() -> None:
    sliding, _ = _finished(FullSmoothing())
    problem = sliding.problem()
    here = problem.at(sliding.window.trajectory, sliding.window.points)
    last = problem.normal(here, Stage(GATE))
    batch = solve(problem, here, SolverOptions(40, 1e-6), ConstantSchedule(GATE))
    assert batch.converged
    assert here.cost(last.used, last.stage) - batch.costs[-1] < 0.5


def test_smoothing_everything_after_every_epoch_ends_where_the_batch_from_the_truth_ends() -> None:
    sliding, _ = _finished(FullSmoothing())
    away = LAYOUT.local(optimum(LONG).point.trajectory[-1], sliding.belief.mean)
    assert np.abs(away / sliding.belief.std).max() < 1.0


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_the_estimate_is_within_its_own_uncertainty_of_the_truth(mode: WindowPolicy) -> None:
    belief = _finished(mode)[0].belief
    assert np.isfinite(belief.factor).all()
    error = LAYOUT.local(belief.mean, sample(LONG).truth[-1])
    assert np.abs(error / belief.std).max() < 5.0


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_every_epoch_is_accounted_for(mode: WindowPolicy) -> None:
    sliding, taken = _finished(mode)
    counts = [sum(len(m.values) for m in epoch.measurements) for epoch in sample(LONG).epochs]
    assert [t.accepted + t.rejected for t in taken] == counts
    gone = [row.time for t in taken for row in t.marginalized]
    left = [epoch.time for epoch in sliding.window.epochs]
    assert gone + left == [epoch.time for epoch in sample(LONG).epochs]


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_smoothed_epochs_are_within_their_own_uncertainty_of_the_truth(mode: WindowPolicy) -> None:
    truth = sample(LONG).truth[-len(_finished(mode)[0].window.epochs) :]
    rows = _finished(mode)[0].smoothed()
    assert len(rows) == len(truth)
    for row, x in zip(rows[1:], truth[1:], strict=True):
        std = np.linalg.norm(row.factor, axis=1)
        assert np.abs(LAYOUT.local(row.mean, x) / std).max() < 6.0


def test_the_mass_distribution_becomes_known() -> None:
    here = sample(LONG)
    sliding = run(smoother(here, FullSmoothing()), here.epochs[:2])
    early = sliding.mass_std
    assert early > 0.4
    assert _finished(FullSmoothing())[0].mass_std < early / 2


class _Counted(Dogleg):
    """Dogleg steps within a small radius, counted."""

    steps = 0

    def propose(self, solve: Solve, layout: StateLayout, number: float) -> Step | None:
        """Count the step."""
        type(self).steps += 1
        return super().propose(solve, layout, number)


def test_a_step_rule_of_ones_own_is_followed_to_the_same_estimate() -> None:
    here, few = sample(LONG), sample(LONG).epochs[:12]
    plain = run(smoother(here, FullSmoothing()), few)
    rule = _Counted(1.0)
    sliding = run(smoother(here, FullSmoothing(), rule=rule), few)
    assert _Counted.steps > len(few) / 2
    for each in (plain, sliding):
        each.settle()
    away = LAYOUT.local(plain.belief.mean, sliding.belief.mean)
    assert np.abs(away / plain.belief.std).max() < 0.1


def _blind(epoch: Epoch) -> Epoch:
    return Epoch(epoch.time, ())


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_epochs_without_an_observation_are_bridged(mode: WindowPolicy) -> None:
    here = sample(LONG)
    epochs = tuple(_blind(f) if 12 <= k < 18 else f for k, f in enumerate(here.epochs))
    sliding = run(smoother(here, mode), epochs[:12])
    known = sliding.belief.std
    run(sliding, epochs[12:18])
    lost = sliding.belief.std
    assert (lost[:6] > known[:6]).all()
    run(sliding, epochs[18:])
    error = LAYOUT.local(sliding.belief.mean, here.truth[-1])
    assert np.abs(error / sliding.belief.std).max() < 5.0


def _nonsense(epoch: Epoch, generator: np.random.Generator) -> Epoch:
    """Every observation of a landmark at another one's place."""
    (m,) = epoch.measurements
    return Epoch(epoch.time, (replace(m, values=generator.permutation(m.values)),))


@cache
def _after_nonsense(mode: WindowPolicy) -> tuple[SlidingSmoother, UpdateResult, np.ndarray]:
    """After a run in which epoch 20 holds wrong observations alone; what that epoch did, and its error in standard deviations."""
    here = sample(LONG)
    sliding = run(smoother(here, mode), here.epochs[:20])
    taken = sliding.add(_nonsense(here.epochs[20], np.random.default_rng(0)))
    away = LAYOUT.local(sliding.belief.mean, here.truth[20]) / sliding.belief.std
    return run(sliding, here.epochs[21:]), taken, away


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_a_frame_of_wrong_observations_alone_leaves_the_end_of_the_run_as_it_was(mode: WindowPolicy) -> None:
    clean = _finished(mode)[0].belief
    away = LAYOUT.local(clean.mean, _after_nonsense(mode)[0].belief.mean)
    assert np.abs(away / clean.std).max() < 3.0


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_wrong_observations_alone_are_rejected(mode: WindowPolicy) -> None:
    taken = _after_nonsense(mode)[1]
    assert taken.rejected > 0.5 * (taken.accepted + taken.rejected)


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_wrong_observations_alone_do_not_mislead_the_epoch_that_holds_them(mode: WindowPolicy) -> None:
    assert np.abs(_after_nonsense(mode)[2]).max() < 6.0


def test_a_share_of_wrong_associations_does_little_harm() -> None:
    here = sample(LONG, wrong=0.1)
    belief = run(smoother(here, FullSmoothing()), here.epochs).belief
    error = LAYOUT.local(belief.mean, here.truth[-1])
    assert np.abs(error / belief.std).max() < 6.0


def _earlier(sliding: SlidingSmoother) -> None:
    sliding.add(sample(LONG).epochs[1])


def _again(sliding: SlidingSmoother) -> None:
    sliding.add(sample(LONG).epochs[2])


@pytest.mark.parametrize("attempt", [_earlier, _again])
def test_time_that_does_not_go_forwards_is_refused(attempt: Callable[[SlidingSmoother], None]) -> None:
    sliding = run(smoother(sample(LONG), FullSmoothing()), sample(LONG).epochs[:3])
    before = sliding.belief
    with pytest.raises(InputError, match="order of time"):
        attempt(sliding)
    np.testing.assert_array_equal(sliding.belief.mean, before.mean)
    np.testing.assert_array_equal(sliding.belief.factor, before.factor)


POSE = Pose(LAYOUT)


def _with_pose(epoch: Epoch, x: np.ndarray, std: float, generator: np.random.Generator) -> Epoch:
    noise = np.concatenate([std * generator.standard_normal(6), np.zeros(14)])
    values = LAYOUT.retract(x, noise)[None, :7]
    parameters = pose_parameters(std**2 * np.eye(6)[None])
    return Epoch(epoch.time, (*epoch.measurements, Measurement(POSE, values, parameters)))


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_a_second_sensor_sharpens_the_estimate(mode: WindowPolicy) -> None:
    here, generator = sample(LONG), np.random.default_rng(3)
    pairs = zip(here.epochs, here.truth, strict=True)
    both = run(smoother(here, mode), tuple(_with_pose(f, x, 0.002, generator) for f, x in pairs)).belief
    alone = _finished(mode)[0].belief
    assert (both.std[:6] < alone.std[:6]).all()
    error = LAYOUT.local(both.mean, here.truth[-1])
    assert np.abs(error / both.std).max() < 5.0


def _gyro_run(mode: WindowPolicy) -> tuple[SlidingSmoother, float]:
    """A rotation alone, seen by a gyro; and its true speed at the end."""
    layout = StateLayout(ROTATION_BLOCKS)
    dataset = simulate(Scenario.simplified(kind="gyro", rate_rpm=RICH_RPM, epochs=25))
    assert dataset.truth is not None
    epochs = build_timeline(dataset.log, layout, SensorNoise(gyro_noise_std=0.002))
    prior = FirstStatePrior(layout.origin(), np.repeat([1e-6, 1.0, 0.5], [3, 3, 5]))
    process = TorqueFreeProcess(layout, ProcessNoise())
    sliding = run(SlidingSmoother(process, prior, SmootherOptions(mode), has_landmarks=False), epochs)
    return sliding, float(np.linalg.norm(dataset.truth.rate_i[-1]))


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_a_gyro_alone_can_be_smoothed(mode: WindowPolicy) -> None:
    sliding, speed = _gyro_run(mode)
    belief = sliding.belief
    assert np.isfinite(belief.factor).all()
    assert np.linalg.norm(belief.mean[belief.layout.mean_slice("w")]) == pytest.approx(speed, abs=0.01)
    assert belief.std[belief.layout.slice("w")].max() < 0.002


def test_a_guessed_pose_is_where_an_epoch_begins() -> None:
    """One that is nonsense is overcome by the observations."""
    here = sample(LONG)
    sliding = run(smoother(here, FullSmoothing()), here.epochs[:14])
    guess = LAYOUT.retract(here.truth[14], np.concatenate([np.full(3, 0.01), np.full(3, 0.1), np.zeros(14)]))
    sliding.add(here.epochs[14], guess[:7])
    expected = run(smoother(here, FullSmoothing()), here.epochs[:15]).belief
    away = LAYOUT.local(expected.mean, sliding.belief.mean)
    assert np.abs(away / expected.std).max() < 0.5


def test_least_squares_as_the_kernel_rejects_nothing() -> None:
    options = SmootherOptions(FullSmoothing(), loss=LeastSquares())
    prior = FirstStatePrior(sample(LONG).truth[0], STD)
    sliding = SlidingSmoother(PROCESS, prior, options, has_landmarks=True)
    epochs = [
        _nonsense(f, np.random.default_rng(k)) if k == 5 else f for k, f in enumerate(sample(LONG).epochs)
    ]
    assert sum(sliding.add(epoch).rejected for epoch in epochs[:8]) == 0


def test_epochs_that_have_left_do_not_count_against_the_fit_of_the_others() -> None:
    sliding, _ = _finished(FixedLag(10, SOON))
    prior, other = sliding.window.marginal_prior, smoother(sample(LONG), FixedLag(10, SOON))
    assert prior is not None
    many_left = replace(sliding.window, marginal_prior=replace(prior, constant_cost=1e6))
    other.resume(many_left, replace(sliding.state, fits=False))
    other._remember(other.problem())
    assert other.state.fits


def test_epochs_that_have_gathered_end_where_those_that_come_one_by_one_do() -> None:
    one_by_one, together = _finished(FullSmoothing())[0], smoother(sample(LONG), FullSmoothing())
    epochs = sample(LONG).epochs
    for first in range(0, len(epochs), 4):
        together.add_all(epochs[first : first + 4])
    away = LAYOUT.local(one_by_one.belief.mean, together.belief.mean)
    assert np.abs(away / one_by_one.belief.std).max() < 0.5
    np.testing.assert_allclose(together.belief.std, one_by_one.belief.std, rtol=0.05)


def test_the_latest_state_and_the_map_are_told_together_with_their_joint_covariance() -> None:
    sliding, _ = _finished(FullSmoothing())
    told, belief = sliding.joint_belief(LandmarkOptions(explained=0.0)), sliding.belief
    assert isinstance(told, LandmarkBelief)
    np.testing.assert_array_equal(told.mean, belief.mean)
    np.testing.assert_allclose(told.state.covariance, belief.covariance, rtol=1e-6, atol=1e-14)
    normal = sliding._linearised().normal
    assert isinstance(normal.solution, SchurSystem)
    marginals = Marginals(normal.solution, normal.eliminated)
    assert normal.eliminated is not None
    by_epochs, own = marginals.landmark_rows(np.flatnonzero(normal.eliminated.is_constrained))
    expected = by_epochs @ by_epochs.swapaxes(1, 2) + own @ own.swapaxes(1, 2)
    rows = told.joint_factor()[LAYOUT.error_dim :].reshape(len(told.ids), 3, -1)
    found, wanted = (np.sqrt(np.einsum("kii->ki", P)) for P in (rows @ rows.swapaxes(1, 2), expected))
    np.testing.assert_allclose(found, wanted, rtol=0.05)  # what few modes leave out is each landmark's own
