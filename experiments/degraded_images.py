"""Degraded stereo images: losses, and errors over stated deviations.

    python -m experiments.degraded_images SEQUENCE FOLDER --kinds missing frozen dark salt blur eclipse all

SEQUENCE is a rendered folder (`spinfilters simulate --kind stereo-images`), FOLDER takes the degraded copies. Prints verdict and
errors of each estimator, the largest Mahalanobis length of each block of its state over its own epochs, and what was lost.
"""

import argparse
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import degrees
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from jaxtyping import UInt8

from experiments.command_line import run_study
from spinfilters.core.errors import InputError
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.run.comparison_run import compare_dataset
from spinfilters.settings.run_settings import Settings
from spinfilters.vision.image_folder import CAMERAS, IMAGES, LIST
from spinfilters.vision.track_images import track_images

Image = UInt8[np.ndarray, "h w"]
SALT: Final = 0.02
"""Share of pixels that are black or white."""
BLUR_PX: Final = 5
FROZEN_S, ECLIPSE_S, DARK_S = (20.0, 22.0), (25.0, 35.0), 30.0
"""Times of the left camera's repeated image, of darkness, and from which on half the light is left."""
ESTIMATORS: Final = ("mekf", "smoother")


@dataclass(frozen=True)
class Shot:
    """Time and camera of an image.

    ``time`` (s), ``number`` in the sequence, ``camera`` 0 or 1.
    """

    time: float
    number: int
    camera: int


def dark(image: Image, shot: Shot) -> Image:
    """Half the light."""
    return image // 2 if shot.time >= DARK_S else image


def eclipse(image: Image, shot: Shot) -> Image:
    """No light."""
    return np.zeros_like(image) if _within(shot.time, ECLIPSE_S) else image


def blur(image: Image, _shot: Shot) -> Image:
    """Mean of 5 x 5 pixels."""
    return np.asarray(cv2.blur(image, (BLUR_PX, BLUR_PX)), dtype=np.uint8)


def salt(image: Image, shot: Shot) -> Image:
    """Black and white pixels."""
    drawn, spoiled = np.random.default_rng((shot.number, shot.camera)).random(image.shape), image.copy()
    spoiled[drawn < SALT / 2], spoiled[drawn > 1 - SALT / 2] = 255, 0
    return spoiled


CHANGES: Final[dict[str, Callable[[Image, Shot], Image]]] = {
    each.__name__: each for each in (dark, eclipse, blur, salt)
}
"""Of an image."""
KINDS: Final = ("missing", "frozen", *CHANGES)
"""missing: every tenth image of the right camera.   frozen: the left one repeats its image of 20 s for 2 s."""


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sequence", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--kinds", nargs="+", choices=(*KINDS, "all"), default=[*KINDS, "all"])
    options = parser.parse_args()
    for kind in options.kinds:
        place = options.folder / kind
        _degraded(options.sequence, place, KINDS if kind == "all" else (kind,))
        print(f"{kind}:", flush=True)
        try:
            _measured(place)
        except InputError as error:
            print(f"    refused: {error}", flush=True)


def _degraded(source: Path, place: Path, kinds: Sequence[str]) -> None:
    """Write a copy of a sequence with these kinds of degradation."""
    place.mkdir(parents=True, exist_ok=True)
    for name in ("truth.csv", "truth.toml", "dataset.toml"):
        shutil.copy(source / name, place)
    for number, camera in enumerate(CAMERAS):
        (place / camera / IMAGES).mkdir(parents=True, exist_ok=True)
        for name in ("sensor.yaml", LIST):
            shutil.copy(source / camera / name, place / camera)
        files = [
            line.split(",") for line in (source / camera / LIST).read_text().splitlines() if line[0] != "#"
        ]
        shots = [Shot((int(ns) - int(files[0][0])) * 1e-9, k, number) for k, (ns, _) in enumerate(files)]
        held = next(shot for shot in shots if shot.time >= FROZEN_S[0])
        for shot in shots:
            taken = held if "frozen" in kinds and not number and _within(shot.time, FROZEN_S) else shot
            if "missing" not in kinds or not number or shot.number % 10 != 9:
                image = cv2.imread(
                    str(source / camera / IMAGES / files[taken.number][1]), cv2.IMREAD_GRAYSCALE
                )
                for change in (CHANGES[kind] for kind in kinds if kind in CHANGES):
                    image = change(np.asarray(image, dtype=np.uint8), taken)
                cv2.imwrite(str(place / camera / IMAGES / files[shot.number][1]), np.asarray(image))


def _within(time: float, span: tuple[float, float]) -> bool:
    return span[0] <= time < span[1]


def _measured(images: Path) -> None:
    tracked = track_images(images)
    for evaluation in compare_dataset(tracked.dataset, Settings(estimators=ESTIMATORS)).evaluations:
        print(f"    {_line(evaluation)}", flush=True)
        for reason in evaluation.history.status.reasons:
            print(f"        {reason[:240]}")
    for sentence in tracked.losses.sentences():
        print(f"    {sentence}", flush=True)


def _line(evaluation: Evaluation) -> str:
    verdict, errors, nees = evaluation.history.status.verdict, evaluation.errors, evaluation.nees
    if errors is None or nees is None or errors.rms.position is None or errors.rms.attitude is None:
        return f"{evaluation.name}: {verdict}, no errors"
    own = nees.within(evaluation.own_begin or 0.0, np.inf) or nees
    longest = {name: float(np.sqrt(values.max())) for name, values in own.blocks.items()}
    return (
        f"{evaluation.name}: {verdict}, {len(evaluation.history.time)} epochs, position {1e3 * errors.rms.position:.2f} mm, "
        f"attitude {degrees(errors.rms.attitude):.3f} deg, rate {degrees(errors.rms.rate):.3f} deg/s, NEES {own.mean:.2f}, longest "
        + ", ".join(f"{name} {length:.1f}" for name, length in longest.items())
    )


if __name__ == "__main__":
    run_study(main)
