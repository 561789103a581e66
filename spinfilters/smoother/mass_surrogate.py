"""A surrogate of the marginal posterior of the mass distribution: as many draws as wanted, without solving a motion for each.

Laplace's density (`spinfilters.smoother.mass_posterior`) costs a solution of the motion. Its logarithm is smooth in the errors d of
the mass distribution, so that a Gaussian process through some hundred samples of it is right to a few per cent. Quantiles of these
samples alone are off by several per cent of an interval's width, those of ten thousand draws of the surrogate by one.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.models.state_blocks import MASS_DISTRIBUTION
from spinfilters.smoother.mass_posterior import (
    MassNode,
    MassPosterior,
    MassSampler,
    even_steps,
    log_volumes,
)

DEEPEST: Final = 25.0
"""Fall of the log density from its largest, below which a sample is left out."""
LENGTHS: Final = (1.5, 2.0, 3.0, 4.5, 7.0)
"""Of the Gaussian process, in deviations of the posterior; the likeliest is taken."""
NUGGETS: Final = (1e-6, 1e-4, 1e-2)
"""Variance of what the process leaves, over its own."""
BLOCK: Final = 20_000
"""Draws whose surrogate is evaluated together."""


@dataclass(frozen=True)
class Surrogate:
    """A Gaussian process through the log density of errors d of the mass distribution about one, a parabola its mean.

    Attributes
    ----------
    centre, root : ndarray of float, shapes (5,) and (5, 5)
        Mean and square root of the covariance of the posterior: z = root^-1 (d - centre).
    parabola : ndarray of float, shape (21,)
        Coefficients of 1, z and products of z.
    at : ndarray of float, shape (n, 5)
        Pilot samples z.
    solved : ndarray of float, shape (n,)
        K^-1 (log density - parabola).
    length : float
        Of the process.
    """

    centre: Float[np.ndarray, " 5"]
    root: Float[np.ndarray, "5 5"]
    parabola: Float[np.ndarray, " 21"]
    at: Float[np.ndarray, "n 5"]
    solved: Float[np.ndarray, " n"]
    length: float

    @classmethod
    def through(
        cls, d: Float[np.ndarray, "n 5"], logs: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"]
    ) -> "Surrogate":
        """The likeliest process through log densities at errors d, whose posterior weights are given."""
        centre = weights @ d
        root = np.linalg.cholesky(np.cov(d.T, aweights=weights))
        kept = logs > logs.max() - DEEPEST
        z, y = np.linalg.solve(root, (d[kept] - centre).T).T, logs[kept]
        root_weight = np.exp(0.125 * (y - y.max()))
        parabola = np.linalg.lstsq(_parabola(z) * root_weight[:, np.newaxis], y * root_weight)[0]
        left, best = y - _parabola(z) @ parabola, (np.inf, z, 1.0)
        for length in LENGTHS:
            kernel = _kernel(z, z, length)
            for nugget in NUGGETS:
                factor = np.linalg.cholesky(kernel + nugget * np.eye(len(z)))
                white = np.linalg.solve(factor, left)
                # -2 ln likelihood, the variance of the process at its likeliest
                cost = len(z) * np.log(white @ white) + 2 * np.log(np.diag(factor)).sum()
                if cost < best[0]:
                    best = float(cost), np.linalg.solve(factor.T, white), length
        return cls(centre, root, parabola, z, best[1], best[2])

    def __call__(self, d: Float[np.ndarray, "n 5"]) -> Float[np.ndarray, " n"]:
        """Log density at errors d."""
        z = np.linalg.solve(self.root, (d - self.centre).T).T
        blocks = (z[k : k + BLOCK] for k in range(0, len(z), BLOCK))
        return np.concatenate(
            [
                _parabola(each) @ self.parabola + _kernel(each, self.at, self.length) @ self.solved
                for each in blocks
            ]
        )


def _parabola(z: Float[np.ndarray, "n 5"]) -> Float[np.ndarray, "n 21"]:
    rows, columns = np.triu_indices(z.shape[1])
    return np.column_stack([np.ones(len(z)), z, z[:, rows] * z[:, columns]])


def _kernel(
    a: Float[np.ndarray, "n 5"], b: Float[np.ndarray, "m 5"], length: float
) -> Float[np.ndarray, "n m"]:
    square = np.square(a).sum(axis=1)[:, np.newaxis] + np.square(b).sum(axis=1) - 2 * a @ b.T
    return np.exp(-0.5 * np.maximum(square, 0.0) / length**2)


class MassFrame:
    """Mass distributions as errors d about that of one trajectory."""

    def __init__(self, sampler: MassSampler, nodes: list[MassNode]) -> None:
        self.sampler, self.nodes, layout = sampler, nodes, sampler.layout
        self.s, self.at = layout.slice(MASS_DISTRIBUTION.name), layout.mean_slice(MASS_DISTRIBUTION.name)
        self.origin = nodes[0].trajectory[0]
        self.roots = [sampler.root(node) for node in nodes]

    def errors(
        self, points: Float[np.ndarray, "n 5"], about: Float[np.ndarray, " m"]
    ) -> Float[np.ndarray, "n 5"]:
        """Errors of mass distributions about that of a state."""
        return self.sampler.errors(points, about)

    def points(self, d: Float[np.ndarray, "n 5"], about: Float[np.ndarray, " m"]) -> Float[np.ndarray, "n 5"]:
        """Mass distributions with these errors about that of a state."""
        step = np.zeros((len(d), self.sampler.layout.error_dim))
        step[:, self.s] = d
        return self.sampler.layout.retract(np.tile(about, (len(d), 1)), step)[:, self.at]

    def drawn(self, count: int, share: Float[np.ndarray, " c"], seed: int) -> Float[np.ndarray, "n 5"]:
        """Mass distributions from the mixture of t distributions at the nodes, evenly spread."""
        chosen, steps = even_steps(count, share, seed)
        found = np.empty((count, 5))
        for k, node in enumerate(self.nodes):
            own = chosen == k
            if own.any():
                found[own] = self.points(steps[own] @ self.roots[k].T, node.trajectory[0])
        return found

    def begun(self, points: Float[np.ndarray, " 5"]) -> Float[np.ndarray, "k m"]:
        """The motion that the nearest node's regression gives a mass distribution."""
        away = [self.errors(points[np.newaxis], node.trajectory[0])[0] for node in self.nodes]
        far = [
            float(np.linalg.norm(np.linalg.solve(root, d))) for root, d in zip(self.roots, away, strict=True)
        ]
        nearest = int(np.argmin(far))
        return self.sampler.moved(self.nodes[nearest], away[nearest])


