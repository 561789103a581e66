"""Tests of the models of a recording: score tests about its smoothed motion, and its marginal likelihood under a setup.

A jump amid the recording is a kick of the state at the end of one step. It is sought at the step where it is likeliest.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.errors import NUMERICAL_ERRORS, numerical
from spinfilters.evaluation.epoch_spans import clock_text, time_text
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.filters.history import EstimateHistory
from spinfilters.filters.timeline import Timeline, times_of
from spinfilters.inference.identified_noise import Unstated, noise_model
from spinfilters.inference.noise_choice import STATED
from spinfilters.inference.noise_model import NoiseModel
from spinfilters.inference.setup import Setup
from spinfilters.io.disturbances import DENSITIES
from spinfilters.io.input_file import reason
from spinfilters.io.sensor_format import sensor_format
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.models.state_blocks import ATTITUDE, POSITION, RATE, VELOCITY, StateBlock
from spinfilters.smoother.batch_smoother import GATE
from spinfilters.smoother.landmark_factors import OBSERVATIONS_NEEDED, reinitialised, seen_ids
from spinfilters.smoother.problem import Problem, problem_of
from spinfilters.verdict.model_errors.alternatives import CONTACT_AT_BEGIN, CONTACT_AT_END, Alternative, table
from spinfilters.verdict.model_errors.hypotheses import (
    KnownLevels,
    among_inliers,
    is_contradicted,
    is_doubtful,
    is_settled,
    measured_epochs,
    minus_twice_log_likelihood,
    noise_of,
    solved_near,
    with_identified,
    with_refused_in_a_row,
)
from spinfilters.verdict.model_errors.linear_rows import Columns, LinearRows
from spinfilters.verdict.model_errors.noise_components import NoiseComponents
from spinfilters.verdict.model_errors.score_tests import ScoreTest, likelier, score_tests
from spinfilters.verdict.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.verdict.recording_tests import wrong_units
from spinfilters.verdict.tested_models import NOT_TESTED, TestedModels, possible_correlation

Kicks = Callable[[SmoothedMotion], Float[np.ndarray, "k n m"]]
"""Changes of the state's error at every epoch per unit of m sizes, components in the order of the layout."""
LEAST_TOLD: Final = 1e-9
"""Share of a kick's information that states must leave; with less it is rounding."""
FEWEST_STEPS: Final = 4
"""Before and after a jump: nearer to the ends it is contact there."""
LARGEST_FALL: Final = float(-2 * np.log(1 - np.sqrt(0.99)))
"""Of the statistic from the likeliest step to one that contains the jump all the same, with a probability of 0.99."""


@dataclass(frozen=True)
class JumpKind:
    """Kind of jump with its words.

    Attributes
    ----------
    name, phrase, unit : str
        As of an `Alternative`; the time of the jump follows the phrase.
    cure, moving_cure : str
        Likewise; they may name the interval from ``begin`` to ``end`` that contains the jump, s.
    kicks : Kicks
        Of the state at every epoch.
    """

    name: str
    phrase: str
    unit: str
    cure: str
    kicks: Kicks
    moving_cure: str = ""


def jumps(motion: SmoothedMotion) -> Iterator[Alternative]:
    """Of every kind the jump at its likeliest step; none in recordings too short for one."""
    count = len(motion.time) - 1
    if count <= 2 * FEWEST_STEPS:
        return
    for kind in KINDS:
        among = step_statistics(motion, kind.kicks)[FEWEST_STEPS:-FEWEST_STEPS]
        if among.max(initial=0.0) > 0:
            step = FEWEST_STEPS + int(among.argmax())
            first = float(motion.time[0])
            begin, end = (clock_text(each) for each in interval_of_jump(motion.time, among))
            yield Alternative(
                kind.name,
                f"{kind.phrase} at {time_text(float(motion.time[step + 1]), first)}, between {begin} and {end} s",
                kind.unit,
                partial(kick_of_step, kicks=kind.kicks, step=step),
                kind.cure.format(begin=begin, end=end),
                kind.moving_cure.format(begin=begin, end=end),
                trials=len(among),
            )


def kick_of_step(motion: SmoothedMotion, kicks: Kicks, step: int) -> Columns:
    """Right-hand sides of the kick at the end of a step, as all later measurements see it."""
    return motion.kicked(kicks(motion)[step + 1], step)


def interval_of_jump(time: Float[np.ndarray, " k"], among: Float[np.ndarray, " j"]) -> tuple[float, float]:
    """Time from the beginning of the first step that may contain the jump to the end of the one after the last, s.

    The kick of a step is at its end: one early in the next step is as near to it.

    Parameters
    ----------
    among : (j,) float array
        Statistics of the steps, without `FEWEST_STEPS` at each end.
    """
    possible = FEWEST_STEPS + np.flatnonzero(among >= among.max() - LARGEST_FALL)
    return float(time[possible[0]]), float(time[possible[-1] + 2])


