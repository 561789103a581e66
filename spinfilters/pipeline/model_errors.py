"""Errors of the models that a recording shows.

Score tests about the smoothed motion, with reasons for the verdict.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from spinfilters.data.input_file import reason
from spinfilters.data.sensor_format import sensor_format
from spinfilters.errors import NUMERICAL_ERRORS, numerical
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.identification.components import DISTURBANCES
from spinfilters.estimators.identification.noise_model import NoiseModel
from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.alternative_table import table
from spinfilters.estimators.model_errors.hypotheses import (
    KnownLevels,
    among_inliers,
    is_contradicted,
    is_doubtful,
    is_settled,
    noise_of,
    solved_near,
    with_identified,
    with_refused_in_a_row,
)
from spinfilters.estimators.model_errors.jumps import jumps
from spinfilters.estimators.model_errors.laplace_likelihood import minus_twice_log_likelihood
from spinfilters.estimators.model_errors.linear_rows import LinearRows
from spinfilters.estimators.model_errors.lower_densities import beside_lower_densities
from spinfilters.estimators.model_errors.refused_ends import with_refused_ends
from spinfilters.estimators.model_errors.score_tests import likelier, score_tests
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.estimators.smoothing.factors.landmark_observations import OBSERVATIONS_NEEDED, seen_ids
from spinfilters.estimators.smoothing.problem.landmark_reinitialisation import reinitialised
from spinfilters.estimators.smoothing.problem.least_squares import Problem, problem_of
from spinfilters.estimators.smoothing.solver.annealing import GATE
from spinfilters.estimators.timeline import Timeline, times_of
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.pipeline.correlation_verdict import possible_correlation
from spinfilters.pipeline.identified_noise import Unstated, noise_model
from spinfilters.pipeline.setup import Setup
from spinfilters.pipeline.tested_models import NOT_TESTED, TestedModels
from spinfilters.sensors.sensor_registry import sensor_of
from spinfilters.state.status import Verdict
from spinfilters.verdict.wrong_units import wrong_units

Placed = Callable[[SmoothedMotion], Iterable[Alternative]]
MOST_EPOCHS_WITH_MAP, MOST_EPOCHS = 300, 1024
"""Of a recording that are tested: those of landmarks tie all poses together."""


def tested_models(setup: Setup, evaluations: Sequence[Evaluation]) -> TestedModels:
    """Score tests about the motion of the best estimator.

    None where nothing can be linearised.
    """
    best, units = tested_history(setup, evaluations), tuple(wrong_units(setup.dataset))
    if best is None:
        return replace(NOT_TESTED, units=units)
    most = tested_epochs(setup)
    std = np.linalg.norm(best.factor[:most], axis=2)
    found = tested_about(setup, best.mean[:most], table().values(), jumps)
    correlated = possible_correlation(setup, found.solved, stated_levels(setup))
    has_inspector = setup.dataset.inspector is not None
    return replace(
        found, units=units, std=std, correlated=correlated, solved=None, has_inspector=has_inspector
    )


def tested_about(
    setup: Setup,
    trajectory: Float[np.ndarray, "k m"],
    errors: Iterable[Alternative],
    placed: Placed,
) -> TestedModels:
    """Score tests of the first epochs about a nearly most probable trajectory.

    Where there are none, why.

    Parameters
    ----------
    placed: errors at the places where a motion shows them most.
    """
    try:
        with np.errstate(all="ignore"):
            return _tested(setup, trajectory, errors, placed)
    except NUMERICAL_ERRORS as error:
        return TestedModels(trouble=reason(numerical(error)))


def _tested(
    setup: Setup, trajectory: Float[np.ndarray, "k m"], errors: Iterable[Alternative], placed: Placed
) -> TestedModels:
    """Score tests at the noise levels of the setup.

    Where residuals contradict these, at those that the data would have, too.
    """
    epochs = setup.timeline[: len(trajectory)]
    problem, time = linear_problem(setup, epochs), times_of(epochs)
    near = solved_near(problem, trajectory, landmarks_placed(problem, trajectory))
    solved = None if near is None else with_refused_in_a_row(near)
    if solved is None:
        return TestedModels(trouble="the smoothed motion cannot be linearised")
    unknown = Unstated.of_all(setup.log, setup.process.noise)
    model = noise_model(problem, setup.noise, unknown) or NoiseModel(problem, (), ())
    every, told = tuple(errors), KnownLevels(stated_levels(setup), _correlation(setup), setup.inflation)
    solved = with_refused_ends(solved, time, lambda rows: noise_of(model, rows, told))
    noise, taken_in = noise_of(model, solved, told), solved is not near
    contradicted = is_contradicted(noise, solved)
    settled = not is_doubtful(noise, solved) or (not contradicted and (taken_in or bool(told.correlation)))
    identified = None if settled else with_identified(model, solved, gated=not taken_in)
    motion = SmoothedMotion(time, solved if identified is None else identified)
    every = (*every, *placed(motion))
    if identified is None:
        found = beside_lower_densities(score_tests(motion, noise, every), motion, model, told)
        inflation = told.score_inflation
        return TestedModels(tuple(found), contradicted, solved=near, score_inflation=inflation)
    found = score_tests(motion, noise_of(model, identified), every)
    stated = among_inliers(problem, identified)
    if stated is not None and is_settled(stated):
        beside = score_tests(SmoothedMotion(time, stated), noise_of(model, stated, told), every)
        found = likelier(found, beside, _advantage(identified, stated))
    inflation = np.inf if told.counts_common_errors else None
    return TestedModels(tuple(found), contradicted, solved=near, score_inflation=inflation)


def _advantage(one: LinearRows, other: LinearRows) -> float:
    """Fall of -2 ln likelihood from another solved problem to one, at least 0."""
    return max(minus_twice_log_likelihood(other) - minus_twice_log_likelihood(one), 0.0)


def _correlation(setup: Setup) -> dict[str, float]:
    """Samples that count as one, of a correlated gyro's level.

    The error is no error of the motion's model.
    """
    if setup.gyro_noise is None or not setup.gyro_noise.is_of_flight:
        return {}
    return {
        option.name: setup.gyro_noise.correlation_time
        for sensor in setup.log.sensors
        if sensor_of(sensor).identified_option is not None
        for option in sensor_format(sensor).noise
    }


def tested_history(setup: Setup, evaluations: Sequence[Evaluation]) -> EstimateHistory | None:
    """The estimate about which models are tested: the estimator that used most measurements of each epoch.

    The smoother if it runs, else the first that has not failed.
    """
    good = [
        each.history
        for each in evaluations
        if each.history.status.verdict is not Verdict.FAILED
        and each.history.layout == setup.process.layout
        and np.isfinite(each.history.mean).all()
    ]
    return next((each for each in good if each.name == "smoother"), good[0] if good else None)


def tested_epochs(setup: Setup) -> int:
    """Number of first epochs in which models are tested, at most."""
    return MOST_EPOCHS_WITH_MAP if setup.initial.has_landmarks else MOST_EPOCHS


def stated_levels(setup: Setup) -> frozenset[str]:
    """Names of the noise levels that are not identified."""
    options = {option.name for name in setup.log.sensors for option in sensor_format(name).noise}
    return frozenset((options | set(DISTURBANCES)) - setup.unstated | setup.inflation.keys())


def linear_problem(setup: Setup, epochs: Timeline, ids: Int[np.ndarray, " L"] | None = None) -> Problem:
    """The smoothing problem of some epochs, the first among them.

    With landmarks of these ids, or of all where none are given.
    """
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
