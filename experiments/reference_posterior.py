"""Quantiles of the sampled posterior compared with those of a long run of samples with the exact density of all states.

    python -m experiments.reference_posterior [--seeds 5] [--first 0] [--steps 4000] [--sensors gyro,pose] [--samples 800]

The estimator `posterior` integrates the motion out by Laplace's method. The reference does not: each of its steps draws a mass
distribution, and for it all states of the motion (605 to 1208 numbers) eight times, weighted by their exact density. Its mass
distributions come from a surrogate, a Gaussian process through the logarithm of Laplace's density at so many pilot samples. So the
weights are nearly equal; an independence sampler (Metropolis, Hastings) with these proposals would accept the share that is
printed. The surrogate also is a control variate: its own quantiles are known from many cheap draws, and the steps only measure
what is added,

    F(x) = F_surrogate(x) + sum over steps i of (w_i - 1 / n) 1(m_i < x).

What is taken of a step's motion is the Gaussian of the last state given the mass distribution. Printed for each recording of the
calibration prior, and each number of samples, are processor time, Pareto shape, accepted share, and the deviation of the logarithm
of the weights. By quantity follows the largest difference of quantiles over levels and components, in per cent of the width of the
reference's 95 % interval. Last stands the largest difference of two halves of the reference, each of its own steps and draws.
"""

import argparse
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from experiments.command_line import run_study
from spinfilters.campaigns.calibration_draws import drawn_scenario
from spinfilters.core.robust_losses import LeastSquares
from spinfilters.core.working_time import working_seconds
from spinfilters.evaluation.stated_errors import LEVELS, posterior_quantities
from spinfilters.filters.history import EstimateHistory
from spinfilters.inference.smoother_run import smooth_at_once, smoothed_problem
from spinfilters.models.state_mixture import StateMixture
from spinfilters.models.status import AXES, MOMENTS
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import simulate
from spinfilters.smoother.linear_system import SchurSystem, latest_factor
from spinfilters.smoother.mass_posterior import (
    FIXED_STD,
    NO_POINTS,
    ConditionalMotion,
    MassSampler,
    log_volumes,
)
from spinfilters.smoother.posterior import SamplingOptions, SurrogatePosterior, sample_posterior
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.smoother.problem import Problem, Stage

CHAIN_SEED: Final = 99
PILOTS: Final = 1500
"""Samples of Laplace's density that the surrogate goes through."""
DRAWS: Final = 40_000
"""Of the surrogate, for each half of the reference."""
MOTIONS: Final = 8
"""Draws of the motion for each mass distribution: the weights' scatter by the draw falls with their root."""
STRICT: Final = Stage(LeastSquares())


class ExactSampler(MassSampler):
    """A sampler whose density is that of a mass distribution by some draws of the motion, without Laplace's method."""

    def __init__(self, problem: Problem, seed: int) -> None:
        super().__init__(problem)
        self.generator, self.corrections = np.random.default_rng(seed), list[float]()

    def conditional(
        self,
        trajectory: Float[np.ndarray, "k m"],
        iterations: int,
        points: Float[np.ndarray, "L 3"] | None = None,
    ) -> ConditionalMotion | None:
        """The motion given a mass distribution, with the mean over draws of the exact density over that of their proposal."""
        found = super().conditional(trajectory, iterations, points)
        if found is None:
            return None
        mean, std = self._prior.mean.copy(), self._prior_std.copy()
        mean[self._at], std[self._s] = trajectory[0, self._at], FIXED_STD
        problem = replace(self.problem, motion=replace(self.problem.motion, prior=FirstStatePrior(mean, std)))
        least = (
            problem.at(found.trajectory, NO_POINTS).cost(None, STRICT) - found.solution.predicted_reduction
        )
        logs = []
        for _ in range(MOTIONS):
            errors, square = motion_draw(found.solution, self.generator)
            drawn = integrated_draw(problem, found.trajectory, errors + found.solution.errors)
            cost = problem.at(drawn, NO_POINTS).cost(None, STRICT)
            logs.append(-0.5 * (cost - least - square))
        correction = float(np.logaddexp.reduce(logs)) - np.log(MOTIONS)
        self.corrections.append(correction)
        return replace(found, log_density=found.log_density + correction)


