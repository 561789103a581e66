"""Doubts about a filter: its departure from the smoother, the evidence for its inertia, and its noise.

Noise is doubted where the data contradict a stated level, or where innovations are too large or not white.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import chdtri

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError, numerical
from spinfilters.evaluation.consistency import WHOLE, compared_parts, expected_nees, finite_epochs
from spinfilters.evaluation.estimator_evaluation import Evaluation, without_calibration
from spinfilters.evaluation.filter_noise_tests import MEASUREMENTS, FilterTests, NoiseTest, filter_tests
from spinfilters.evaluation.filter_noise_tests import MOST_EPOCHS as MOST_TESTED_EPOCHS
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import LandmarkBelief
from spinfilters.filters.history import EstimateHistory, finished_history, history_at
from spinfilters.filters.noise_levels import BLOCK, CYCLE, VarianceComponent
from spinfilters.filters.timeline import run
from spinfilters.inference.first_epochs import DETERMINED_STD, LARGEST_DEPARTURE, is_bent
from spinfilters.inference.identification import Identified, LevelTest, identify, level_tests
from spinfilters.inference.identified_noise import WHOLE_RECORDING, Unstated, is_smallest, noise_model
from spinfilters.inference.noise_model import NoiseModel
from spinfilters.inference.setup import Setup
from spinfilters.inference.smoother_run import smooth_at_once
from spinfilters.io.disturbances import DENSITIES, DISTURBANCES
from spinfilters.io.input_file import reason
from spinfilters.io.sensor_format import sensor_format
from spinfilters.models.state_blocks import MASS_DISTRIBUTION
from spinfilters.models.state_layout import Gaussian
from spinfilters.models.status import ALL, BODY, CENTRE, NOTHING, POSITION, ROTATION, Finding
from spinfilters.settings.run_settings import Settings
from spinfilters.smoother.batch_smoother import NO_LANDMARKS, NO_POINTS
from spinfilters.smoother.landmark_factors import OBSERVATIONS_NEEDED
from spinfilters.smoother.motion_factors import STRETCH
from spinfilters.smoother.problem import problem_of, with_last_constants
from spinfilters.verdict.checks import STATE_ANOTHER, finding
from spinfilters.verdict.judge import own_rows, quantity_differences

RARE = 0.01
"""Probability of a NEES of a consistent filter, beyond which one that is expected with the smoother for the truth is a doubt: 1.9
per degree of freedom of a state with a place, 3.0 of a mass distribution. Of 70 filters of noisy poses on the thesis' motion those
below had a NEES of up to 1.9 and errors of up to 3.0 deviations, those beyond it of up to 14 and 58."""
HELD = 2.0
"""Expected square of a component of a published quantity in its own deviations, mean over the epochs and in the last, up to which
the quantity holds: a normal error of that size is beyond four deviations with a probability of 0.5 %."""
HELD_AT_ONCE = 16.0
"""The same at one epoch: there the smoother itself is four deviations away."""


@dataclass(frozen=True)
class OverConfidence:
    """Expected NEES per degree of freedom of a part of a filter's error.

    Attributes
    ----------
    mean, last : float
        Over its epochs, and in the last.
    dof : int
        Of the part.
    """

    part: str
    mean: float
    last: float
    dof: int

    @property
    def excess(self) -> float:
        """Times the largest that a consistent filter has."""
        return max(self.mean, self.last) / (float(chdtri(self.dof, RARE)) / self.dof)


FARTHEST: Final = 1e12
"""Expected NEES beyond which a number says no more than that two estimates have nothing to do with one another."""


def over_confidence(history: EstimateHistory, smoother: EstimateHistory) -> list[Finding] | None:
    """Finding where a filter departs from the smoother beyond its own covariance; None without a common epoch."""
    parts = compared_parts(history.layout)
    found = [
        OverConfidence(name, float(nees.mean()), float(nees[-1]), parts[name].stop - parts[name].start)
        for name, nees in expected_nees(history, smoother).items()
        if nees.size
    ]
    if not found:
        return None
    worst = max(found, key=lambda each: each.excess)
    if worst.excess <= 1:
        return []
    nees = min(max(worst.mean, worst.last), FARTHEST)
    numbers: dict[str, float | str] = {
        "nees": nees,
        "times": float(np.sqrt(nees)),
        "which": "" if worst.part == WHOLE else f" of the {MASS_DISTRIBUTION.label}",
        "where": "over its epochs" if worst.mean >= worst.last else "in the last epoch",
    }
    return [finding("over-confident", numbers, over_confident_quantities(history, smoother))]


def over_confident_quantities(history: EstimateHistory, smoother: EstimateHistory) -> frozenset[str]:
    """Published quantities whose errors a filter states too small; all where that cannot be computed."""
    rows = own_rows(history)
    rows = rows[(rows < len(smoother.time)) & finite_epochs(history)[rows]]
    rows = rows[finite_epochs(smoother)[rows]]
    if not rows.size:
        return ALL
    with np.errstate(all="ignore"):
        found = quantity_differences(history_at(history, rows), history_at(smoother, rows))
        squares = {name: each.expected_squares for name, each in found.items()}
    return ALL & frozenset(name for name, own in squares.items() if not _is_within_chance(own))


def _is_within_chance(squares: Float[np.ndarray, "n c"]) -> bool:
    typical = max(float(squares.mean(axis=0).max()), float(squares[-1].max()))
    return typical <= HELD and float(squares.max()) <= HELD_AT_ONCE


MOST_EPOCHS = 1000
"""That are looked at: a motion that does not show itself in these counts as one that does not."""
SMALLEST_REFUSAL = 1e-12
"""Probability of a refused measurement, where there is no gate."""
NOT_FINITE = 1e9
"""Evidence of a sphere whose numbers lead nowhere where those of the body do."""


@dataclass(frozen=True)
class InertiaEvidence:
    """Evidence for the inertia of the initialisation compared with a sphere.

    Attributes
    ----------
    total : float
        Twice the logarithm of the likelihood ratio.
    epochs : int
        That it was gathered over.
    """

    total: float
    epochs: int


def inertia_evidence(setup: Setup, settings: Settings) -> InertiaEvidence | None:
    """Inertia evidence of the epochs after the initialisation.

    None where that has failed or is followed by none.
    """
    first = len(setup.initial.mean)
    rest = min(len(setup.timeline) - first, MOST_EPOCHS)
    if setup.initial.has_failed or rest < 1 or not np.isfinite(setup.belief.factor).all():
        return None
    try:
        with np.errstate(all="ignore"):  # what is not finite becomes a status
            body, sphere = (
                _predict_history(setup, settings, belief)
                for belief in (setup.belief, _as_sphere(setup.belief))
            )
    except NUMERICAL_ERRORS:
        return InertiaEvidence(0.0, rest)
    if body.has_failed:
        return InertiaEvidence(0.0, len(body.time))
    if sphere.has_failed:
        return InertiaEvidence(NOT_FINITE, len(body.time))
    return InertiaEvidence(_evidence(body, sphere, settings), len(body.time))


def _predict_history(setup: Setup, settings: Settings, belief: Gaussian | LandmarkBelief) -> EstimateHistory:
    first = len(setup.initial.mean)
    ekf = MultiplicativeEkf(setup.process, settings.robust, landmarks=settings.landmarks)
    ekf.start(belief)
    setup.take_in_first_epoch(ekf)
    return run(ekf, setup.end_of_initialisation, setup.timeline[first : first + MOST_EPOCHS])


def _as_sphere(belief: Gaussian | LandmarkBelief) -> Gaussian | LandmarkBelief:
    """The belief about everything else, of a body whose inertia is known to be a sphere's."""
    layout, name = belief.layout, MASS_DISTRIBUTION.name
    mean, factor = belief.mean.copy(), belief.factor.copy()
    mean[layout.mean_slice(name)], factor[layout.slice(name)] = 0.0, 0.0
    return replace(belief, mean=mean, factor=factor)


