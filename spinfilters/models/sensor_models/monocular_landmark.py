"""A landmark seen by one camera: a direction without a distance."""

from spinfilters.geometry.cameras import Monocular
from spinfilters.models.sensor_models.camera_landmark import RESTING, CameraLandmark, CameraPoseModel
from spinfilters.models.sensor_noise import SensorNoiseModel
from spinfilters.state.layout import StateLayout


class MonocularLandmark(CameraLandmark[Monocular]):
    """z = (u, v) in pixels of the point p_g; see `CameraLandmark`.

    One view does not tell the distance, so this is no `LandmarkSensor`: a landmark cannot be made from a single measurement.
    """

    name = "monocular"
    dim = 2
    value_dim = 2
    known_by = 3
    images = 1

    def __init__(
        self,
        layout: StateLayout,
        noise: SensorNoiseModel | None = None,
        camera: Monocular | None = None,
        pose: CameraPoseModel = RESTING,
    ) -> None:
        super().__init__(layout, camera or Monocular(), noise, pose)
