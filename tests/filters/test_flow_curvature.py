"""Second-order terms of the motion keep a filter of an undisturbed motion consistent, and leave others what they are."""

from functools import cache

import numpy as np
import pytest
from jaxtyping import Float

from spinfilters.evaluation.consistency import chi_square_band, true_states
from spinfilters.filters.compiled_steps import compiled_propagation
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import EpochRun, Measurement, SensorTimeline
from spinfilters.filters.flow_curvature import (
    LEFT,
    SOFT,
    TURN,
    FlowCurvature,
    bends_over,
)
from spinfilters.filters.timeline import LogTimeline, SensorNoise, Timeline, build_timeline, run
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, Gaussian, StateLayout
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate

FULL = StateLayout(FULL_BLOCKS)
UNDISTURBED = TorqueFreeProcess(FULL, ProcessNoise(0.0, 0.0))
SEEDS = 12
STD = np.repeat([0.01, 0.01, 0.02, 0.02, 0.005, 0.15], [3, 3, 3, 3, 3, 5])
"""Of a belief whose moments are hardly known."""


@cache
def poses(seed: int) -> tuple[Timeline, Gaussian, Float[np.ndarray, "k m"]]:
    """Poses of a throw without disturbances, a belief drawn about its first state, and true states."""
    scenario = Scenario.simplified(
        kind="pose",
        rate_rpm=tuple(8 * np.array(RICH_RPM)),
        epochs=120,
        interval=0.005,
        noise=ProcessNoise(0.0, 0.0),
        seed=seed,
    )
    dataset = simulate(scenario)
    assert dataset.truth is not None
    truth = true_states(dataset.truth, FULL)
    error = STD * np.random.default_rng([seed, 7]).standard_normal(len(STD))
    return (
        build_timeline(dataset.log, FULL, SensorNoise()),
        Gaussian(FULL, FULL.retract(truth[0], error), np.diag(STD)),
        truth,
    )


def last_nees(seed: int, turn: float) -> float:
    """Normalised squared error of the last state."""
    timeline, belief, truth = poses(seed)
    estimator = MultiplicativeEkf(UNDISTURBED, curvature=FlowCurvature(turn))
    estimator.start(belief)
    history = run(estimator, timeline[0].time, timeline[1:])
    error = FULL.local(history.mean[-1], truth[-1])
    return float(np.square(np.linalg.solve(history.factor[-1], error)).sum())


def test_a_filter_with_the_terms_is_consistent_and_one_without_is_not() -> None:
    low, high = chi_square_band(FULL.error_dim, SEEDS)
    first_order, second_order = (
        np.mean([last_nees(seed, turn) for seed in range(SEEDS)]) for turn in (np.inf, TURN)
    )
    assert first_order > 1.3 * high
    assert low < second_order < high


def test_the_terms_are_the_mean_square_that_a_tangent_lacks() -> None:
    """Of states drawn along a soft direction, after a stretch."""
    _, belief, _ = poses(0)
    factor = np.zeros((FULL.error_dim, FULL.error_dim))
    factor[FULL.slice("w"), 0], factor[FULL.slice("s"), 0] = (
        [0.05, -0.1, 0.05],
        [0.05, 0.0, -0.025, 0.0, 0.01],
    )
    duration = 1.0 / float(np.linalg.norm(belief.mean[FULL.mean_slice("w")]))
    (bend,) = bends_over(UNDISTURBED, belief.mean, factor, duration)
    drawn = np.random.default_rng(0).standard_normal(4000)
    around = FULL.retract(np.tile(belief.mean, (len(drawn), 1)), drawn[:, None] * factor[:, 0])
    end, transition = UNDISTURBED.step(belief.mean, duration), UNDISTURBED.linearise(belief.mean, duration)[1]
    errors = FULL.local(np.tile(end, (len(drawn), 1)), UNDISTURBED.step(around, duration))
    beyond = errors - drawn[:, None] * (transition @ factor[:, 0])  # c u^2 / 2
    found, told = np.mean(beyond**2, axis=0), 0.75 * (transition @ bend) ** 2
    moved = told > 1e-3 * told.max()
    assert np.count_nonzero(moved) >= 3
    np.testing.assert_allclose(found[moved], told[moved], rtol=0.15)


def test_a_belief_of_a_known_body_stays_as_it_is() -> None:
    _, belief, _ = poses(0)
    known = belief.factor.copy()
    known[FULL.slice("s")] *= 0.9 * SOFT / STD[-1]
    curvature = FlowCurvature(TURN)
    assert curvature.widened(UNDISTURBED, belief.mean, known, 0.1) is known
    assert not curvature.is_due(0.1)
    assert not np.array_equal(
        FlowCurvature(TURN).widened(UNDISTURBED, belief.mean, belief.factor, 0.1), known
    )


def test_bends_of_a_spin_about_an_axis_are_seldom_computed() -> None:
    """They are zero, however little is known of the moments about the axis and across it."""
    axis = np.array([0.0, 0.0, 3.0])
    mean, factor, stretches = FULL.origin(), np.diag(STD), 0
    mean[FULL.mean_slice("w")] = axis
    factor[FULL.slice("s").start + 2 :] *= 1e-4  # of the products of inertia
    curvature = FlowCurvature(TURN)
    for _ in range(600):  # 360 rad
        before = curvature.snapshot()[LEFT][0]
        assert curvature.widened(UNDISTURBED, mean, factor, 0.2) is factor
        stretches += curvature.snapshot()[LEFT][0] != before
        curvature.pass_step(0.2)
    assert stretches < 15


