"""Points of lidar scans against the planes of the body."""

from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.conversions import continuous_quaternions, quaternion_from_matrix
from spinfilters.data.camera import Rig
from spinfilters.data.measurement_log import MeasurementStream
from spinfilters.data.sensor_format import NoiseOption, SensorFormat, SensorNoise
from spinfilters.data.stated_values import NumberRange
from spinfilters.errors import InputError
from spinfilters.models.sensor_models.lidar_point import LidarPoint, lidar_point_parameters
from spinfilters.sensors.sensor import (
    BoundStream,
    CameraView,
    MotionSamples,
    Sensor,
    model_over,
    row_covariance,
)
from spinfilters.sensors.simulated_scene import Scene, SimulatedStream
from spinfilters.state.layout import StateLayout

NORMAL_TOLERANCE: Final = 1e-6
"""Largest | |n| - 1 | that is taken as rounding."""
SCAN_SECONDS: Final = 0.1
"""Duration of a simulated scan."""
MOST_POINTS: Final = 200
"""Of a simulated scan."""
BOX: Final = np.array([0.65, 0.5, 0.4])
"""Half edges of the simulated body, over the radius of the surface that cameras see."""
ANGLE_STD: Final = 1e-4
"""Of a simulated scan's angles, rad."""
FARTHEST_M: Final = 100.0
"""Largest range of an outlier."""


