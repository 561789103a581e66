"""Map errors after two revolutions and after all: the gain by loop closure.

    python -m experiments.loop_closure RUN SHAPE [RUN SHAPE ...]

Each RUN is one of `spinfilters compare` of rendered images (`experiments.image_sequences` renders). Its first two revolutions are
tracked and smoothed alone. Printed are the median distances of landmarks to the true surface: of all landmarks of both maps, and of
pairs of one place (within 1 mm in both), which are like with like: later landmarks have fewer observations. With 95 % intervals of
the difference (bootstrap).
"""

import sys
import tempfile
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from experiments.command_line import run_study
from experiments.map_accuracy import landmarks_on, surface_distance
from spinfilters.run.comparison_run import RunOutput, compare_into
from spinfilters.run.reconstruction import images_of
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.body_view import named_mesh
from spinfilters.vision.image_folder import CAMERAS, IMAGES, LIST
from spinfilters.vision.track_images import track_images

PAIRS: Final = 24
"""Of two revolutions at 10.3 rpm, 0.5 s apart."""
SAME_M: Final = 1e-3
RADIUS_M: Final = 0.11
DRAWN: Final = 1000


def main() -> None:
    """Run the study."""
    arguments = sys.argv[1:]
    for run, shape in zip(arguments[::2], arguments[1::2], strict=True):
        mesh = named_mesh(shape, RADIUS_M)
        late = landmarks_on(Path(run), mesh)
        with tempfile.TemporaryDirectory() as folder:
            early = landmarks_on(_first_revolutions(Path(run), Path(folder)), mesh)
        before, after = (1e3 * np.abs(surface_distance(points, mesh)) for points in (early, late))
        gap, match = (np.asarray(found) for found in KDTree(late).query(early))
        same = gap < SAME_M
        print(
            f"{Path(run).name}: all {np.median(before):.4f} mm of {len(before)}, {np.median(after):.4f} of {len(after)}; "
            f"same places {_compared(before[same], after[match[same]])}",
            flush=True,
        )


def _compared(before: Float[np.ndarray, " k"], after: Float[np.ndarray, " k"]) -> str:
    rows = np.random.default_rng(0).integers(len(before), size=(DRAWN, len(before)))
    low, high = np.quantile(np.median(after[rows], axis=1) - np.median(before[rows], axis=1), (0.025, 0.975))
    return (
        f"{np.median(before):.4f} mm, {np.median(after):.4f} of {len(before)}, difference {low:.4f} to {high:.4f}, "
        f"root mean square {np.sqrt(np.mean(before**2)):.4f}, {np.sqrt(np.mean(after**2)):.4f}"
    )


def _first_revolutions(run: Path, folder: Path) -> Path:
    """Run of the first pairs of a run's images."""
    images, part = images_of(run, None), folder / "images"
    for camera in CAMERAS:
        (part / camera).mkdir(parents=True)
        (part / camera / IMAGES).symlink_to((images / camera / IMAGES).resolve())
        (part / camera / "sensor.yaml").write_text((images / camera / "sensor.yaml").read_text())
        lines = [line for line in (images / camera / LIST).read_text().splitlines() if line[0] != "#"]
        (part / camera / LIST).write_text("\n".join(lines[:PAIRS]) + "\n")
    for name in ("truth.csv", "truth.toml", "dataset.toml"):
        (part / name).write_text((images / name).read_text())
    compare_into(track_images(part).dataset, Settings(estimators=("smoother",)), RunOutput(folder / "run"))
    return folder / "run"


if __name__ == "__main__":
    run_study(main)
