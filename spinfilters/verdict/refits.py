"""Fits of other models where a recording is doubted: a flywheel inside the body, a hinge, a camera that moves without known poses,
and first epochs that belong to another motion.

A score test promises less than a fit explains where the motion has bent to the error. Each fit smooths the motion again with the
other model; -2 ln likelihood is compared with that of the models as they are, each at the noise levels that it identifies.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import matrix_from_quaternion, rotation_vector_from_quaternion
from spinfilters.core.camera_trajectory import CameraTrajectory, Displacement, displaced
from spinfilters.core.chi_square import chi_square_tail
from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.core.mass_distribution import from_inertia, inertia_matrix, second_moments_of
from spinfilters.filters.timeline import build_timeline, times_of
from spinfilters.inference.first_epochs import Initialiser, with_identified_noise
from spinfilters.inference.identified_noise import Unstated, noise_model
from spinfilters.inference.initial_estimate import InitialEstimate
from spinfilters.inference.noise_choice import stated_models
from spinfilters.inference.noise_model import NoiseModel
from spinfilters.inference.setup import Setup, camera_view, layout_of
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
from spinfilters.smoother.landmark_factors import OBSERVATIONS_NEEDED
from spinfilters.smoother.linear_system import Marginals
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.smoother.problem import Problem, problem_of
from spinfilters.smoother.solver import SolverOptions, solve
from spinfilters.verdict.model_errors.alternatives import FLYWHEEL, HINGE, INSPECTOR_MISSING
from spinfilters.verdict.model_errors.error_columns import CHANGES, HIGHEST_DEGREE, hinge_drive, smooth_paths
from spinfilters.verdict.model_errors.hypotheses import (
    minus_twice_log_likelihood,
    solved_near,
    with_identified,
)
from spinfilters.verdict.model_errors.linear_rows import LinearRows
from spinfilters.verdict.model_errors.score_tests import TELLING, ScoreTest
from spinfilters.verdict.model_errors.smoothed_motion import (
    KnownCamera,
    SmoothedMotion,
    centred_time,
    displaced_camera,
    is_steady,
)
from spinfilters.verdict.model_tests import landmark_ids, landmarks_placed, linear_problem
from spinfilters.verdict.tested_models import LaterBegin, TestedModels

ROUNDS: Final = 3
"""Of noise levels that a fit identifies: the first are those of a motion without a flywheel, which took it for disturbances."""


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

    @property
    def is_steady(self) -> bool:
        """Whether the body spins about one axis, at noise levels of its own: at others a wrong model may flatten any rates."""
        trajectory = self.trajectory if self.rows is None else self.rows.here.trajectory
        return is_steady(trajectory[:, self.setup.process.layout.mean_slice(RATE.name)])


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


# A flywheel

LEAST_SPREAD: Final = 1e-3
"""Singular value of the momentum's fit relative to the largest, below which the motion says nothing of a direction."""
ENOUGH: Final = 10.0
"""Of -2 ln likelihood that a fitted error takes off, from which it is a cause worth a name."""


def with_flywheel_refit(models: TestedModels, settings: Settings, motion: DoubtedMotion) -> TestedModels:
    """Score tests with that of a flywheel from a fit, where it explains more.

    None of a spin about one axis, which does not distinguish a flywheel from other moments, nor from slow torques.
    """
    if motion.setup.process.layout.has(ROTOR):
        return models
    try:
        with np.errstate(all="ignore"):
            test = (
                None if motion.is_steady else _flywheel_test(motion, _samples_as_one(motion.setup, settings))
            )
    except (InputError, *NUMERICAL_ERRORS):
        return models
    linear = models.test_of(FLYWHEEL)
    if test is None or (linear is not None and linear.gain >= test.gain):
        return models
    return models.with_test(test)


def _samples_as_one(setup: Setup, settings: Settings) -> float:
    """Samples of a gyro that count as one with a flywheel.

    What a motion without one leaves of a gyro is correlated; what one with it leaves is the gyro's own error.
    """
    if setup.gyro_noise is None:
        return 1.0
    layout = setup.process.layout
    drag: DragLaw | bool = QUADRATIC if layout.has(DRAG) else LINEAR if layout.has(LINEAR_DRAG) else False
    process = replace(settings.process, rotor=True, gravity=layout.has(ACCELERATION), drag=drag)
    chosen = replace(settings, process=process)
    beside = stated_models(setup.dataset, setup.log, layout_of(setup.log, chosen), chosen).gyro_noise
    return 1.0 if beside is None else max(beside.correlation_time, 1.0)


