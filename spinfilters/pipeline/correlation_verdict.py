"""Doubts about errors of measurements that are correlated in time."""

from collections.abc import Collection
from typing import TYPE_CHECKING, Final

from spinfilters.estimators.model_errors.correlated_errors import CorrelatedErrors, correlated_errors
from spinfilters.estimators.model_errors.correlated_observations import (
    ObservationCorrelation,
    observation_correlation,
)
from spinfilters.estimators.model_errors.linear_rows import LinearRows
from spinfilters.pipeline.identified_noise import Unstated, noise_model

if TYPE_CHECKING:
    from spinfilters.pipeline.setup import Setup

LIKELY: Final = 0.5
"""Probability of errors that are likelier than not."""
LARGEST_NEES: Final = 2.0
"""Expected per degree of freedom, beyond which errors that are likelier than not are a doubt."""
LARGEST_UNDECIDED_NEES: Final = 20.0
"""The same of errors that the recording does not tell from disturbances: a gyro alone hardly tells small ones, and no recording is
doubted for what may always be so."""
HIDDEN, LARGEST_HIDDEN_NEES = 0.8, 2.5
"""The same where disturbances leave less than a fifth of a measurement's variance to white noise: deviations rest on them alone."""
LARGEST_SCORE: Final = 5.0
"""Standard deviations beyond which landmarks' residuals are correlated by no chance."""


def correlated_error_doubts(setup: "Setup", rows: LinearRows | None, stated: Collection[str]) -> list[str]:
    """A sentence about errors that the estimates take for white ones beside disturbances.

    None of a gyro whose error is known to be correlated.

    Parameters
    ----------
    rows: of a smoothed motion; None where there are none.   stated: names of levels that are not identified.
    """
    if rows is None or setup.gyro_noise is not None:
        return []
    levels = Unstated.of_all(setup.log, setup.process.noise)
    model = noise_model(rows.problem, setup.noise, levels)
    seen = observation_correlation(rows)
    if seen is not None and seen.score > LARGEST_SCORE and seen.inflation > LARGEST_NEES:
        return [_of_landmarks(seen)]
    found = [] if model is None else correlated_errors(rows, model, stated)
    return [_sentence(each) for each in found if _matters(each)][:1]


def _matters(found: CorrelatedErrors) -> bool:
    if found.probability > LIKELY:
        return found.expected_nees > LARGEST_NEES
    return found.expected_nees > (LARGEST_HIDDEN_NEES if found.disturbed > HIDDEN else LARGEST_UNDECIDED_NEES)


def _of_landmarks(seen: ObservationCorrelation) -> str:
    return (
        f"errors of a landmark's observations are correlated ({seen.value:.2f} from epoch to epoch, {seen.score:.0f} deviations "
        f"of chance): squared errors of the estimates may be {seen.inflation:.1f} times what is stated; use images further apart"
    )


def _sentence(found: CorrelatedErrors) -> str:
    if found.probability <= LIKELY:
        return _undecided(found)
    return (
        f"errors of the measurements are correlated over {found.time:.2g} s ({_sizes(found)}; -2 ln likelihood falls by "
        f"{found.advantage:.0f}) and pass for disturbances: squared errors may be {found.inflation:.0f} times what is stated; "
        "take measurements further apart, or a longer recording"
    )


def _undecided(found: CorrelatedErrors) -> str:
    return (
        f"disturbances cannot be told from errors of the measurements that are correlated over {found.time:.2g} s "
        f"({_sizes(found)}), with which squared errors are {found.inflation:.0f} times what is stated: state process.torque_psd if "
        "it is known, or give a longer recording"
    )


def _sizes(found: CorrelatedErrors) -> str:
    return ", ".join(f"{name} {value:.2g}" for name, value in found.lasting.items())