class LidarPointsSensor(Sensor):
    """Lidar points, one a row, at the scan's epoch.

    Values (range m, azimuth and elevation rad, delay s, unit normal n_g, offset d m).
    The point was measured ``delay`` after the epoch, and lies on the plane n_g.p = d, n_g outwards. Frame i is that of the lidar.
    Covariance over (range, azimuth, elevation), m and rad: with what the planes' own errors add to the range.
    """

    name = "lidar-points"
    format = SensorFormat(
        name=name,
        kind=name,
        file="lidar_points.csv",
        columns=("range_m", "azimuth_rad", "elevation_rad", "delay_s", "nx", "ny", "nz", "offset_m"),
        dimension=3,
        noise=(
            NoiseOption("lidar_range_std", "ranges", NumberRange(1e-9, 1e6, "m"), 0.01, (0,)),
            NoiseOption("lidar_angle_std", "angles", NumberRange(1e-12, 1.0, "rad"), 1e-4, (1, 2)),
        ),
        repeats=True,
    )
    sees_place = True
    tells_frames = True

    def bind(
        self, stream: MeasurementStream, layout: StateLayout, noise: SensorNoise, view: CameraView | None
    ) -> BoundStream:
        """Ranges, whose parameters are the rays, delays and faces."""
        _require_normals(stream)
        std = np.array([noise.lidar_range_std, noise.lidar_angle_std, noise.lidar_angle_std])
        z = stream.values
        parameters = lidar_point_parameters(z[:, 1:3], z[:, 3], z[:, 4:], row_covariance(stream, std))
        return BoundStream(model_over(LidarPoint, layout), stream.time, z[:, :1], parameters)

    def initial_motion(
        self, stream: MeasurementStream, noise: SensorNoise, view: CameraView | None
    ) -> MotionSamples:
        """A pose per scan, the motion during it left out."""
        # here: every command lists the sensors, and the lidar's room is slow to import
        from spinfilters.geometry.ray_angles import unit_vectors
        from spinfilters.models.plane_poses import PlanePoints, plane_poses

        _require_normals(stream)
        z = stream.values
        points = z[:, :1] * unit_vectors(z[:, 1], z[:, 2])
        scans = [PlanePoints(points[a:b], z[a:b, 4:7], z[a:b, 7]) for a, b in pairwise(stream.epoch_offsets)]
        found = [
            (t, pose)
            for t, pose in zip(stream.epoch_times, plane_poses(scans), strict=True)
            if pose is not None
        ]
        q = quaternion_from_matrix(np.array([pose.rotation for _, pose in found]))
        return MotionSamples(
            np.array([t for t, _ in found]),
            continuous_quaternions(q),
            positions=np.array([pose.translation for _, pose in found]),
        )

    def simulate(self, scene: Scene) -> SimulatedStream:
        """Points on the faces of a box within the surface.

        `MOST_POINTS` in a scan about every epoch.
        """
        from spinfilters.geometry.ray_angles import angles_of

        model, layout = LidarPoint(scene.motion.layout), scene.motion.layout
        half = BOX * float(np.linalg.norm(scene.surface.points, axis=1).max())
        std = np.array([scene.noise.position_std, ANGLE_STD, ANGLE_STD])
        covariance = np.tile(np.diag(std**2), (MOST_POINTS, 1, 1))
        delay = np.linspace(-SCAN_SECONDS / 2, SCAN_SECONDS / 2, MOST_POINTS)
        times, rows = [], []
        for time, x, R in zip(scene.motion.time, scene.motion.states, scene.motion.rotations, strict=True):
            t, rate = x[layout.mean_slice("t")], R @ x[layout.mean_slice("w")]
            points, planes = _box_points(half, -R.T @ t, scene.generator)
            arm = points @ R.T
            angles = np.stack(angles_of(t + arm + delay[:, None] * np.cross(rate, arm)), axis=1)
            parameters = lidar_point_parameters(angles, delay, planes, covariance)
            exact = model.predict(x, parameters)
            met = model.linearise(x, parameters, exact).valid
            measured = np.column_stack([exact, angles])
            measured = measured + std * scene.generator.standard_normal(measured.shape)
            rows.append(np.column_stack([measured, delay, planes])[met])
            times.append(np.full(int(met.sum()), time))
        stream = MeasurementStream(self.name, np.concatenate(times), np.concatenate(rows))
        return SimulatedStream(stream, {"lidar_range_std": float(std[0]), "lidar_angle_std": float(std[1])})

    def outliers(
        self, count: int, rig: Rig | None, generator: np.random.Generator
    ) -> Float[np.ndarray, "count 8"]:
        """Ranges of random planes up to `FARTHEST_M`.

        Beams lie before the lidar, planes anywhere within a metre of the origin of g.
        """
        normals = generator.standard_normal((count, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        ranges, angles = generator.uniform(0, FARTHEST_M, count), generator.uniform(-0.5, 0.5, (count, 2))
        return np.column_stack([ranges, angles, np.zeros(count), normals, generator.uniform(0, 1, count)])


def _box_points(
    half: Float[np.ndarray, "3"], lidar: Float[np.ndarray, "3"], generator: np.random.Generator
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 4"]]:
    """Visible points on the faces of a box, and their planes.

    Half edges, m, about the origin of g; seen from the lidar's place in g.

    Raises
    ------
    InputError: a lidar within the box.
    """
    seen = np.flatnonzero(np.abs(lidar) > half)
    if not seen.size:
        raise InputError("the lidar is within the body; move it away (range_m)")
    area = np.prod(half) / half[seen] * (np.abs(lidar[seen]) - half[seen])  # as it appears from there
    axis = generator.choice(seen, MOST_POINTS, p=area / area.sum())
    every, side = np.arange(MOST_POINTS), np.sign(lidar[axis])
    points, planes = generator.uniform(-half, half, (MOST_POINTS, 3)), np.zeros((MOST_POINTS, 4))
    points[every, axis], planes[every, axis], planes[:, 3] = side * half[axis], side, half[axis]
    return points, planes


def _require_normals(stream: MeasurementStream) -> None:
    """InputError: a normal that is no unit vector, a range that is not positive."""
    off = np.abs(np.linalg.norm(stream.values[:, 4:7], axis=1) - 1.0) > NORMAL_TOLERANCE
    bad = np.flatnonzero(off | (stream.values[:, 0] <= 0))
    if bad.size:
        row = stream.values[bad[0]]
        raise InputError(
            f"{stream.sensor} row {bad[0]}: range {row[0]:g} m and normal {row[4:7].tolist()} of its plane; give a positive range "
            "and a unit normal"
        )


LIDAR_POINTS = LidarPointsSensor()
