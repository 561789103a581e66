"""Doubts about noise levels and about models.

Each with the number that tells how far the data are from what was stated.
"""

from collections.abc import Mapping

import numpy as np

from spinfilters.data.input_file import reason
from spinfilters.data.sensor_format import sensor_format
from spinfilters.errors import NUMERICAL_ERRORS, numerical
from spinfilters.estimators.filters.noise_adaptation import BLOCK, CYCLE
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.identification.components import DISTURBANCES
from spinfilters.evaluation.deviation_parts import without_calibration
from spinfilters.evaluation.noise_tests import MEASUREMENTS, MOST_EPOCHS, FilterTests, NoiseTest, filter_tests
from spinfilters.pipeline.setup import Setup
from spinfilters.settings.run_settings import Settings
from spinfilters.state.status import Finding, Verdict
from spinfilters.verdict.checks import finding

LARGEST_SCORE = 5.0
"""Standard deviations beyond which a test is no chance."""
LARGEST_RATIO = 1.5
"""Of a variance to the stated one, below which the difference does not matter: deviations of 1.22."""
LARGEST_AUTOCORRELATION = 0.15
"""Of a filter's corrections, below which what is left of a model error does not matter."""
DENSITY_OF = {"torque": "torque_psd", "force": "force_psd"}
"""Options of the process by the source of the disturbance."""


def untested(error: Exception) -> Finding:
    """Noise that numerical trouble kept from being tested."""
    return finding("noise-not-tested", {"text": reason(numerical(error))})


def filter_noise_diagnostics(history: EstimateHistory, setup: Setup, settings: Settings) -> list[Finding]:
    """Findings of a filter's own epochs about noise.

    None of one that has failed, or that adapts what it was told.
    """
    adapts = settings.adaptation.measurement or settings.adaptation.process
    if adapts or history.status.verdict is Verdict.FAILED:
        return []
    with np.errstate(all="ignore"):
        try:
            found = filter_tests(without_calibration(history), setup.process, _tested_epochs(setup))
        except NUMERICAL_ERRORS as error:
            return [untested(error)]
    tests = {DENSITY_OF.get(name, name): test for name, test in found.noise.items()}
    measurements = tests.get(MEASUREMENTS)
    if measurements is not None and _is_identified(setup):
        tests |= {name: tests[name].beside(measurements) for name in tests.keys() & DISTURBANCES}
    correlated = _of_whiteness(found, setup)
    if correlated:  # which white noise of the measurements is not, whatever its size
        tests.pop(MEASUREMENTS, None)
    return [*noise_doubts(tests, setup), *correlated]


def noise_doubts(tests: Mapping[str, NoiseTest], setup: Setup) -> list[Finding]:
    """A finding about the level that the data contradict most.

    One that is wrong shows in the tests of the others.
    A level that nobody states may be too large, which its identification means it to be.
    """
    for name, test in sorted(tests.items(), key=lambda item: -abs(item[1].score)):
        told = name not in setup.unstated if name in DISTURBANCES else not _is_identified(setup)
        large = test.score > LARGEST_SCORE and test.ratio > LARGEST_RATIO
        small = told and test.score < -LARGEST_SCORE and test.ratio < 1 / LARGEST_RATIO
        if large or small:
            return [_finding(name, test, told)]
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


def _tested_epochs(setup: Setup) -> int:
    """Epochs of a filter that are tested: of identified levels those before it learns them further."""
    return CYCLE - BLOCK if setup.identified else MOST_EPOCHS


def _finding(name: str, test: NoiseTest, told: bool) -> Finding:
    numbers = {
        "times": float(np.sqrt(test.ratio)),
        "ratio": test.ratio,
        "score": abs(test.score),
        "level": "stated deviation" if told else "deviation that was identified",
    }
    if name in DISTURBANCES:
        before = "what is stated" if told else "what its first epochs have"
        return finding("filter-disturbance", numbers | {"name": name, "before": before})
    which = "measurements" if name == MEASUREMENTS else f"{name} measurements"
    cure = "state another, or leave it out to have it identified"
    if not told:
        cure = "the noise changes or a model is wrong: state the level, or cut the recording"
    return finding("filter-noise", numbers | {"name": which, "cure": cure})


def _of_whiteness(found: FilterTests, setup: Setup) -> list[Finding]:
    """Findings about white noise of a gyro of unknown error.

    Its correlated noise is told to filters as white noise of more weight.
    """
    if setup.gyro_noise is not None:
        return []
    if found.whiteness_score <= LARGEST_SCORE or found.autocorrelation <= LARGEST_AUTOCORRELATION:
        return []
    numbers = {"correlation": found.autocorrelation, "score": found.whiteness_score}
    return [finding("correlated-corrections", numbers)]
