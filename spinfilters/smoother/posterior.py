"""Reference posterior of a problem: a mixture of Gaussians that need not be Gaussian together.

The state is the motion x and its constants, of which the mass distribution s alone makes the problem far from linear. The marginal
posterior of s, with the motion and any landmarks integrated out about their optimum (`spinfilters.smoother.mass_posterior`), is
sampled by importance; where the Pareto shape of the weights is above `spinfilters.core.posterior_sampling.LARGEST_SHAPE`, an
ensemble of walkers continues from the resampled points (`spinfilters.core.posterior_sampling`). Every sample of s comes with the
Gaussian of the motion given s, so that

    p(x, s | y) = sum over samples i of w_i N(x; x^(s_i), P(s_i)).

What is published of the posterior are mixtures of these Gaussians, never their draws. Noise levels are those of the problem.

A sample costs a solution of the motion. The logarithm of the density is smooth in the errors d of the mass distribution, so that a
Gaussian process through some hundred samples of it, the surrogate, is right to a few per cent. Quantiles of these samples alone are
off by several per cent of an interval's width, those of ten thousand draws of the surrogate by one.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.core.posterior_sampling import LARGEST_SHAPE, Ensemble, ImportanceWeights, stretch_step
from spinfilters.filters.square_root import lower_roots
from spinfilters.models.body import MassSamples
from spinfilters.models.state_blocks import MASS_DISTRIBUTION
from spinfilters.models.state_layout import StateLayout
from spinfilters.models.state_mixture import StateMixture
from spinfilters.smoother.linear_system import Marginals, latest_factor
from spinfilters.smoother.mass_posterior import (
    NO_POINTS,
    TRIED,
    MassNode,
    MassPosterior,
    MassSampler,
    even_steps,
    log_volumes,
)
from spinfilters.smoother.problem import Problem

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


DRAWS = 12_000
"""Of the surrogate, for quantities of the body."""
COVARIANCES = 24
"""Samples over which the covariance of the motion given the mass distribution is averaged."""


@dataclass(frozen=True)
class SamplingOptions:
    """How a posterior is sampled.

    Attributes
    ----------
    samples : int
        Of the mass distribution, by importance.
    largest_shape : float
        Pareto shape of their weights from which an ensemble of walkers follows.
    walkers, steps, settling : int
        Of the ensemble; of its steps the first ones are left out.
    seed : int
        Of everything random.
    """

    samples: int = 800
    largest_shape: float = LARGEST_SHAPE
    walkers: int = 40
    steps: int = 60
    settling: int = 20
    seed: int = 0


@dataclass(frozen=True)
class Posterior:
    """Moments of every epoch's posterior, and the mixture of the last one.

    Attributes
    ----------
    mean : ndarray of float, shape (k, m)
        Means.
    factor : ndarray of float, shape (k, n, n)
        Square roots of the covariances.
    last : StateMixture
        Of the last epoch.
    mass : MassSamples
        Of the mass distribution.
    """

    mean: Float[np.ndarray, "k m"]
    factor: Float[np.ndarray, "k n n"]
    last: StateMixture
    mass: MassSamples


def sample_posterior(
    problem: Problem,
    trajectory: Float[np.ndarray, "k m"],
    options: SamplingOptions = SamplingOptions(),
    points: Float[np.ndarray, "L 3"] = NO_POINTS,
    used: Bool[np.ndarray, " N"] | None = None,
) -> Posterior | None:
    """The posterior of a problem.

    Parameters
    ----------
    problem : Problem
        With a prior of its first state and block s in its layout, at the noise levels that are taken as known.
    trajectory : ndarray of float, shape (k, m)
        Its solution, where the walk along the ridge of likely mass distributions begins.
    options : SamplingOptions
        How it is sampled.
    points : ndarray of float, shape (L, 3)
        Landmarks of the solution, m, frame g.
    used : ndarray of bool, shape (N,), or None
        Observations of landmarks that the solution uses; None without landmarks.

    Returns
    -------
    Posterior or None
        None where a linear problem along the ridge has no solution.
    """
    sampler = MassSampler(problem, points, used)
    nodes = sampler.ridge(trajectory)
    found = sampler.sample(nodes, options.samples, options.seed)
    if found is None:
        return None
    is_sampled = found.weights.shape < options.largest_shape
    if not is_sampled:
        found = _walk_ensemble(sampler, nodes, found, options)
    weights = found.weights.weights
    mean, factor = _moments(sampler, found, weights)
    last = StateMixture(
        problem.layout,
        found.trajectories[:, -1],
        found.last_factors,
        weights,
        found.weights.shape,
        "importance" if is_sampled else "mcmc",
    )
    if is_sampled:
        points, weights_of_points = SurrogatePosterior.through(sampler, nodes, found).draws(
            DRAWS, options.seed
        )
        last = replace(last, mass_points=points, mass_weights=weights_of_points)
    shape = sampler.gaussian_shape(nodes[0], TRIED, options.seed + 1)
    nees = sampler.gaussian_nees(nodes[0], found.points, weights)
    return Posterior(mean, factor, last, MassSamples(found.points, weights, shape, nees))


def _walk_ensemble(
    sampler: MassSampler, nodes: list[MassNode], found: MassPosterior, options: SamplingOptions
) -> MassPosterior:
    """Samples of an ensemble of walkers from resampled points, in errors about the first node."""
    layout, s = sampler.layout, sampler.layout.slice(MASS_DISTRIBUTION.name)
    at, origin = layout.mean_slice(MASS_DISTRIBUTION.name), nodes[0].trajectory[0]
    generator = np.random.default_rng(options.seed)

    places = sampler.errors(found.points, origin)  # d about the first node
    spread = np.linalg.inv(np.cov(places.T, aweights=found.weights.weights))

    def evaluate(d: Float[np.ndarray, " 5"]) -> tuple[float, tuple[np.ndarray, np.ndarray] | None]:
        """Density of d, and the motion there, begun at the nearest sample's."""
        away = places - d
        near = found.trajectories[int(np.einsum("ni,ij,nj->n", away, spread, away).argmin())]
        step = np.zeros(layout.error_dim)
        step[s] = d
        begin = near.copy()
        begin[:, at] = layout.retract(origin, step)[at]
        there = sampler.conditional(begin, iterations=3)
        if there is None:
            return -np.inf, None
        density = there.log_density + float(log_volumes(d))
        return density, (there.trajectory, latest_factor(there.solution))

    chosen = generator.choice(len(places), options.walkers, p=found.weights.weights)
    first = places[chosen] + 1e-3 * generator.standard_normal((options.walkers, 5)) * places.std(axis=0)
    begun = [evaluate(d) for d in first]
    ensemble = Ensemble(first, np.array([density for density, _ in begun]), tuple(kept for _, kept in begun))
    kept: list[tuple[np.ndarray, np.ndarray]] = []
    for step in range(options.steps):
        ensemble = stretch_step(ensemble, evaluate, generator)
        if step >= options.settling:
            kept += [each for each in ensemble.carried if each is not None]
    trajectories = np.array([trajectory for trajectory, _ in kept])
    factors = np.array([factor for _, factor in kept])
    count = len(kept)
    weights = ImportanceWeights(np.full(count, 1 / count), found.weights.shape)
    nothing = np.zeros(count)
    return MassPosterior(trajectories, factors, trajectories[:, 0, at], nothing, nothing, weights)


