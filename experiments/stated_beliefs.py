"""Filters and smoother that begin from a stated belief: NEES with its band over draws.

    python -m experiments.stated_beliefs [--draws 100] [--first 0] [--sensors pose,gyro] [--estimators mekf,ukf]
        [--frames 60] [--pixel-std 1] [-o FILE]

Every draw has a recording and a belief of its own, whose error is drawn about the truth with the stated deviations
(``initialisation.from_truth``). The noise is stated. The table has the mean NEES per degree of freedom at the second and the last
epoch, with the band that holds 99 % of such means of consistent estimates; of a gyro it is that of rate and moments. Tracks have no
map (``--sensors stereo-tracks``): filters alone, and an exact first pose. ``ekf-joint`` there shows what a textbook filter states.
``-o`` keeps a line of JSON for each estimate.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.stats import chi2

from experiments.command_line import rows_of_seeds, run_study
from spinfilters.inference.setup import maps_landmarks
from spinfilters.run.comparison_run import compare_dataset
from spinfilters.run.given_belief import POSE_WORDS
from spinfilters.settings.run_settings import InitialisationOptions, Settings
from spinfilters.simulation.scenario import Scenario, simulate, without_map

ESTIMATORS: Final = ("mekf", "ukf", "smoother")
RATE_RPM: Final = (4.0, 9.0, 3.0)
STD: Final = {
    "position": 0.005,
    "attitude": 0.02,
    "velocity": 0.005,
    "center_of_mass": 0.005,
    "rate": 0.02,
    "mass_distribution": 0.05,
}
"""Of the beliefs; blocks that a state lacks are left out."""
EPOCHS: Final = {"second": 1, "last": -1}
COVERAGE: Final = 0.99
"""Of the band of a mean."""


def rows_of(
    seed: int, sensor: str, estimators: Sequence[str], frames: int, pixel_std: float
) -> Iterator[dict[str, Any]]:
    """A row for each estimator of one draw."""
    scenario = Scenario(kind=sensor, seed=seed, epochs=frames, rate_rpm=RATE_RPM, pixel_std=pixel_std)
    dataset = without_map(simulate(scenario))
    std = dict(STD)
    if maps_landmarks(dataset):  # the first pose defines g, and smoothers begin otherwise
        std = {name: value for name, value in STD.items() if name not in POSE_WORDS}
        estimators = tuple(name for name in estimators if name != "smoother")
    belief = InitialisationOptions(from_truth=True, draw=seed, std=std)
    settings = Settings(estimators=tuple(estimators), verdict="filter", initialisation=belief)
    for evaluation in compare_dataset(dataset, settings).evaluations:
        nees = evaluation.rotation_nees if evaluation.nees is None else evaluation.nees
        if nees is None:
            continue
        found = {name: float(nees.total[row]) for name, row in EPOCHS.items()}
        yield {"seed": seed, "sensor": sensor, "estimator": evaluation.name, "dof": nees.dof, **found}


def lines_of(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Lines of the report."""
    for sensor in dict.fromkeys(row["sensor"] for row in rows):
        for name in dict.fromkeys(row["estimator"] for row in rows):
            own = [row for row in rows if row["sensor"] == sensor and row["estimator"] == name]
            if not own:
                continue
            count = len(own) * own[0]["dof"]
            low, high = chi2.ppf([(1 - COVERAGE) / 2, (1 + COVERAGE) / 2], count) / count
            means = {each: np.mean([row[each] for row in own]) / own[0]["dof"] for each in EPOCHS}
            told = ", ".join(f"{mean:.3f} at the {each} epoch" for each, mean in means.items())
            yield f"{sensor}, {name}: {len(own)} draws, NEES per degree of freedom {told} (band {low:.3f} to {high:.3f})"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--sensors", default="pose,gyro")
    parser.add_argument("--estimators", default=",".join(ESTIMATORS))
    parser.add_argument("--frames", type=int, default=60, help="epochs of a recording")
    parser.add_argument("--pixel-std", type=float, default=1.0, help="of tracks, px")
    parser.add_argument("-o", "--output", type=Path, default=None)
    options = parser.parse_args(arguments)
    seeds = range(options.first, options.first + options.draws)
    rows: list[dict[str, Any]] = []
    for sensor in options.sensors.split(","):
        rows += rows_of_seeds(
            lambda seed, of=sensor: rows_of(
                seed, of, options.estimators.split(","), options.frames, options.pixel_std
            ),
            seeds,
            options.output,
        )
    for line in lines_of(rows):
        print(line)


if __name__ == "__main__":
    run_study(main)