def _evidence(body: EstimateHistory, sphere: EstimateHistory, settings: Settings) -> float:
    """Evidence by epoch.

    The likelihoods count where both used as much, else the squares, a refused value taken for one at the gate.
    """
    alike = body.accepted == sphere.accepted
    likelihoods = 2 * (body.log_likelihood - sphere.log_likelihood)
    refused = max(1.0 - settings.robust.gate_probability, SMALLEST_REFUSAL)
    dimension = body.dof.sum() / max(body.accepted.sum(), 1)
    at_gate = float(chdtri(max(dimension, 1.0), refused))
    squares = sphere.nis - body.nis + at_gate * (sphere.rejected - body.rejected)
    return float(np.where(alike, likelihoods, squares).sum())


LEAST_EVIDENCE = 30.0
"""Of moments that a motion determines (`inertia_evidence`)."""
FEWEST_EPOCHS = 10
"""With less the evidence, at three numbers an epoch, says nothing of the motion."""


def reference_smoother(
    histories: list[EstimateHistory], setup: Setup, settings: Settings
) -> EstimateHistory | None:
    """The reference smoother of the filters.

    One of these histories, or made where what they begin from is vague.
    None where it has failed, or where it would have to be made with landmarks.
    """
    finished = finished_history(histories)
    if finished is not None:
        return finished
    vague = setup.initial.departure > LARGEST_DEPARTURE or not setup.initial.moments_std <= DETERMINED_STD
    vague |= setup.is_given and is_bent(setup.initial.belief)
    if histories or not vague or setup.initial.has_landmarks:
        return None
    try:
        made = smooth_at_once(setup, settings, lambda *_: None)
    except (InputError, *NUMERICAL_ERRORS):
        return None
    return None if made.has_failed else made


