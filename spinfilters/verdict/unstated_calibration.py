"""Errors of a calibration that is not stated, as large as the residuals leave possible.

A default deviation s describes a good calibration, which this one may not be. Its error x therefore has a prior with tails,
the Cauchy density 1 / (1 + (x / s)^2) up to the size S that is plausible of it at all. The score test of the same error gives its
size z with the standard deviation d, without a prior. The posterior density is in proportion to

    p(x) = exp(-(z - x)^2 / 2 d^2) / (1 + (x / s)^2),   |x| <= S.

The considered deviation is its root mean square, at least s, and large enough that four of them are exceeded with a probability of
0.5 % only: this posterior has tails that a normal one has not. Residuals that determine the error better than s leave s; such as
hardly determine it raise s by a few times, and such as contradict s by as much as they show. A stated deviation is taken as it is.

The deviation of a clock is one of its rate. A rate that changes while a gyro alone records leaves the motion of another body, so
that residuals hardly show it: stamps are then late by x (2 t / T - 1)^2 at the time t of a recording of the duration T, and x has
the same prior, with s the duration times the deviation of the clock.
"""

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.inference.setup import Setup
from spinfilters.inference.stated_noise import PRIOR
from spinfilters.io.consider_parameter import ConsideredDeviation
from spinfilters.verdict.model_errors.alternatives import table
from spinfilters.verdict.model_errors.score_tests import ScoreTest
from spinfilters.verdict.model_errors.sensor_alternatives import ClockDrift
from spinfilters.verdict.model_errors.smoothed_motion import SmoothedMotion

POINTS: Final = 20001
"""Of the integrals over [-S, S]: a default of S / 50 spans 200 of them."""
LARGEST: Final = 4.0
"""Deviations within which a verdict promises an estimate to be."""
LARGEST_DRIFT: Final = 0.05
"""Of a recording's duration, by which stamps may be late at its ends beside its middle: the clock's rate is then 20 % off there."""
BEYOND: Final = 5e-3
"""Probability of an error beyond them that is allowed, as of an over-confident filter (`HELD` of `verdict.agreement_tests`)."""


def enlargements(
    considered: Sequence[ConsideredDeviation], tests: Iterable[ScoreTest]
) -> Float[np.ndarray, " c"]:
    """Times the considered deviation of every independent error, at least 1.

    Parameters
    ----------
    considered : sequence of ConsideredDeviation
        Those of the run that are not zero.
    tests : iterable of ScoreTest
        Score tests of the recording. An error without one, which no residual shows, keeps its deviation.

    Returns
    -------
    array (c,)
        In the order of the columns of `EstimateHistory.calibration`.
    """
    by_name = {each.error.parameter.name: each for each in tests if each.error.parameter is not None}
    found = []
    for each in considered:
        test = by_name.get(each.parameter.name)
        if each.source != PRIOR or test is None:
            found.append(np.ones(each.parameter.size))
            continue
        found.append(
            np.array(
                [
                    possible_deviation(size, std, each.std, test.error.plausible) / each.std
                    for size, std in zip(test.size, test.std, strict=True)
                ]
            )
        )
    return np.concatenate(found) if found else np.ones(0)


def enlarged_words(considered: Iterable[ConsideredDeviation]) -> list[str]:
    """Words for the considered parameters that are not stated and have a score test, so that `enlargements` may exceed 1."""
    tested = {each.parameter.name for each in table().values() if each.parameter is not None}
    return [
        each.parameter.words
        for each in considered
        if each.std > 0 and each.source == PRIOR and each.parameter.name in tested
    ]


def possible_deviation(size: float, std: float, default: float, plausible: float) -> float:
    """Deviation of a calibration error that is not stated, at least the default one; see the module.

    Parameters
    ----------
    size, std : float
        Of the error by the residuals alone, with its standard deviation; zero or not finite where they show nothing.
    default : float
        Scale of the prior.
    plausible : float
        Largest size that is considered.
    """
    if not (np.isfinite([size, std, plausible]).all() and std > 0 and plausible > default):
        return default
    x = np.linspace(-plausible, plausible, POINTS)
    log_density = -0.5 * ((size - x) / std) ** 2 - np.log1p((x / default) ** 2)
    density = np.exp(log_density - log_density.max())
    density /= density.sum()
    farthest = np.argsort(-np.abs(x), kind="stable")
    beyond = np.abs(x[farthest[np.searchsorted(np.cumsum(density[farthest]), BEYOND)]])
    return max(default, float(np.sqrt(density @ x**2)), float(beyond) / LARGEST)


def possible_clock_drift(
    setup: Setup, motion: SmoothedMotion, tests: Iterable[ScoreTest]
) -> Float[np.ndarray, "k n"] | None:
    """Error of the states by one deviation of a clock's drift, where rates alone are measured and nobody states the clock.

    Parameters
    ----------
    motion : SmoothedMotion
        Of the tested epochs.
    tests : iterable of ScoreTest
        About it.

    Returns
    -------
    (k, n) float array or None
        Of every tested epoch; None where other measurements show a drift, or the clock is stated.
    """
    clock = next((each for each in setup.calibration if each.parameter.of_clock), None)
    if clock is None or clock.source != PRIOR or not all(each.model.reads_rate for each in motion.measured):
        return None
    error = ClockDrift()
    columns = error.columns(motion)
    if columns is None:
        return None
    test = next((each for each in tests if each.error.name == error.name), None)
    size, std = (0.0, np.inf) if test is None else (float(test.size[0]), float(test.std[0]))
    span = float(motion.time[-1] - motion.time[0])
    deviation = possible_deviation(size, std, clock.std * span, LARGEST_DRIFT * span)
    return deviation * motion.rows.sensitivity(columns).states[:, :, 0]