def step_statistics(motion: SmoothedMotion, kicks: Kicks) -> Float[np.ndarray, " j"]:
    """Score statistic of a kick in every step."""
    after = motion.rows.steps_after
    H = motion.kicks_of_steps(kicks(motion))
    # per step: information F = H'H - H'(J P J')H and score u = H'r of its kicks, in units of their own size
    across = np.swapaxes(H, 1, 2)
    whole, spread = across @ H, across @ after.spread
    scale = np.sqrt(np.einsum("kmm->km", whole))
    unit = np.where(scale > 0, 1 / np.where(scale > 0, scale, 1.0), 0.0)
    F = (whole - spread @ np.swapaxes(spread, 1, 2)) * unit[:, :, None] * unit[:, None, :]
    u = np.einsum("kdm,kd->km", H, after.rest) * unit
    if not (np.isfinite(F).all() and np.isfinite(u).all()):
        return np.zeros(len(H))
    # u' F^+ u over the directions that the measurements show
    values, vectors = np.linalg.eigh(F)
    along = np.einsum("kmv,km->kv", vectors, u)
    told = values > LEAST_TOLD
    return np.where(told, along**2 / np.where(told, values, 1.0), 0.0).sum(axis=1)


def _of_blocks(*blocks: StateBlock) -> Kicks:
    """Every component of those of some blocks that a state has."""

    def kicks(motion: SmoothedMotion) -> Float[np.ndarray, "k n m"]:
        """The same at every epoch."""
        layout = motion.rows.problem.layout
        every = np.eye(layout.error_dim)
        chosen = np.concatenate([every[:, layout.slice(b.name)] for b in blocks if layout.has(b)], axis=1)
        return np.broadcast_to(chosen, (len(motion.time), *chosen.shape))

    return kicks


KINDS: Final = (
    JumpKind(
        "contact-amid",
        "contact",
        "rad/s and m/s",
        "use the recording before {begin} s or after {end} s (--segment)",
        _of_blocks(RATE, VELOCITY),
    ),
    JumpKind(
        "frame-jump",
        "a jump of the camera, or of the frame that is tracked,",
        "rad and m",
        "use the recording before {begin} s or after {end} s (--segment), or give the camera's motion (inspector.tum)",
        _of_blocks(ATTITUDE, POSITION),
        "use the recording before {begin} s or after {end} s (--segment), or give poses without a jump (inspector.tum)",
    ),
    JumpKind(
        "clock-jump",
        "a jump of the clock, as where samples are lost,",
        "s",
        "give every sample its own time stamp",
        lambda motion: motion.change[:, :, None],
    ),
)


SUSPECTED: Final = 0.05
"""Probability of a test below which its error is tested at smaller densities too."""
SHARES: Final = (1 / 4, 1 / 16)
"""Of the identified densities."""


def beside_lower_densities(
    found: Sequence[ScoreTest], motion: SmoothedMotion, model: NoiseModel, told: KnownLevels
) -> list[ScoreTest]:
    """Tests, of `SUSPECTED` errors at the likeliest of some densities.

    Of errors of the whole recording. The same tests where all densities are stated, or where no error is suspected.
    """
    lower = np.array([name not in told.stated for name in model.densities])
    suspected = [each.error for each in found if each.p_value < SUSPECTED and not each.error.by_epoch]
    best = list(found)
    if not lower.any() or not suspected or told.correlation:
        return best
    likelihood = minus_twice_log_likelihood(motion.rows)
    for share in SHARES:
        log_variance = np.concatenate([np.zeros(len(model.components)), np.log(share) * lower])
        own = model.at(log_variance)
        rows = among_inliers(own.problem, motion.rows)
        if rows is None:
            continue
        beside = score_tests(replace(motion, rows=rows), noise_of(own, rows, told), suspected)
        best = likelier(best, beside, max(minus_twice_log_likelihood(rows) - likelihood, 0.0))
    return best


BETTER: Final = 4.0
"""By how much less the squared residuals are with a touch and one epoch more."""
Noise = Callable[[LinearRows], NoiseComponents]
"""Variance components of a solved problem."""


class RefusedEnds(NamedTuple):
    """A problem with its refused ends included where a contact explains them.

    Attributes
    ----------
    solved : LinearRows
        The problem.
    possible_contacts : tuple[(k, n) float array, ...]
        Of ends that stay refused, which a contact or a gross error may be: error of the states by the contact.
    """

    solved: LinearRows
    possible_contacts: tuple[Float[np.ndarray, "k n"], ...] = ()