def _flywheel_test(motion: DoubtedMotion, samples_as_one: float) -> ScoreTest | None:
    """The test of a flywheel; None where a fit leads nowhere or explains nothing."""
    setup, trajectory, without = motion.setup, motion.trajectory, motion.rows
    problem = _problem_with_flywheel(setup, len(trajectory))
    begun = trajectory if without is None else without.here.trajectory
    wide = _with_momentum(setup.process.layout, problem.layout, begun)
    found = at_own_levels(setup, problem, wide)
    if without is None or found is None:
        return None
    layout, likelihood = problem.layout, minus_twice_log_likelihood(found)
    there = _narrow(setup.process.layout, layout, found.here.trajectory)
    gain = _gain_of_fit(setup, without, _FittedPath(there, likelihood), samples_as_one)
    if gain is None:
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


class _FittedPath(NamedTuple):
    """A path found with an error, in the layout without it, and its -2 ln likelihood."""

    trajectory: Float[np.ndarray, "k m"]
    minus_twice_log_likelihood: float


def _gain_of_fit(
    setup: Setup, without: LinearRows, found: _FittedPath, samples_as_one: float
) -> float | None:
    """By how much -2 ln likelihood falls with an error, where that is `ENOUGH`; else None.

    Were the motion without the error caught in a local minimum, the path found with it would free it.
    """

    def gain(rows: LinearRows) -> float:
        return (minus_twice_log_likelihood(rows) - found.minus_twice_log_likelihood) / samples_as_one

    gained = gain(without)
    if not gained > ENOUGH:
        return None
    freed = at_own_levels(setup, without.problem, found.trajectory)
    if freed is not None:
        gained = min(gained, gain(freed))
    return gained if gained > ENOUGH else None


def _problem_with_flywheel(setup: Setup, count: int) -> Problem:
    """The smoothing problem of so many epochs with a flywheel's momentum in the state."""
    layout = setup.process.layout.joined(ROTOR)
    epochs = build_timeline(setup.log, layout, setup.noise, camera_view(setup.dataset))[:count]
    ids = landmark_ids(setup, epochs)
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
    body = _conserving(own, trajectory, np.moveaxis(R, 2, 0))
    if body is None:
        return found
    scale = float(
        np.cbrt(np.linalg.det(second_moments_of(body.inertia)))
    )  # the state's inertia has second moments of determinant 1
    found[:, layout.mean_slice(MASS_DISTRIBUTION.name)] = from_inertia(body.inertia)
    found[:, layout.mean_slice(ROTOR.name)] = body.further / scale
    return found


SHAPES: Final = np.array(
    [np.outer(a, b) + np.outer(b, a) for k, a in enumerate(np.eye(3)) for b in np.eye(3)[k:]]
)
"""Basis of the symmetric matrices."""


class _ConservingBody(NamedTuple):
    """Inertia that conserves the angular momentum of a motion best, up to scale, and the size of what else has momentum."""

    inertia: Float[np.ndarray, "3 3"]
    further: Float[np.ndarray, " f"]


