"""Runs of two estimators of one tumble, made up but of the right kind, and their evaluations."""

from dataclasses import dataclass, replace

import numpy as np

from spinfilters.core.attitude_conversions import integrate_gyro, rotate
from spinfilters.core.mass_distribution import from_inertia
from spinfilters.core.torque_free import torque_free_motion
from spinfilters.evaluation.consistency import true_states
from spinfilters.evaluation.estimator_evaluation import Evaluation, evaluate
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.truth import Truth
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout
from spinfilters.models.status import EstimatorStatus

MOMENTS = np.array([0.6, 0.85, 1.0])
FRAMES, INITIALISATION_EPOCHS = 60, 20
INTERVAL = 0.25
START_END = INTERVAL * (INITIALISATION_EPOCHS - 1)


@dataclass(frozen=True)
class SampleRuns:
    """Truth, and one evaluation per estimator with and without it."""

    truth: Truth
    with_truth: list[Evaluation]
    without_truth: list[Evaluation]


def full_runs() -> SampleRuns:
    """Both estimators over the full state."""
    return _runs(StateLayout(FULL_BLOCKS))


def rotation_runs() -> SampleRuns:
    """Both estimators over rotations only, as with a gyro."""
    return _runs(StateLayout(ROTATION_BLOCKS))


def _runs(layout: StateLayout) -> SampleRuns:
    truth = _tumble()
    histories = [_history(name, layout, truth, seed) for seed, name in enumerate(("mekf", "ukf"))]
    return SampleRuns(
        truth, [evaluate(history, truth) for history in histories], [evaluate(h) for h in histories]
    )


def _tumble() -> Truth:
    time = INTERVAL * np.arange(FRAMES)
    rate = torque_free_motion(MOMENTS, np.array([0.2, 3.0, 0.1]), time).rate
    q = integrate_gyro(time, rate, np.array([0.0, 0.0, 0.0, 1.0]))
    path = np.column_stack([0.01 * time, 0 * time, 0.6 + 0.002 * time])
    return Truth(
        time=time,
        center_of_mass=path,
        q_ig=q,
        velocity=np.tile([0.01, 0.0, 0.002], (FRAMES, 1)),
        rate_i=rotate(q, rate),
        principal_moments=MOMENTS,
        principal_axes_g=np.eye(3),
        center_of_mass_g=np.array([0.02, -0.01, 0.03]),
    )


def _history(name: str, layout: StateLayout, truth: Truth, seed: int) -> EstimateHistory:
    generator = np.random.default_rng(seed)
    states = true_states(truth, layout)
    factor = np.tile(1e-3 * np.eye(layout.error_dim), (FRAMES, 1, 1))
    errors = 1e-3 * generator.standard_normal((FRAMES, layout.error_dim))
    started = np.arange(FRAMES) < INITIALISATION_EPOCHS
    return EstimateHistory(
        name=name,
        layout=layout,
        time=truth.time,
        mean=layout.retract(states, errors),
        factor=factor,
        nis=np.where(started, 0.0, generator.chisquare(9, FRAMES)),
        dof=np.where(started, 0, 9),
        log_likelihood=np.zeros(FRAMES),
        accepted=np.where(started, 0, 3),
        rejected=np.zeros(FRAMES, dtype=int),
        runtime=np.where(started, 0.0, 1e-3),
        status=EstimatorStatus(),
        initialisation=INITIALISATION_EPOCHS,
        observations=np.full(FRAMES, 5),
    )


def nearly_spherical(evaluation: Evaluation) -> Evaluation:
    """The same run with a mass distribution of which nothing was learnt."""
    history = evaluation.history
    mean = history.mean.copy()
    mean[:, history.layout.mean_slice("s")] = from_inertia(np.eye(3))
    return evaluate(replace(history, mean=mean))