def _moments(
    sampler: MassSampler, found: MassPosterior, weights: Float[np.ndarray, " i"]
) -> tuple[Float[np.ndarray, "k m"], Float[np.ndarray, "k n n"]]:
    """Mean and covariance factor of every epoch: P = E P(s) + cov x^(s)."""
    layout = sampler.layout
    mean = found.trajectories[int(weights.argmax())]
    for _ in range(3):  # the mean on a manifold
        mean = layout.retract(
            mean, np.einsum("i,ikn->kn", weights, _errors_about(layout, mean, found.trajectories))
        )
    away = _errors_about(layout, mean, found.trajectories) * np.sqrt(weights)[:, np.newaxis, np.newaxis]
    rows = [np.moveaxis(away, 0, 2)]
    picked = np.searchsorted(np.cumsum(weights), (np.arange(COVARIANCES) + 0.5) / COVARIANCES)
    for number in np.minimum(picked, len(weights) - 1):
        there = sampler.conditional(found.trajectories[number], iterations=sampler.follow_ups)
        if there is not None:
            rows.append(Marginals(there.solution, None).factors / np.sqrt(COVARIANCES))
    return mean, lower_roots(np.concatenate(rows, axis=2))


def _errors_about(
    layout: StateLayout, mean: Float[np.ndarray, "k m"], trajectories: Float[np.ndarray, "i k m"]
) -> Float[np.ndarray, "i k e"]:
    return np.array([layout.local(mean, each) for each in trajectories])