def with_refused_ends(solved: LinearRows, time: Float[np.ndarray, " k"], noise: Noise) -> RefusedEnds:
    """The problem with refused first and last epochs included where a contact explains them, else unchanged.

    A contact fits any one epoch, so that its residuals alone do not tell it from a gross error. What it would make of the states
    is then returned, where it changes the rate by no more than the rate itself: by a touch a body turns otherwise, by a gross
    error it seems to do so at any rate.
    """
    possible = []
    for epoch, contact in _refused_ends(solved):
        taken = among_inliers(solved.problem, solved, np.array([epoch]))
        if taken is None:
            continue
        motion = SmoothedMotion(time, taken)
        found = score_tests(motion, noise(taken), [contact])
        if not found or found[0].explained is None or found[0].shift is None:
            continue
        if _squares(taken, found[0].explained) < _squares(solved) - BETTER:
            solved = taken
            continue
        layout = solved.problem.layout
        error = layout.local(solved.here.trajectory, taken.here.trajectory) - found[0].shift
        change = np.linalg.norm(error[:, layout.slice(RATE.name)], axis=1)
        if change.max() <= np.sqrt(np.mean(np.sum(motion.rates**2, axis=1))):
            possible.append(error)
    return RefusedEnds(solved, tuple(possible))


def _refused_ends(solved: LinearRows) -> list[tuple[int, Alternative]]:
    """First and last measured epochs none of whose measurements counts, with the contact there."""
    measured, counted = measured_epochs(solved)
    if solved.problem.observations is not None or not measured.any():
        return []
    first, last = np.flatnonzero(measured)[[0, -1]].tolist()
    ends = [(first, CONTACT_AT_BEGIN), (last, CONTACT_AT_END)]
    return [(epoch, contact) for epoch, contact in ends if not counted[epoch]]


def _squares(solved: LinearRows, explained: Float[np.ndarray, " r"] | float = 0.0) -> float:
    """Sum of squared residuals less what an error explains of them."""
    left = np.concatenate([part.ravel() for part in solved.left.parts]) - explained
    return float(left @ left)


Placed = Callable[[SmoothedMotion], Iterable[Alternative]]
MOST_EPOCHS_WITH_MAP, MOST_EPOCHS = 300, 1024
"""Of a recording that are tested: those of landmarks tie all poses together."""


def tested_models(setup: Setup, best: EstimateHistory | None) -> TestedModels:
    """Score tests about the motion of the best estimate (`tested_history`); none where no estimate can be linearised."""
    units = tuple(wrong_units(setup.dataset))
    if best is None:
        return replace(NOT_TESTED, units=units)
    most = tested_epochs(setup)
    std = np.linalg.norm(best.factor[:most], axis=2)
    found = tested_about(setup, best.mean[:most], table().values(), jumps)
    correlated = possible_correlation(setup, found.solved, stated_levels(setup))
    has_inspector = setup.dataset.inspector is not None
    known = frozenset(each.parameter.name for each in setup.calibration if each.source == STATED)
    return replace(
        found,
        units=units,
        std=std,
        correlated=correlated,
        has_inspector=has_inspector,
        known_calibration=known,
    )


def tested_about(
    setup: Setup,
    trajectory: Float[np.ndarray, "k m"],
    errors: Iterable[Alternative],
    placed: Placed,
) -> TestedModels:
    """Score tests of the first epochs about a nearly most probable trajectory, or the reason why there are none.

    Parameters
    ----------
    placed : Placed
        Errors at the places where a motion shows them most.
    """
    try:
        with np.errstate(all="ignore"):
            return _test_models(setup, trajectory, errors, placed)
    except NUMERICAL_ERRORS as error:
        return TestedModels(trouble=reason(numerical(error)))