def agreement_diagnostics(
    evaluation: Evaluation, smoother: EstimateHistory | None, unheld: Sequence[Finding] = ()
) -> list[Finding]:
    """Findings where a filter departs from the smoother beyond its own covariance.

    Parameters
    ----------
    unheld : Sequence[Finding]
        What is found of it where there is nothing to compare it with.
    """
    history = evaluation.history
    if smoother is None or history.has_failed or history.layout != smoother.layout:
        return list(unheld)
    found = over_confidence(history, smoother)
    return list(unheld) if found is None else found


def motion_diagnostics(setup: Setup, settings: Settings) -> list[Finding]:
    """Finding where the motion does not determine the moments."""
    evidence = inertia_evidence(setup, settings)
    if evidence is None or evidence.total >= LEAST_EVIDENCE:
        return []
    few = evidence.epochs < FEWEST_EPOCHS
    why = "they are too few" if few else "a steady spin shows its axis only"
    numbers = {"epochs": evidence.epochs, "evidence": evidence.total, "limit": LEAST_EVIDENCE, "why": why}
    return [finding("motion-shows-no-moments", numbers, _resting_on_moments(setup))]


def _resting_on_moments(setup: Setup) -> frozenset[str]:
    """Quantities that rest on the wobble as the moments do.

    A steady spin shows the centre of mass across its axis only; along it the centre, and its place with it, follow from the same
    wobble. An undetermined body and an identified density of torques explain the same changes of the rates: the body takes a part
    of the disturbances, the density comes out too small, and with it the deviations of rate and attitude.
    """
    quantities = BODY | {CENTRE, POSITION} if setup.process.layout.translates else BODY
    return quantities | ROTATION if "torque_psd" in setup.unstated else quantities


LARGEST_SCORE = 5.0
"""Standard deviations beyond which a test is no chance."""
LARGEST_RATIO = 1.5
"""Of a variance to the stated one, below which the difference does not matter: deviations of 1.22."""
LARGEST_AUTOCORRELATION = 0.15
"""Of a filter's corrections, below which what is left of a model error does not matter."""
DENSITY_OF: Final = {each.name: each.option for each in DISTURBANCES}
"""Options of the process by the source of the disturbance."""


def untested(error: Exception) -> Finding:
    """Noise that numerical trouble kept from being tested."""
    return finding("noise-not-tested", {"text": reason(numerical(error))})