def _conserving(
    own: StateLayout, trajectory: Float[np.ndarray, "k m"], further: Float[np.ndarray, "f k 3"]
) -> _ConservingBody | None:
    """The body with which R_k J w_k + (what else has momentum, linear in its size) is the same for all k; None without one.

    Parameters
    ----------
    further : (f, k, 3) float array
        Momentum per unit of what else has some, in i.
    """
    R = matrix_from_quaternion(trajectory[:, own.mean_slice(ATTITUDE.name)])
    w = trajectory[:, own.mean_slice(RATE.name)]
    J = inertia_matrix(trajectory[0, own.mean_slice(MASS_DISTRIBUTION.name)])
    # Unknowns: the 6 entries of J (its size is held by its trace), what else has momentum, and the constant momentum in i.
    columns = [np.einsum("kij,jl,kl->ki", R, shape, w) for shape in SHAPES]
    A = np.stack([*columns, *further, *np.tile(-np.eye(3)[:, None], (1, len(w), 1))], axis=2)
    level = float(np.sqrt((A**2).sum() / A.shape[2]))
    trace = np.concatenate([np.trace(SHAPES, axis1=1, axis2=2), np.zeros(len(further) + 3)])
    rows = np.concatenate([A.reshape(-1, A.shape[2]), level * trace[None]])
    right = np.concatenate([np.zeros(A[..., 0].size), [level * float(np.trace(J))]])
    solution = np.linalg.lstsq(rows, right, rcond=LEAST_SPREAD)[0]
    inertia = np.tensordot(solution[:6], SHAPES, axes=1)
    if not (np.isfinite(solution).all() and _is_of_body(inertia)):
        return None
    return _ConservingBody(inertia, solution[6:-3])


def _is_of_body(inertia: Float[np.ndarray, "3 3"]) -> bool:
    """Whether a body can have this inertia: its second moments are positive."""
    return bool(np.linalg.eigvalsh(second_moments_of(inertia)).min() > 0)


def _narrow(own: StateLayout, layout: StateLayout, x: Float[np.ndarray, "k n"]) -> Float[np.ndarray, "k m"]:
    """Points of a layout in one with fewer blocks."""
    return np.concatenate([x[:, layout.mean_slice(block.name)] for block in own.members], axis=1)


# A body with moving parts

HINGE_STEPS: Final = 3
"""Improvements of a hinge's size: one falls short where the motion has bent to the hinge."""


def with_hinge_refit(models: TestedModels, motion: DoubtedMotion) -> TestedModels:
    """Score tests with that of a hinge from a fit, where a flywheel alone, which is fitted, explains more than a hinge's score.

    The score is of first order about a motion that the hinge has bent. None where another error is named beside a flywheel, whose
    own score falls short as well, nor of a spin about one axis, which does not distinguish a hinge from slow torques.
    """
    linear, classes = models.test_of(HINGE), models.classes
    others = [each for own in classes[1:] for each in own]
    is_between = bool(classes) and classes[0][0].error is FLYWHEEL and (not others or linear in others)
    if linear is None or not is_between:
        return models
    try:
        with np.errstate(all="ignore"):
            test = None if motion.is_steady else _hinge_test(motion)
    except (InputError, *NUMERICAL_ERRORS):
        return models
    return models if test is None or linear.gain >= test.gain else models.with_test(test)


class _HingedMotion(NamedTuple):
    """A motion with the inertia of its middle, and the size of a hinge."""

    trajectory: Float[np.ndarray, "k m"]
    size: Float[np.ndarray, " b"]


def _hinge_test(doubted: DoubtedMotion) -> ScoreTest | None:
    """The test of a hinge from a fit; None where that leads nowhere or explains nothing."""
    setup, without = doubted.setup, doubted.rows
    if without is None:
        return None
    time = times_of(setup.timeline[: len(doubted.trajectory)])
    trajectory, size = _with_hinge(setup.process.layout, without.here.trajectory, time)
    rows = _smoothed_with(_HingedMotion(trajectory, size), without, setup, time)
    known = HINGE.plausible**-2.0 * np.eye(len(size))  # information of the prior
    covariance = np.linalg.inv(known)
    for _ in range(HINGE_STEPS):
        if rows is None:
            return None
        motion = SmoothedMotion(time, rows)
        columns = rows.residual(motion.disturbed(angular=hinge_drive(motion, size).by_size))
        F, u = columns.gram(columns), columns.gram(rows.left)[:, 0]
        covariance = np.linalg.inv(F + known)
        size = size + covariance @ (u - known @ size)
        rows = _smoothed_with(_HingedMotion(rows.here.trajectory, size), without, setup, time)
    if rows is None:
        return None
    trajectory = rows.here.trajectory
    likelihood = minus_twice_log_likelihood(rows) + float(size @ known @ size)
    samples_as_one = 1.0 if setup.gyro_noise is None else max(setup.gyro_noise.correlation_time, 1.0)
    gain = _gain_of_fit(setup, without, _FittedPath(trajectory, likelihood), samples_as_one)
    if gain is None:
        return None
    dof = float(len(size))
    return ScoreTest(
        HINGE,
        size,
        np.sqrt(np.diag(covariance)),
        gain,
        dof,
        gain,
        float(chi_square_tail(gain, dof)),
        shift=setup.process.layout.local(doubted.trajectory, trajectory),
    )


