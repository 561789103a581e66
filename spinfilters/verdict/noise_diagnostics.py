"""Doubts about noise: levels that the data contradict, innovations that are too large or not white."""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import NUMERICAL_ERRORS, numerical
from spinfilters.evaluation.estimator_evaluation import without_calibration
from spinfilters.evaluation.filter_noise_tests import (
    MEASUREMENTS,
    MOST_EPOCHS,
    FilterTests,
    NoiseTest,
    filter_tests,
)
from spinfilters.filters.history import EstimateHistory, finished_history
from spinfilters.filters.noise_levels import BLOCK, CYCLE, VarianceComponent
from spinfilters.inference.identification import Identified, LevelTest, identify, level_tests
from spinfilters.inference.identified_noise import WHOLE_RECORDING, Unstated, is_smallest, noise_model
from spinfilters.inference.noise_model import NoiseModel
from spinfilters.inference.setup import Setup
from spinfilters.io.disturbances import DENSITIES, DISTURBANCES
from spinfilters.io.input_file import reason
from spinfilters.io.sensor_format import sensor_format
from spinfilters.models.status import ALL, NOTHING, Finding
from spinfilters.settings.run_settings import Settings
from spinfilters.smoother.batch_smoother import NO_LANDMARKS, NO_POINTS
from spinfilters.smoother.landmark_factors import OBSERVATIONS_NEEDED
from spinfilters.smoother.motion_factors import STRETCH
from spinfilters.smoother.problem import problem_of, with_common_constants
from spinfilters.verdict.checks import STATE_ANOTHER, finding

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
            epochs = CYCLE - BLOCK if setup.identified else MOST_EPOCHS
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
        option.name
        for stream in setup.dataset.log.streams
        for option in sensor_format(stream.sensor).noise
        if option.components is not None
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
        trajectory = np.ascontiguousarray(with_common_constants(history.layout, mean[::-1])[::-1])
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
    if worst is None or not abs(worst.score) > LARGEST_LEVEL_SCORE:
        return []
    found = identify(levels.model, levels.trajectory, levels.points, levels.model.stated)
    if found is None:
        return []
    k = [each.name for each in found.components].index(worst.name)
    if not abs(found.log_variance[k]) > np.log(LARGEST_RATIO):
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
