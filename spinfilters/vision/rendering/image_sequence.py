"""Rendered stereo pairs of a true motion in the EuRoC layout."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import repeat
from pathlib import Path
from typing import Final, NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from spinfilters.attitude.conversions import matrix_from_quaternion
from spinfilters.data.atomic_write import make_folder, write_bytes, write_text, write_toml
from spinfilters.data.consider_parameter import exact_calibration
from spinfilters.data.dataset import INSPECTOR_FILE
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.pose_files import write_tum
from spinfilters.data.truth import Truth, write_truth
from spinfilters.geometry.camera_trajectory import CameraTrajectory
from spinfilters.vision.raw_rig import RawCamera, RawRig, write_raw_rig
from spinfilters.vision.rendering.body_view import Appearance, View, body_image
from spinfilters.vision.rendering.imaging import Imaging, add_stars, ideal_matrix, photograph

MARGIN_PX = 24
"""Around the image, so that a distorted image has no empty rim."""
NANOSECONDS = 1_000_000_000

Pair = tuple[UInt8[np.ndarray, "h w"], UInt8[np.ndarray, "h w"]]


class FramePose(NamedTuple):
    """Rotation (3, 3) to frame i and place (3,), m, of a frame in i."""

    rotation: Float[np.ndarray, "3 3"]
    place: Float[np.ndarray, " 3"]


AT_REST: Final = FramePose(np.eye(3), np.zeros(3))
"""Of the raw left camera where it is frame i."""


@dataclass(frozen=True)
class SeenMotion:
    """True motion of a body, and of the camera that sees it.

    ``inspector`` holds the poses of the raw left camera in i; None of one at rest, which is frame i.
    """

    truth: Truth
    inspector: CameraTrajectory | None = None

    def poses(self) -> Iterator[tuple[FramePose, FramePose]]:
        """Poses of g and of the raw left camera in i.

        The origin of g is told by `Truth.center_of_mass_g`.
        """
        truth = self.truth
        rotations = matrix_from_quaternion(truth.q_ig)
        offset = np.zeros(3) if truth.center_of_mass_g is None else truth.center_of_mass_g
        of_body = map(FramePose, rotations, truth.center_of_mass - rotations @ offset)
        if self.inspector is None:
            return zip(of_body, repeat(AT_REST))
        seen_from = self.inspector.at(truth.time)
        return zip(
            of_body, map(FramePose, matrix_from_quaternion(seen_from[:, 3:]), seen_from[:, :3]), strict=True
        )


@dataclass(frozen=True)
class RenderedScene:
    """Rendered scene: a body before a stereo rig.

    Attributes
    ----------
    body: as it looks.   rig: of raw cameras.   imaging: of both.   seed: of noise and stars.
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

    def pair(self, body: FramePose, number: int, camera: FramePose = AT_REST) -> Pair:
        """Left and right image by the poses of g and of the raw left camera.

        The number chooses the noise.
        """
        generator = np.random.default_rng([self.seed, 2, number])
        left, right = (
            self._image(each, body, self._view(each, camera), generator)
            for each in (self.rig.left, self.rig.right)
        )
        return left, right

    def _view(self, camera: RawCamera, left: FramePose) -> FramePose:
        """Pose of a camera of the rig in i, by that of the left one."""
        turn = left.rotation @ self.rig.left.R_bc.T
        return FramePose(turn @ camera.R_bc, left.place + turn @ (camera.t_bc - self.rig.left.t_bc))

    def _image(
        self, camera: RawCamera, body: FramePose, view: FramePose, generator: np.random.Generator
    ) -> UInt8[np.ndarray, "h w"]:
        ratio = self.imaging.oversampling
        K = ideal_matrix(camera, ratio, MARGIN_PX)
        shape = ((camera.height + 2 * MARGIN_PX) * ratio, (camera.width + 2 * MARGIN_PX) * ratio)
        radiance, _ = body_image(self.body, *body, View(K, shape, *view))
        directions, brightness = self.stars
        add_stars(radiance, directions @ view.rotation, brightness, K)
        return photograph(radiance, camera, MARGIN_PX, self.imaging, generator)


def rendered_pairs(stage: RenderedScene, motion: SeenMotion) -> Iterator[Pair]:
    """A pair at every time of a true motion."""
    for number, (body, camera) in enumerate(motion.poses()):
        yield stage.pair(body, number, camera)


def write_sequence(
    stage: RenderedScene,
    motion: SeenMotion,
    folder: Path,
    description: str,
    progress: Callable[[int, int], None],
) -> None:
    """Render a motion into a folder.

    Images, calibration, truth, the inspector's poses and, last, dataset.toml.

    Parameters
    ----------
    progress: called after every pair with how many are done, and of how many.
    """
    stamps = np.round(motion.truth.time * NANOSECONDS).astype(np.int64).tolist()
    for camera in ("cam0", "cam1"):
        make_folder(folder / camera / "data")
        rows = [f"{stamp},{stamp:019d}.png" for stamp in stamps]
        write_text(folder / camera / "data.csv", "\n".join(["#timestamp [ns],filename", *rows]) + "\n")
    for number, (stamp, pair) in enumerate(zip(stamps, rendered_pairs(stage, motion), strict=True)):
        for camera, image in zip(("cam0", "cam1"), pair, strict=True):
            encoded = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1]
            write_bytes(folder / camera / "data" / f"{stamp:019d}.png", encoded.tobytes())
        progress(number + 1, len(stamps))
    write_raw_rig(stage.rig, folder)
    write_truth(motion.truth, folder)
    if motion.inspector is not None:
        write_tum(
            folder / INSPECTOR_FILE, MeasurementStream("pose", motion.inspector.time, motion.inspector.poses)
        )
    document = {
        "kind": "stereo-images",
        "description": description,
        "calibration": exact_calibration(("stereo",), inspector=motion.inspector is not None),
    }
    write_toml(folder / "dataset.toml", document)
