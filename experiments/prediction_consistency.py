"""Predictions behind the last measurement against the truth that goes on: NEES with its band over seeds.

    python -m experiments.prediction_consistency [--seeds 40] [--first 0] [--measured 40] [--ahead 17] [-o FILE]

The bundled example is cut after ``--measured`` seconds. What each estimator states of the motion ``--ahead`` seconds later is
compared with the truth there: mean NEES per degree of freedom at the end, with the band of as many consistent predictions, and how
far off the motion was as a multiple of the root mean square that is stated. ``-o`` keeps a line of JSON for each prediction.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from experiments.command_line import rows_of_seeds, run_study
from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.evaluation.prediction_errors import errors_ahead
from spinfilters.io.dataset import Segment
from spinfilters.run.comparison_run import compare_dataset
from spinfilters.run.predictions import predict_history, stamps_ahead
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate, without_map

ESTIMATORS: Final = ("mekf", "smoother")


def rows_of(seed: int, measured: float, ahead: float) -> Iterator[dict[str, Any]]:
    """A row for the prediction of every estimator."""
    whole = without_map(simulate(Scenario(seed=seed)))
    dataset = whole.part(Segment(None, None, measured, True, ""))
    comparison = compare_dataset(dataset, Settings(estimators=ESTIMATORS, verdict="filter"))
    for evaluation in comparison.evaluations:
        assert evaluation.truth is not None
        steps = stamps_ahead(evaluation.history.time, ahead, evaluation.truth.time)
        predicted = predict_history(comparison.setup.process, evaluation.history, steps)
        errors = errors_ahead(predicted, evaluation)
        if errors is not None:
            yield {"seed": seed, "estimator": evaluation.name, "dof": errors.dof, **errors.document}


def lines_of(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Lines of the report."""
    for name in ESTIMATORS:
        own = [row for row in rows if row["estimator"] == name and row["nees_per_dof_end"] is not None]
        if not own:
            continue
        dof = own[0]["dof"]
        low, high = (float(limit) / dof for limit in chi_square_band(dof, len(own)))
        inside = np.mean(
            [row["nees_band_95"][0] <= row["nees_per_dof_end"] <= row["nees_band_95"][1] for row in own]
        )
        mean = np.mean([row["nees_per_dof_end"] for row in own])
        yield (
            f"{name}: {len(own)} predictions over {own[0]['seconds']:.4g} s, NEES per degree of freedom {mean:.3f} "
            f"(band {low:.3f} to {high:.3f}), {100 * inside:.0f} % of them in their own band of 95 %"
        )
        ratios = {
            quantity: np.sqrt(
                np.mean(
                    [
                        (row["errors"][quantity]["end"] / row["errors"][quantity]["end_std"]) ** 2
                        for row in own
                    ]
                )
            )
            for quantity in own[0]["errors"]
        }
        yield "  error over stated, " + ", ".join(
            f"{quantity} {ratio:.2f}" for quantity, ratio in ratios.items()
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--measured", type=float, default=40.0, help="seconds before the cut")
    parser.add_argument("--ahead", type=float, default=17.0, help="seconds predicted")
    parser.add_argument("-o", "--output", type=Path, default=None)
    options = parser.parse_args(arguments)
    seeds = range(options.first, options.first + options.seeds)
    rows = rows_of_seeds(lambda seed: rows_of(seed, options.measured, options.ahead), seeds, options.output)
    for line in lines_of(rows):
        print(line)


if __name__ == "__main__":
    run_study(main)