def _test_models(
    setup: Setup, trajectory: Float[np.ndarray, "k m"], errors: Iterable[Alternative], placed: Placed
) -> TestedModels:
    """Score tests at the noise levels of the setup.

    Where residuals contradict these, at those that the data would have, too.
    """
    epochs = setup.timeline[: len(trajectory)]
    # the tests need the rows themselves, also of more epochs than a smoother keeps
    problem, time = replace(linear_problem(setup, epochs), rows_together=len(epochs)), times_of(epochs)
    near = smoothed_about(problem, trajectory)
    solved = None if near is None else with_refused_in_a_row(near)
    if solved is None:
        return TestedModels(trouble="the smoothed motion cannot be linearised")
    unknown = Unstated.of_all(setup.log, setup.process.noise)
    model = noise_model(problem, setup.noise, unknown) or NoiseModel(problem, (), ())
    every, told = tuple(errors), KnownLevels(stated_levels(setup), _correlation(setup), setup.inflation)
    solved, possible = with_refused_ends(solved, time, lambda rows: noise_of(model, rows, told))
    noise, taken_in = noise_of(model, solved, told), solved is not near
    contradicted = is_contradicted(noise, solved)
    settled = not is_doubtful(noise, solved) or (not contradicted and (taken_in or bool(told.correlation)))
    identified = None if settled else with_identified(model, solved, gated=not taken_in)
    motion = SmoothedMotion(time, solved if identified is None else identified, told.counts_common_errors)
    every = (*every, *placed(motion))
    if identified is None:
        found = beside_lower_densities(score_tests(motion, noise, every), motion, model, told)
        inflation = told.score_inflation
        return TestedModels(
            tuple(found), contradicted, solved=near, score_inflation=inflation, possible_contacts=possible
        )
    found = score_tests(motion, noise_of(model, identified), every)
    stated = among_inliers(problem, identified)
    if stated is not None and is_settled(stated):
        beside = score_tests(replace(motion, rows=stated), noise_of(model, stated, told), every)
        # fall of -2 ln likelihood from the stated levels to the identified ones
        advantage = minus_twice_log_likelihood(stated) - minus_twice_log_likelihood(identified)
        found = likelier(found, beside, max(advantage, 0.0))
    inflation = np.inf if told.counts_common_errors else None
    return TestedModels(
        tuple(found), contradicted, solved=near, score_inflation=inflation, possible_contacts=possible
    )


def _correlation(setup: Setup) -> dict[str, float]:
    """Samples of a correlated gyro that count as one, by its noise options; empty where its error is not of a flight."""
    if setup.gyro_noise is None or not setup.gyro_noise.is_of_flight:
        return {}
    return {
        option.name: setup.gyro_noise.correlation_time
        for sensor in setup.log.sensors
        if sensor_of(sensor).identified_option is not None
        for option in sensor_format(sensor).noise
    }


def tested_history(setup: Setup, evaluations: Sequence[Evaluation]) -> EstimateHistory | None:
    """The estimate about which models are tested: the smoother's, else the first that has not failed."""
    good = [
        each.history
        for each in evaluations
        if not each.history.has_failed
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
    return frozenset((options | set(DENSITIES)) - setup.unstated | setup.inflation.keys())


def linear_problem(setup: Setup, epochs: Timeline, ids: Int[np.ndarray, " L"] | None = None) -> Problem:
    """The smoothing problem of some epochs, the first among them, with landmarks of these ids (default all)."""
    ids = landmark_ids(setup, epochs) if ids is None else ids
    return problem_of(setup.process, epochs, ids, setup.initial.prior, OBSERVATIONS_NEEDED)


def landmark_ids(setup: Setup, epochs: Timeline) -> Int[np.ndarray, " L"]:
    """Ids of the unknown landmarks that are observed in some epochs."""
    return np.unique(seen_ids(epochs)) if setup.initial.has_landmarks else np.zeros(0, dtype=int)


def smoothed_about(problem: Problem, trajectory: Float[np.ndarray, "k m"]) -> LinearRows | None:
    """The problem at the most probable states near a trajectory and `landmarks_placed`; None where it has no solution."""
    return solved_near(problem, trajectory, landmarks_placed(problem, trajectory))


def landmarks_placed(problem: Problem, trajectory: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "L 3"]:
    """Landmarks where most of their observations from a trajectory agree, m, frame g."""
    observations = problem.observations
    if observations is None:
        return np.zeros((0, 3))
    points, nobody = np.zeros((observations.landmarks, 3)), np.zeros(len(observations), dtype=bool)
    placed = reinitialised(observations, trajectory, points, nobody, GATE)
    return points if placed is None else placed


def minus_twice_log_evidence(setup: Setup, trajectory: Float[np.ndarray, "k m"]) -> float | None:
    """-2 ln evidence of the first epochs.

    Up to a constant of priors and of the measurements' number. None where they cannot be linearised about a trajectory.
    """
    try:
        with np.errstate(all="ignore"):
            problem = linear_problem(setup, setup.timeline[: len(trajectory)])
            solved = smoothed_about(problem, trajectory)
            return None if solved is None else minus_twice_log_likelihood(solved)
    except NUMERICAL_ERRORS:
        return None


def cost_of_first_epochs(setup: Setup) -> float:
    """-2 ln marginal likelihood of the initialisation's epochs, with its prior; infinite where they could not be smoothed."""
    start = setup.initial
    if not start.has_states:
        return np.inf
    found = minus_twice_log_evidence(setup, start.mean)
    return np.inf if found is None else found + 2 * float(np.log(start.prior.std).sum())
