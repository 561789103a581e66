"""Consistency of a truth with itself.

Its rates turn its attitudes, its velocities carry its centre of mass.
A truth whose rates are in degrees, in axes of the body, or of another stretch of time is read without complaint, and every error
against it is wrong. Measured truths have noise, so what is looked at is far coarser than any noise: turns of a radian, whole paths.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.attitude.conversions import angle_between, integrate_gyro, inverse, multiply
from spinfilters.data.truth import Truth

WINDOW: Final = 1.0
"""Rad of turn after which attitudes and rates start together again, so that a gyro's bias does not add up."""
LARGEST_STEP: Final = 1.0
"""Rad between two rows, above which rates at the rows alone do not tell the turn."""
TOLD: Final = 0.8
"""Share of all turning that must be in steps no larger: of a body that is seen too rarely nothing is said."""
DEGREES: Final = (55.0, 60.0)
"""Ratio of a rate to the turn that is seen, within which the rate is in degrees; steps too long to be told are no hindrance."""
APART: Final = 0.25
"""Rad within a window, which a quarter of all turning must exceed: rates wrong by a third; optical noise is a tenth of it."""
SHARE: Final = 0.5
"""Of the extent of a path, that the path of its velocities is off by: neither sign nor unit nor axes can be right."""
NOISE: Final = 10.0
"""Times the noise of positions and of summed velocities, below which nothing is said."""
FEWEST: Final = 5
"""Rows."""


def contradictions(truth: Truth) -> list[str]:
    """One sentence for each contradiction of a truth with itself.

    None for one that does not contradict, or is too short to tell.
    """
    with np.errstate(all="ignore"):  # numbers beyond all bounds are no reason to stop
        return [*_of_rotation(truth), *_of_translation(truth)]


def _of_rotation(truth: Truth) -> Iterator[str]:
    if len(truth.time) <= FEWEST:
        return
    if _is_in_degrees(truth):
        yield _sentence("its rates turn its attitudes 57 times too far, as if they were in degrees")
        return
    apart = _typically_apart(truth)
    if apart is not None and apart > APART:
        yield _sentence(f"its rates do not turn its attitudes ({apart:.2g} rad apart within a radian)")


def _of_translation(truth: Truth) -> Iterator[str]:
    dt, velocity = np.diff(truth.time), truth.velocity
    if len(dt) < FEWEST:
        return
    steps = (velocity[1:] + velocity[:-1]) / 2 * dt[:, None]
    carried = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    off, extent = _spread(truth.center_of_mass - carried), max(map(_spread, (truth.center_of_mass, carried)))
    summed = _noise(velocity) * np.sqrt(len(dt)) * float(np.median(dt))
    if off > SHARE * extent and off > NOISE * (_noise(truth.center_of_mass) + summed):
        yield _sentence(
            f"its velocities do not carry its centre of mass ({off:.2g} m apart on a path of {extent:.2g} m)"
        )


def _sentence(why: str) -> str:
    return f"THE TRUTH CONTRADICTS ITSELF: {why}. Errors against it mean little."


def _is_in_degrees(truth: Truth) -> bool:
    turn, seen = _turns(truth)
    moved = np.minimum(turn, seen) > 0
    ratio = turn[moved] / seen[moved]
    return len(ratio) > FEWEST and DEGREES[0] < np.median(ratio) < DEGREES[1]


def _turns(truth: Truth) -> tuple[Float[np.ndarray, " j"], Float[np.ndarray, " j"]]:
    """Rotations of every step by the rates and by the attitudes, rad."""
    rates, q = truth.rate_i, truth.q_ig
    by_rates = np.linalg.norm(rates[1:] + rates[:-1], axis=1) / 2 * np.diff(truth.time)
    return by_rates, angle_between(q[1:], q[:-1])


def _typically_apart(truth: Truth) -> float | None:
    """Third quartile of the angle between turns by attitudes and rates, rad.

    All turning counts; None where too few rows tell. What rates leave open between two rows, by their second differences, is
    taken off.
    """
    turn, seen = _turns(truth)
    told, weight = turn <= LARGEST_STEP, np.maximum(turn, seen)
    if np.count_nonzero(told) < FEWEST or not weight[told].sum() > TOLD * weight.sum():
        return None
    begin, end = _windows(turn, told), 1 + np.flatnonzero(told)
    curved = np.linalg.norm(np.diff(truth.rate_i, n=2, axis=0), axis=1)
    left = np.maximum(np.append(curved, 0.0), np.append(0.0, curved)) * np.diff(truth.time) / 2
    open_still = np.append(0.0, np.cumsum(left))
    apart = _angles_apart(truth, begin, end) - (open_still[end] - open_still[begin])
    order = np.argsort(apart)
    summed = np.cumsum(weight[told][order])
    return float(apart[order][np.searchsorted(summed, 0.75 * summed[-1])])


def _windows(turn: Float[np.ndarray, " j"], told: Bool[np.ndarray, " j"]) -> Int[np.ndarray, " n"]:
    """First row of the window of every step that is told.

    ``turn`` (rad) is that of each step.
    """
    done = np.cumsum(np.where(told, turn, 0.0))
    window = np.floor((done - np.where(told, turn, 0.0)) / WINDOW)
    begins = (np.diff(window, prepend=-1.0) != 0) | (np.diff(told, prepend=False) != 0)
    return np.maximum.accumulate(np.where(begins, np.arange(len(turn)), 0))[told]


def _angles_apart(
    truth: Truth, begin: Int[np.ndarray, " n"], end: Int[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Angles between the turns from row to row by the attitudes and by the rates, rad."""
    back = integrate_gyro(
        truth.time, -truth.rate_i, np.array([0.0, 0.0, 0.0, 1.0])
    )  # inverse of the turn so far
    by_rates = multiply(inverse(back[end]), back[begin])
    return angle_between(by_rates, multiply(truth.q_ig[end], inverse(truth.q_ig[begin])))


def _spread(path: Float[np.ndarray, "n 3"]) -> float:
    """Median distance from the middle of a path, m."""
    return float(np.median(np.linalg.norm(path - np.median(path, axis=0), axis=1)))


def _noise(values: Float[np.ndarray, "n 3"]) -> float:
    """Standard deviation of white noise, at most, by second differences.

    Their variance is six times its own.
    """
    return float(np.median(np.linalg.norm(np.diff(values, n=2, axis=0), axis=1)) / np.sqrt(18.0) / 0.9)
