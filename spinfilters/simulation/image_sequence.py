"""Rendered stereo pairs of a simulated motion in the EuRoC layout: distortion, blur, exposure, noise and stars."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import repeat
from pathlib import Path
from typing import Final, NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from spinfilters.core.absolute_orientation import nearest_rotation
from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.camera_trajectory import CameraTrajectory
from spinfilters.io.consider_parameter import exact_calibration
from spinfilters.io.dataset import INSPECTOR_FILE
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.output_files import make_folder, write_bytes, write_text, write_toml
from spinfilters.io.sensor_tables import write_tum
from spinfilters.io.truth import Truth, write_truth
from spinfilters.simulation.body_view import Appearance, SurfaceTexture, View, body_image, named_mesh
from spinfilters.simulation.inspector import STATIC
from spinfilters.simulation.scenario import Scenario, silent, simulate
from spinfilters.vision.rectification import RawCamera, RawRig, write_raw_rig

WHITE = 255.0


@dataclass(frozen=True)
class Imaging:
    """Properties of both cameras.

    Attributes
    ----------
    exposure : float
        Grey value over 255 of radiance 1.
    blur_px : float
        Standard deviation of the point spread.
    read_noise : float
        Grey values.
    full_well : float
        Electrons at 255; their number is a Poisson number.
    stars : int
        In a field of view.
    oversampling : int
        Samples of a pixel along each axis.
    """

    exposure: float = 0.85
    blur_px: float = 0.5
    read_noise: float = 1.0
    full_well: float = 10_000.0
    stars: int = 40
    oversampling: int = 2


def ideal_matrix(camera: RawCamera, oversampling: int, margin: int) -> Float[np.ndarray, "3 3"]:
    """K of the oversampled image without distortion, ``margin`` px larger on all sides; pixel centres are whole numbers."""
    K = camera.camera_matrix * oversampling
    K[:2, 2] = (camera.camera_matrix[:2, 2] + margin + 0.5) * oversampling - 0.5
    K[2, 2] = 1.0
    return K


def photograph(
    radiance: Float[np.ndarray, "h w"],
    camera: RawCamera,
    margin: int,
    imaging: Imaging,
    generator: np.random.Generator,
) -> UInt8[np.ndarray, "r c"]:
    """Raw image of oversampled radiance with a margin (`ideal_matrix`)."""
    ratio = imaging.oversampling
    image = cv2.remap(radiance.astype(np.float32), *_sample_places(camera, ratio, margin), cv2.INTER_LINEAR)
    height, width = camera.height, camera.width
    image = image.reshape(height, ratio, width, ratio).mean(axis=(1, 3))
    if imaging.blur_px > 0:
        image = cv2.GaussianBlur(image, (0, 0), imaging.blur_px)
    electrons = np.clip(image * imaging.exposure, 0, None) * imaging.full_well
    grey = generator.poisson(electrons) * (WHITE / imaging.full_well)
    grey += imaging.read_noise * generator.standard_normal(grey.shape)
    return np.clip(np.round(grey), 0, WHITE).astype(np.uint8)


def add_stars(
    radiance: Float[np.ndarray, "h w"],
    directions: Float[np.ndarray, "s 3"],
    brightness: Float[np.ndarray, " s"],
    K: Float[np.ndarray, "3 3"],
) -> None:
    """Add points at infinity in these directions (camera frame) where nothing is in front of them."""
    ahead = directions[:, 2] > 0.1
    place = directions[ahead] @ K.T
    column, row = np.round(place[:, :2] / place[:, 2:]).astype(int).T
    height, width = radiance.shape
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    column, row, light = column[inside], row[inside], brightness[ahead][inside]
    dark = radiance[row, column] == 0
    radiance[row[dark], column[dark]] = light[dark]


@lru_cache(maxsize=8)
def _sample_places(camera: RawCamera, ratio: int, margin: int) -> tuple[np.ndarray, np.ndarray]:
    """Column and row, in the ideal image, of every sample of the raw one."""
    columns, rows = np.arange(camera.width * ratio), np.arange(camera.height * ratio)
    u, v = np.meshgrid((columns + 0.5) / ratio - 0.5, (rows + 0.5) / ratio - 0.5)
    raw = np.stack([u, v], axis=2).reshape(-1, 1, 2)
    K = ideal_matrix(camera, ratio, margin)
    if camera.distortion.any():
        rays = cv2.undistortPoints(raw, camera.camera_matrix, camera.distortion).reshape(-1, 2)
        ideal = rays * np.diag(K)[:2] + K[:2, 2]
    else:
        ideal = (raw.reshape(-1, 2) + margin + 0.5) * ratio - 0.5
    shape = (len(rows), len(columns))
    return ideal[:, 0].reshape(shape).astype(np.float32), ideal[:, 1].reshape(shape).astype(np.float32)


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
        """Poses of g, whose origin follows from `Truth.center_of_mass_g`, and of the raw left camera, both in i."""
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
    body : Appearance
        The body as it looks.
    rig : RawRig
        Of raw cameras.
    imaging : Imaging
        Of both cameras.
    seed : int
        Of noise and stars.
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
        """Left and right image by the poses of g and of the raw left camera; the number of the pair chooses the noise."""
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
    """Write images, calibration, truth, the inspector's poses and, last, dataset.toml of a rendered motion.

    Parameters
    ----------
    stage : RenderedScene
        Body and cameras.
    motion : SeenMotion
        Of the body and of the left camera.
    folder : Path
        That exists.
    description : str
        For dataset.toml.
    progress : Callable[[int, int], None]
        Called after every pair with how many are done, and of how many.
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


