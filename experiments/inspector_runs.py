"""Map-free tracks before a circling and a resting inspector.

Estimators from near the truth: errors and what they state.
Run: python -m experiments.inspector_runs --seeds 300
"""

import argparse
from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Float

from experiments.command_line import run_study
from spinfilters.evaluation.consistency import true_states
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.filter import MultiplicativeFilter
from spinfilters.filters.timeline import SensorNoise, Timeline, build_timeline, run
from spinfilters.filters.ukf import MultiplicativeUkf
from spinfilters.inference.initial_estimate import SmoothingOptions, smooth_first_epochs
from spinfilters.inference.setup import camera_view
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, Gaussian, StateLayout
from spinfilters.simulation.inspector import INSPECTORS, STATIC
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.smoother.problem import InitialGuess

LAYOUT: Final = StateLayout(FULL_BLOCKS)
NOISE: Final = ProcessNoise(force_psd=1e-6, torque_psd=1e-6)
PROCESS: Final = TorqueFreeProcess(LAYOUT, NOISE, 1e-8)
START_STD: Final = np.repeat([1e-6, 1e-6, 0.002, 0.003, 0.002, 0.01], [3, 3, 3, 3, 3, 5])
"""Of the belief at the first epoch, whose pose defines g."""
FILTERS: Final = {"mekf": MultiplicativeEkf, "ukf": MultiplicativeUkf}
SMOOTHER: Final = "smoother"
BLOCKS: Final = ("t", "a", "v", "w")


def run_seed(seed: int, inspector: str, estimator: str) -> Float[np.ndarray, " 9"]:
    """Mean squares of errors and stated ones, and NEES.

    They are of the four blocks; NEES per degree of freedom.
    """
    scenario = Scenario.simplified(
        rate_rpm=RICH_RPM, seed=seed, epochs=40, landmarks=150, noise=NOISE, inspector=inspector
    )
    dataset = simulate(scenario)
    known = dataset.known_map
    assert dataset.truth is not None
    assert known is not None
    states = true_states(dataset.truth, LAYOUT)
    dataset = without_map(dataset)
    timeline = build_timeline(dataset.log, LAYOUT, SensorNoise(pixel_std=1.0), camera_view(dataset))
    error = START_STD * np.random.default_rng(1000 + seed).standard_normal(LAYOUT.error_dim)
    error[:6] = 0
    first = Gaussian(LAYOUT, LAYOUT.retract(states[0], error), np.diag(START_STD))
    if estimator == SMOOTHER:
        prior = FirstStatePrior(first.mean, START_STD)
        guess = InitialGuess(states, known.ids, known.points)
        found = smooth_first_epochs(PROCESS, timeline, guess, prior, SmoothingOptions())
        mean, factors = found.mean[1:], found.factor[1:]
    else:
        mean, factors = _filtered(FILTERS[estimator](PROCESS), first, timeline)
    errors = LAYOUT.local(mean, states[1:])
    nees = np.square(np.linalg.solve(factors, errors[..., None])).sum(axis=(1, 2)) / LAYOUT.error_dim
    squares = [np.mean(errors[:, LAYOUT.slice(block)] ** 2) for block in BLOCKS]
    stated = [np.mean(np.sum(factors[:, LAYOUT.slice(block)] ** 2, axis=2)) for block in BLOCKS]
    return np.array([*squares, *stated, nees.mean()])


def _filtered(
    estimator: MultiplicativeFilter, first: Gaussian, timeline: Timeline
) -> tuple[Float[np.ndarray, "k m"], Float[np.ndarray, "k n n"]]:
    """Means and factors of the covariances after every epoch but the first."""
    estimator.start(first)
    for measurement in timeline[0].measurements:
        estimator.update(measurement)
    history = run(estimator, timeline[0].time, timeline[1:])
    return history.mean, history.factor


def main(arguments: Sequence[str] | None = None) -> None:
    """Print ratios of errors and stated ones, and NEES, with standard errors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=300)
    parser.add_argument("--estimator", choices=(*FILTERS, SMOOTHER), default="mekf")
    options = parser.parse_args(arguments)
    seeds = options.seeds
    found = {
        name: np.stack([run_seed(seed, name, options.estimator) for seed in range(seeds)])
        for name in INSPECTORS
    }
    generator = np.random.default_rng(0)
    drawn = [generator.integers(0, seeds, seeds) for _ in range(400)]
    for name in (each for each in INSPECTORS if each != STATIC):
        ratios = np.stack([_ratio(found[name][rows], found[STATIC][rows]) for rows in drawn])
        ratio, spread = _ratio(found[name], found[STATIC]), ratios.std(axis=0)
        for k, block in enumerate(BLOCKS):
            print(
                f"{name} over {STATIC}, {block}: error {ratio[k]:.3f} +- {spread[k]:.3f}, stated {ratio[k + 4]:.3f}"
            )
    for name, each in found.items():
        nees = each[:, 8]
        print(f"{name}: NEES per dof {nees.mean():.3f} +- {nees.std() / np.sqrt(seeds):.3f}")


def _ratio(moving: Float[np.ndarray, "s 9"], static: Float[np.ndarray, "s 9"]) -> Float[np.ndarray, " 8"]:
    return np.sqrt(moving[:, :8].mean(axis=0) / static[:, :8].mean(axis=0))


if __name__ == "__main__":
    run_study(main)
