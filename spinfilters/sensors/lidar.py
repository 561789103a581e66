"""A lidar of points of the body, for the observability analyser.

No data set holds it yet.
"""

from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.sensor_format import SensorNoise
from spinfilters.errors import InputError
from spinfilters.models.sensor_models.lidar_landmark import LidarLandmark
from spinfilters.sensors.sensor import AnalysedSensor, BoundStream, CameraView, Sensor
from spinfilters.state.layout import StateLayout


class LidarSensor(Sensor):
    """Sensor of the model `spinfilters.models.sensor_models.lidar_landmark.LidarLandmark`."""

    name = "lidar"
    sees_place = True
    analysis = AnalysedSensor(
        LidarLandmark,
        (0.01, 0.002),
        "lidar 0.01 m in range, 0.002 rad in azimuth and elevation",
        sees_points=True,
        words="a lidar",
    )

    def bind(
        self, stream: MeasurementStream, layout: StateLayout, noise: SensorNoise, view: CameraView | None
    ) -> BoundStream:
        """InputError: points of a lidar serve the analyser alone."""
        raise InputError("points of a lidar are not read by this version; give the poses of registered scans")


LIDAR = LidarSensor()