_FOCAL_PX, _BASELINE_M = 466.7, 0.09
_SIZE = (640, 480)
IMAGE_RADIUS_M: Final = 0.11
"""Of a rendered body, m; less than a scenario's own, so that the whole body stays in the images."""


@dataclass(frozen=True)
class ImageScenario:
    """A body before a stereo camera.

    Attributes
    ----------
    scenario : Scenario
        The motion, the seed, and how the left camera moves; its measurements are not asked for.
    shape : str
        A polyhedron or the file of a mesh (`named_mesh`).
    foil : float
        Share of the surface that is crinkled metal foil.
    sun : tuple[float, float, float]
        Direction to it, frame i.
    imaging : Imaging
        Of both cameras.
    size : tuple[int, int]
        Width and height of the images, px.
    """

    scenario: Scenario = field(default_factory=lambda: Scenario(radius_m=IMAGE_RADIUS_M))
    shape: str = "spheres"
    foil: float = 0.0
    sun: tuple[float, float, float] = (-0.5, -0.6, -1.0)
    imaging: Imaging = field(default_factory=Imaging)
    size: tuple[int, int] = _SIZE

    def motion(self) -> SeenMotion:
        """True motion that stays in view of the inspector."""
        dataset = simulate(replace(self.scenario, kind=Scenario.kind), silent)
        assert dataset.truth is not None
        return SeenMotion(dataset.truth, CameraTrajectory.of(dataset.inspector))

    def stage(self) -> RenderedScene:
        """The body, the sun and the cameras."""
        body = Appearance(
            named_mesh(self.shape, self.scenario.radius_m),
            SurfaceTexture(self.scenario.seed, self.foil),
            self.sun,
        )
        return RenderedScene(body, example_rig(self.size), self.imaging, self.scenario.seed)


def render(scenario: ImageScenario, folder: Path, progress: Callable[[int, int], None] = silent) -> str:
    """Write the images of a scenario into a folder, with truth.

    Parameters
    ----------
    scenario : ImageScenario
        Body, motion and cameras.
    folder : Path
        That exists.
    progress : Callable[[int, int], None]
        Called after every pair with how many are done, and of how many.

    Returns
    -------
    str
        Description of the images.

    Raises
    ------
    InputError
        A shape that is no mesh, numbers that are no motion, a folder that cannot be written.
    """
    stage, motion = scenario.stage(), scenario.scenario
    description = (
        f"rendered stereo images of {Path(scenario.shape).name}, {motion.epochs} pairs at {motion.interval} s, seed {motion.seed}"
        + ("" if motion.inspector == STATIC else f", inspector: {motion.inspector}")
    )
    write_sequence(stage, scenario.motion(), folder, description, progress)
    return description


def example_rig(size: tuple[int, int] = _SIZE) -> RawRig:
    """Raw rig with the thesis' focal length and baseline, distorting lenses, and cameras 0.3 deg from parallel."""
    width, height = size
    focal = _FOCAL_PX * width / _SIZE[0]
    turned = np.array([[1.0, -0.002, 0.004], [0.002, 1.0, -0.003], [-0.004, 0.003, 1.0]])
    centre = ((width - 1) / 2, (height - 1) / 2)
    left = RawCamera(
        np.array([focal, focal, centre[0] + 3.0, centre[1] - 2.0]),
        np.array([-0.08, 0.02, 0.0004, -0.0003, 0.0]),
        width,
        height,
        np.eye(3),
        np.zeros(3),
    )
    right = RawCamera(
        np.array([focal * 1.002, focal * 1.001, centre[0] - 2.0, centre[1] + 1.0]),
        np.array([-0.075, 0.015, -0.0002, 0.0002, 0.0]),
        width,
        height,
        nearest_rotation(turned),
        np.array([_BASELINE_M, 0.0004, -0.0003]),
    )
    return RawRig(left, right)
