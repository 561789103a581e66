"""What the allowance for errors of a gyro that last costs, and what it saves.

    python -m experiments.lasting_errors [--seeds 40] [--first 0] [-o ROWS]

Recordings are drawn from the prior of the calibration, noise not stated: as they are, and with Gauss-Markov errors beside the white
ones, as large, with a correlation of 0.9 from sample to sample. Each is estimated as always, and by a verdict that takes all errors
for white. Printed by recording and verdict are how many estimates are ``ok``, how many of these have a published quantity beyond 4
stated deviations, the largest error of these, and the mean square of the rate's errors in stated deviations (1 if calibrated).

A second table is of the smoother's rates as always: the share within the central 50, 80 and 95 %, a test whether ranks of the first
component are uniform (Kolmogorov, Smirnov), and the continuous ranked probability score over the deviation with white errors. It is
given for the stated Gaussian, and for the mixture whose quantiles are the stated intervals: Gaussians of the deviations with white
errors and with each explanation by lasting ones, at its probability and over what is not known of its levels.
"""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Final
from unittest.mock import patch

import numpy as np
from scipy.stats import kstest

from experiments.command_line import Row, rows_of_seeds, run_study
from experiments.sealed_trial import ESTIMATORS, compared, drawn, with_lasting_errors
from spinfilters.campaigns.calibration_draws import StatedComponent, calibration_draw, stated_components
from spinfilters.inference.smoother_run import NAME as SMOOTHER
from spinfilters.models.status import RATE
from spinfilters.simulation.scenario import without_noise
from spinfilters.verdict import model_tests
from spinfilters.verdict.tested_models import NO_CORRELATION

RECORDINGS: Final = {"white errors": drawn, "errors that last": with_lasting_errors}
VERDICTS: Final = ("as always", "all errors taken for white")
LEVELS: Final = (0.5, 0.8, 0.95)
"""Probabilities of central intervals."""


def rows_of_seed(seed: int) -> Iterator[Row]:
    """A row a recording, verdict and estimator."""
    for recording, make in RECORDINGS.items():
        dataset = without_noise(make("gyro", seed))
        for verdict in VERDICTS:
            nothing = patch.object(model_tests, "possible_correlation", lambda *_: NO_CORRELATION)
            with nullcontext() if verdict == VERDICTS[0] else nothing:
                comparison = compared(dataset)
            if comparison is None:
                continue
            for evaluation in comparison.evaluations:
                draw, rates = calibration_draw(evaluation, seed), stated_components(evaluation)[RATE]
                squares = [(each.error / each.std) ** 2 for each in rates]
                yield {
                    "recording": recording,
                    "verdict": verdict,
                    "estimator": draw.estimator,
                    "seed": seed,
                    "is_ok": draw.is_ok,
                    "is_right": draw.is_right,
                    "worst": draw.worst,
                    "square": float(np.mean(squares)),
                    "rate": [
                        [each.error, each.std, each.weights.tolist(), each.deviations.tolist()]
                        for each in rates
                    ],
                }


def mixture_cells(rows: Sequence[Row], is_mixture: bool) -> str:
    """Coverage, test and score of the rates of some rows, by the stated Gaussian or by the mixture."""
    ranks, scores = [], []
    for row in rows:
        for error, std, weights, deviations in row["rate"]:
            own = (np.array(weights), np.array(deviations)) if is_mixture else (np.ones(1), np.array([std]))
            stated = StatedComponent(error, std, *own)
            ranks.append(stated.triple[2])
            scores.append(stated.scores[0] / deviations[0])
    every = np.array(ranks)
    within = (f"{np.mean(np.abs(2 * every - 1) < level):.0%}" for level in LEVELS)
    p_value = kstest(every[::3], "uniform").pvalue
    return f"{' | '.join(within)} | {p_value:.2g} | {np.mean(scores):.2f}"


def main() -> None:
    """Run the study and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path)
    asked = parser.parse_args()
    rows = rows_of_seeds(rows_of_seed, range(asked.first, asked.first + asked.seeds), asked.output)
    print(
        "| recording | verdict | estimator | ok | of these beyond 4 | largest of these | mean square, rate |"
    )
    print("|---|---|---|---|---|---|---|")
    for recording in RECORDINGS:
        for verdict in VERDICTS:
            for estimator in ESTIMATORS:
                wanted = {"recording": recording, "verdict": verdict, "estimator": estimator}
                own = [row for row in rows if wanted.items() <= row.items()]
                ok = [row for row in own if row["is_ok"]]
                wrong = sum(not row["is_right"] for row in ok)
                largest = max((row["worst"] for row in ok), default=0.0)
                square = np.mean([row["square"] for row in own])
                counts = f"{len(ok)} of {len(own)} | {wrong} | {largest:.1f} | {square:.2f}"
                print(f"| {recording} | {verdict} | {estimator} | {counts} |")
    print(
        "\n| recording | rates are stated by | 50 % | 80 % | 95 % | rank test p | score |\n|---|---|---|---|---|---|---|"
    )
    for recording in RECORDINGS:
        wanted = {"recording": recording, "verdict": VERDICTS[0], "estimator": SMOOTHER}
        own = [row for row in rows if wanted.items() <= row.items()]
        for is_mixture, words in enumerate(("one Gaussian", "the mixture")):
            print(f"| {recording} | {words} | {mixture_cells(own, bool(is_mixture))} |")


if __name__ == "__main__":
    run_study(main)
