"""Errors of the models that a recording shows: score tests about the smoothed motion, with reasons for the verdict."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import chi2

from spinfilters.data.input_file import reason
from spinfilters.data.sensor_format import sensor_format
from spinfilters.errors import NUMERICAL_ERRORS
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.identification.components import DISTURBANCES, FORCE_PSD, ComponentRows
from spinfilters.estimators.identification.noise_model import NoiseModel
from spinfilters.estimators.model_errors.alternative import Alternative, table
from spinfilters.estimators.model_errors.hypotheses import (
    EVERY_MEASUREMENT,
    among_inliers,
    is_contradicted,
    is_doubtful,
    minus_twice_log_likelihood,
    noise_of,
    rejects_in_a_row,
    solved_near,
    with_identified,
)
from spinfilters.estimators.model_errors.score_tests import Effect, ScoreTest, likelier, score_tests
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.estimators.smoothing.factors.landmark_observations import OBSERVATIONS_NEEDED, seen_ids
from spinfilters.estimators.smoothing.problem.landmark_reinitialisation import reinitialised
from spinfilters.estimators.smoothing.problem.least_squares import Problem, problem_of
from spinfilters.estimators.smoothing.solver.annealing import GATE
from spinfilters.estimators.smoothing.solver.batch_smoother import NO_POINTS
from spinfilters.estimators.timeline import Timeline, times_of
from spinfilters.evaluation.evaluation import Evaluation
from spinfilters.pipeline.identified_noise import innovation_rows
from spinfilters.pipeline.wrong_units import WrongUnit, wrong_units
from spinfilters.state.status import Verdict

if TYPE_CHECKING:
    from spinfilters.pipeline.setup import Setup

FALSE_ALARM: Final = 1e-2
"""Probability that a model error is named where all models are right: of all tests together (Bonferroni)."""
LEAST_EFFECT: Final = Effect(largest=10.0, rms=4.0)
"""Deviations by which removing an error moves a state, at one epoch or over all. One that moves all by less, and does not
contradict the stated noise, is left to the uncertainty: of a tossed phone there is always one, as a hand that still touches."""
NAMED: Final = 2
"""Errors that a verdict names at most."""
MOST_EPOCHS_WITH_MAP, MOST_EPOCHS = 300, 1024
"""Of a recording that are tested: those of landmarks tie all poses together."""


@dataclass(frozen=True)
class TestedModels:
    """Score tests of a recording.

    Attributes
    ----------
    tests: the most explaining first.   contradicted: whether residuals contradict the noise levels that the recording was told.
    trouble: why there are no tests of a motion that was estimated; empty where there are.   units: that are probably others.
    std: (k, n) stated deviations of the states that were tested, or None where they are unknown.
    """

    tests: tuple[ScoreTest, ...] = ()
    contradicted: bool = False
    trouble: str = ""
    units: tuple[WrongUnit, ...] = ()
    std: Float[np.ndarray, "k n"] | None = None

    @property
    def named(self) -> tuple[ScoreTest, ...]:
        """Those that a verdict names: the likeliest of those beyond chance, as far as they matter to the estimates."""
        beyond = FALSE_ALARM / max(len(self.tests), 1)
        likely = [each for each in self.tests if each.p_value < beyond][:NAMED]
        return tuple(each for each in likely if self.contradicted or self._matters(each, beyond))

    def _matters(self, test: ScoreTest, beyond: float) -> bool:
        """Whether an error moves estimates, and is beyond chance at their noise levels, not only by what the levels fall."""
        if self.std is None:
            return True
        effect = test.effect(self.std)
        moves = effect.largest >= LEAST_EFFECT.largest or effect.rms >= LEAST_EFFECT.rms
        return moves and float(chi2.sf(test.statistic, test.dof)) < beyond

    @property
    def names(self) -> tuple[str, ...]:
        """Of the model errors in the verdict, the likeliest first."""
        return (*(each.name for each in self.units), *(each.error.name for each in self.named))

    @property
    def reasons(self) -> list[str]:
        """For doubt: the errors that explain most, with what to do."""
        shown = [f"the residuals show {'; or '.join(map(_phrase, self.named))}"] if self.named else []
        return [*self.beside, *shown]

    @property
    def beside(self) -> list[str]:
        """For doubt beside tests: wrong units, and that no error could be looked for."""
        units = [each.reason for each in self.units]
        if not self.trouble:
            return units
        sentence = f"errors of the models could not be looked for ({self.trouble})"
        return [*units, f"{sentence}: check the data set and its noise"]


NOT_TESTED: Final = TestedModels()


def _phrase(test: ScoreTest) -> str:
    error, size = test.error, float(np.linalg.norm(test.size))
    std = float(np.sqrt(test.std**2 @ test.size**2) / max(size, np.finfo(float).tiny))
    return f"{error.phrase} ({size:.2g} +- {std:.1g} {error.unit}, chi-square {test.statistic:.0f}): {error.cure}"


def tested_models(setup: "Setup", evaluations: Sequence[Evaluation]) -> TestedModels:
    """Score tests about the motion of the best estimator that there is; none where nothing can be linearised."""
    best, units = _best(setup, evaluations), tuple(wrong_units(setup.dataset))
    if best is None:
        return replace(NOT_TESTED, units=units)
    most = MOST_EPOCHS_WITH_MAP if setup.initial.has_landmarks else MOST_EPOCHS
    std = np.linalg.norm(best.factor[:most], axis=2)
    return replace(tested_about(setup, best.mean[:most], table().values()), units=units, std=std)


def tested_about(
    setup: "Setup", trajectory: Float[np.ndarray, "k m"], errors: Iterable[Alternative]
) -> TestedModels:
    """Score tests of the first epochs about a trajectory near the most probable one; where there are none, why."""
    try:
        with np.errstate(all="ignore"):
            return _tested(setup, trajectory, errors)
    except NUMERICAL_ERRORS as error:
        return TestedModels(trouble=reason(error))


def _tested(
    setup: "Setup", trajectory: Float[np.ndarray, "k m"], errors: Iterable[Alternative]
) -> TestedModels:
    """Tests at the noise levels of the setup; where residuals contradict these, at those that the data would have, too."""
    epochs = setup.timeline[: len(trajectory)]
    problem, time = linear_problem(setup, epochs), times_of(epochs)
    solved = solved_near(problem, trajectory, landmarks_placed(problem, trajectory))
    rejected = solved is not None and problem.observations is None and rejects_in_a_row(solved)
    if rejected:  # by gates, which would hide the error
        solved = solved_near(problem, trajectory, NO_POINTS, EVERY_MEASUREMENT)
    if solved is None:
        return TestedModels(trouble="the smoothed motion cannot be linearised")
    model, every, stated_names = _noise_model(setup, problem), tuple(errors), _stated(setup)
    noise = noise_of(model, solved, stated_names)
    contradicted = is_contradicted(noise, solved)
    identified = with_identified(model, solved) if not rejected and is_doubtful(noise, solved) else None
    if identified is None:
        return TestedModels(tuple(score_tests(SmoothedMotion(time, solved), noise, every)), contradicted)
    found = score_tests(SmoothedMotion(time, identified), noise_of(model, identified), every)
    stated = among_inliers(problem, identified)
    if stated is not None:
        beside = score_tests(SmoothedMotion(time, stated), noise_of(model, stated, stated_names), every)
        advantage = minus_twice_log_likelihood(stated) - minus_twice_log_likelihood(identified)
        found = likelier(found, beside, max(advantage, 0.0))
    return TestedModels(tuple(found), contradicted)


def minus_twice_log_evidence(setup: "Setup", trajectory: Float[np.ndarray, "k m"]) -> float | None:
    """Of the first epochs, up to a constant of priors; None where they cannot be linearised about a trajectory."""
    try:
        with np.errstate(all="ignore"):
            problem = linear_problem(setup, setup.timeline[: len(trajectory)])
            solved = solved_near(problem, trajectory, landmarks_placed(problem, trajectory))
            return None if solved is None else minus_twice_log_likelihood(solved)
    except NUMERICAL_ERRORS:
        return None


def _best(setup: "Setup", evaluations: Sequence[Evaluation]) -> EstimateHistory | None:
    """The estimator that used most measurements of each epoch: the smoother if it runs, else the first that has not failed."""
    good = [
        each.history
        for each in evaluations
        if each.history.status.verdict is not Verdict.FAILED
        and each.history.layout == setup.process.layout
        and np.isfinite(each.history.mean).all()
    ]
    return next((each for each in good if each.name == "smoother"), good[0] if good else None)


def _stated(setup: "Setup") -> frozenset[str]:
    """Names of the noise levels that are not identified."""
    with_own = [stream.sensor for stream in setup.dataset.log.streams if stream.covariance is not None]
    options = {option.name for name in setup.dataset.log.sensors for option in sensor_format(name).noise}
    own = {option.name for name in with_own for option in sensor_format(name).noise}
    return frozenset((options | set(DISTURBANCES)) - setup.unstated | own)


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
                rows = {k: innovation_rows(problem.motion.sensors[k].model, option.components)}
                if not rows[k]:
                    continue
            landmarks = problem.observations is not None and form.has_landmarks
            components.append(ComponentRows(option.name, getattr(setup.noise, option.name), rows, landmarks))
    densities = [name for name in DISTURBANCES if problem.layout.translates or name != FORCE_PSD]
    positive = tuple(name for name in densities if getattr(setup.process.noise, name) > 0)
    return NoiseModel(problem, tuple(components), positive)
