"""Errors of a calibration that is not stated, as large as the residuals leave possible.

A default deviation s describes a good calibration, which this one may not be. Its error x therefore has a prior with tails,
the Cauchy density 1 / (1 + (x / s)^2) up to the size S that is plausible of it at all. The score test of the same error gives its
size z with the standard deviation d, without a prior. The posterior density is in proportion to

    p(x) = exp(-(z - x)^2 / 2 d^2) / (1 + (x / s)^2),   |x| <= S.

The considered deviation is its root mean square, at least s, and large enough that four of them are exceeded with a probability of
0.5 % only: this posterior has tails that a normal one has not. Residuals that determine the error better than s leave s; such as
hardly determine it raise s by a few times, and such as contradict s by as much as they show. A stated deviation is taken as it is.
"""

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.inference.stated_noise import PRIOR
from spinfilters.io.consider_parameter import ConsideredDeviation
from spinfilters.verdict.model_errors.alternatives import table
from spinfilters.verdict.model_errors.score_tests import ScoreTest

POINTS: Final = 20001
"""Of the integrals over [-S, S]: a default of S / 50 spans 200 of them."""
LARGEST: Final = 4.0
"""Deviations within which a verdict promises an estimate to be."""
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
