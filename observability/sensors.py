"""The filters' sensors with usual noise, ready for a `System`."""

from collections.abc import Sequence
from fractions import Fraction
from typing import Final

from observability.rational import Rationals, rationals
from observability.system import Sensor
from spinfilters.models.sensors.attitude import Attitude
from spinfilters.models.sensors.gyro import Gyro
from spinfilters.models.sensors.lidar_landmark import LidarLandmark
from spinfilters.models.sensors.monocular_landmark import MonocularLandmark
from spinfilters.models.sensors.pose import Pose
from spinfilters.models.sensors.stereo_landmark import StereoLandmark
from spinfilters.state.layout import FULL_BLOCKS, StateLayout

LAYOUT: Final = StateLayout(FULL_BLOCKS)
RIG: Final[Rationals] = rationals((466.7, 470.0, 320.0, 240.0, 0.09))
"""fx, fy, cx, cy in px and the baseline in m."""
PIXEL_STD: Final = Fraction(1)
RANGE_STD, ANGLE_STD = rationals((0.01, 0.002))
"""Of a lidar, m and rad."""
GYRO_STD: Final = 0.002
"""rad/s."""
ATTITUDE_STD: Final = (0.01,) * 3
"""rad."""
POSE_STD: Final = (0.005,) * 3 + (0.01,) * 3
"""m and rad."""


def gyro() -> Sensor:
    """A rate gyro on the body."""
    return Sensor(Gyro(LAYOUT), (rationals((GYRO_STD, 0.0)),))


def attitude() -> Sensor:
    """A lidar or star tracker of which the attitude alone is used."""
    return Sensor(Attitude(LAYOUT), (_lower(ATTITUDE_STD),))


def lidar(points: Sequence[Rationals], known: bool = False) -> Sensor:
    """A lidar that sees these points of the body (frame g, m); to be mapped, unless the map is known."""
    return Sensor(LidarLandmark(LAYOUT), tuple((*p, RANGE_STD, ANGLE_STD) for p in points), 0 if known else 3)


def pose() -> Sensor:
    """A lidar, or any tracker, that gives the pose of g."""
    return Sensor(Pose(LAYOUT), (_lower(POSE_STD),))


def stereo(points: Sequence[Rationals], known: bool = False) -> Sensor:
    """A stereo pair that sees these landmarks (frame g, m); to be mapped, unless the map is known."""
    return Sensor(StereoLandmark(LAYOUT), tuple((*p, *RIG, PIXEL_STD) for p in points), 0 if known else 3)


def monocular(points: Sequence[Rationals], known: bool = False) -> Sensor:
    """One camera that sees these landmarks (frame g, m); to be mapped, unless the map is known."""
    return Sensor(
        MonocularLandmark(LAYOUT), tuple((*p, *RIG[:4], PIXEL_STD) for p in points), 0 if known else 3
    )


def _lower(std: Sequence[float]) -> Rationals:
    """Rows of the lower factor of a diagonal covariance."""
    return rationals([each if row == col else 0.0 for row, each in enumerate(std) for col in range(row + 1)])
