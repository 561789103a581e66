"""The real throws: a bare phone, and a phone on a racquet, from their gyro alone.

    python -m experiments.gyro_throws DATA/racquet_phyphox/data [-o runs/throws]

Prints the moments of the phone's clean tosses with the error of rates predicted 0.3 s ahead, and the medians over all racquet
throws with drag, between the marks that people set, which hold some of the hand, and between the ends of the flights that are
found; draws the fitted inertia of every racquet throw.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.command_line import run_study
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.inference.setup import Setup
from spinfilters.io.dataset import Dataset
from spinfilters.io.output_files import make_folder
from spinfilters.plots.style import save_figure
from spinfilters.plots.throws import Throw, throws_figure
from spinfilters.run.estimation import compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.run.readers import read_dataset
from spinfilters.run.segment_choice import ALL, AUTO, read_several
from spinfilters.settings.run_settings import Settings

PHONE = "round1/Gyroscope rotation rate 2025-01-16 17-10-11"
SETTINGS = Settings(estimators=("mekf", "ukf"))
AHEAD = 0.3
MEANT = {ALL: "as marked", AUTO: "as found"}


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/throws"))
    options = parser.parse_args()
    make_folder(options.output)
    for segment in (3, 4):
        setup, evaluations = estimate(read_dataset(options.data / PHONE, segment), SETTINGS)
        for evaluation in evaluations:
            error = prediction_errors(setup, evaluation)
            print(
                f"phone, segment {segment}, {evaluation.name}: moments {np.round(evaluation.body.principal_moments, 3)}, rate "
                f"{AHEAD} s ahead: rms {100 * np.sqrt(np.mean(error**2)):.1f} %, largest {100 * error.max():.1f} % of |w|"
            )
    for which in (ALL, AUTO):
        racquet(options.data, options.output, which)


def racquet(data: Path, output: Path, which: str) -> None:
    """Every throw of rounds 2 and 3 that is marked (``all``) or found (``auto``), with drag."""
    settings = replace(SETTINGS, process=replace(SETTINGS.process, drag=True))
    folders = sorted(path for round_ in ("round2", "round3") for path in (data / round_).iterdir())
    results: dict[str, list[tuple[Throw, bool]]] = {name: [] for name in SETTINGS.estimators}
    for dataset in [dataset for folder in folders for dataset in read_several(folder, which)]:
        for evaluation in estimate(dataset, settings)[1]:
            ok = evaluation.history.status.verdict == "ok"
            number = len(results[evaluation.name])
            results[evaluation.name].append((Throw.from_body(number, evaluation.body, not ok), ok))
    for name, throws in results.items():
        ratios = np.array([throw.ratios for throw, ok in throws if ok])
        std = np.array([np.sqrt(np.diag(throw.covariance)) for throw, ok in throws if ok])
        middle = np.median(ratios, axis=0)
        print(
            f"racquet, {MEANT[which]}, {name}: {len(ratios)} of {len(throws)} throws ok, median J1/J3 {middle[0]:.4f}, "
            f"J2/J3 {middle[1]:.4f}, rms departure from the median in own standard deviations "
            f"{np.sqrt(np.mean(((ratios - middle) / std) ** 2)):.2f}"
        )
        save_figure(throws_figure([throw for throw, _ in throws]), output / f"throws-{which}-{name}.png")


def estimate(dataset: Dataset, settings: Settings) -> tuple[Setup, tuple[Evaluation, ...]]:
    """Both filters on one throw."""
    setup = prepare(dataset, settings)
    return setup, compare_estimators(setup, settings, lambda *_: None).evaluations


def prediction_errors(setup: Setup, evaluation: Evaluation) -> np.ndarray:
    """Relative prediction errors of the rate, 0.3 s ahead.

    |w predicted - w measured| / |w measured| of every frame from the end of the start on.
    """
    gyro, history = setup.dataset.log.stream("gyro"), evaluation.history
    rate = history.layout.mean_slice("w")
    errors = []
    for index in np.flatnonzero(history.time >= setup.end_of_initialisation):
        later = int(np.searchsorted(gyro.time, history.time[index] + AHEAD))
        if later < len(gyro.time):
            ahead = setup.process.step(history.mean[index], float(gyro.time[later] - history.time[index]))
            measured = gyro.values[later]
            errors.append(np.linalg.norm(ahead[rate] - measured) / np.linalg.norm(measured))
    return np.array(errors)


if __name__ == "__main__":
    run_study(main)
