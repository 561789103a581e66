"""Deviations of throws that integrate over what is not known of the disturbances' densities, compared with the stated ones.

    python -m experiments.density_posterior [--seeds 12] [--first 0] [--disturbance 0] [--poses]

The throws of `experiments.captured_throws` only bound the densities of force and torque. The smoother takes each at its posterior
mean. Here the marginal likelihood of each is evaluated at levels from e^-8 to e^7 of the most likely one, times a prior that is
flat in the standard deviation, with the covariance P and the error x of the states at each level. Printed are NEES per degree of
freedom of the last epoch and the largest error in deviations, of the smoother's covariance

- as stated;
- of the mixture over the levels, E P + var x;
- widened along its own axes until four deviations are exceeded with the probability 3e-4 over the levels.

With ``--poses`` the same of the pose recordings that `spinfilters calibration pose` draws with these seeds.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq
from scipy.special import ndtr

from experiments.captured_throws import drawn
from experiments.command_line import run_study
from spinfilters.campaigns.calibration_draws import drawn_scenario
from spinfilters.core.robust_losses import LeastSquares
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR, quantity_errors
from spinfilters.filters.history import EstimateHistory
from spinfilters.inference.identified_noise import noise_model
from spinfilters.inference.setup import Setup
from spinfilters.inference.smoother_run import smooth_at_once
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import simulate, without_noise
from spinfilters.smoother.batch_smoother import NO_LANDMARKS, NO_POINTS
from spinfilters.smoother.linear_system import Marginals
from spinfilters.smoother.mass_posterior import log_determinant
from spinfilters.smoother.problem import Problem, Stage, problem_of
from spinfilters.verdict.doubts import evaluated

LEVELS: Final = np.arange(-8.0, 7.5)
"""Of ln density, about the most likely one."""
BEYOND: Final = 3e-4
"""Probability of an error beyond four deviations."""
TAIL: Final = 0.97
"""Posterior probability below the level whose covariance gives the axes along which deviations are widened."""
STRICT: Final = Stage(LeastSquares())
WAYS: Final = ("stated", "mixture", "tail")


@dataclass(frozen=True)
class DensityPosterior:
    """Belief of the last epoch at each level of one density.

    Attributes
    ----------
    weights : (l,) float array
        Posterior probability of each level.
    errors : (l, n) float array
        Of the states from those at the mean density.
    covariances : (l, n, n) float array
        At each level.
    """

    weights: Float[np.ndarray, " l"]
    errors: Float[np.ndarray, "l n"]
    covariances: Float[np.ndarray, "l n n"]

    @property
    def mixture(self) -> Float[np.ndarray, "n n"]:
        """E P + var x."""
        away = self.errors - self.weights @ self.errors
        return np.einsum("l,lij->ij", self.weights, self.covariances + away[:, :, None] * away[:, None, :])

    def widened(self, P: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
        """P with deviations that hold up to four of them, with the probability 1 - `BEYOND`, along its axes."""
        L = np.linalg.cholesky(P)
        whitened = np.linalg.solve(L, np.linalg.solve(L, self.covariances).swapaxes(1, 2))
        high = min(int(np.searchsorted(np.cumsum(self.weights), TAIL)), len(LEVELS) - 1)
        axes = np.linalg.eigh(whitened[high])[1]
        stds = np.sqrt(np.einsum("ia,lij,ja->al", axes, whitened, axes))
        times = np.array([_held(self.weights, each) for each in stds])
        rows = L @ axes * times
        return rows @ rows.T


def _held(weights: Float[np.ndarray, " l"], stds: Float[np.ndarray, " l"]) -> float:
    """Deviation, at least 1, four of which are exceeded with the probability `BEYOND` by a mixture of these deviations."""

    def excess(deviation: float) -> float:
        return float(weights @ (2 * ndtr(-LARGEST_STATED_ERROR * deviation / stds))) - BEYOND

    return 1.0 if excess(1.0) < 0 else float(brentq(excess, 1.0, 100.0))  # pyright: ignore[reportArgumentType]


def posterior_of(
    problem: Problem, trajectory: Float[np.ndarray, "k m"], name: str, value: float
) -> DensityPosterior:
    """Posterior of a density about its most likely value, the other levels as they are in the problem."""
    process, logs, errors, covariances = problem.motion.process, [], [], []
    assert isinstance(process, TorqueFreeProcess)
    for y in LEVELS:
        noise = replace(process.noise, **{name: value * float(np.exp(y))})
        log_density, error, P = solved_at(problem, process.with_noise(noise), trajectory)
        logs.append(log_density + y / 2)
        errors.append(error)
        covariances.append(P)
    weights = np.exp(np.array(logs) - max(logs))
    weights[0] /= 1 - np.exp(
        -(LEVELS[1] - LEVELS[0]) / 2
    )  # the prior's tail towards zero, where nothing changes
    return DensityPosterior(weights / weights.sum(), np.array(errors), np.array(covariances))


def solved_at(
    problem: Problem, process: TorqueFreeProcess, trajectory: Float[np.ndarray, "k m"]
) -> tuple[float, np.ndarray, np.ndarray]:
    """Log marginal likelihood up to a constant, and error and covariance of the last epoch, of the linear problem."""
    own = replace(problem, motion=replace(problem.motion, process=process))
    here = own.at(trajectory, NO_POINTS)
    normal, d = own.normal(here, STRICT), len(own.ordering.moving)
    cost = here.cost(None, STRICT) - normal.predicted_reduction + log_determinant(normal)
    cost -= 2 * float(np.linalg.slogdet(here.dynamics.rows[:, :, d : 2 * d])[1].sum())
    factor = Marginals(normal.system, None).factors[-1]
    return -cost / 2, normal.system.errors[-1], factor @ factor.T


def covariances_of(history: EstimateHistory, setup: Setup) -> Iterator[Float[np.ndarray, "n n"]]:
    """Covariance of the last epoch in each of `WAYS`."""
    yield history.covariance[-1]
    problem = problem_of(setup.process, setup.timeline, NO_LANDMARKS, setup.initial.prior, 2)
    model = noise_model(problem, setup.noise, setup.sought)
    assert model is not None
    stated = model.values(np.zeros(len(history.noise)))
    ratios = np.array([each.expected for each in history.noise]) / stated
    problem = model.scaled(np.log(ratios) * [1.0 if each.is_density else 2.0 for each in history.noise])
    process = problem.motion.process
    assert isinstance(process, TorqueFreeProcess)
    P = solved_at(problem, process, history.mean)[2]
    found = [
        posterior_of(problem, history.mean, each.name, each.value)
        for each in history.noise
        if each.is_density
    ]
    yield P + sum(each.mixture - P for each in found)
    yield P + sum(each.widened(P) - P for each in found)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--disturbance", type=float, default=0.0, help="true density of force and torque")
    parser.add_argument("--poses", action="store_true", help="drawn poses instead of throws")
    options = parser.parse_args(arguments)
    settings, nees, largest = Settings(estimators=("smoother",)), [], []
    for seed in range(options.first, options.first + options.seeds):
        scenario = drawn_scenario("pose", seed) if options.poses else drawn(seed, options.disturbance)
        setup = prepare(without_noise(simulate(scenario)), settings)
        history = smooth_at_once(setup, settings, lambda *_: None)
        own = []
        for P in covariances_of(history, setup):
            factor = np.concatenate([history.factor[:-1], np.linalg.cholesky(P)[None]])
            own.append(evaluated(replace(history, factor=factor), setup))
        nees.append([float(each.nees.total[-1]) / each.nees.dof for each in own if each.nees is not None])
        largest.append([max(float(v[-1]) for v in quantity_errors(each).values()) for each in own])
    for name, mean, most in zip(WAYS, np.mean(nees, axis=0), np.max(largest, axis=0), strict=True):
        print(
            f"{name:8s} NEES per degree of freedom {mean:.2f}, largest error {most:.1f} deviations of {len(nees)} recordings"
        )


if __name__ == "__main__":
    run_study(main)