def _smoothed_with(
    hinged: _HingedMotion, without: LinearRows, setup: Setup, time: Float[np.ndarray, " k"]
) -> LinearRows | None:
    """The motion smoothed again while a hinge drives it as it drives this one, at the noise levels that it identifies."""
    here = replace(without.here, trajectory=hinged.trajectory)
    motion = SmoothedMotion(time, replace(without, here=here))
    driven = np.zeros((len(time), setup.process.layout.error_dim))
    driven[:, setup.process.layout.slice(RATE.name)] = hinge_drive(motion, hinged.size).angular
    problem = replace(without.problem, motion=replace(without.problem.motion, driven=driven))
    return at_own_levels(setup, problem, hinged.trajectory)


def _with_hinge(
    own: StateLayout, trajectory: Float[np.ndarray, "k m"], time: Float[np.ndarray, " k"]
) -> _HingedMotion:
    """The trajectory with the inertia, and its change, that conserve the angular momentum best; without a hinge where none does."""
    none = _HingedMotion(trajectory, np.zeros(len(CHANGES)))
    R = matrix_from_quaternion(trajectory[:, own.mean_slice(ATTITUDE.name)])
    w = trajectory[:, own.mean_slice(RATE.name)]
    share = centred_time(time)
    body = _conserving(own, trajectory, np.einsum("k,kij,sjl,kl->ski", share, R, SHAPES, w))
    if body is None:
        return none
    change = np.tensordot(body.further, SHAPES, axes=1)
    if not (_is_of_body(body.inertia + change) and _is_of_body(body.inertia - change)):
        return none
    values, axes = np.linalg.eigh(body.inertia)
    narrow = axes / np.sqrt(values) @ axes.T
    B = narrow @ change @ narrow
    level = float(np.trace(B)) / 3
    found = trajectory.copy()
    found[:, own.mean_slice(MASS_DISTRIBUTION.name)] = from_inertia(body.inertia)
    return _HingedMotion(
        found, np.array([B[0, 1], B[0, 2], B[1, 2], B[0, 0] - level, level - B[2, 2], level])
    )


# A moving camera

STEPS: Final = 3
"""Improvements of the path: the first takes three quarters of what there is, a fourth one 2 % more."""


def with_camera_refit(models: TestedModels, motion: DoubtedMotion) -> TestedModels:
    """Score tests with that of a moving camera from a fit, where it explains more than its score promises.

    The score of its motion is of first order about a trajectory that the motion has bent. So the path of the camera is improved
    step by step, with the body's motion smoothed again before the camera on that path.
    """
    test = models.test_of(INSPECTOR_MISSING)
    if test is None or not (models.contradicted or test.p_value < TELLING) or models.tests[0] is test:
        return models
    gain, dof, farthest, std = fitted_camera(motion)
    if not gain - 2 * dof > test.merit:
        return models
    p_value = min(test.p_value, float(chi_square_tail(gain, dof)))
    size, of_size = np.array([farthest]), np.array([std])
    fitted = replace(test, size=size, std=of_size, gain=gain, statistic=gain, dof=dof, p_value=p_value)
    return models.with_test(fitted)


class FittedCamera(NamedTuple):
    """A smooth path of a camera.

    Attributes
    ----------
    gain : float
        Fall of -2 ln likelihood; minus infinity where no fit leads there.
    numbers : float
        Of which the path is made.
    farthest, std : float
        Largest component of its displacement and its standard deviation, m or rad.
    """

    gain: float = -np.inf
    numbers: float = 0.0
    farthest: float = 0.0
    std: float = np.inf


def fitted_camera(doubted: DoubtedMotion) -> FittedCamera:
    """Fit a smooth path of the camera and the motion of the body near a trajectory."""
    try:
        with np.errstate(all="ignore"):
            return _camera_path(doubted)
    except (InputError, *NUMERICAL_ERRORS):
        return FittedCamera()


