"""A circling inspector beside one at rest.

The same body, noise and map-free problem, errors of every estimator over many seeds.
Run: python -m experiments.moving_inspector --seeds 12
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float

from experiments.command_line import run_study
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.run.comparison_run import compare_dataset
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.inspector import INSPECTORS, STATIC
from spinfilters.simulation.scenario import RICH_RPM, THESIS_RPM, Scenario, simulate, without_map

ESTIMATORS: Final = ("mekf", "ukf", "smoother")
QUANTITIES: Final = ("position [mm]", "attitude [deg]", "velocity [mm/s]", "rate [deg/s]")
_UNITS: Final = np.array([1e3, np.rad2deg(1.0), 1e3, np.rad2deg(1.0)])
MOTIONS: Final = {"thesis": THESIS_RPM, "rich": RICH_RPM}


def squared_errors(evaluation: Evaluation) -> Float[np.ndarray, " 5"]:
    """Mean squares of the four `QUANTITIES`, and the NEES per degree of freedom."""
    assert evaluation.errors is not None
    assert evaluation.nees is not None
    rms = evaluation.errors.rms
    assert rms.position is not None
    assert rms.velocity is not None
    found = np.array([rms.position, rms.attitude, rms.velocity, rms.rate]) * _UNITS
    return np.append(found**2, evaluation.nees.mean)


def run_seed(scenario: Scenario, estimators: tuple[str, ...]) -> Float[np.ndarray, "e 5"]:
    """Squared errors of every estimator on the scenario's tracks without a map."""
    compared = compare_dataset(without_map(simulate(scenario)), Settings(estimators=estimators))
    return np.stack([squared_errors(evaluation) for evaluation in compared.evaluations])


def pooled(squares: Float[np.ndarray, "s e 5"]) -> Float[np.ndarray, "e 5"]:
    """Root of the mean square over seeds of the errors, mean of the NEES."""
    mean = squares.mean(axis=0)
    return np.concatenate([np.sqrt(mean[:, :4]), mean[:, 4:]], axis=1)


def ratio_with_spread(
    moving: Float[np.ndarray, "s e 5"], static: Float[np.ndarray, "s e 5"]
) -> tuple[Float[np.ndarray, "e 4"], Float[np.ndarray, "e 4"]]:
    """Ratio of the pooled errors, and its standard deviation by the bootstrap over seeds."""
    generator, count = np.random.default_rng(0), len(moving)
    drawn = [generator.integers(0, count, count) for _ in range(400)]
    every = np.stack([pooled(moving[rows])[:, :4] / pooled(static[rows])[:, :4] for rows in drawn])
    return pooled(moving)[:, :4] / pooled(static)[:, :4], every.std(axis=0)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print errors of both inspectors and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--motion", choices=MOTIONS, default="thesis")
    parser.add_argument("--estimators", default=",".join(ESTIMATORS))
    options = parser.parse_args(arguments)
    estimators = tuple(options.estimators.split(","))
    usual = Scenario.common_workload(MOTIONS[options.motion])
    squares = {name: [] for name in INSPECTORS}
    for seed in range(options.first, options.first + options.seeds):
        for name in INSPECTORS:
            squares[name].append(run_seed(replace(usual, seed=seed, inspector=name), estimators))
            print(f"seed {seed} {name}: {np.sqrt(squares[name][-1][:, 1])} deg", flush=True)
    static = np.stack(squares[STATIC])
    for name in INSPECTORS:
        moving = np.stack(squares[name])
        ratio, spread = ratio_with_spread(moving, static)
        for estimator, errors, part, std in zip(estimators, pooled(moving), ratio, spread, strict=True):
            shown = ", ".join(
                f"{quantity} {error:.3f} (ratio {r:.3f} +- {s:.3f})"
                for quantity, error, r, s in zip(QUANTITIES, errors, part, std, strict=False)
            )
            print(f"{name:7s} {estimator:9s} {shown}, NEES per dof {errors[4]:.2f}")


if __name__ == "__main__":
    run_study(main)
