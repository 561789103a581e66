"""Rendered stereo images of a simulated motion."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

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


@dataclass(frozen=True)
class ImageScenario:
    """A body before a stereo camera.

    Attributes
    ----------
    shape : str
        A polyhedron or the file of a mesh (`named_mesh`).
    radius_m : float
        Of the body, m; less than a scenario's own, so that the whole body stays in the images.
    rate_rpm, moments, frames, interval, seed : tuple, tuple, int, float, int
        Of the motion, as `Scenario` has them.
    foil : float
        Share of the surface that is crinkled metal foil.
    sun : tuple[float, float, float]
        Direction to it, frame i.
    imaging : Imaging
        Of both cameras.
    size : tuple[int, int]
        Width and height of the images, px.
    inspector : str
        How the left camera moves (`spinfilters.simulation.inspector.INSPECTORS`).
    """

    shape: str = "spheres"
    radius_m: float = 0.11
    rate_rpm: tuple[float, float, float] = Scenario.rate_rpm
    moments: tuple[float, float, float] = Scenario.principal_moments
    frames: int = Scenario.epochs
    interval: float = Scenario.interval
    seed: int = Scenario.seed
    foil: float = 0.0
    sun: tuple[float, float, float] = (-0.5, -0.6, -1.0)
    imaging: Imaging = field(default_factory=Imaging)
    size: tuple[int, int] = _SIZE
    inspector: str = Scenario.inspector

    def motion(self) -> SeenMotion:
        """True motion with the thesis' disturbances that stays in view of the inspector."""
        scenario = Scenario(
            rate_rpm=self.rate_rpm,
            epochs=self.frames,
            interval=self.interval,
            principal_moments=self.moments,
            radius_m=self.radius_m,
            inspector=self.inspector,
            seed=self.seed,
        )
        dataset = simulate(scenario, silent)
        assert dataset.truth is not None
        return SeenMotion(dataset.truth, CameraTrajectory.of(dataset.inspector))

    def stage(self) -> RenderedScene:
        """The body, the sun and the cameras."""
        body = Appearance(
            named_mesh(self.shape, self.radius_m), SurfaceTexture(self.seed, self.foil), self.sun
        )
        return RenderedScene(body, example_rig(self.size), self.imaging, self.seed)


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
    stage = scenario.stage()
    description = (
        f"rendered stereo images of {Path(scenario.shape).name}, {scenario.frames} pairs at {scenario.interval} s, "
        f"seed {scenario.seed}"
        + ("" if scenario.inspector == STATIC else f", inspector: {scenario.inspector}")
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
