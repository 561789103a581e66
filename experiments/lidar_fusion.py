"""Lidar, stereo tracks and gyro of one motion, fused.

Points at 1 Hz, tracks at 2 Hz, gyro at 100 Hz, 60 s: together, and each alone.
python -m experiments.lidar_fusion [--seeds 1] [--estimator mekf] [--kind lidar-points]

Together it is one command: spinfilters simulate --kind lidar-points --interval 1 --frames 60 --beside stereo-tracks 0.5
--beside gyro 0.01 --known-map --rate-rpm 4 9 3 -o fusion, and spinfilters compare fusion.
"""

import argparse
from dataclasses import replace
from time import process_time

import numpy as np

from experiments.command_line import run_study
from spinfilters.api.simulation import simulate
from spinfilters.evaluation.trajectory_errors import TruthErrors, root_mean_square
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.sensor_format import sensor_format
from spinfilters.run.estimation import compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM

COMPARED = (40.0, 60.0)
"""Seconds over which errors are compared: every filter has then settled."""
BESIDE = {"stereo-tracks": 0.5, "gyro": 0.01}


def main() -> None:
    """Print a line for every choice of sensors and seed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--estimator", default="mekf")
    parser.add_argument("--kind", default="lidar-points", choices=("lidar-points", "lidar-poses"))
    options = parser.parse_args()
    for seed in range(options.seeds):
        whole = recording(options.kind, seed)
        estimate(whole, options.estimator)
        for sensor in whole.log.sensors:
            estimate(alone(whole, sensor), options.estimator)


def recording(kind: str, seed: int) -> Dataset:
    """All three sensors on one motion.

    The map of the tracks is known, so that all tell the same frame g.
    """
    return simulate(
        kind, seed=seed, frames=60, interval=1.0, rate_rpm=RICH_RPM, known_map=True, beside=BESIDE
    )


def alone(whole: Dataset, sensor: str) -> Dataset:
    """The measurements of one sensor."""
    form = sensor_format(sensor)
    log = MeasurementLog((whole.log.stream(sensor),))
    return replace(whole, kind=form.kind, log=log, known_map=whole.known_map if form.has_landmarks else None)


def estimate(dataset: Dataset, estimator: str) -> None:
    """Table line of one run."""
    settings, begin = Settings(estimators=(estimator,)), process_time()
    (found,) = compare_estimators(prepare(dataset, settings), settings, lambda *_: None).evaluations
    seconds = process_time() - begin
    rms = [] if found.errors is None else rms_of(found.errors)
    nees = None if found.nees is None else found.nees.within(*COMPARED)
    told = "" if nees is None else f", NEES per dof {nees.mean:.2f}"
    print(
        f"seed {dataset.options.notes['seed']}, {' + '.join(dataset.log.sensors)}: {seconds:.1f} s of one core, "
        f"{found.history.status.verdict}, RMS {', '.join(rms)}{told}",
        flush=True,
    )


def rms_of(errors: TruthErrors) -> list[str]:
    """RMS of the errors at whole seconds, where every sensor but the gyro measures, in words."""
    at = (errors.time >= COMPARED[0]) & (np.abs(errors.time - np.round(errors.time)) < 1e-6)
    quantities = {
        "mm": errors.position,
        "mrad": errors.attitude,
        "mm/s": errors.velocity,
        "mrad/s": errors.rate,
    }
    return [
        f"{1e3 * root_mean_square(values[at]):.2f} {unit}"
        for unit, values in quantities.items()
        if values is not None
    ]


if __name__ == "__main__":
    run_study(main)