def test_runs_of_epochs_and_single_epochs_are_widened_alike() -> None:
    timeline, belief, _ = poses(1)
    means = []
    for epochs in (timeline[1:], list(timeline)[1:]):
        estimator = MultiplicativeEkf(UNDISTURBED, curvature=FlowCurvature(TURN))
        estimator.start(belief)
        history = run(estimator, timeline[0].time, epochs)
        means.append((history.mean, history.factor, estimator.snapshot()[LEFT]))
    for together, single in zip(*means, strict=True):
        np.testing.assert_allclose(together, single, rtol=1e-9, atol=1e-12)


class InterpretedEkf(MultiplicativeEkf):
    """Its predictions are made in NumPy."""

    compiled_prediction = False


@pytest.mark.parametrize("spread", [1.0, 0.2, 1e-3])
def test_compiled_predictions_widen_beliefs_as_numpy_does(spread: float) -> None:
    """Of a hardly known, a rather well known and a known body."""
    timeline, belief, _ = poses(4)
    factor = np.array(belief.factor)
    factor[FULL.slice("s")] *= spread
    found = []
    for kind in (MultiplicativeEkf, InterpretedEkf):
        estimator = kind(UNDISTURBED, curvature=FlowCurvature(TURN))
        estimator.start(Gaussian(FULL, belief.mean, factor))
        history = run(estimator, timeline[0].time, list(timeline)[1:])
        found.append((history.mean, history.covariance, estimator.snapshot()[LEFT]))
    for compiled, interpreted in zip(*found, strict=True):
        np.testing.assert_allclose(compiled, interpreted, rtol=1e-8, atol=1e-12)


def test_a_filter_goes_on_from_a_snapshot_within_a_stretch() -> None:
    timeline, belief, _ = poses(2)
    whole, resumed = (MultiplicativeEkf(UNDISTURBED, curvature=FlowCurvature(TURN)) for _ in range(2))
    whole.start(belief)
    run(whole, timeline[0].time, timeline[1:50])
    resumed.start(belief)
    resumed.restore(whole.snapshot())
    ends = [run(each, timeline[49].time, timeline[50:]).factor[-1] for each in (whole, resumed)]
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize(
    ("scale", "speed", "dt"),
    [(1.0, 1.0, 0.1), (0.2, 1.0, 0.1), (0.01, 1.0, 0.1), (1.0, 1.1, 1.0), (np.nan, 1.0, 0.1)],
)
def test_a_compiled_prediction_of_any_belief_is_that_of_numpy(scale: float, speed: float, dt: float) -> None:
    """Soft and hardly soft beliefs, a known body, a step longer than a stretch, a belief that is not finite."""
    _, belief, _ = poses(3)
    factor, mean = belief.factor.copy(), belief.mean.copy()
    factor[FULL.slice("s")] *= scale
    mean[FULL.mean_slice("w")] *= speed
    found = []
    for kind in (MultiplicativeEkf, InterpretedEkf):
        estimator = kind(UNDISTURBED, curvature=FlowCurvature(TURN))
        estimator.start(Gaussian(FULL, mean, factor))
        estimator.predict(dt)
        found.append((estimator.mean, estimator.belief.covariance, estimator.snapshot()[LEFT]))
    for compiled, interpreted in zip(*found, strict=True):
        np.testing.assert_allclose(compiled, interpreted, rtol=1e-9, atol=1e-12)


@pytest.mark.skipif(compiled_propagation(11) is None, reason="no compiled code")
def test_runs_side_by_side_are_widened_as_each_by_itself() -> None:
    timeline, belief, truth = poses(5)
    assert isinstance(timeline, LogTimeline)
    scales, singles = (1.0, 0.5, 0.02), []
    error = FULL.local(truth[0], belief.mean)
    beliefs = [
        Gaussian(FULL, FULL.retract(truth[0], scale * error), scale * belief.factor) for scale in scales
    ]
    estimator = MultiplicativeEkf(UNDISTURBED, curvature=FlowCurvature(TURN))
    for each in beliefs:
        estimator.start(each)
        singles.append(run(estimator, timeline[0].time, timeline[1:]))
    estimator.start(belief)
    sensors = []
    for part in timeline.sensors:
        every = part.every
        values, parameters = (np.tile(array, (len(scales), 1)) for array in (every.values, every.parameters))
        measured = Measurement(every.model, values, parameters)
        sensors.append(SensorTimeline(measured, part.first[1:], part.end[1:]))
    epochs = EpochRun(np.diff(timeline.time), tuple(sensors))
    means, factors = (np.stack([getattr(each, name) for each in beliefs]) for name in ("mean", "factor"))
    taken = estimator.take_in_runs(epochs, means, factors)
    assert taken is not None
    for k, (single, done) in enumerate(zip(singles, taken.done.tolist(), strict=True)):
        assert done == len(epochs.dt)
        factor, std = taken.rows["factor"][k, :done], np.sqrt(np.einsum("kii->ki", single.covariance[:done]))
        scale = std[:, :, np.newaxis] * std[:, np.newaxis]
        found = factor @ np.swapaxes(factor, 1, 2) / scale
        np.testing.assert_allclose(found, single.covariance[:done] / scale, atol=1e-7)
