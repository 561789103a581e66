"""The marginal posterior of a mass distribution whose least-squares problem is far from Gaussian.

Where a motion hardly shows the moments, likely mass distributions lie along a curved ridge, and the joint optimum of mass and
trajectory lies where trajectories have the least freedom, not where most of the probability is. With the trajectory x integrated
out about its optimum x^(s) for each mass distribution s (Laplace; Tierney, Kadane 1986),

    log p(s | y) = -J(x^(s), s) / 2 - log det H_xx(s) / 2 - log v(s) + constant,

J the sum of squared residuals, those of the prior among them, and H_xx the information of the trajectory. Landmarks, if there are
any, are integrated out with it: x holds them too, and observations that the solution rejects stay out. This density of five
dimensions is sampled. Nodes are set along the ridge, by steps in its softest direction with Newton's step in the other four. A
mixture of t distributions at the nodes proposes samples. They are weighted by density over proposal, with a smoothed tail, whose
Pareto shape says whether the weights can be relied upon (`spinfilters.core.posterior_sampling`).

The density refers to errors of s about itself, the invariant volume of the chart. The prior is Gaussian in D = log S about its own
mean instead, so that its density is divided by v(s), the product of sinh(d) / d over the pairs of eigenvalues l_i of D,
d = (l_i - l_j) / 2. Without it needles and thin discs would be likely for want of data: the invariant volume counts their axes many
times over.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.posterior_sampling import ImportanceWeights, smoothed_weights
from spinfilters.core.robust_losses import Gate, LeastSquares
from spinfilters.models.body import MassSamples
from spinfilters.models.state_blocks import MASS_DISTRIBUTION
from spinfilters.models.state_layout import StateLayout
from spinfilters.smoother.batch_smoother import FAR, BatchSmoothing
from spinfilters.smoother.linear_system import Marginals, SchurSystem, latest_factor
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.smoother.problem import NormalEquations, Problem, Stage
from spinfilters.smoother.solver import ConstantSchedule, SolverOptions, solve

FIXED_STD = 1e-6
"""Standard deviation of a prior that fixes the mass distribution; its share of log det H is the same for all."""
STEP, SMALLEST_STEP = 0.7, 0.02
"""Step along the ridge, in standard deviations of its softest direction; the least one, in the logarithm of second moments."""
LONGEST_STEP = 0.35
"""Of a step, in the log of second moments: local curvatures say little beyond it."""
MOST_NODES = 24
"""In each direction along the ridge."""
FALLEN = 11.0
"""Fall of the log probability per step along the ridge at which a walk ends: beyond four deviations of a Gaussian."""
EVEN_SHARE = 0.5
"""Of the samples, spread evenly over the nodes: tails to four deviations are stated, and need as many samples as the middle."""
PROPOSAL_DOF, PROPOSAL_WIDTH = 6.0, 1.25
"""Degrees of freedom of the t distributions, and their width over the local one."""
SMALLEST_GAP = 1e-6
"""Half a difference of eigenvalues below which sinh(d) / d is 1 to rounding."""
SOFT = 0.02
"""Standard deviation of the logarithm of second moments, beyond which states may bend by more than noise moves them."""
SAMPLES, TRIED = 256, 80
"""Samples of the mixture, and of the Gaussian belief whose Pareto shape is asked for."""
WIDE = 0.1
"""Standard deviation of the logarithm of second moments beyond which a direction counts as hardly determined."""
MOST_EPOCHS = 600
"""Of a recording whose posterior is sampled: a sample solves all of them."""
SMALLEST_UNIFORM = 1e-9
"""Of points of the unit cube, which have no sample at its faces."""
NO_POINTS = np.zeros((0, 3))


@dataclass(frozen=True)
class MassNode:
    """A mass distribution on the ridge, with its most probable trajectory.

    Attributes
    ----------
    trajectory : ndarray of float, shape (k, m)
        Most probable states given the mass distribution, which is that of every epoch.
    points : ndarray of float, shape (L, 3)
        Most probable landmarks, m, frame g.
    log_density : float
        log p(s | y) up to the constant.
    step : ndarray of float, shape (5,)
        Newton's step of the profile -J / 2 from here.
    covariance : ndarray of float, shape (5, 5)
        Inverse curvature of the profile.
    factors : ndarray of float, shape (k, n, n)
        Covariance factors of every epoch, with the mass distribution free.
    """

    trajectory: Float[np.ndarray, "k m"]
    points: Float[np.ndarray, "L 3"]
    log_density: float
    step: Float[np.ndarray, " 5"]
    covariance: Float[np.ndarray, "5 5"]
    factors: Float[np.ndarray, "k n n"]

    @cached_property
    def softest(self) -> tuple[float, Float[np.ndarray, " 5"]]:
        """Standard deviation along the softest direction, and that direction."""
        values, vectors = np.linalg.eigh(self.covariance)
        return float(np.sqrt(values[-1])), vectors[:, -1]


@dataclass(frozen=True)
class ConditionalMotion:
    """The motion given a mass distribution, a Gaussian about its most probable trajectory.

    Attributes
    ----------
    trajectory : ndarray of float, shape (k, m)
        Most probable states.
    points : ndarray of float, shape (L, 3)
        Most probable landmarks, m, frame g.
    log_density : float
        log p(s | y) of the mass distribution, up to the constant.
    solution : SchurSystem
        Linear problem there.
    """

    trajectory: Float[np.ndarray, "k m"]
    points: Float[np.ndarray, "L 3"]
    log_density: float
    solution: SchurSystem


@dataclass(frozen=True)
class MassPosterior:
    """Weighted samples of the mass distribution, each with its motion.

    Attributes
    ----------
    trajectories : ndarray of float, shape (n, k, m)
        Most probable states given each sample.
    last_factors : ndarray of float, shape (n, e, e)
        Covariance factors of the last epoch given each sample.
    points : ndarray of float, shape (n, 5)
        Samples s.
    log_density : ndarray of float, shape (n,)
        log p(s | y) of each sample, up to a constant.
    log_ratios : ndarray of float, shape (n,)
        Log density of each sample over that of its proposal, up to a constant; zero of samples that are drawn from the density.
    weights : ImportanceWeights
        Of the samples.
    """

    trajectories: Float[np.ndarray, "n k m"]
    last_factors: Float[np.ndarray, "n e e"]
    points: Float[np.ndarray, "n 5"]
    log_density: Float[np.ndarray, " n"]
    log_ratios: Float[np.ndarray, " n"]
    weights: ImportanceWeights


@dataclass(frozen=True)
class SampledMass:
    """Samples of a mass distribution, and what they say of the smoother's motion.

    Attributes
    ----------
    mass : MassSamples
        Weighted samples; the Pareto shape of their weights says whether they can be relied upon.
    widening : ndarray of float, shape (k, n)
        Root mean square of the errors of every epoch over the samples, about the smoother's states and in its deviations, where
        that is above 1; 1 for the mass distribution itself.
    """

    mass: MassSamples
    widening: Float[np.ndarray, "k n"]


class MassSampler:
    """Walks and samples the mass posterior of a problem.

    Parameters
    ----------
    problem : Problem
        At the noise levels that it is to be judged by.
    points : ndarray of float, shape (L, 3)
        Landmarks of its solution, m, frame g.
    used : ndarray of bool, shape (N,), or None
        Observations of landmarks that count.
    """

    def __init__(
        self,
        problem: Problem,
        points: Float[np.ndarray, "L 3"] = NO_POINTS,
        used: Bool[np.ndarray, " N"] | None = None,
    ) -> None:
        self.problem, self.layout, self._points, self._used = problem, problem.layout, points, used
        self._loss = LeastSquares() if used is None else Gate(FAR, FAR, used)
        self._s, self._at = (
            self.layout.slice(MASS_DISTRIBUTION.name),
            self.layout.mean_slice(MASS_DISTRIBUTION.name),
        )
        prior = problem.motion.prior
        assert prior is not None
        self._prior = prior
        self._prior_std = np.linalg.norm(prior.factor, axis=1)

    @property
    def follow_ups(self) -> int:
        """Iterations that take landmarks to a motion that has its own place already."""
        return min(len(self._points), 1)

    def node(
        self, trajectory: Float[np.ndarray, "k m"], points: Float[np.ndarray, "L 3"] | None = None
    ) -> MassNode | None:
        """The node at a trajectory's mass distribution; None where a linear problem has no solution."""
        found = self.conditional(trajectory, 4, points)
        if found is None:
            return None
        x, points, log_density = found.trajectory, found.points, found.log_density
        here = self.problem.at(x, points)
        normal = self.problem.normal(here, Stage(self._loss))
        solution = normal.solution
        if solution is None:
            return None
        factors = Marginals(solution, normal.eliminated).factors
        rows = factors[0, self._s]
        return MassNode(x, points, log_density, solution.errors[0, self._s], rows @ rows.T, factors)

    def ridge(self, trajectory: Float[np.ndarray, "k m"]) -> list[MassNode]:
        """Nodes along the softest direction through a trajectory's mass distribution, both ways."""
        first = self.node(trajectory)
        if first is None:
            return []
        nodes = [first]
        for sign in (1.0, -1.0):
            nodes += self._walk(first, sign * first.softest[1])
        return nodes

    def sample(self, nodes: list[MassNode], count: int, seed: int) -> MassPosterior | None:
        """Weighted samples from a mixture at the nodes, evenly spread over it; None without any node."""
        if not nodes:
            return None
        roots = [self.root(node) for node in nodes]
        share = self.shares(nodes)
        trajectories, factors, density = [], [], []
        for k, step in zip(*even_steps(count, share, seed), strict=True):
            found = self.conditional(self.moved(nodes[k], roots[k] @ step), 1, nodes[k].points)
            if found is not None:
                trajectories.append(found.trajectory)
                factors.append(latest_factor(found.solution))
                density.append(found.log_density)
        if not trajectories:
            return None
        every = np.array(trajectories)
        points = every[:, 0, self._at]
        logs = np.array(density)
        ratios = logs - self.log_proposal(points, nodes, share)
        return MassPosterior(every, np.array(factors), points, logs, ratios, smoothed_weights(ratios))

    def shares(self, nodes: list[MassNode]) -> Float[np.ndarray, " c"]:
        """Shares of the nodes in the mixture that proposes samples."""
        return shares_of_nodes(np.array([self._log_mass(node) for node in nodes]))

    def bends(self, trajectory: Float[np.ndarray, "k m"]) -> Float[np.ndarray, "q n"]:
        """Second-order terms of the last state along the soft directions of the mass distribution.

        Let u be the distance from a trajectory's mass distribution along a principal direction of its covariance, in standard
        deviations, and x(u) the most probable last state there, with Newton's step in the other four directions. Then

            x(u) = x(0) [+] (b u + c u^2 / 2),    c = (x(1) [-] x(0)) + (x(-1) [-] x(0)).

        The covariance of a Gaussian about x(0) has b only. Over u ~ N(0, 1) the bend c adds E[u^4] / 4 c c' = 3/4 c c' to the mean
        square about x(0).

        Parameters
        ----------
        trajectory : ndarray of float, shape (k, m)
            Most probable states.

        Returns
        -------
        ndarray of float, shape (q, n)
            c of each direction whose standard deviation is beyond `SOFT`; none where a linear problem has no solution.
        """
        first = self.node(trajectory)
        if first is None:
            return np.zeros((0, self.layout.error_dim))
        values, vectors = np.linalg.eigh(first.covariance)
        widths, found = np.sqrt(values), []
        for k in np.flatnonzero(widths > SOFT):
            length = min(float(widths[k]), LONGEST_STEP)
            ends = [self._next(first, sign * vectors[:, k], length) for sign in (1.0, -1.0)]
            away = [self.layout.local(first.trajectory[-1], end.trajectory[-1]) for end in ends if end]
            if len(away) == 2:
                found.append((away[0] + away[1]) * (widths[k] / length) ** 2)
        return np.array(found).reshape(-1, self.layout.error_dim)

    def gaussian_nees(
        self, node: MassNode, points: Float[np.ndarray, "n 5"], weights: Float[np.ndarray, " n"]
    ) -> float:
        """Mean NEES per degree of freedom of samples in the Gaussian about a node."""
        origin = np.tile(node.trajectory[0], (len(points), 1))
        moved = origin.copy()
        moved[:, self._at] = points
        error = self.layout.local(origin, moved)[:, self._s]
        squares = np.einsum("ni,ni->n", error, np.linalg.solve(node.covariance, error.T).T)
        return float(weights @ squares) / error.shape[1]

    def gaussian_shape(self, node: MassNode, count: int, seed: int) -> float:
        """Pareto shape of the Gaussian about a node as a proposal: above 0.7 the posterior is not Gaussian."""
        generator, root, logs = np.random.default_rng(seed), np.linalg.cholesky(node.covariance), []
        for _ in range(count):
            z = generator.standard_normal(5)
            d = root @ z
            found = self.conditional(self.moved(node, d), 1, node.points)
            log_proposal = -0.5 * float(z @ z) - float(log_volumes(d))
            logs.append(-np.inf if found is None else found.log_density - log_proposal)
        return smoothed_weights(np.array(logs)).shape

    def _walk(self, first: MassNode, direction: Float[np.ndarray, " 5"]) -> list[MassNode]:
        nodes: list[MassNode] = []
        here, best = first, self._log_mass(first)
        while len(nodes) < MOST_NODES:
            std = here.softest[0]
            length = min(max(STEP * std, SMALLEST_STEP), LONGEST_STEP)
            there = self._next(here, direction, length)
            if there is None or not np.isfinite(there.log_density):
                break
            nodes.append(there)
            best = max(best, self._log_mass(there))
            if self._log_mass(there) < best - FALLEN:
                break
            turned = there.softest[1]
            direction = turned if turned @ direction > 0 else -turned
            here = there
        return nodes

    def _next(self, here: MassNode, direction: Float[np.ndarray, " 5"], length: float) -> MassNode | None:
        """The node on the ridge a step along a direction from another; None where a linear problem has no solution."""
        there = self.node(self.moved(here, length * direction), here.points)
        if there is None:
            return None
        for _ in range(2):  # Newton's step across the ridge
            across = self._step_across(there, direction)
            if np.linalg.norm(across) < 0.1 * length:
                break
            moved = self.node(self.moved(there, across), there.points)
            if moved is None:
                break
            there = moved
        return there

    def _step_across(self, node: MassNode, direction: Float[np.ndarray, " 5"]) -> Float[np.ndarray, " 5"]:
        """Newton's step without its part along a direction, capped."""
        along = node.covariance @ direction
        step = node.step - along * (direction @ node.step) / (direction @ along)
        return step * min(1.0, LONGEST_STEP / max(float(np.linalg.norm(step)), 1e-300))

    def root(self, node: MassNode) -> Float[np.ndarray, "5 5"]:
        """Root of the covariance of a node's proposal: one step long along the ridge, as wide as the profile across it."""
        length = min(max(STEP * node.softest[0], SMALLEST_STEP), LONGEST_STEP)
        values, vectors = np.linalg.eigh(node.covariance)
        widths = np.sqrt(values)
        widths[-1] = min(widths[-1], length)
        return PROPOSAL_WIDTH * vectors * widths

    def _log_mass(self, node: MassNode) -> float:
        """Log probability of a node's part of the ridge, up to a constant."""
        return node.log_density + float(np.linalg.slogdet(self.root(node))[1])

    def log_proposal(
        self, points: Float[np.ndarray, "n 5"], nodes: list[MassNode], share: Float[np.ndarray, " c"]
    ) -> Float[np.ndarray, " n"]:
        """Log density of the mixture of t distributions in the invariant volume, up to a constant.

        A distribution of errors d about its node has there its density of d over v(d).
        """
        parts = []
        for node, part in zip(nodes, share, strict=True):
            d, root = self.errors(points, node.trajectory[0]), self.root(node)
            square = np.square(np.linalg.solve(root, d.T)).sum(axis=0)
            tail = -(PROPOSAL_DOF + 5) / 2 * np.log1p(square / PROPOSAL_DOF)
            parts.append(np.log(part) - np.linalg.slogdet(root)[1] + tail - log_volumes(d))
        return np.logaddexp.reduce(parts, axis=0)

    def errors(
        self, points: Float[np.ndarray, "n 5"], about: Float[np.ndarray, " m"]
    ) -> Float[np.ndarray, "n 5"]:
        """Errors of mass distributions about that of a state."""
        origin = np.tile(about, (len(points), 1))
        moved = origin.copy()
        moved[:, self._at] = points
        return self.layout.local(origin, moved)[:, self._s]

    def moved(self, node: MassNode, d: Float[np.ndarray, " 5"]) -> Float[np.ndarray, "k m"]:
        """A node's trajectory with its mass distribution moved by d, everything else following by regression."""
        F = node.factors
        by_mass = F @ np.swapaxes(F[:, self._s], 1, 2) @ np.linalg.solve(node.covariance, d)
        by_mass[:, self._s] = d
        return self.layout.retract(node.trajectory, by_mass)

    def conditional(
        self,
        trajectory: Float[np.ndarray, "k m"],
        iterations: int,
        points: Float[np.ndarray, "L 3"] | None = None,
    ) -> ConditionalMotion | None:
        """The motion given a trajectory's mass distribution; None where a linear problem has no solution.

        Parameters
        ----------
        points : ndarray of float, shape (L, 3), or None
            Landmarks to begin from; None for those of the problem's solution.
        """
        mean, std = self._prior.mean.copy(), self._prior_std.copy()
        mean[self._at], std[self._s] = trajectory[0, self._at], FIXED_STD
        fixed = replace(self.problem, motion=replace(self.problem.motion, prior=FirstStatePrior(mean, std)))
        solved = solve(
            fixed,
            fixed.at(trajectory, self._points if points is None else points),
            SolverOptions(iterations=iterations, settled=1e-3),
            ConstantSchedule(self._loss),
        )
        solution = solved.normal.solution
        if solution is None:
            return None
        x = solved.point.trajectory.copy()
        x[:, self._at] = trajectory[0, self._at]
        away = self.layout.local(self._prior.mean, x[0])[self._s] / self._prior_std[self._s]
        least = solved.point.cost(self._used, Stage(self._loss)) - solved.normal.predicted_reduction
        log_density = -0.5 * (least + float(away @ away)) - 0.5 * log_determinant(solved.normal)
        outside = float(log_volumes(away * self._prior_std[self._s]))
        return ConditionalMotion(x, solved.point.points, log_density - outside, solution)


