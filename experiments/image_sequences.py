"""Rendered sequences from images to errors.

Front end and estimators on bodies and motions, truth and noise unknown to both.
    python -m experiments.image_sequences FOLDER --case box 1 4 9 3 --case spheres 0 0.5 10 0.5

Renders what FOLDER lacks (half a minute of processor time each), then measures the front end in processor time, in one piece and
on line, runs MEKF, UKF and smoother on its tracks, and prints one line of a table per estimator. Errors are root mean squares
after two revolutions; the last column holds position, attitude and rate over those of the last estimator, in the epochs that all
made themselves: those before are the filters' initialisation, which is a smoother of its own epochs alone.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from experiments.command_line import run_study
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.io.dataset_reader import has_images
from spinfilters.run.comparison_run import compare_dataset
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.image_sequence import IMAGE_RADIUS_M, ImageScenario, render
from spinfilters.simulation.scenario_record import Scenario
from spinfilters.vision.track_images import TrackedImages, track_images, track_images_online

ESTIMATORS: Final = ("mekf", "ukf", "smoother")
REVOLUTIONS: Final = 2.0
"""Before errors count."""


@dataclass(frozen=True)
class SequenceCase:
    """Body, seed, and initial rate about the principal axes, rpm."""

    shape: str
    seed: int
    rate_rpm: tuple[float, float, float]

    @property
    def name(self) -> str:
        """Name of the sequence's folder."""
        return f"{self.shape}-{self.seed}-{'-'.join(f'{rpm:g}' for rpm in self.rate_rpm)}"

    @property
    def begin(self) -> float:
        """Time after which errors count, s."""
        return REVOLUTIONS * 60 / float(np.linalg.norm(self.rate_rpm))


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--case",
        nargs=5,
        action="append",
        required=True,
        metavar=("SHAPE", "SEED", "RPM_X", "RPM_Y", "RPM_Z"),
    )
    parser.add_argument("--estimators", nargs="+", default=list(ESTIMATORS))
    options = parser.parse_args()
    print(
        "| case, estimator | verdict | position | attitude | rate | worst moment | NEES per dof | over the last |"
    )
    for shape, seed, *rpm in options.case:
        x, y, z = map(float, rpm)
        _measured(options.folder, SequenceCase(shape, int(seed), (x, y, z)), options.estimators)


def _measured(folder: Path, case: SequenceCase, estimators: Sequence[str]) -> None:
    images = folder / case.name
    if not has_images(images):
        motion = Scenario(radius_m=IMAGE_RADIUS_M, seed=case.seed, rate_rpm=case.rate_rpm)
        render(ImageScenario(motion, shape=case.shape), images)
    begin = time.process_time()
    tracked = track_images(images)
    middle = time.process_time()
    online = track_images_online(images)
    end = time.process_time()
    comparison = compare_dataset(tracked.dataset, Settings(estimators=tuple(estimators)))
    for line in lines(case, comparison.evaluations):
        print(line, flush=True)
    print(
        f"{case.name}: front end {middle - begin:.1f} s, on line {_pairs(online) / (end - middle):.1f} pairs a second of processor "
        f"time; inflation {tracked.document['error_correlation']['inflation']:.2f}",
        flush=True,
    )


def _pairs(tracked: TrackedImages) -> int:
    return tracked.losses.kept["image pairs"]


def lines(case: SequenceCase, evaluations: Sequence[Evaluation]) -> list[str]:
    """Lines of a table, one per estimator."""
    own = max(case.begin, *(each.own_begin or 0.0 for each in evaluations))
    last = _sizes(evaluations[-1], own)
    return [_line(case, each, _sizes(each, own) / last) for each in evaluations]


def _sizes(evaluation: Evaluation, begin: float) -> Float[np.ndarray, " 3"]:
    """Root mean squares of position, attitude and rate from a time on.

    Not a number without errors.
    """
    errors = None if evaluation.errors is None else evaluation.errors.within(begin, np.inf)
    rms = None if errors is None else errors.rms
    return np.array([np.nan] * 3 if rms is None else [rms.position, rms.attitude, rms.rate], dtype=float)


def _line(case: SequenceCase, evaluation: Evaluation, ratios: Float[np.ndarray, " 3"]) -> str:
    """Line of a table: rms errors after two revolutions, NEES over own epochs."""
    status = evaluation.history.status
    moments = None if evaluation.body_errors is None else evaluation.body_errors.principal_moments
    errors = None if evaluation.errors is None else evaluation.errors.within(case.begin, np.inf)
    nees = None if evaluation.nees is None else evaluation.nees.within(evaluation.own_begin or 0.0, np.inf)
    rms = None if errors is None else errors.rms
    if rms is None or rms.position is None or rms.attitude is None or nees is None or moments is None:
        return f"| {case.name}, {evaluation.name} | {status.verdict} | no errors: {'; '.join(status.reasons)[:160]} |"
    return (
        f"| {case.name}, {evaluation.name} | {status.verdict} | {1e3 * rms.position:.2f} mm | {degrees(rms.attitude):.3f} deg | "
        f"{degrees(rms.rate):.3f} deg/s | {np.abs(moments).max():.4f} | {nees.mean:.2f} | "
        f"{', '.join(f'{ratio:.2f}' for ratio in ratios)} |"
        + "".join(f"\n    {reason[:240]}" for reason in status.reasons)
    )


if __name__ == "__main__":
    run_study(main)