@dataclass(frozen=True)
class SurrogatePosterior:
    """The surrogate with the frame of its errors and the mixture that proposes draws.

    Attributes
    ----------
    frame : MassFrame
        Of the errors d.
    share : ndarray of float, shape (c,)
        Of the nodes in the mixture.
    density : Surrogate
        Of d.
    """

    frame: MassFrame
    share: Float[np.ndarray, " c"]
    density: Surrogate

    @classmethod
    def through(
        cls, sampler: MassSampler, nodes: list[MassNode], found: MassPosterior
    ) -> "SurrogatePosterior":
        """Through importance samples of the mass distribution."""
        frame = MassFrame(sampler, nodes)
        d = frame.errors(found.points, frame.origin)
        density = Surrogate.through(d, found.log_density + log_volumes(d), found.weights.weights)
        return cls(frame, sampler.shares(nodes), density)

    def log_density(self, points: Float[np.ndarray, "n 5"]) -> Float[np.ndarray, " n"]:
        """Logarithm of the density of d at mass distributions."""
        return self.density(self.frame.errors(points, self.frame.origin))

    def draws(self, count: int, seed: int) -> tuple[Float[np.ndarray, "n 5"], Float[np.ndarray, " n"]]:
        """Mass distributions, evenly spread over the mixture, and their weights."""
        points = self.frame.drawn(count, self.share, seed)
        # densities of d: the mixture's refers to the invariant volume
        volume = log_volumes(self.frame.errors(points, self.frame.origin))
        proposal = self.frame.sampler.log_proposal(points, self.frame.nodes, self.share)
        log = self.log_density(points) - proposal - volume
        weights = np.exp(log - log.max())
        return points, weights / weights.sum()