def _camera_path(doubted: DoubtedMotion) -> FittedCamera:
    setup, rows = doubted.setup, doubted.rows
    time = times_of(setup.timeline[: len(doubted.trajectory)])
    if rows is None:
        return FittedCamera()
    at_rest = least = minus_twice_log_likelihood(rows)
    paths, count = smooth_paths(HIGHEST_DEGREE), 0.0
    std = np.full((len(time), 6), np.inf)
    poses = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(time), 1))
    for _ in range(STEPS):
        motion = SmoothedMotion(time, rows)
        camera = KnownCamera.of(motion)
        if camera is None:
            break
        by, std, count = _path(motion, replace(camera, poses=poses), paths)
        poses = displaced(poses, by)
        rows = at_own_levels(setup, _problem_before(setup, time, poses), rows.here.trajectory)
        if rows is None:
            break
        least = min(least, minus_twice_log_likelihood(rows))
    away = np.abs(np.concatenate([poses[:, :3], rotation_vector_from_quaternion(poses[:, 3:])], axis=1))
    at = np.unravel_index(np.argmax(away), away.shape)
    return FittedCamera(at_rest - least, count, float(away[at]), float(std[at]))


def _path(
    motion: SmoothedMotion, camera: KnownCamera, paths: Displacement
) -> tuple[Float[np.ndarray, "k 6"], Float[np.ndarray, "k 6"], float]:
    """The most probable displacement of the camera at every epoch, its deviation, and of how many numbers it is made."""
    own = motion.rows.residual(displaced_camera(motion, paths, camera))
    F, u = own.gram(own), own.gram(motion.rows.left)[:, 0]
    covariance = np.linalg.inv(F + np.eye(len(F)) / INSPECTOR_MISSING.plausible**2)
    made = paths(motion.time, camera.poses)
    std = np.sqrt(np.einsum("kim,mn,kin->ki", made, covariance, made))
    return made @ (covariance @ u), std, float(len(F))


def _problem_before(setup: Setup, time: Float[np.ndarray, " k"], poses: Float[np.ndarray, "k 7"]) -> Problem:
    """The smoothing problem of the epochs at these times, before a camera of known poses."""
    view = camera_view(setup.dataset)
    assert view is not None
    view = replace(view, inspector=CameraTrajectory(time, poses))
    epochs = build_timeline(setup.log.slice(time[0], time[-1]), setup.process.layout, setup.noise, view)
    return linear_problem(setup, epochs)


# First epochs of another motion

LEFT_OUT_SHARE: Final = 0.2
"""Of a recording's length, without which its first epochs are tried again: contact lasts less."""
LARGEST_FIT: Final = 1.5
"""Rms of whitened residuals up to which the later epochs are one motion, and above which the first ones are not."""


def with_later_begin(models: TestedModels, setup: Setup, settings: Settings) -> TestedModels:
    """The tests with a contact in the first epochs, where those do not settle on a motion and later ones do.

    An initialisation that fails leaves no motion about which a score test could find the contact.
    """
    first = setup.initial
    if setup.is_given or first.converged or first.has_failed or not first.fit > LARGEST_FIT:
        return models
    time = times_of(setup.timeline)
    begin = float(time[np.searchsorted(time, time[0] + LEFT_OUT_SHARE * (time[-1] - time[0]))])
    try:
        with np.errstate(all="ignore"):
            later = _begun_at(begin, setup, settings)
    except (InputError, *NUMERICAL_ERRORS):
        return models
    settled = later.converged and later.fit < LARGEST_FIT and later.rejected <= later.accepted
    return replace(models, later_begin=LaterBegin(begin, first.fit, later.fit)) if settled else models


def _begun_at(begin: float, setup: Setup, settings: Settings) -> InitialEstimate:
    """The initialisation of the measurements from a time on, at levels of noise that it identifies itself."""
    layout, log = setup.process.layout, setup.log.slice(begin, times_of(setup.timeline)[-1])
    dataset = replace(setup.dataset, log=log)
    stated = stated_models(dataset, log, layout, settings)
    initialiser = Initialiser(dataset, camera_view(dataset), layout, settings.initialisation)
    return with_identified_noise(initialiser, stated.process, stated.noise, setup.sought)[0].start