def shares_of_nodes(log_mass: Float[np.ndarray, " c"]) -> Float[np.ndarray, " c"]:
    """Shares of the nodes in the mixture that proposes samples: their probability, and `EVEN_SHARE` for all alike."""
    mass = np.exp(log_mass - log_mass.max())
    return (1 - EVEN_SHARE) * mass / mass.sum() + EVEN_SHARE / len(mass)


def even_steps(
    count: int, share: Float[np.ndarray, " c"], seed: int
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n 5"]]:
    """Node of each draw from a mixture of t distributions, and its step in units of that node's root, evenly spread."""
    from scipy.special import chdtri, ndtri  # here alone: few motions need samples

    uniform = even_points(count, 7, seed)
    chosen = np.minimum(np.searchsorted(np.cumsum(share), uniform[:, 0]), len(share) - 1)
    tails = np.sqrt(PROPOSAL_DOF / chdtri(PROPOSAL_DOF, 1 - uniform[:, 1]))
    return chosen, ndtri(uniform[:, 2:]) * tails[:, np.newaxis]


def even_points(count: int, dimension: int, seed: int) -> Float[np.ndarray, "n d"]:
    """Points of the open unit cube, more even than independent ones.

    Multiples of the powers of 1 / g, g^(d + 1) = g + 1, modulo one, with a random shift (Roberts 2018; Cranley, Patterson 1976).
    """
    ratio = 2.0
    for _ in range(40):  # a contraction: the last digits settle
        ratio = (1 + ratio) ** (1 / (dimension + 1))
    generators = ratio ** -np.arange(1.0, dimension + 1)
    shift = np.random.default_rng(seed).random(dimension)
    points = (shift + np.outer(np.arange(count), generators)) % 1.0
    return np.clip(points, SMALLEST_UNIFORM, 1 - SMALLEST_UNIFORM)


def log_volumes(d: Float[np.ndarray, "*n 5"]) -> Float[np.ndarray, "*n"]:
    """log v of errors d of mass distributions: logarithm of their volume over the invariant one."""
    return log_volume_ratio(traceless_part(d))


def log_volume_ratio(D: Float[np.ndarray, "*n 3 3"]) -> Float[np.ndarray, "*n"]:
    """log v: sum of log(sinh(d) / d) over the pairs of eigenvalues of D, d half their difference."""
    smallest, middle, largest = np.moveaxis(np.linalg.eigvalsh(D), -1, 0)
    d = np.maximum(np.array([middle - smallest, largest - smallest, largest - middle]) / 2, SMALLEST_GAP)
    return (d + np.log1p(-np.exp(-2 * d)) - np.log(2 * d)).sum(axis=0)


def traceless_part(d: Float[np.ndarray, "*n 5"]) -> Float[np.ndarray, "*n 3 3"]:
    """The symmetric D of trace zero with the components d, as `spinfilters.core.mass_distribution.traceless`."""
    a, b, c, e, f = np.moveaxis(d, -1, 0)
    return np.stack([a, c, e, c, b, f, e, f, -a - b], axis=-1).reshape(*d.shape[:-1], 3, 3)


def log_determinant(normal: NormalEquations) -> float:
    """log det of the information of all unknowns, landmarks included, of a problem that has a solution."""
    solution, landmarks = normal.system, normal.eliminated
    roots = [
        np.diagonal(solution.tridiagonal.information_sqrts, axis1=1, axis2=2).ravel(),
        np.diagonal(solution.information_sqrt),
    ]
    if landmarks is not None:
        own = landmarks.information_sqrt[landmarks.is_constrained]  # of the others it holds nothing
        roots.append(np.diagonal(own, axis1=1, axis2=2).ravel())
    return 2 * float(np.log(np.abs(np.concatenate(roots))).sum())


def leaves_one_direction_open(layout: StateLayout, factor: Float[np.ndarray, "n n"]) -> bool:
    """Whether a belief of this covariance factor hardly determines one direction of the mass distribution, and others well."""
    if not layout.has(MASS_DISTRIBUTION) or not np.isfinite(factor).all():
        return False
    std = np.linalg.svd(factor[layout.slice(MASS_DISTRIBUTION.name)], compute_uv=False)
    return bool(std[0] > WIDE > std[1])


def can_be_walked(problem: Problem, epochs: int) -> bool:
    """Whether a recording of so many epochs, without landmarks, is short enough for its mass posterior to be walked along."""
    has_mass = problem.motion.prior is not None and problem.layout.has(MASS_DISTRIBUTION)
    return has_mass and not problem.is_long and epochs <= MOST_EPOCHS


def sampled_mass(problem: Problem, smoothed: BatchSmoothing) -> SampledMass | None:
    """Samples of the mass distribution, where a motion leaves one direction of it hardly determined; None elsewhere.

    Parameters
    ----------
    problem : Problem
        At its noise levels.
    smoothed : BatchSmoothing
        Its solution.
    """
    layout = problem.layout
    if not can_be_walked(problem, len(smoothed.mean)):
        return None
    if not np.isfinite(smoothed.factor).all() or not leaves_one_direction_open(layout, smoothed.factor[0]):
        return None
    sampler = MassSampler(problem)
    nodes = sampler.ridge(smoothed.mean)
    found = sampler.sample(nodes, SAMPLES, 0)
    # an infinite shape: no sample has a density, or too few for a tail, which says nothing of the posterior's form
    if found is None or not np.isfinite(found.weights.shape):
        return None
    points, weights = found.points, found.weights.weights
    shape, nees = (
        sampler.gaussian_shape(nodes[0], TRIED, 1),
        sampler.gaussian_nees(nodes[0], points, weights),
    )
    mass = MassSamples(points, weights, shape, nees, found.weights.shape)
    widening = motion_widening(layout, smoothed.mean, smoothed.factor, found.trajectories, weights)
    return SampledMass(mass, widening)


def motion_widening(
    layout: StateLayout,
    mean: Float[np.ndarray, "k m"],
    factor: Float[np.ndarray, "k n n"],
    trajectories: Float[np.ndarray, "i k m"],
    weights: Float[np.ndarray, " i"],
) -> Float[np.ndarray, "k n"]:
    """Root mean square errors over samples, in a smoother's deviations (`SampledMass.widening`).

    The mean square about its states x is the covariance given the mass distribution, as at x, and that of the most probable states
    of the samples about x.

    Parameters
    ----------
    mean, factor : ndarrays of float, shapes (k, m), (k, n, n)
        The smoother's states with their covariance factors.
    trajectories, weights : ndarrays of float, shapes (i, k, m), (i,)
        Most probable states given each sample of the mass distribution.
    """
    s, F = layout.slice(MASS_DISTRIBUTION.name), factor
    along = (
        np.linalg.pinv(F[:, s]) @ F[:, s]
    )  # projects errors of unit variance on those that the mass distribution has
    variances = np.square(np.linalg.norm(F - F @ along, axis=2))
    for weight, trajectory in zip(weights, trajectories, strict=True):
        variances += weight * np.square(layout.local(mean, trajectory))
    times = np.sqrt(variances) / np.linalg.norm(F, axis=2)
    times[:, s] = 1.0
    return np.fmax(times, 1.0)
