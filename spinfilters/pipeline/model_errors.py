"""Errors of the models that a recording shows: score tests about the smoothed motion, with reasons for the verdict."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.data.sensor_format import sensor_format
from spinfilters.errors import NUMERICAL_ERRORS
from spinfilters.estimators.identification.components import DISTURBANCES, FORCE_PSD, ComponentRows
from spinfilters.estimators.identification.noise_model import NoiseModel
from spinfilters.estimators.model_errors.alternative import Alternative, table
from spinfilters.estimators.model_errors.hypotheses import (
    among_inliers,
    is_contradicted,
    is_doubtful,
    minus_twice_log_likelihood,
    noise_of,
    solved_near,
    with_identified,
)
from spinfilters.estimators.model_errors.score_tests import ScoreTest, likelier, score_tests
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.estimators.smoothing.factors.landmark_observations import OBSERVATIONS_NEEDED, seen_ids
from spinfilters.estimators.smoothing.problem.landmark_reinitialisation import reinitialised
from spinfilters.estimators.smoothing.problem.least_squares import Problem, problem_of
from spinfilters.estimators.smoothing.solver.annealing import GATE
from spinfilters.estimators.timeline import Timeline, times_of
from spinfilters.evaluation.evaluation import Evaluation
from spinfilters.state.status import Verdict

if TYPE_CHECKING:
    from spinfilters.pipeline.setup import Setup

FALSE_ALARM: Final = 1e-5
"""Probability of a score beyond which a model error is named."""
CONTRADICTED: Final = 5e-4
"""The same where residuals contradict the noise levels: about one alarm in a hundred over all alternatives."""
NAMED: Final = 2
"""Errors that a verdict names at most."""
MOST_EPOCHS_WITH_MAP, MOST_EPOCHS = 300, 1024
"""Of a recording that are tested: those of landmarks tie all poses together."""


def model_error_diagnostics(setup: "Setup", evaluations: Sequence[Evaluation]) -> list[str]:
    """The reason that names the errors that explain most, with what to do; empty where nothing is found."""
    named = tested_models(setup, evaluations).named
    return [f"the residuals show {'; or '.join(map(_phrase, named))}"] if named else []


@dataclass(frozen=True)
class TestedModels:
    """Score tests of a recording, the most explaining first, and whether residuals contradict the noise levels it was told."""

    tests: tuple[ScoreTest, ...] = ()
    contradicted: bool = False

    @property
    def named(self) -> tuple[ScoreTest, ...]:
        """Those that a verdict names."""
        beyond = CONTRADICTED if self.contradicted else FALSE_ALARM
        return tuple(each for each in self.tests if each.p_value < beyond)[:NAMED]


def _phrase(test: ScoreTest) -> str:
    error, size = test.error, float(np.linalg.norm(test.size))
    std = float(np.sqrt(test.std**2 @ test.size**2) / max(size, np.finfo(float).tiny))
    return f"{error.phrase} ({size:.2g} +- {std:.1g} {error.unit}, chi-square {test.statistic:.0f}): {error.cure}"


def tested_models(setup: "Setup", evaluations: Sequence[Evaluation]) -> TestedModels:
    """Score tests about the motion of the best estimator that there is; none where nothing can be linearised."""
    trajectory = _smoothed_trajectory(setup, evaluations)
    if trajectory is None:
        return TestedModels()
    return tested_about(setup, trajectory, table().values())


def tested_about(
    setup: "Setup", trajectory: Float[np.ndarray, "k m"], errors: Iterable[Alternative]
) -> TestedModels:
    """Score tests of the first epochs about a trajectory near the most probable one; none where it cannot be linearised."""
    try:
        with np.errstate(all="ignore"):
            return _tested(setup, trajectory, errors)
    except NUMERICAL_ERRORS:
        return TestedModels()


def _tested(
    setup: "Setup", trajectory: Float[np.ndarray, "k m"], errors: Iterable[Alternative]
) -> TestedModels:
    """Tests at the noise levels of the setup; where residuals contradict these, at those that the data would have, too."""
    epochs = setup.timeline[: len(trajectory)]
    problem, time = linear_problem(setup, epochs), times_of(epochs)
    solved = solved_near(problem, trajectory, landmarks_placed(problem, trajectory))
    if solved is None:
        return TestedModels()
    model, every = _noise_model(setup, problem), tuple(errors)
    noise = noise_of(model, solved)
    contradicted = is_contradicted(noise, solved)
    identified = with_identified(model, solved) if is_doubtful(noise, solved) else None
    if identified is None:
        return TestedModels(tuple(score_tests(SmoothedMotion(time, solved), noise, every)), contradicted)
    found = score_tests(SmoothedMotion(time, identified), noise_of(model, identified), every)
    stated = among_inliers(problem, identified)
    if stated is not None:
        beside = score_tests(SmoothedMotion(time, stated), noise_of(model, stated), every)
        advantage = minus_twice_log_likelihood(stated) - minus_twice_log_likelihood(identified)
        found = likelier(found, beside, max(advantage, 0.0))
    return TestedModels(tuple(found), contradicted)


def _smoothed_trajectory(
    setup: "Setup", evaluations: Sequence[Evaluation]
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


def linear_problem(setup: "Setup", epochs: Timeline, ids: Int[np.ndarray, " L"] | None = None) -> Problem:
    """The smoothing problem of some epochs, the first among them, with landmarks of these ids, or of all where none are given."""
    if ids is None:
        ids = np.unique(seen_ids(epochs)) if setup.initial.has_landmarks else np.zeros(0, dtype=int)
    return problem_of(setup.process, epochs, ids, setup.initial.prior, OBSERVATIONS_NEEDED)


def landmarks_placed(problem: Problem, trajectory: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "L 3"]:
    """Landmarks where most of their observations from a trajectory agree, m, frame g."""
    observations = problem.observations
    if observations is None:
        return np.zeros((0, 3))
    points, nobody = np.zeros((observations.landmarks, 3)), np.zeros(len(observations), dtype=bool)
    placed = reinitialised(observations, trajectory, points, nobody, GATE)
    return points if placed is None else placed


def _noise_model(setup: "Setup", problem: Problem) -> NoiseModel:
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
