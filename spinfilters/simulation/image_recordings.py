"""Rendered stereo images of a simulated motion."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from spinfilters.core.absolute_orientation import nearest_rotation
from spinfilters.core.camera_trajectory import CameraTrajectory
from spinfilters.simulation.body_view import Appearance, SurfaceTexture, named_mesh
from spinfilters.simulation.image_sequence import Imaging, RenderedScene, SeenMotion, write_sequence
from spinfilters.simulation.inspector import STATIC
from spinfilters.simulation.scenario import Scenario, silent, simulate
from spinfilters.vision.rectification import RawCamera, RawRig

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
