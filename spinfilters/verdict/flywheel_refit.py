"""A flywheel inside the body, fitted where a recording is doubted."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.chi_square import chi_square_tail
from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.core.mass_distribution import from_inertia, inertia_matrix
from spinfilters.filters.timeline import build_timeline
from spinfilters.inference.identified_noise import Unstated, noise_model
from spinfilters.inference.noise_model import NoiseModel
from spinfilters.inference.setup import Setup, camera_view
from spinfilters.inference.stated_noise import layout_of, stated_models
from spinfilters.models.state_blocks import (
    ACCELERATION,
    ATTITUDE,
    DRAG,
    LINEAR_DRAG,
    MASS_DISTRIBUTION,
    RATE,
    ROTOR,
)
from spinfilters.models.state_layout import StateLayout
from spinfilters.settings.run_settings import LINEAR, QUADRATIC, DragLaw, Settings
from spinfilters.smoother.landmark_factors import OBSERVATIONS_NEEDED, seen_ids
from spinfilters.smoother.linear_system import Marginals
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.smoother.problem import Problem, problem_of
from spinfilters.smoother.solver import SolverOptions, solve
from spinfilters.verdict.model_errors.alternatives import FLYWHEEL
from spinfilters.verdict.model_errors.hypotheses import (
    minus_twice_log_likelihood,
    solved_near,
    with_identified,
)
from spinfilters.verdict.model_errors.linear_rows import LinearRows
from spinfilters.verdict.model_errors.score_tests import ScoreTest
from spinfilters.verdict.model_errors.smoothed_motion import is_steady
from spinfilters.verdict.model_tests import landmarks_placed, linear_problem
from spinfilters.verdict.tested_models import TestedModels

ROUNDS: Final = 3
"""Of noise levels that a fit identifies: the first are those of a motion without a flywheel, which took it for disturbances."""
LEAST_SPREAD: Final = 1e-3
"""Singular value of the momentum's fit relative to the largest, below which the motion says nothing of a direction."""
ENOUGH: Final = 10.0
"""Of -2 ln likelihood that a flywheel takes off, from which it is a cause worth a name."""


@dataclass(frozen=True)
class DoubtedMotion:
    """A motion whose models are doubted, to be compared with fits of other models.

    Attributes
    ----------
    setup : Setup
        Of the recording.
    trajectory : (k, m) float array
        States of the first epochs, about which the models were tested.
    """

    setup: Setup
    trajectory: Float[np.ndarray, "k m"]

    @cached_property
    def rows(self) -> LinearRows | None:
        """The models as they are, solved at the noise levels that they identify: once for all fits; None where it is not solved."""
        problem = linear_problem(self.setup, self.setup.timeline[: len(self.trajectory)])
        return at_own_levels(self.setup, problem, self.trajectory)


def with_flywheel_refit(models: TestedModels, settings: Settings, motion: DoubtedMotion) -> TestedModels:
    """Score tests with that of a flywheel from a fit, where it explains more.

    None of a spin about one axis, which does not tell a flywheel from other moments, nor from slow torques.
    """
    setup, layout = motion.setup, motion.setup.process.layout
    if layout.has(ROTOR) or is_steady(motion.trajectory[:, layout.mean_slice(RATE.name)]):
        return models
    try:
        with np.errstate(all="ignore"):
            test = _fitted(motion, _samples_as_one(setup, settings))
    except (InputError, *NUMERICAL_ERRORS):
        return models
    linear = next((each for each in models.tests if each.error.name == FLYWHEEL.name), None)
    if test is None or (linear is not None and linear.gain >= test.gain):
        return models
    others = [each for each in models.tests if each.error.name != FLYWHEEL.name]
    return replace(models, tests=tuple(sorted((*others, test), key=lambda each: -each.merit)))


def _samples_as_one(setup: Setup, settings: Settings) -> float:
    """Samples of a gyro that count as one beside a flywheel.

    What a motion without one leaves of a gyro is correlated; what one with it leaves tells the gyro's own error.
    """
    if setup.gyro_noise is None:
        return 1.0
    layout = setup.process.layout
    drag: DragLaw | bool = QUADRATIC if layout.has(DRAG) else LINEAR if layout.has(LINEAR_DRAG) else False
    process = replace(settings.process, rotor=True, gravity=layout.has(ACCELERATION), drag=drag)
    chosen = replace(settings, process=process)
    beside = stated_models(setup.dataset, setup.log, layout_of(setup.log, chosen), chosen).gyro_noise
    return 1.0 if beside is None else max(beside.correlation_time, 1.0)


