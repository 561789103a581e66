"""Limit cycle of one axis within a dead band: thrusters fire at its edges, and a constant push bends the path in between."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

LEAD = 20.0
"""Simulated before time zero, s: further back the cycle is as it was then."""
SHORTEST = 1e-6
"""Of an arc, s: an edge that it begins at is not where it ends."""
SPREAD = 0.2
"""Of the velocity behind a pulse, relative."""
MOST_ARCS = 4000
"""Drawn; behind them the cycle repeats from the first arc that begins at the same edge. Of an inspector that is some hours."""


def limit_cycle(
    band: float, pulse: float, push: float, generator: np.random.Generator
) -> Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " n"]]:
    """Coordinate over time, s.

    Between pulses x'' is constant; at an edge of the band a pulse turns the velocity inwards.

    Parameters
    ----------
    band : float
        Either way, m or rad.
    pulse : float
        Mean velocity behind a pulse, per s.
    push : float
        Largest constant acceleration, per s^2; drawn, of either sign.
    """
    acceleration = float(generator.uniform(-push, push))
    start, place = [-LEAD], [float(generator.uniform(-band, band))]
    velocity = [pulse * float(generator.choice([-1.0, 1.0]))]
    strength = np.random.default_rng(int(generator.integers(2**32)))

    def extended(until: float) -> None:
        """Arcs up to a time, or as many as are drawn and one at whose edge an earlier one begins."""
        while start[-1] < until and (len(start) <= MOST_ARCS or place[-1] not in place[1:-1]):
            duration, edge = _leaves(place[-1], velocity[-1], acceleration, band)
            start.append(start[-1] + duration)
            place.append(edge)
            velocity.append(-np.sign(edge) * pulse * (1 + SPREAD * float(strength.uniform(-1, 1))))

    def repeated(time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Times, those behind the last arc in the cycle that repeats."""
        if np.max(time) <= start[-1]:
            return time
        begin, end = start[place.index(place[-1], 1)], start[-1]
        return np.where(time > end, begin + (time - begin) % (end - begin), time)

    def at(time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Coordinates."""
        extended(float(np.max(time)))
        time = repeated(time)
        arc = np.clip(np.searchsorted(start, time, side="right") - 1, 0, None)
        since = time - np.array(start)[arc]
        return np.array(place)[arc] + np.array(velocity)[arc] * since + acceleration * since**2 / 2

    return at


def _leaves(x: float, v: float, a: float, band: float) -> tuple[float, float]:
    """Time until a parabola leaves the band, and the edge where it does."""
    found = []
    for edge in (-band, band):
        roots = np.roots([a / 2, v, x - edge]) if a else np.array([(edge - x) / v])
        found += [(float(np.real(t)), edge) for t in roots if np.isreal(t) and np.real(t) > SHORTEST]
    return min(found)