def filter_noise_diagnostics(history: EstimateHistory, setup: Setup, settings: Settings) -> list[Finding]:
    """Noise findings of a filter's own epochs.

    None of one that has failed or that adapts its noise, and none without innovations, as of a smoother's history.
    """
    adapts = settings.adaptation.measurement or settings.adaptation.process
    if adapts or not history.dof[history.own].any() or history.has_failed:
        return []
    with np.errstate(all="ignore"):
        try:
            # of levels that were identified only the epochs before the filter learns them further
            epochs = CYCLE - BLOCK if setup.identified else MOST_TESTED_EPOCHS
            found = filter_tests(without_calibration(history), setup.process, epochs)
        except NUMERICAL_ERRORS as error:
            return [untested(error)]
    tests = {DENSITY_OF.get(name, name): test for name, test in found.noise.items()}
    measurements = tests.get(MEASUREMENTS)
    if measurements is not None and _is_identified(setup):
        tests |= {name: tests[name].beside(measurements) for name in tests.keys() & DENSITIES.keys()}
    correlated = _whiteness_findings(found, setup)
    if correlated:  # which white noise of the measurements is not, whatever its size
        tests.pop(MEASUREMENTS, None)
    return [*noise_doubts(tests, setup), *correlated]


LONGEST_CORRELATION: Final = 0.1
"""Share of a recording over which errors of a gyro may be correlated; what lasts longer is a constant error, and no noise."""


def expected_nis(setup: Setup) -> float:
    """Least NIS per degree of freedom that the noise of a run is meant to give; 1 of white noise.

    The white noise that stands for noise correlated over n samples has n times its variance, and rows may be inflated. It is zero
    where measurements show no noise, which the conditions of the run say.
    """
    if any(map(is_smallest, setup.identified)):
        return 0.0
    wide, gyro = max(setup.inflation.values(), default=1.0), setup.gyro_noise
    if gyro is not None:
        longest = LONGEST_CORRELATION * min(len(setup.timeline), WHOLE_RECORDING)
        wide *= max(min(gyro.correlation_time, longest), 1.0)
    return 1 / max(wide, 1.0)


def noise_doubts(tests: Mapping[str, NoiseTest], setup: Setup) -> list[Finding]:
    """A finding about the level that the data contradict most; one that is wrong shows in the tests of the others.

    A level that is not stated may be too large, as its identification means it to be.
    """
    for name, test in sorted(tests.items(), key=lambda item: -abs(item[1].score)):
        told = name not in setup.unstated if name in DENSITIES else not _is_identified(setup)
        large = test.score > LARGEST_SCORE and test.ratio > LARGEST_RATIO
        small = told and test.score < -LARGEST_SCORE and test.ratio < 1 / LARGEST_RATIO
        if large or small:
            return [_level_finding(name, test, told)]
    return []


def _is_identified(setup: Setup) -> bool:
    """Whether the noise of a sensor of this data set is not stated."""
    options = {
        option for stream in setup.dataset.log.streams for option in sensor_format(stream.sensor).levels
    }
    return setup.gyro_noise is not None or bool(options & setup.unstated)


def _level_finding(name: str, test: NoiseTest, told: bool) -> Finding:
    numbers = {
        "times": float(np.sqrt(test.ratio)),
        "ratio": test.ratio,
        "score": abs(test.score),
        "level": "stated deviation" if told else "deviation that was identified",
    }
    if name in DENSITIES:
        before = "what is stated" if told else "what its first epochs have"
        return finding("filter-disturbance", numbers | {"name": name, "before": before})
    which = "measurements" if name == MEASUREMENTS else f"{name} measurements"
    cure = "state another, or leave it out to have it identified"
    if not told:
        cure = "the noise changes or a model is wrong: state the level, or cut the recording"
    return finding("filter-noise", numbers | {"name": which, "cure": cure})


def _whiteness_findings(found: FilterTests, setup: Setup) -> list[Finding]:
    """Findings about corrections that are not white; none for a gyro whose noise was identified as correlated."""
    if setup.gyro_noise is not None:
        return []
    if found.whiteness_score <= LARGEST_SCORE or found.autocorrelation <= LARGEST_AUTOCORRELATION:
        return []
    numbers = {"correlation": found.autocorrelation, "score": found.whiteness_score}
    return [finding("correlated-corrections", numbers)]


