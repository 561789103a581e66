"""Markov chain Monte Carlo by an ensemble of walkers that stretch towards one another (Goodman, Weare 2010)."""

from collections.abc import Callable
from typing import Final, Generic, NamedTuple, TypeVar

import numpy as np
from jaxtyping import Float

STRETCH: Final = 2.0
"""Largest factor a by which a walker's distance to another one is stretched; factors z have the density 1 / sqrt(z) on [1/a, a]."""
Carried = TypeVar("Carried")
Evaluate = Callable[[np.ndarray], tuple[float, Carried]]
"""Log density of a point up to a constant, minus infinity where it has none, and what is to be kept with the point."""


class Ensemble(NamedTuple, Generic[Carried]):
    """Walkers after a step.

    Attributes
    ----------
    points : ndarray of float, shape (w, d)
        Where they are.
    log_density : ndarray of float, shape (w,)
        There.
    carried : tuple
        What the evaluation of each point gave besides.
    accepted : float
        Share of the moves of the step that were taken.
    """

    points: Float[np.ndarray, "w d"]
    log_density: Float[np.ndarray, " w"]
    carried: tuple[Carried, ...]
    accepted: float = 1.0


def stretch_step(
    ensemble: Ensemble[Carried], evaluate: Evaluate[Carried], generator: np.random.Generator
) -> Ensemble[Carried]:
    """Every walker moved once, the halves of the ensemble in turn, each along lines to walkers of the other half.

    A move y = x' + z (x - x') is taken with the probability min(1, z^(d - 1) p(y) / p(x)), which leaves p unchanged and is the same
    for every affine image of p.

    Parameters
    ----------
    ensemble : Ensemble
        An even number of walkers, more than dimensions, not in a plane.
    evaluate : Evaluate
        Of the density p.
    generator : numpy.random.Generator
        Of everything random.
    """
    points, log_density = ensemble.points.copy(), ensemble.log_density.copy()
    carried, taken = list(ensemble.carried), 0
    count, dimension = points.shape
    halves = np.arange(count // 2), np.arange(count // 2, count)
    for own, other in (halves, halves[::-1]):
        for walker in own:
            towards = points[generator.choice(other)]
            z = (1 + (STRETCH - 1) * generator.random()) ** 2 / STRETCH
            there = towards + z * (points[walker] - towards)
            density, kept = evaluate(there)
            odds = (dimension - 1) * np.log(z) + density - log_density[walker]
            if np.log(generator.random()) < odds:
                points[walker], log_density[walker], carried[walker] = there, density, kept
                taken += 1
    return Ensemble(points, log_density, tuple(carried), taken / count)