def motion_draw(
    solution: SchurSystem, generator: np.random.Generator
) -> tuple[Float[np.ndarray, "k e"], float]:
    """Errors of all epochs drawn from a linear problem's Gaussian, and their square in it."""
    chain = solution.tridiagonal
    L, F, X = chain.information_sqrts, chain.next, chain.coupling[:, :, :-1]
    z = generator.standard_normal(len(solution.separator_step))
    separator = np.linalg.solve(np.tril(solution.information_sqrt).T, z)
    square, steps, after = float(z @ z), np.zeros(L.shape[:2]), np.zeros(L.shape[1])
    # backwards along the chain: dv_k = L_k^-T (n_k - X_k dx - F_k dv_k+1)
    for k in range(len(L) - 1, -1, -1):
        n = generator.standard_normal(L.shape[1])
        square += float(n @ n)
        right = n - X[k] @ separator - (F[k] @ after if k + 1 < len(L) else 0.0)
        after = steps[k] = np.linalg.solve(L[k].T, right)
    return solution.ordering.errors(separator, steps), square


def integrated_draw(
    problem: Problem, trajectory: Float[np.ndarray, "k m"], errors: Float[np.ndarray, "k n"]
) -> Float[np.ndarray, "k m"]:
    """States with the disturbances of a draw's errors, integrated from its first state.

    Errors far from zero, as those of attitudes that nothing measures, are no motion when each is added to its own epoch: steps are
    far stiffer than the errors are small. The disturbances n = e' - defect - Phi e of the linear problem are kept instead, which is
    the same draw to first order and has the same volume.
    """
    motion, layout = problem.motion, problem.layout
    steps = motion.process.linearise_steps(trajectory[:-1], trajectory[1:], motion.dt)
    n = errors[1:] - steps.defect - np.einsum("kij,kj->ki", steps.transition, errors[:-1])
    drawn = np.empty_like(trajectory)
    drawn[0] = layout.retract(trajectory[0], errors[0])
    for k, dt in enumerate(motion.dt.tolist()):
        drawn[k + 1] = layout.retract(motion.process.step(drawn[k], dt), n[k])
    return drawn


@dataclass(frozen=True)
class Reference:
    """A long run of weighted steps, with many draws of the surrogate that proposed them.

    Attributes
    ----------
    last : StateMixture
        The last state given each step's mass distribution, with its weight.
    surrogate : StateMixture
        Mass distributions of the surrogate's draws in states that say nothing else.
    accepted : float
        Share that an independence sampler would accept.
    spread : float
        Deviation of the logarithm of the weights.
    """

    last: StateMixture
    surrogate: StateMixture
    accepted: float
    spread: float

    @property
    def halves(self) -> "tuple[Reference, Reference]":
        """Steps and draws of the first half, and of the second."""
        first, second = (
            replace(self, last=one, surrogate=other)
            for one, other in zip(_halves(self.last), _halves(self.surrogate), strict=True)
        )
        return first, second

    def quantiles(self, history: EstimateHistory) -> dict[str, Float[np.ndarray, "c q"]]:
        """Quantiles of each published quantity, those of the mass distribution with the surrogate as control variate."""
        steps = posterior_quantities(self.last, history)
        cheap = posterior_quantities(self.surrogate, history)
        found = {
            name: mixture.quantiles(LEVELS) for name, mixture in steps.items() if name not in MASS_QUANTITIES
        }
        for name in MASS_QUANTITIES:
            values = np.concatenate([cheap[name].values, steps[name].values])
            added = self.last.weights - 1 / len(self.last.weights)
            found[name] = point_quantiles(values, np.concatenate([self.surrogate.weights, added]))
        return found


MASS_QUANTITIES: Final = (MOMENTS, AXES)


def point_quantiles(
    values: Float[np.ndarray, "n c"], weights: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "c q"]:
    """Quantiles of weighted points, whose weights sum to one and may be negative."""
    found = np.empty((values.shape[1], len(LEVELS)))
    for k, column in enumerate(values.T):
        order = np.argsort(column)
        below = np.maximum.accumulate(np.cumsum(weights[order]))
        found[k] = column[order][np.minimum(np.searchsorted(below, LEVELS), len(order) - 1)]
    return found