LARGEST_LEVEL_SCORE: Final = 4.0
"""Standard deviations beyond which a test is no chance: one of 8000 levels that are right."""
LEAST_LEVEL_SCORE: Final = 3.0
"""The same for an identified variance that is `FEWFOLD` times too small."""
FEWFOLD: Final = 4.0
"""The deviations that rest on such a variance may be half of what they should be, and an error of four of them is one of two. Of
300 filters of poses those beyond it, three, had errors of 2.3, 4.4 and 4.8."""
LIKELY_SCORE: Final = 2.0
"""Standard deviations below which no other level seems too small: where data have less noise than stated, deviations are only too
large, and what they are about holds."""


def stated_level_diagnostics(
    setup: Setup, settings: Settings, histories: Sequence[EstimateHistory]
) -> list[Finding]:
    """A finding about the level that the data contradict most; one that is wrong shows in the tests of the others.

    A level that is not stated may be too large, as its identification means it to be.

    Parameters
    ----------
    histories : Sequence[EstimateHistory]
        Of which the first that has not failed gives the states; with landmarks the initialisation does.
    """
    if settings.adaptation.measurement or settings.adaptation.process:
        return []
    try:
        with np.errstate(all="ignore"):
            levels = _levels_of_run(setup, settings, histories)
            return [] if levels is None else _most_contradicted(setup, levels)
    except NUMERICAL_ERRORS as error:
        return [untested(error)]


class _Levels(NamedTuple):
    """All levels of a problem, and states near the most probable ones.

    Those that every row of a sensor states for itself are compared with the data without their inflation.
    """

    model: NoiseModel
    trajectory: Float[np.ndarray, "k m"]
    points: Float[np.ndarray, "L 3"]


def _levels_of_run(setup: Setup, settings: Settings, histories: Sequence[EstimateHistory]) -> _Levels | None:
    """Levels of the initialisation's epochs with landmarks, else of all that an estimator came through, up to `STRETCH`."""
    start = setup.initial
    trajectory, ids, points, needed, used = start.mean, start.ids, start.points, OBSERVATIONS_NEEDED, None
    if not start.has_landmarks:
        history = finished_history(histories)
        if history is None or history.layout != setup.process.layout:
            return None
        mean = history.mean[:STRETCH]
        trajectory = with_last_constants(history.layout, mean)
        ids, points, needed, used = NO_LANDMARKS, NO_POINTS, 2, history.noise
    if not np.isfinite(trajectory).all():
        return None
    epochs = setup.timeline[: len(trajectory)]
    problem = problem_of(setup.process, epochs, ids, start.prior, needed, settings.smoother.robust_loss)
    model = noise_model(problem, setup.noise, Unstated.of_all(setup.log, setup.process.noise))
    if model is None:
        return None
    return _Levels(_deflated(_model_at(model, used or ()), setup.inflation), trajectory, points)


def _most_contradicted(setup: Setup, levels: _Levels) -> list[Finding]:
    """A finding about the level that the data contradict most, where that is beyond chance and matters."""
    tests = _level_tests(setup, levels)
    unstated = setup.unstated - setup.inflation.keys()
    inflated = max(setup.inflation.values(), default=1.0) > 1.0
    # correlated noise is taken for white noise that weighs as much
    white = setup.gyro_noise is None and not inflated
    asked = [test for test in tests if test.name not in unstated or (white and test.score > 0)]
    worst = max(asked, key=lambda test: abs(test.score), default=None)
    if worst is None or not abs(worst.score) > LEAST_LEVEL_SCORE:
        return []
    beyond_chance = abs(worst.score) > LARGEST_LEVEL_SCORE
    if not beyond_chance and (worst.score < 0 or worst.name not in unstated):
        return []
    found = identify(levels.model, levels.trajectory, levels.points, levels.model.stated)
    if found is None:
        return []
    k = [each.name for each in found.components].index(worst.name)
    if not abs(found.log_variance[k]) > np.log(LARGEST_RATIO if beyond_chance else FEWFOLD):
        return []
    others = max((test.score for test in tests if test.name != worst.name), default=0.0)
    about = NOTHING if worst.score < 0 and others < LIKELY_SCORE else ALL
    return [_stated_level_finding(setup, found, k, abs(worst.score), about)]


