"""Sampling of a posterior: an ensemble Markov chain, and importance weights with their diagnosis.

The chain is an ensemble of walkers that stretch towards one another (Goodman, Weare 2010).

Importance weights: a density q proposes samples of a target p known up to a factor; log w = log p - log q. The largest weights are
replaced by quantiles of a generalised Pareto distribution that is fitted to them (Vehtari, Simpson, Gelman, Yao, Gabry 2024,
"Pareto smoothed importance sampling"). Its shape k says how far q is from p: with k < 0.5 the weights have a finite variance, up to
0.7 averages are of use, above they are not. The fit is the empirical Bayes estimate of Zhang and Stephens (2009).
"""

from collections.abc import Callable
from dataclasses import dataclass
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


LARGEST_SHAPE = 0.7
"""Pareto k above which weighted averages cannot be relied upon (Vehtari et al. 2024, Sec. 3.2)."""
FEWEST_IN_TAIL = 5
PRIOR_SAMPLES, PRIOR_SHAPE = 10, 0.5
"""Weight, in samples, and mean of the weak prior of k (Vehtari et al. 2024, Appendix C)."""


@dataclass(frozen=True)
class ImportanceWeights:
    """Normalised importance weights.

    Attributes
    ----------
    weights : ndarray of float, shape (n,)
        Their sum is one.
    shape : float
        Pareto k of their tail; infinite where there are too few samples or no finite weight.
    """

    weights: Float[np.ndarray, " n"]
    shape: float

    @property
    def effective(self) -> float:
        """Effective number of samples, 1 / sum of squares."""
        return float(1.0 / np.square(self.weights).sum())


def smoothed_weights(log_ratios: Float[np.ndarray, " n"]) -> ImportanceWeights:
    """Pareto-smoothed weights of samples.

    Parameters
    ----------
    log_ratios : ndarray of float, shape (n,)
        log p - log q up to a constant; minus infinity or NaN where the target has no density.
    """
    n = len(log_ratios)
    logs = np.where(np.isfinite(log_ratios), log_ratios, -np.inf)
    if not np.isfinite(logs).any():
        return ImportanceWeights(np.full(n, 1.0 / n), np.inf)
    weights = np.exp(logs - logs.max())
    tail = int(np.ceil(min(0.2 * n, 3 * np.sqrt(n))))
    shape = np.inf
    order = np.argsort(weights)
    if tail >= FEWEST_IN_TAIL and tail < n:
        largest, cutoff = order[-tail:], weights[order[-tail - 1]]
        excess = weights[largest] - cutoff
        if excess[-1] > 0:
            scale, shape = generalised_pareto(np.maximum(excess, np.finfo(float).tiny))
            p = (np.arange(tail) + 0.5) / tail
            spread = -np.log1p(-p) if abs(shape) < 1e-9 else np.expm1(-shape * np.log1p(-p)) / shape
            weights[largest] = np.minimum(cutoff + scale * spread, weights[largest].max())
        else:
            shape = 0.0  # equal weights have no tail
    return ImportanceWeights(weights / weights.sum(), float(shape))


def generalised_pareto(excess: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """Scale and shape k of the generalised Pareto distribution of positive, ascending numbers (Zhang, Stephens 2009)."""
    n = len(excess)
    quartile, largest = excess[int(np.floor(n / 4 + 0.5)) - 1], excess[-1]
    count = 30 + int(np.sqrt(n))
    theta = 1 / largest + (1 - np.sqrt(count / (np.arange(count) + 0.5))) / (
        3 * max(quartile, largest * 1e-12)
    )
    shapes = np.log1p(-theta[:, None] * excess).mean(axis=1)
    likelihood = n * (np.log(-theta / shapes) - shapes - 1)
    weight = np.exp(likelihood - np.logaddexp.reduce(likelihood))
    mean = float(theta @ weight)
    shape = float(np.log1p(-mean * excess).mean())
    scale = -shape / mean
    return scale, (n * shape + PRIOR_SAMPLES * PRIOR_SHAPE) / (n + PRIOR_SAMPLES)
