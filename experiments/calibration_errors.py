"""NEES under calibration errors, with and without consider covariance.

The calibration is wrong by what is stated of it.
    python -m experiments.calibration_errors [--seeds 30] [--first 0] [--cases tracks]

Every run reads simulated measurements with a calibration whose errors are drawn from the stated deviations: focal length 0.5 %,
principal point 2 px, baseline 2 %, scale of a gyro 2 %, of the clock 1 %. Printed is, of each case and estimator, the NEES per
degree of freedom over its own epochs (of a gyro: of rate and mass distribution) with the whole covariance and with its random part
alone: means over the runs, and how many were `ok`.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from experiments.command_line import run_study
from spinfilters.evaluation.epoch_spans import own_span
from spinfilters.evaluation.estimator_evaluation import Evaluation, evaluate, without_calibration
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.models.status import Verdict
from spinfilters.run.estimation import ComparisonExtent, compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate, without_map

DEVIATIONS: Final = {
    "focal_std": 0.005,
    "center_std": 2.0,
    "baseline_std": 0.02,
    "gyro_scale_std": 0.02,
    "clock_scale_std": 0.01,
}
CASES: Final = {
    "tracks": replace(Scenario.rich(), epochs=60, landmarks=250),
    "pose": replace(Scenario.rich(), kind="pose", epochs=120),
    "gyro": replace(Scenario.rich(), kind="gyro", epochs=200),
}


@dataclass(frozen=True)
class Honesty:
    """NEES per degree of freedom of one run, by whole and random covariance."""

    estimator: str
    total: float
    random: float
    is_ok: bool


def miscalibrated(dataset: Dataset, errors: Mapping[str, np.ndarray]) -> Dataset:
    """Data as read with errors of the calibration, by `ConsiderParameter.name`."""
    slower = 1 - float(errors["clock_scale_std"][0])
    streams = []
    for stream in dataset.log.streams:
        reads_rates = sensor_of(stream.sensor).measured_rates(stream) is not None
        scale = 1 + float(errors["gyro_scale_std"][0]) if reads_rates else 1.0
        streams.append(replace(stream, time=slower * stream.time, values=scale * stream.values))
    truth, rig = dataset.truth, dataset.rig
    assert truth is not None
    if rig is not None and rig.baseline_m:
        focal, centre = 1 - float(errors["focal_std"][0]), errors["center_std"].tolist()
        moved = {"cx": rig.left.cx - centre[0], "cy": rig.left.cy - centre[1]}
        left = replace(rig.left, fx=focal * rig.left.fx, fy=focal * rig.left.fy, **moved)
        rig = replace(rig, left=left, baseline_m=rig.baseline_m * (1 - float(errors["baseline_std"][0])))
    truth = replace(truth, time=slower * truth.time)
    return replace(dataset, log=MeasurementLog(tuple(streams)), truth=truth, rig=rig)


def drawn_errors(generator: np.random.Generator) -> dict[str, np.ndarray]:
    """Errors of the stated deviations."""
    return {name: std * generator.standard_normal(2) for name, std in DEVIATIONS.items()}


def honesty(scenario: Scenario, seed: int, estimators: Sequence[str]) -> Iterator[Honesty]:
    """NEES of one run, for all estimators."""
    dataset = simulate(replace(scenario, seed=seed))
    errors = drawn_errors(np.random.default_rng([seed, 15]))
    dataset = miscalibrated(without_map(dataset), errors)
    settings = Settings(estimators=tuple(estimators), calibration=DEVIATIONS)  # pyright: ignore[reportArgumentType]
    extent = ComparisonExtent(bounding=lambda evaluations, _: list(evaluations))
    compared = compare_estimators(prepare(dataset, settings), settings, lambda *_: None, extent=extent)
    for each in compared.evaluations:
        alone = evaluate(without_calibration(each.history), dataset.truth, each.alignment)
        is_ok = each.history.status.verdict is Verdict.OK
        yield Honesty(each.name, _nees(each), _nees(alone), is_ok)


def _nees(evaluation: Evaluation) -> float:
    """NEES per degree of freedom of the state over the estimator's own epochs; a gyro's is of rate and mass distribution."""
    nees = own_span(evaluation).nees
    return np.nan if nees is None else nees.mean


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cases", default=",".join(CASES))
    parser.add_argument("--estimators", default="mekf,ukf,smoother")
    options = parser.parse_args()
    for name in options.cases.split(","):
        found = [
            each
            for seed in range(options.first, options.first + options.seeds)
            for each in honesty(CASES[name], seed, options.estimators.split(","))
        ]
        for estimator in options.estimators.split(","):
            own = [each for each in found if each.estimator == estimator]
            total, random = (np.array([getattr(each, part) for each in own]) for part in ("total", "random"))
            print(
                f"{name} {estimator}: total {np.nanmean(total):.2f} (at most {np.nanmax(total):.2f}), random part alone "
                f"{np.nanmean(random):.1f}; ok {sum(each.is_ok for each in own)} of {len(own)}"
            )


if __name__ == "__main__":
    run_study(main)
