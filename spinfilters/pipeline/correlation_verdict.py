"""Doubts and wider covariances for errors that may be correlated in time.

Errors that are likely are a doubt. Where the data do not tell them from disturbances, deviations are widened until they
hold with either; what then is not determined is no longer said to be.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.sensor_format import sensor_format
from spinfilters.estimators.model_errors.correlated_errors import CorrelatedErrors, correlated_errors
from spinfilters.estimators.model_errors.correlated_observations import (
    ObservationCorrelation,
    observation_correlation,
)
from spinfilters.estimators.model_errors.linear_rows import LinearRows
from spinfilters.pipeline.identified_noise import Unstated, noise_model
from spinfilters.pipeline.setup import Setup

LIKELY: Final = 0.8
"""Probability of errors that are a doubt; less likely ones are covered by deviations."""
LARGEST_NEES: Final = 2.0
"""Expected per degree of freedom, beyond which errors that are likely are a doubt."""
LARGEST_SCORE: Final = 5.0
"""Standard deviations beyond which landmarks' residuals are correlated by no chance."""


@dataclass(frozen=True)
class PossibleCorrelation:
    """Errors of a recording's measurements that are correlated, or may be.

    Attributes
    ----------
    doubts: sentences about those that are likely.
    widening: B of the first epochs, by which F B is a covariance factor that holds with them; None where F is one.
    undecided: a sentence about errors that only may be correlated.
    score_inflation: by which errors of landmarks' observations that last enlarge scores, beyond what is stated of them; 1 where
        they are white.
    """

    doubts: tuple[str, ...] = ()
    widening: Float[np.ndarray, "k e e"] | None = None
    undecided: str = ""
    score_inflation: float = 1.0


NO_CORRELATION: Final = PossibleCorrelation()


def possible_correlation(
    setup: Setup, rows: LinearRows | None, stated: Collection[str]
) -> PossibleCorrelation:
    """Errors that the estimates take for white ones beside disturbances.

    None of a gyro whose error is known to be correlated.

    Parameters
    ----------
    rows: of a smoothed motion; None where there are none.   stated: names of levels that are not identified.
    """
    if rows is None or setup.gyro_noise is not None:
        return NO_CORRELATION
    levels = Unstated.of_all(setup.log, setup.process.noise)
    model = noise_model(rows.problem, setup.noise, levels)
    seen = observation_correlation(rows)
    if seen is not None and seen.score > LARGEST_SCORE:
        left = seen.inflation / _stated_inflation(setup)
        if left > LARGEST_NEES:
            return PossibleCorrelation((_of_landmarks(seen, left),), score_inflation=left)
        if seen.inflation > LARGEST_NEES:
            return NO_CORRELATION
    found = [] if model is None else correlated_errors(rows, model, stated)
    if not found:
        return NO_CORRELATION
    doubts = tuple(_sentence(each) for each in found if _is_doubt(each))[:1]
    widest = max(found, key=lambda each: float(np.square(each.widening).sum()))
    return PossibleCorrelation(doubts, widest.widening, _undecided(widest))


def _is_doubt(found: CorrelatedErrors) -> bool:
    return found.probability > LIKELY and found.expected_nees > LARGEST_NEES


def _stated_inflation(setup: Setup) -> float:
    """Factor by which the variances of landmarks' observations are stated to be larger for errors that they have in common."""
    formats = [sensor_format(stream.sensor) for stream in setup.log.streams]
    names = {option.name for form in formats if form.has_landmarks for option in form.noise}
    return max((by for name, by in setup.inflation.items() if name in names), default=1.0)


def _of_landmarks(seen: ObservationCorrelation, left: float) -> str:
    return (
        f"errors of a landmark's observations are correlated ({seen.value:.2f} from epoch to epoch, {seen.score:.0f} deviations "
        f"of chance): squared errors of the estimates may be {left:.1f} times what is stated; use images further apart, or state "
        "covariances of the rows with a covariance_inflation"
    )


def _sentence(found: CorrelatedErrors) -> str:
    return (
        f"errors of the measurements are correlated over {found.time:.2g} s ({_sizes(found)}; -2 ln likelihood falls by "
        f"{found.advantage:.0f}) and pass for disturbances: deviations allow for "
        f"{found.inflation:.0f} times the variance; take measurements further apart, or a longer recording"
    )


def _undecided(found: CorrelatedErrors) -> str:
    return (
        f"disturbances cannot be told from errors of the measurements that are correlated over {found.time:.2g} s "
        f"({_sizes(found)}), and deviations hold with both: state process.torque_psd if it is known, or give a longer recording"
    )


def _sizes(found: CorrelatedErrors) -> str:
    return ", ".join(f"{name} {value:.2g}" for name, value in found.lasting.items())
