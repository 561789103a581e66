"""What any estimator of throws can know whose densities are not stated: zero and 1e-3 look alike, and weigh differently.

    python -m experiments.density_limits [--seeds 12] [--first 0] [-o FILE]

Each of the throws of `experiments.captured_throws` is made without disturbances and with densities of 1e-3 and 1e-2. The linear
problem of the smoother is solved at every pair of densities of force and torque in whole decades from 1e-8 to 10. With the marginal
likelihood of each pair, the last epoch's belief is the mixture over the pairs under a prior:

    flat       flat in the square root of each density, as the estimators have it,
    shrunk     1 / (s + square root) with s^2 = 1e-6, the thesis' density: whole decades above it are equally likely,
    cauchy     half-Cauchy in the square root, of median 1e-3,
    known      the three densities that there are, and no others, equally likely; with 2 and 5 times the odds on zero.

``true`` takes the pair that there is. Of throws that leave a moment uncertain by more than 0.1 of the largest, even without
disturbances, nothing is counted: there the problem is not linear. Printed are NEES per degree of freedom by true density, with the
band of as many consistent estimates, and the largest error of any component of the state in deviations. Behind it stand by how much
the log likelihood of a true zero exceeds that of a common density of 1e-3, and the mean variance at 1e-3 over that at zero (trace
per dimension). ``-o`` keeps a line of JSON for each throw.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from experiments.captured_throws import drawn
from experiments.command_line import rows_of_seeds, run_study
from experiments.density_posterior import solved_at
from spinfilters.evaluation.consistency import chi_square_band, true_states
from spinfilters.inference.identified_noise import noise_model
from spinfilters.inference.smoother_run import smooth_at_once
from spinfilters.models.body import body_estimate
from spinfilters.models.process import THESIS_NOISE, TorqueFreeProcess
from spinfilters.models.state_layout import Gaussian
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import simulate, without_noise
from spinfilters.smoother.batch_smoother import NO_LANDMARKS
from spinfilters.smoother.problem import problem_of
from spinfilters.verdict.checks import LARGEST_MOMENT_STD

DECADES: Final = np.arange(-8, 2)
"""Of the densities; the least is none."""
TRUE: Final = {0.0: -8, 1e-3: -3, 1e-2: -2}
"""Densities of the throws, and their decades."""
SCALE: Final = float(np.sqrt(THESIS_NOISE.force_psd))
ODDS: Final = (1.0, 2.0, 5.0)
"""On zero, of the prior that knows the three densities."""
PRIORS: Final = ("flat", "shrunk", "cauchy", *(f"known {odds:g}" for odds in ODDS))


@dataclass(frozen=True)
class DensityPairs:
    """Last epoch at all pairs of densities of force (d) and torque (d).

    Attributes
    ----------
    moments_std : float
        Of the least known moment without disturbances, of the largest.
    log_likelihood : (d, d) float array
        Up to a constant.
    errors : (d, d, n) float array
        Estimate less truth.
    covariances : (d, d, n, n) float array
        Stated.
    """

    moments_std: float
    log_likelihood: Float[np.ndarray, "d d"]
    errors: Float[np.ndarray, "d d n"]
    covariances: Float[np.ndarray, "d d n n"]

    def mixed(self, prior: Float[np.ndarray, " d"]) -> tuple[float, float]:
        """NEES per degree of freedom and largest error in deviations of the mixture under a prior of each density."""
        weights = np.exp(self.log_likelihood - self.log_likelihood.max()) * np.outer(prior, prior)
        weights /= weights.sum()
        error = np.einsum("ij,ijn->n", weights, self.errors)
        away = self.errors - error
        inside = self.covariances + away[..., :, np.newaxis] * away[..., np.newaxis, :]
        return _normalised(error, np.einsum("ij,ijnm->nm", weights, inside))

    def at(self, decade: int) -> tuple[float, float]:
        """The same of the estimate at a common density."""
        k = int(np.flatnonzero(decade == DECADES)[0])
        return _normalised(self.errors[k, k], self.covariances[k, k])

    def between(self, none: int, some: int) -> tuple[float, float]:
        """Log likelihood of a common density over that of another, and mean variance at the other over that at it."""
        k, other = (int(np.flatnonzero(decade == DECADES)[0]) for decade in (none, some))
        variance = np.trace(np.linalg.solve(self.covariances[k, k], self.covariances[other, other]))
        return float(self.log_likelihood[k, k] - self.log_likelihood[other, other]), float(
            variance / self.errors.shape[2]
        )


def _normalised(error: Float[np.ndarray, " n"], covariance: Float[np.ndarray, "n n"]) -> tuple[float, float]:
    nees = error @ np.linalg.solve(covariance, error) / len(error)
    return float(nees), float(np.abs(error / np.sqrt(np.diag(covariance))).max())


def prior_of(name: str) -> Float[np.ndarray, " d"]:
    """Probability of each decade under one of `PRIORS`, that of all below the least with it."""
    word, _, odds = name.partition(" ")
    if word == "known":
        return np.array([float(odds) if k == DECADES[0] else float(k in TRUE.values()) for k in DECADES])
    edges = 10.0 ** ((np.append(DECADES, DECADES[-1] + 1) - 0.5) / 2)
    edges[0] = 0.0
    sizes = {"flat": edges, "shrunk": np.log1p(edges / SCALE), "cauchy": np.arctan(edges / SCALE)}
    return np.diff(sizes[word])


def pairs_of(seed: int, density: float) -> DensityPairs | None:
    """All pairs for the throw of a seed; None where the smoother identifies no densities."""
    settings = Settings(estimators=("smoother",))
    setup = prepare(without_noise(simulate(drawn(seed, density))), settings)
    history, truth = smooth_at_once(setup, settings, lambda *_: None), setup.dataset.truth
    problem = problem_of(setup.process, setup.timeline, NO_LANDMARKS, setup.initial.prior, 2)
    model = noise_model(problem, setup.noise, setup.sought)
    if truth is None or model is None or not history.noise:
        return None
    # sensors at the levels that the smoother identifies
    stated = model.values(np.zeros(len(history.noise)))
    ratios = np.log([each.value for each in history.noise]) - np.log(stated)
    problem = model.scaled(ratios * [0.0 if each.is_density else 2.0 for each in history.noise])
    process = problem.motion.process
    assert isinstance(process, TorqueFreeProcess)
    away = history.layout.local(history.mean[-1], true_states(truth, history.layout)[-1])
    count, n = len(DECADES), len(away)
    logs, errors, covariances = (
        np.zeros((count,) * 2),
        np.zeros((count, count, n)),
        np.zeros((count, count, n, n)),
    )
    for i, force in enumerate(10.0**DECADES):
        for j, torque in enumerate(10.0**DECADES):
            noise = replace(process.noise, force_psd=float(force), torque_psd=float(torque))
            solved = solved_at(problem, process.with_noise(noise), history.mean)
            logs[i, j], errors[i, j], covariances[i, j] = solved[0], solved[1] - away, solved[2]
    belief = Gaussian(history.layout, history.mean[-1], np.linalg.cholesky(covariances[0, 0]))
    std = body_estimate(belief, intervals=False).principal_moments_std
    return DensityPairs(float(std.max()), logs, errors, covariances)


def rows_of(seed: int) -> Iterator[dict[str, Any]]:
    """A row of each density on the throw of a seed."""
    for density, decade in TRUE.items():
        pairs = pairs_of(seed, density)
        if pairs is None:
            continue
        beliefs = {name: pairs.mixed(prior_of(name)) for name in PRIORS} | {"true": pairs.at(decade)}
        between = pairs.between(TRUE[0.0], TRUE[1e-3])
        yield {
            "seed": seed,
            "density": density,
            "dof": pairs.errors.shape[2],
            "moments_std": pairs.moments_std,
            "beliefs": beliefs,
            "between": between,
        }


def lines_of(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Lines of the report."""
    every, rows = len(rows), [row for row in rows if row["moments_std"] <= LARGEST_MOMENT_STD]
    yield f"{len(rows)} of {every} recordings determine the moments"
    yield f"{'NEES by true density':22s}" + "".join(f"{density:>20g}" for density in TRUE)
    for name in (*PRIORS, "true"):
        cells = []
        for density in TRUE:
            own = np.array([row["beliefs"][name] for row in rows if row["density"] == density])
            cells.append(f"{own[:, 0].mean():.2f} (at most {own[:, 1].max():.1f})" if len(own) else "-")
        yield f"{name:22s}" + "".join(f"{cell:>20s}" for cell in cells)
    none = [row["between"] for row in rows if row["density"] == 0.0]
    if none:
        dof = rows[0]["dof"]
        low, high = (float(limit) / dof for limit in chi_square_band(dof, len(none)))
        yield f"band of {len(none)} throws {low:.2f} to {high:.2f}, {dof} degrees of freedom"
        likelier, wider = np.median(none, axis=0)
        yield (
            f"without disturbances: ln likelihood of zero over that of 1e-3 has the median {likelier:.1f}, "
            f"variance at 1e-3 over that at zero {wider:.1f}"
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, default=None)
    options = parser.parse_args(arguments)
    for line in lines_of(
        rows_of_seeds(rows_of, range(options.first, options.first + options.seeds), options.output)
    ):
        print(line)


if __name__ == "__main__":
    run_study(main)
