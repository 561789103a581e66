"""Moments of a body whose motion hardly shows them: the published mean of the posterior, compared with its mode.

    python -m experiments.weak_motions [--seeds 24] [--first 0] [-o ROWS]

Poses of 100 epochs at 2, 6 and 1 rpm, the noise as `simulate` states it. The mode is the mass distribution of the estimator's last
Gaussian belief. Printed are, of MEKF and smoother, how many recordings have both open ratios of moments within 2.5 stated
deviations of the truth, the largest error in deviations, and the continuous ranked probability score (CRPS; Gneiting, Raftery
2007) of published samples over that of the mode's Gaussian, with a 95 % interval by the jackknife over recordings.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from experiments.command_line import Row, rows_of_seeds, run_study
from spinfilters import compare, simulate
from spinfilters.campaigns.calibration_report import gaussian_crps
from spinfilters.campaigns.statistics import QUANTILE
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.models.body import body_estimate

RATE_RPM: Final = (2.0, 6.0, 1.0)
EPOCHS: Final = 100
ESTIMATORS: Final = ("mekf", "smoother")
WITHIN: Final = 2.5
"""Stated deviations."""


def sample_crps(values: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"], truth: float) -> float:
    """CRPS of weighted samples: E |X - truth| - E |X - X'| / 2."""
    spread = weights @ np.abs(values[:, np.newaxis] - values) @ weights
    return float(weights @ np.abs(values - truth) - spread / 2)


def rows_of_seed(seed: int) -> Iterator[Row]:
    """A row an estimator: errors in deviations and scores, published and of the mode."""
    data = simulate("pose", rate_rpm=RATE_RPM, frames=EPOCHS, seed=seed)
    assert data.truth is not None
    assert data.truth.principal_moments is not None
    truth = np.sort(data.truth.principal_moments)
    run = compare(data, ESTIMATORS, verdict="filter")
    for name in ESTIMATORS:
        yield {"seed": seed, "estimator": name} | scores(run[name].evaluation, truth / truth[-1])


def scores(evaluation: Evaluation, truth: Float[np.ndarray, " 3"]) -> Row:
    """Errors and scores of the two moments that are not 1 by definition."""
    published, mode = evaluation.body, body_estimate(evaluation.history.belief(-1))
    mass = evaluation.history.mass
    own = gaussian_crps((mode.principal_moments - truth)[:2], mode.principal_moments_std[:2]).tolist()
    if mass is not None:
        columns = mass.principal_moments.T
        found = [sample_crps(columns[k], mass.weights, truth[k]) for k in (0, 1)]
    else:
        found = own
    return {
        "sampled": mass is not None,
        "away": [
            float(np.abs((body.principal_moments - truth)[:2] / body.principal_moments_std[:2]).max())
            for body in (published, mode)
        ],
        "crps": [float(np.mean(found)), float(np.mean(own))],
    }


def ratio_with_interval(pairs: Float[np.ndarray, "n 2"]) -> tuple[float, float]:
    """Ratio of the means of two scores, with half its 95 % interval."""
    ratio = float(pairs[:, 0].mean() / pairs[:, 1].mean())
    count = len(pairs)
    left_out = np.array([np.delete(pairs, k, axis=0).mean(axis=0) for k in range(count)])
    spread = left_out[:, 0] / left_out[:, 1]
    return ratio, QUANTILE * float(np.sqrt((count - 1) / count * np.square(spread - spread.mean()).sum()))


def main() -> None:
    """Run the study and print a line an estimator."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=24)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path)
    asked = parser.parse_args()
    rows = rows_of_seeds(rows_of_seed, range(asked.first, asked.first + asked.seeds), asked.output)
    for name in ESTIMATORS:
        own = [row for row in rows if row["estimator"] == name]
        away = np.array([row["away"] for row in own])
        ratio, half = ratio_with_interval(np.array([row["crps"] for row in own]))
        within = np.count_nonzero(away < WITHIN, axis=0)
        print(
            f"{name}: {sum(row['sampled'] for row in own)} of {len(own)} sampled; within {WITHIN} deviations {within[0]} "
            f"(mode {within[1]}), largest {away[:, 0].max():.2f} (mode {away[:, 1].max():.2f}); CRPS over the mode's "
            f"{ratio:.2f} +- {half:.2f}"
        )


if __name__ == "__main__":
    run_study(main)
