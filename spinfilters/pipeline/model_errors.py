"""Errors of the models that a recording shows: score tests about the smoothed motion, with reasons for the verdict."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.sensor_format import sensor_format
from spinfilters.errors import NUMERICAL_ERRORS
from spinfilters.estimators.identification.components import DISTURBANCES, FORCE_PSD, ComponentRows
from spinfilters.estimators.identification.identify import STAGE, NoiseModel, identify
from spinfilters.estimators.identification.residuals import residuals_of, source_factors
from spinfilters.estimators.model_errors.linear_rows import LinearRows
from spinfilters.estimators.model_errors.model_error import table
from spinfilters.estimators.model_errors.noise_components import NoiseComponents
from spinfilters.estimators.model_errors.score_tests import ScoreTest, score_tests
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.estimators.smoothing.factors.landmark_observations import OBSERVATIONS_NEEDED, seen_ids
from spinfilters.estimators.smoothing.problem.landmark_reinitialisation import reinitialised
from spinfilters.estimators.smoothing.problem.least_squares import (
    LinearizationPoint,
    NormalEquations,
    Problem,
    Stage,
    problem_of,
    with_common_constants,
)
from spinfilters.estimators.smoothing.solver.annealing import GATE
from spinfilters.estimators.smoothing.solver.iterations import SolverOptions, solve
from spinfilters.estimators.timeline import times_of
from spinfilters.evaluation.evaluation import Evaluation
from spinfilters.pipeline.setup import Setup
from spinfilters.state.status import Verdict

FALSE_ALARM: Final = 1e-5
"""Probability of a score beyond which a model error is named."""
NAMED: Final = 2
"""Errors that a verdict names at most."""
MOST_EPOCHS_WITH_MAP, MOST_EPOCHS = 300, 1024
"""Of a recording that are tested: those of landmarks tie all poses together."""
ITERATIONS: Final = 6
NOISE_RATIO: Final = 1.25
"""Of squared residuals over their expectation, either way, beyond which noise levels are identified anew before the tests."""
TELLING: Final = 20.0
"""Redundancy of a component from which such a ratio tells anything."""


def model_error_diagnostics(setup: Setup, evaluations: Sequence[Evaluation]) -> list[str]:
    """The reason that names the errors that explain most, with what to do; empty where nothing is found."""
    alarms = [each for each in tested_models(setup, evaluations) if each.p_value < FALSE_ALARM]
    if not alarms:
        return []
    named = "; or ".join(_phrase(each) for each in alarms[:NAMED])
    return [f"the residuals show {named}"]


def _phrase(test: ScoreTest) -> str:
    error, size = test.error, float(np.linalg.norm(test.size))
    std = float(np.sqrt((test.std**2 @ test.size**2)) / max(size, np.finfo(float).tiny))
    return f"{error.phrase} ({size:.2g} +- {std:.1g} {error.unit}, chi-square {test.statistic:.0f}): {error.cure}"


def tested_models(setup: Setup, evaluations: Sequence[Evaluation]) -> list[ScoreTest]:
    """Score tests about the motion of the best estimator that there is; none where nothing can be linearised."""
    trajectory = _smoothed_trajectory(setup, evaluations)
    if trajectory is None:
        return []
    try:
        with np.errstate(all="ignore"):
            return tests_about(setup, trajectory)
    except NUMERICAL_ERRORS:
        return []


def tests_about(setup: Setup, trajectory: Float[np.ndarray, "k m"]) -> list[ScoreTest]:
    """Score tests of the first epochs about a trajectory near the most probable one."""
    solved = _solved(_problem(setup, len(trajectory)), trajectory)
    if solved is None:
        return []
    model = _noise_model(setup, solved.problem)
    noise = _noise(model, solved)
    ratio = noise.squares(solved.residual(solved.right)) / np.maximum(noise.redundancy, 1.0)
    doubtful = np.abs(np.log(np.maximum(ratio, np.finfo(float).tiny))) > np.log(NOISE_RATIO)
    if np.any(doubtful & (noise.redundancy > TELLING)):
        again = _with_identified(model, solved)
        if again is not None:
            solved, noise = again, _noise(model, again)
    time = times_of(setup.timeline[: len(trajectory)])
    return score_tests(SmoothedMotion(time, solved), noise, table().values())


def _smoothed_trajectory(
    setup: Setup, evaluations: Sequence[Evaluation]
) -> Float[np.ndarray, "k m"] | None:
    """Of the estimator that used most measurements of each epoch: the smoother if it runs, else the first that has not failed."""
    good = [
        each.history
        for each in evaluations
        if each.history.status.verdict is not Verdict.FAILED
        and each.history.layout == setup.process.layout
        and np.isfinite(each.history.mean).all()
    ]
    if not good:
        return None
    best = next((each for each in good if each.name == "smoother"), good[0])
    most = MOST_EPOCHS_WITH_MAP if setup.initial.has_landmarks else MOST_EPOCHS
    return best.mean[:most]


def _problem(setup: Setup, count: int) -> Problem:
    epochs = setup.timeline[:count]
    ids = np.unique(seen_ids(epochs)) if setup.initial.has_landmarks else np.zeros(0, dtype=int)
    return problem_of(setup.process, epochs, ids, setup.initial.prior, OBSERVATIONS_NEEDED)


@dataclass(frozen=True)
class _Strict:
    """The gates with which noise is identified, in every iteration."""

    def stage(self, iteration: int, here: LinearizationPoint, before: NormalEquations | None) -> Stage:
        return STAGE

    def last(self, iteration: int, stage: Stage) -> bool:
        return True

    def repaired(self, here: LinearizationPoint, stage: Stage) -> LinearizationPoint:
        return here


def _solved(
    problem: Problem, trajectory: Float[np.ndarray, "k m"], points: Float[np.ndarray, "L 3"] | None = None
) -> LinearRows | None:
    """The linear problem at the most probable states near a trajectory; None where it has no solution."""
    if points is None:
        points = _placed(problem, trajectory)
    common = np.ascontiguousarray(with_common_constants(problem.layout, trajectory[::-1])[::-1])
    here = problem.at(common, points, STAGE.pose_only_loss)
    found = solve(problem, here, SolverOptions(ITERATIONS), _Strict())
    return LinearRows(problem, found.point, found.normal) if found.normal.solved else None


def _placed(problem: Problem, trajectory: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "L 3"]:
    """Landmarks where most of their observations from a trajectory agree, m, frame g."""
    observations = problem.observations
    if observations is None:
        return np.zeros((0, 3))
    points, nobody = np.zeros((observations.landmarks, 3)), np.zeros(len(observations), dtype=bool)
    placed = reinitialised(observations, trajectory, points, nobody, GATE)
    return points if placed is None else placed


def _noise_model(setup: Setup, problem: Problem) -> NoiseModel:
    """All noise levels of a problem, stated or not."""
    components = []
    sensors = enumerate(problem.motion.sensors)
    by_name = {sensor.model.name: k for k, sensor in sensors}
    for name in setup.dataset.log.sensors:
        form = sensor_format(name)
        for option in form.noise:
            if option.components is None or (form.has_landmarks and option is not form.noise[0]):
                continue
            rows = {}
            if name in by_name:
                k = by_name[name]
                every = tuple(range(problem.motion.sensors[k].model.dim))
                rows = {k: every if form.has_landmarks else option.components}
            landmarks = problem.observations is not None and form.has_landmarks
            components.append(ComponentRows(option.name, getattr(setup.noise, option.name), rows, landmarks))
    densities = [name for name in DISTURBANCES if problem.layout.translates or name != FORCE_PSD]
    positive = tuple(name for name in densities if getattr(setup.process.noise, name) > 0)
    return NoiseModel(problem, tuple(components), positive)


def _noise(model: NoiseModel, solved: LinearRows) -> NoiseComponents:
    problem, here = solved.problem, solved.here
    after = residuals_of(problem, here, solved.normal, model.components, model.densities)
    factors = tuple(source_factors(problem, here, model.densities))
    return NoiseComponents(model.components, factors, after.redundancy)


def _with_identified(model: NoiseModel, solved: LinearRows) -> LinearRows | None:
    """The problem with the noise levels that it identifies itself, solved again."""
    here = solved.here
    found = identify(model, here.trajectory, here.points)
    if found is None:
        return None
    stated = model.values(np.zeros(len(model.components) + len(model.densities)))
    power = [2.0] * len(model.components) + [1.0] * len(model.densities)
    values = [each.value for each in found.components]
    log_variance = np.array(power) * np.log(np.divide(values, stated))
    return _solved(model.scaled(log_variance), here.trajectory, here.points)