def reference_of(problem: Problem, trajectory: Float[np.ndarray, "k m"], steps: int) -> Reference:
    """A reference of so many steps."""
    sampler = MassSampler(problem)
    nodes = sampler.ridge(trajectory)
    exact = ExactSampler(problem, CHAIN_SEED)
    pilot = sampler.sample(nodes, PILOTS, CHAIN_SEED)
    assert pilot is not None
    surrogate = SurrogatePosterior.through(sampler, nodes, pilot)
    frame = surrogate.frame
    halves = [surrogate.draws(DRAWS, CHAIN_SEED + half) for half in range(2)]
    points = np.concatenate([drawn for drawn, _ in halves])
    weights = np.concatenate([weight / 2 for _, weight in halves])
    places = (np.arange(steps) + 0.5) / steps
    chosen = np.minimum(np.searchsorted(np.cumsum(weights), places), len(points) - 1)
    kept, found, logs = [], [], []
    for k in chosen:
        there = exact.conditional(frame.begun(points[k]), 2)
        if there is not None:
            kept.append(there.trajectory[-1])
            found.append(latest_factor(there.solution))
            own = there.trajectory[:1, frame.at]
            volume = log_volumes(frame.errors(own, frame.origin))[0]
            logs.append(there.log_density + volume - surrogate.log_density(own)[0])
    ratio = np.array(logs)
    weight = np.exp(ratio - ratio.max())
    last = StateMixture(
        problem.layout, np.array(kept), np.array(found), weight / weight.sum(), np.nan, "reference"
    )
    means = np.tile(frame.nodes[0].trajectory[-1], (len(points), 1))
    means[:, frame.at] = points
    nothing = np.zeros((len(points), *found[0].shape))
    cheap = StateMixture(problem.layout, means, nothing, weights, np.nan, "surrogate")
    return Reference(last, cheap, accepted_share(ratio), float(np.std(ratio)))


def accepted_share(log_ratios: Float[np.ndarray, " n"]) -> float:
    """Share of steps that an independence sampler with these log weights accepts, in the order as they are shuffled."""
    generator = np.random.default_rng(CHAIN_SEED)
    logs, uniform = generator.permutation(log_ratios), np.log(generator.random(len(log_ratios)))
    here, accepted = logs[0], 0
    for log, chance in zip(logs, uniform, strict=True):
        if chance < log - here:
            here, accepted = log, accepted + 1
    return accepted / len(logs)


def largest_differences(
    one: dict[str, Float[np.ndarray, "c q"]], other: dict[str, Float[np.ndarray, "c q"]]
) -> dict[str, float]:
    """Largest difference of quantiles by quantity, in per cent of the width of the other's 95 % interval."""
    return {
        name: 100 * float((np.abs(one[name] - b) / (b[:, -1:] - b[:, :1])).max()) for name, b in other.items()
    }


def main() -> None:
    """Print a row for each recording."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=5, help="recordings of each sensor")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--steps", type=int, default=4000, help="of the reference")
    parser.add_argument("--sensors", default="gyro,pose")
    parser.add_argument("--samples", default=str(SamplingOptions().samples), help="of the mass distribution")
    options = parser.parse_args()
    print(
        "| recording | samples | s | shape | accepted | spread | largest difference [%] by quantity | of two halves [%] |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for sensor in options.sensors.split(","):
        for seed in range(options.first, options.first + options.seeds):
            setup = prepare(simulate(drawn_scenario(sensor, seed)), Settings())
            problem, smoothed = smoothed_problem(setup, Settings())
            history = smooth_at_once(setup, Settings(), lambda done, every: None)
            reference = reference_of(problem, smoothed.mean, options.steps)
            exact = reference.quantiles(history)
            chance = largest_differences(*(half.quantiles(history) for half in reference.halves))
            for samples in map(int, options.samples.split(",")):
                begin = working_seconds()
                posterior = sample_posterior(problem, smoothed.mean, SamplingOptions(samples=samples))
                seconds = working_seconds() - begin
                assert posterior is not None
                mixtures = posterior_quantities(posterior.last, history)
                differences = largest_differences(
                    {k: each.quantiles() for k, each in mixtures.items()}, exact
                )
                words = (
                    " ".join(f"{name} {value:.1f}" for name, value in each.items())
                    for each in (differences, chance)
                )
                print(
                    f"| {sensor} {seed} | {samples} | {seconds:.1f} | {posterior.last.shape:.2f} "
                    f"| {reference.accepted:.2f} | {reference.spread:.2f} | {' | '.join(words)} |",
                    flush=True,
                )


def _halves(mixture: StateMixture) -> list[StateMixture]:
    """A mixture's first and second half, or every second component of one that is in order of its proposal."""
    half = len(mixture.weights) // 2
    rows = (
        (slice(0, half), slice(half, 2 * half))
        if mixture.method == "surrogate"
        else (slice(0, None, 2), slice(1, None, 2))
    )
    found = (
        replace(mixture, means=mixture.means[r], factors=mixture.factors[r], weights=mixture.weights[r])
        for r in rows
    )
    return [replace(each, weights=each.weights / each.weights.sum()) for each in found]


if __name__ == "__main__":
    run_study(main)
