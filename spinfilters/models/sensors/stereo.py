"""Landmarks seen by a rectified stereo pair: feature tracks in pixels of both images."""

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.cameras import stereo_pair
from spinfilters.io.camera import RIG_FILES, Rig, StereoRig, read_stereo_rig, write_stereo_rig
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_format import CalibrationFiles, SensorFormat, SensorNoise
from spinfilters.io.stated_values import PIXEL
from spinfilters.io.text_table import Table
from spinfilters.models.camera_landmarks import (
    CALIBRATION,
    PIXEL_STD,
    StereoLandmark,
    camera_parameters,
    camera_pose_model,
    mapped_rows,
    posed_samples,
    with_camera_poses,
)
from spinfilters.models.feature_tracks import RIG, FrontEnd, Surface, TrackCamera, TrueMotion, feature_tracks
from spinfilters.models.sensor import (
    AnalysedSensor,
    BoundStream,
    CameraView,
    MotionSamples,
    Scene,
    Sensor,
    SimulatedStream,
    model_over,
    noise_level,
    required_view,
)
from spinfilters.models.sensor_noise import noise_model, noise_of_rows
from spinfilters.models.state_layout import StateLayout

SMALLEST_DISPARITY_PX: Final[float] = -3.0
"""A far point has disparity zero, with noise a little less; below this, columns or cameras are swapped."""
_ROUNDING_PX: Final = 1e-9  # keeps a difference of two coordinates on the right side of a bound


def require_before_cameras(table: Table) -> None:
    """Require all points of a table of tracks before the cameras.

    Disparities from `SMALLEST_DISPARITY_PX` to zero are kept: to reject them is the filter's task. InputError: one below.
    """
    u_left, u_right = table.values[:, 2], table.values[:, 4]
    behind = np.flatnonzero(u_left - u_right < SMALLEST_DISPARITY_PX)
    if behind.size:
        row = int(behind[0])
        raise table.error(
            row,
            f"u_left_px {float(u_left[row])} - u_right_px {float(u_right[row])} is below {SMALLEST_DISPARITY_PX} px, "
            "a point behind the cameras; swap left and right, or delete the line",
        )


class StereoSensor(Sensor):
    """Stereo pixels (u_left, v_left, u_right), one row per landmark and epoch, of the calibrated pair; covariance px^2."""

    name = "stereo"
    format = SensorFormat(
        name="stereo",
        kind="stereo-tracks",
        file="tracks.csv",
        columns=("u_left_px", "v_left_px", "u_right_px"),
        dimension=3,
        noise=(PIXEL_STD,),
        allowed=PIXEL,
        has_landmarks=True,
        calibration=CalibrationFiles(StereoRig, RIG_FILES, read_stereo_rig, write_stereo_rig),
        check=require_before_cameras,
    )
    sees_place = True
    analysis = AnalysedSensor(
        StereoLandmark,
        (*CALIBRATION, 0.09, 1.0),
        {"pixel_std": (len(CALIBRATION) + 1,)},
        sees_points=True,
        has_image=True,
        words="a stereo pair",
    )

    def bind(
        self, stream: MeasurementStream, layout: StateLayout, noise: SensorNoise, view: CameraView | None
    ) -> BoundStream:
        """Rows whose landmark is not in a known map are left out."""
        view, level = required_view(self.name, view), noise_level(stream, noise.pixel_std)
        known, points, ids = slice(None), np.zeros((len(stream), 3)), stream.ids
        if view.known_map is not None:
            (known, points), ids = mapped_rows(stream, view.known_map), None
        time, poses = stream.time[known], view.camera_poses(stream.time[known])
        camera, moves = stereo_pair(view.calibration), camera_pose_model(poses)
        model = model_over(StereoLandmark, layout, noise_model(level, 3), camera, moves)
        parameters = camera_parameters(points, view.calibration, noise_of_rows(level, known))
        return BoundStream(model, time, stream.values[known], with_camera_poses(parameters, poses), ids)

    def initial_motion(
        self, stream: MeasurementStream, noise: SensorNoise, view: CameraView | None
    ) -> MotionSamples:
        """Initial motion from a pose per epoch, and the map where none is known."""
        view, level = required_view(self.name, view), noise_level(stream, noise.pixel_std)
        if view.known_map is None:  # imported here: every command lists the sensors, few need poses of tracks
            from spinfilters.models.tracks.map_building import poses_without_map
            from spinfilters.models.tracks.track_poses import shared_landmarks

            poses, found, ratio = poses_without_map(stream, view.calibration, level)
            samples = posed_samples(poses.time, poses.values, view, found)
            return replace(samples, noise_ratio=ratio, shared=shared_landmarks(stream, poses.time))
        from spinfilters.models.tracks.track_poses import poses_with_map

        poses = poses_with_map(stream, view.known_map, view.calibration, level)
        return posed_samples(poses.time, poses.values, view)

    def samples_each_epoch(self, view: CameraView | None) -> bool:
        """With a known map, to which each epoch is fitted by itself."""
        return view is not None and view.known_map is not None

    def simulate(self, scene: Scene) -> SimulatedStream:
        """Pixels of the landmarks in view of both cameras."""
        stream, landmarks = stereo_tracks(scene.front_end, scene.surface, scene.seen, scene.generator)
        return SimulatedStream(stream, {PIXEL_STD.name: scene.front_end.pixel_std}, landmarks, RIG)

    def flipped(self, values: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """The columns of the two cameras exchanged: a disparity of the wrong sign."""
        return values[[2, 1, 0]]

    def outliers(
        self, count: int, rig: Rig | None, generator: np.random.Generator
    ) -> Float[np.ndarray, "count 3"]:
        """Uniform over both images, at a disparity of at least zero, where a matcher looks."""
        assert rig is not None  # a data set with stereo measurements always has one
        pixels = generator.uniform(0.0, [rig.left.width, rig.left.height, rig.left.width], (count, 3))
        pixels[:, [2, 0]] = np.sort(pixels[:, [2, 0]], axis=1)
        return pixels

    def points_at_infinity(
        self, count: int, rig: Rig | None, generator: np.random.Generator
    ) -> Float[np.ndarray, "count 3"]:
        """Anywhere in the left image, without disparity."""
        assert rig is not None
        u, v = generator.uniform(0, rig.left.width, count), generator.uniform(0, rig.left.height, count)
        return np.stack([u, v, u], axis=1)

    def storable(self, values: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """No disparity below the smallest that track files may hold."""
        bounded = values.copy()
        bounded[:, 2] = np.minimum(values[:, 2], values[:, 0] - SMALLEST_DISPARITY_PX - _ROUNDING_PX)
        return bounded


def stereo_tracks(
    front_end: FrontEnd, surface: Surface, motion: TrueMotion, generator: np.random.Generator
) -> tuple[MeasurementStream, Int[np.ndarray, " m"]]:
    """Stereo tracks over a motion before `RIG`, with the surface rows of landmarks.

    Raises
    ------
    InputError
        When no landmark is ever found.
    """
    parameters = camera_parameters(surface.points, RIG.calibration, front_end.pixel_std)
    camera = TrackCamera(model_over(StereoLandmark, motion.layout), parameters, RIG, horizontal=(0, 2))
    time, ids, values, landmarks = feature_tracks(camera, front_end, surface, motion, generator)
    return MeasurementStream("stereo", time, values, ids), landmarks


STEREO = StereoSensor()
