"""Quantiles of the sampled posterior compared with those of a long Markov chain over all states.

    python -m experiments.reference_posterior [--seeds 5] [--first 0] [--steps 4000] [--sensors gyro,pose] [--samples 800]

The estimator `posterior` integrates the motion out by Laplace's method. The chain does not: each step proposes a mass distribution
and all states of the motion (605 to 1208 numbers), and accepts them by their exact density (Metropolis, Hastings; independence
sampler). What is taken of a step is its mass distribution, with the Gaussian of the last state given it. Printed for each recording
of the calibration prior, and each number of samples, are processor time, Pareto shape, accepted share, and the deviation of the
logarithm of the exact density over Laplace's, by which the Gaussians given a mass distribution are judged. By quantity follows the
largest difference of quantiles over levels and components, in per cent of the width of the chain's 95 % interval. Two halves of the
chain differ by chance; their largest difference stands beside.
"""

import argparse
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from experiments.command_line import run_study
from spinfilters.campaigns.calibration_draws import drawn_scenario
from spinfilters.core.working_time import working_seconds
from spinfilters.evaluation.posterior_distance import LEVELS, QuantityMixture, posterior_quantities
from spinfilters.inference.smoother_run import smooth_at_once, smoothed_problem
from spinfilters.models.state_mixture import StateMixture
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import simulate
from spinfilters.smoother.linear_system import SchurSystem
from spinfilters.smoother.mass_posterior import FIXED_STD, NO_POINTS, STRICT, ConditionalMotion, MassSampler
from spinfilters.smoother.posterior import SamplingOptions, sample_posterior
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.smoother.problem import Problem

CHAIN_SEED: Final = 99
SETTLING: Final = 0.05
"""Share of the chain that is left out at its beginning."""


class ExactSampler(MassSampler):
    """A sampler whose density is that of a mass distribution together with one draw of the motion, without Laplace's method."""

    def __init__(self, problem: Problem, seed: int) -> None:
        super().__init__(problem)
        self.generator, self.corrections = np.random.default_rng(seed), list[float]()

    def conditional(self, trajectory: Float[np.ndarray, "k m"], iterations: int) -> ConditionalMotion | None:
        """The motion given a mass distribution, with the exact density of a draw over that of its proposal."""
        found = super().conditional(trajectory, iterations)
        if found is None:
            return None
        mean, std = self._prior.mean.copy(), self._prior_std.copy()
        mean[self._at], std[self._s] = trajectory[0, self._at], FIXED_STD
        problem = replace(self.problem, motion=replace(self.problem.motion, prior=FirstStatePrior(mean, std)))
        errors, square = motion_draw(found.solution, self.generator)
        drawn = integrated_draw(problem, found.trajectory, errors + found.solution.errors)
        cost = problem.at(drawn, NO_POINTS).cost(None, STRICT)
        least = (
            problem.at(found.trajectory, NO_POINTS).cost(None, STRICT) - found.solution.predicted_reduction
        )
        correction = -0.5 * (cost - least - square)
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
class Chain:
    """A long chain.

    Attributes
    ----------
    last : StateMixture
        The last state given each step's mass distribution, of equal weight.
    accepted : float
        Share of the proposals.
    spread : float
        Deviation of the logarithm of the exact density over Laplace's.
    """

    last: StateMixture
    accepted: float
    spread: float


def long_chain(problem: Problem, trajectory: Float[np.ndarray, "k m"], steps: int) -> Chain:
    """A chain of so many steps, of which the first ones are left out."""
    nodes = MassSampler(problem).ridge(trajectory)
    sampler = ExactSampler(problem, CHAIN_SEED)
    found = sampler.sample(nodes, steps, CHAIN_SEED)
    assert found is not None
    # proposals are even, not independent: in random order
    order = np.random.default_rng(CHAIN_SEED).permutation(len(found.points))
    logs, uniform = found.log_ratios[order], np.random.default_rng(1).random(len(order))
    chosen, here, accepted = np.empty(len(order), dtype=int), int(logs.argmax()), 0
    for k in range(len(order)):
        if np.log(uniform[k]) < logs[k] - logs[here]:
            here, accepted = k, accepted + 1
        chosen[k] = here
    kept = order[chosen[int(SETTLING * len(order)) :]]
    weights = np.full(len(kept), 1 / len(kept))
    last = StateMixture(
        problem.layout, found.trajectories[kept, -1], found.last_factors[kept], weights, np.nan, "chain"
    )
    return Chain(last, accepted / len(order), float(np.std(sampler.corrections)))


def largest_differences(
    one: dict[str, QuantityMixture], other: dict[str, QuantityMixture]
) -> dict[str, float]:
    """Largest difference of quantiles by quantity, in per cent of the width of the other's 95 % interval."""
    found = {}
    for name in one:
        a, b = one[name].quantiles(LEVELS), other[name].quantiles(LEVELS)
        found[name] = 100 * float((np.abs(a - b) / (b[:, -1:] - b[:, :1])).max())
    return found


def main() -> None:
    """Print a row for each recording."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=5, help="recordings of each sensor")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--steps", type=int, default=4000, help="of the chain")
    parser.add_argument("--sensors", default="gyro,pose")
    parser.add_argument("--samples", default=str(SamplingOptions().samples), help="of the mass distribution")
    options = parser.parse_args()
    print(
        "| recording | samples | s | shape | accepted | spread | largest difference [%] by quantity | of the chain's halves [%] |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for sensor in options.sensors.split(","):
        for seed in range(options.first, options.first + options.seeds):
            setup = prepare(simulate(drawn_scenario(sensor, seed)), Settings())
            problem, smoothed = smoothed_problem(setup, Settings())
            history = smooth_at_once(setup, Settings(), lambda done, every: None)
            chain = long_chain(problem, smoothed.mean, options.steps)
            exact = posterior_quantities(chain.last, history)
            chance = max(
                largest_differences(
                    *(posterior_quantities(half, history) for half in _halves(chain.last))
                ).values()
            )
            for samples in map(int, options.samples.split(",")):
                begin = working_seconds()
                posterior = sample_posterior(problem, smoothed.mean, SamplingOptions(samples=samples))
                seconds = working_seconds() - begin
                assert posterior is not None
                differences = largest_differences(posterior_quantities(posterior.last, history), exact)
                told = " ".join(f"{name} {value:.1f}" for name, value in differences.items())
                print(
                    f"| {sensor} {seed} | {samples} | {seconds:.1f} | {posterior.last.shape:.2f} | {chain.accepted:.2f} "
                    f"| {chain.spread:.2f} | {told} | {chance:.1f} |",
                    flush=True,
                )


def _halves(chain: StateMixture) -> list[StateMixture]:
    half = len(chain.weights) // 2
    return [
        replace(chain, means=chain.means[rows], factors=chain.factors[rows], weights=np.full(half, 1 / half))
        for rows in (slice(0, half), slice(half, 2 * half))
    ]


if __name__ == "__main__":
    run_study(main)