def _level_tests(setup: Setup, levels: _Levels) -> list[LevelTest]:
    """Tests of all levels, inflated rows of poses within their inflation.

    Such rows are too small only where they are so with it, and never too large: they hold errors of the map, which all
    poses share, and directions that a scan does not determine; residuals show neither.
    Poses share the errors of a map, which residuals show as far as the view changes, an unknown amount. Those of images are
    slow.
    """
    model, trajectory, points = levels
    tests = level_tests(model, trajectory, points)
    formats = [sensor_format(stream.sensor) for stream in setup.log.streams]
    of_poses = {option.name for form in formats if not form.has_landmarks for option in form.noise}
    inflated = {name: by for name, by in setup.inflation.items() if name in of_poses and by > 1}
    if not inflated:
        return list(tests)
    whole = _deflated(model, {name: 1 / factor for name, factor in inflated.items()})
    most = {t.name: max(t.score, 0.0) for t in level_tests(whole, trajectory, points)}
    return [
        LevelTest(t.name, max(min(t.score, most.get(t.name, 0.0)), 0.0)) if t.name in inflated else t
        for t in tests
    ]


def _stated_level_finding(
    setup: Setup, found: Identified, number: int, score: float, about: frozenset[str]
) -> Finding:
    level = found.components[number]
    is_density = level.name in DENSITIES
    half = 1.0 if is_density else 0.5
    times = float(np.exp(half * found.log_variance[number]))
    numbers: dict[str, float | str] = {"name": level.name, "times": times, "score": score}
    if level.name in setup.inflation:
        inflated = " without their inflation" if setup.inflation[level.name] > 1 else ""
        std = times * half * level.log_std
        return finding(
            "row-noise", numbers | {"std": std, "inflated": inflated, "state": "the rows state"}, about
        )
    together = _stated_together(setup, level.name)
    if len(together) > 1 and level.name not in setup.unstated:
        name = " and ".join(f"sensors.{each}" for each in together)
        numbers |= {"name": name, "std": times * half * level.log_std, "inflated": "", "state": "they state"}
        return finding("row-noise", numbers, about)
    seen = f"{level.value:.3g} +- {level.std:.1g}" if level.told else f"less than {level.upper:.2g}"
    name = f"{'process' if is_density else 'sensors'}.{level.name}"
    numbers |= {"name": name, "stated": level.value / times, "seen": seen}
    if level.name in setup.unstated:
        return finding("identified-noise", numbers, about)
    cure = STATE_ANOTHER + ", or the model is wrong" * is_density
    return finding("stated-noise", numbers | {"cure": cure}, about)


def _stated_together(setup: Setup, option: str) -> list[str]:
    """Noise options of an option's sensor that add to the same deviations, such as a part in proportion to the rate."""
    formats = [sensor_format(stream.sensor).noise for stream in setup.log.streams]
    own = next((form for form in formats if any(each.name == option for each in form)), ())
    beside = [each.name for each in own if each.components is None and setup.noise.values[each.name] > 0]
    return [option, *beside]


def _model_at(model: NoiseModel, levels: Sequence[VarianceComponent]) -> NoiseModel:
    """The model at levels that an estimator has identified by itself."""
    own = {each.name: each for each in levels}
    before = dict(zip(model.names, model.values(model.stated), strict=True))
    by = model.stated
    for k, name in enumerate(model.names):
        if name in own and before[name] > 0:
            half = 1.0 if name in DENSITIES else 0.5
            by[k] = np.log(own[name].value / before[name]) / half
    return model.at(by)


def _deflated(model: NoiseModel, inflation: Mapping[str, float]) -> NoiseModel:
    """The model at the levels of single rows, without what errors in common add."""
    return model.at(-np.log([inflation.get(name, 1.0) for name in model.names]))
