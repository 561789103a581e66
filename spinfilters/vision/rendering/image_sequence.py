"""Rendered stereo pairs of a true motion in the EuRoC layout."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from spinfilters.attitude.conversions import matrix_from_quaternion
from spinfilters.data.atomic_write import make_folder, write_bytes, write_text, write_toml
from spinfilters.data.consider_parameter import exact_calibration
from spinfilters.data.truth import Truth, write_truth
from spinfilters.vision.raw_rig import RawCamera, RawRig, write_raw_rig
from spinfilters.vision.rendering.body_view import Appearance, View, body_image
from spinfilters.vision.rendering.imaging import Imaging, add_stars, ideal_matrix, photograph

MARGIN_PX = 24
"""Around the image, so that a distorted image has no empty rim."""
NANOSECONDS = 1_000_000_000

Pair = tuple[UInt8[np.ndarray, "h w"], UInt8[np.ndarray, "h w"]]


@dataclass(frozen=True)
class RenderedScene:
    """Rendered scene: a body before a stereo rig.

    Attributes
    ----------
    body: as it looks.   rig: of raw cameras; frame i is the left one's at rest.   imaging: of both.   seed: of noise and stars.
    """

    body: Appearance
    rig: RawRig
    imaging: Imaging = field(default_factory=Imaging)
    seed: int = 0

    @cached_property
    def stars(self) -> tuple[Float[np.ndarray, "s 3"], Float[np.ndarray, " s"]]:
        """Directions in i, and radiance of a sample."""
        generator = np.random.default_rng([self.seed, 1])
        sky = generator.standard_normal(
            (self.imaging.stars * 14, 3)
        )  # a field of view is about a 14th of the sky
        sky /= np.linalg.norm(sky, axis=1, keepdims=True)
        return sky, generator.pareto(1.5, len(sky)) + 0.5

    def pair(self, R_ig: Float[np.ndarray, "3 3"], t_ig: Float[np.ndarray, " 3"], number: int) -> Pair:
        """Left and right image of a pose; the number chooses the noise."""
        generator = np.random.default_rng([self.seed, 2, number])
        left, right = (
            self._image(camera, R_ig, t_ig, generator) for camera in (self.rig.left, self.rig.right)
        )
        return left, right

    def _image(
        self,
        camera: RawCamera,
        R_ig: Float[np.ndarray, "3 3"],
        t_ig: Float[np.ndarray, " 3"],
        generator: np.random.Generator,
    ) -> UInt8[np.ndarray, "h w"]:
        ratio, first = self.imaging.oversampling, self.rig.left
        K = ideal_matrix(camera, ratio, MARGIN_PX)
        shape = ((camera.height + 2 * MARGIN_PX) * ratio, (camera.width + 2 * MARGIN_PX) * ratio)
        R_ic, t_ic = first.R_bc.T @ camera.R_bc, first.R_bc.T @ (camera.t_bc - first.t_bc)
        radiance, _ = body_image(self.body, R_ig, t_ig, View(K, shape, R_ic, t_ic))
        directions, brightness = self.stars
        add_stars(radiance, directions @ R_ic, brightness, K)
        return photograph(radiance, camera, MARGIN_PX, self.imaging, generator)


def rendered_pairs(stage: RenderedScene, truth: Truth) -> Iterator[Pair]:
    """A pair at every time of a true motion whose body is known (`Truth.center_of_mass_g`)."""
    rotations = matrix_from_quaternion(truth.q_ig)
    offset = np.zeros(3) if truth.center_of_mass_g is None else truth.center_of_mass_g
    places = truth.center_of_mass - rotations @ offset
    for number, (R_ig, t_ig) in enumerate(zip(rotations, places, strict=True)):
        yield stage.pair(R_ig, t_ig, number)


def write_sequence(
    stage: RenderedScene, truth: Truth, folder: Path, description: str, progress: Callable[[int, int], None]
) -> None:
    """Render a motion into a folder: images, calibration, truth and dataset.toml, which comes last.

    Parameters
    ----------
    progress: called after every pair with how many are done, and of how many.
    """
    stamps = np.round(truth.time * NANOSECONDS).astype(np.int64).tolist()
    for camera in ("cam0", "cam1"):
        make_folder(folder / camera / "data")
        rows = [f"{stamp},{stamp:019d}.png" for stamp in stamps]
        write_text(folder / camera / "data.csv", "\n".join(["#timestamp [ns],filename", *rows]) + "\n")
    for number, (stamp, pair) in enumerate(zip(stamps, rendered_pairs(stage, truth), strict=True)):
        for camera, image in zip(("cam0", "cam1"), pair, strict=True):
            encoded = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1]
            write_bytes(folder / camera / "data" / f"{stamp:019d}.png", encoded.tobytes())
        progress(number + 1, len(stamps))
    write_raw_rig(stage.rig, folder)
    write_truth(truth, folder)
    document = {
        "kind": "stereo-images",
        "description": description,
        "calibration": exact_calibration(("stereo",)),
    }
    write_toml(folder / "dataset.toml", document)