def _fitted(motion: DoubtedMotion, samples_as_one: float) -> ScoreTest | None:
    """The test of a flywheel; None where a fit leads nowhere or explains nothing."""
    setup, trajectory, without = motion.setup, motion.trajectory, motion.rows
    problem = _problem_with_flywheel(setup, len(trajectory))
    begun = trajectory if without is None else without.here.trajectory
    wide = _with_momentum(setup.process.layout, problem.layout, begun)
    found = at_own_levels(setup, problem, wide)
    if without is None or found is None:
        return None
    layout, likelihood = problem.layout, minus_twice_log_likelihood(found)
    gain = (minus_twice_log_likelihood(without) - likelihood) / samples_as_one
    if not gain > ENOUGH:
        return None
    # Were the motion without a flywheel caught in a local minimum, the path found with one would free it.
    there = _narrow(setup.process.layout, layout, found.here.trajectory)
    freed = at_own_levels(setup, without.problem, there)
    if freed is not None:
        gain = min(gain, (minus_twice_log_likelihood(freed) - likelihood) / samples_as_one)
    if not gain > ENOUGH:
        return None
    marginals = Marginals(found.solution, found.normal.eliminated)
    factor = marginals.first_factors(1)[0, layout.slice(ROTOR.name)]
    size = found.here.trajectory[0, layout.mean_slice(ROTOR.name)]
    beyond = float(chi_square_tail(gain, float(ROTOR.dimension)))
    return ScoreTest(
        FLYWHEEL,
        size,
        np.linalg.norm(factor, axis=1),
        gain,
        float(ROTOR.dimension),
        gain,
        beyond,
        shift=setup.process.layout.local(trajectory, there),
    )


def at_own_levels(setup: Setup, problem: Problem, trajectory: Float[np.ndarray, "k m"]) -> LinearRows | None:
    """The problem solved from a trajectory, at the noise levels that it identifies."""
    points = landmarks_placed(problem, trajectory)
    solved = solve(problem, problem.at(trajectory, points), SolverOptions())
    rows = solved_near(problem, solved.point.trajectory, solved.point.points)
    levels = Unstated.of_all(setup.log, setup.process.noise)
    for _ in range(ROUNDS):
        model = None if rows is None else noise_model(rows.problem, setup.noise, levels)
        again = None if rows is None else with_identified(model or NoiseModel(rows.problem, (), ()), rows)
        if again is None:
            break
        rows = again
    return rows


def _problem_with_flywheel(setup: Setup, count: int) -> Problem:
    """The smoothing problem of so many epochs with a flywheel's momentum in the state."""
    layout = setup.process.layout.joined(ROTOR)
    epochs = build_timeline(setup.log, layout, setup.noise, camera_view(setup.dataset))[:count]
    ids = np.unique(seen_ids(epochs)) if setup.initial.has_landmarks else np.zeros(0, dtype=int)
    own, prior = setup.process.layout, setup.initial.prior
    std = np.full(layout.error_dim, ROTOR.prior_std)
    for block in own.members:
        std[layout.slice(block.name)] = prior.std[own.slice(block.name)]
    wide = FirstStatePrior(_wide(own, layout, prior.mean[None])[0], std)
    return problem_of(setup.process.with_layout(layout), epochs, ids, wide, OBSERVATIONS_NEEDED)


def _wide(own: StateLayout, layout: StateLayout, x: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "k n"]:
    """Points of a layout in one with further blocks, these at their origin."""
    found = np.tile(layout.origin(), (len(x), 1))
    for block in own.members:
        found[:, layout.mean_slice(block.name)] = x[:, own.mean_slice(block.name)]
    return found


def _with_momentum(
    own: StateLayout, layout: StateLayout, trajectory: Float[np.ndarray, "k m"]
) -> Float[np.ndarray, "k n"]:
    """The trajectory with the inertia and the flywheel's momentum that conserve the angular momentum best.

    R_k (J w_k + h) is the same for all k: linear in J about the trajectory's own, in h and in the constant.
    """
    found = _wide(own, layout, trajectory)
    R = matrix_from_quaternion(trajectory[:, own.mean_slice(ATTITUDE.name)])
    w = trajectory[:, own.mean_slice(RATE.name)]
    J = inertia_matrix(trajectory[0, own.mean_slice(MASS_DISTRIBUTION.name)])
    # Unknowns: the 6 entries of J (its size is held by its trace), h, and the constant momentum in i.
    shapes = [np.outer(a, b) + np.outer(b, a) for k, a in enumerate(np.eye(3)) for b in np.eye(3)[k:]]
    columns = [np.einsum("kij,jl,kl->ki", R, shape, w) for shape in shapes]
    A = np.stack([*columns, *np.moveaxis(R, 2, 0), *np.tile(-np.eye(3)[:, None], (1, len(w), 1))], axis=2)
    level = float(np.sqrt((A**2).sum() / A.shape[2]))
    trace = np.array([float(np.trace(shape)) for shape in shapes] + [0.0] * 6)
    rows = np.concatenate([A.reshape(-1, A.shape[2]), level * trace[None]])
    right = np.concatenate([np.zeros(A[..., 0].size), [level * float(np.trace(J))]])
    solution = np.linalg.lstsq(rows, right, rcond=LEAST_SPREAD)[0]
    inertia = sum((s * shape for s, shape in zip(solution[:6], shapes, strict=True)), np.zeros((3, 3)))
    second = np.trace(inertia) / 2 * np.eye(3) - inertia
    if not (np.isfinite(solution).all() and np.linalg.eigvalsh(second).min() > 0):
        return found
    scale = float(np.cbrt(np.linalg.det(second)))  # the state's inertia has second moments of determinant 1
    found[:, layout.mean_slice(MASS_DISTRIBUTION.name)] = from_inertia(inertia)
    found[:, layout.mean_slice(ROTOR.name)] = solution[6:9] / scale
    return found


def _narrow(own: StateLayout, layout: StateLayout, x: Float[np.ndarray, "k n"]) -> Float[np.ndarray, "k m"]:
    """Points of a layout in one with fewer blocks."""
    return np.concatenate([x[:, layout.mean_slice(block.name)] for block in own.members], axis=1)
