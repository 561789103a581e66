"""The front end on a rendered sequence: stereo images to tracks.

    python -m experiments.benchmarks.front_end [--pairs 115] [--images FOLDER]

FOLDER is kept and used again; without it the sequence is rendered into a temporary folder, which takes half a minute.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

from experiments.benchmarks.stopwatch import begin_benchmark, now
from experiments.command_line import run_study
from spinfilters.io.dataset_reader import has_images
from spinfilters.simulation.image_sequence import IMAGE_RADIUS_M, ImageScenario, render
from spinfilters.simulation.scenario import RICH_RPM
from spinfilters.simulation.scenario_record import Scenario
from spinfilters.vision.track_images import track_images


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pairs", type=int, default=115)
    parser.add_argument("--images", type=Path)
    given = parser.parse_args()
    begin_benchmark("experiments.benchmarks.front_end")
    seconds = front_end_seconds(given.pairs, given.images)
    print(f"{given.pairs} pairs: {seconds:.1f} s, {1e3 * seconds / given.pairs:.0f} ms a pair")


def front_end_seconds(pairs: int, images: Path | None = None) -> float:
    """Seconds from images to tracks."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "images" if images is None else images
        if not has_images(folder):
            motion = Scenario(radius_m=IMAGE_RADIUS_M, seed=1, rate_rpm=RICH_RPM)
            render(ImageScenario(replace(motion, epochs=pairs), shape="box"), folder)
        begin = now()
        track_images(folder)
        return now() - begin


if __name__ == "__main__":
    run_study(main)
