"""Landmarks of a known map seen by one camera: feature tracks in pixels of one image."""

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.core.attitude_conversions import quaternion_from_rotation_vector
from spinfilters.core.cameras import monocular_camera
from spinfilters.core.errors import InputError
from spinfilters.core.gauss_newton import LeastSquaresEnd, StepEquations, gauss_newton, step_equations
from spinfilters.core.linear_algebra import is_definite
from spinfilters.io.camera import RIG_FILES, PinholeCamera, Rig, read_camera, write_camera
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.sensor_format import CalibrationFiles, SensorFormat, SensorNoise
from spinfilters.io.stated_values import PIXEL
from spinfilters.models.camera_landmarks import (
    CALIBRATION,
    PIXEL_STD,
    MonocularLandmark,
    camera_parameters,
    camera_pose_model,
    mapped_rows,
    posed_samples,
    with_camera_poses,
)
from spinfilters.models.feature_tracks import RIG, TrackCamera, feature_tracks
from spinfilters.models.measurement import MeasurementModel
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

CAMERA: Final = RIG.left
"""The left camera of the simulated stereo rig."""
POSE_LAYOUT: Final = StateLayout(("t", "a"))


class MonocularSensor(Sensor):
    """Values (u, v), pixels of the calibrated camera, one row per landmark and epoch; covariance px^2.

    A single camera does not determine the scale of the scene, so the map must be known.
    """

    name = "monocular"
    format = SensorFormat(
        name="monocular",
        kind="mono-tracks",
        file="tracks.csv",
        columns=("u_px", "v_px"),
        dimension=2,
        noise=(PIXEL_STD,),
        allowed=PIXEL,
        has_landmarks=True,
        calibration=CalibrationFiles(PinholeCamera, RIG_FILES[:1], read_camera, write_camera),
    )
    sees_place = True
    analysis = AnalysedSensor(
        MonocularLandmark,
        (*CALIBRATION, 1.0),
        {"pixel_std": (len(CALIBRATION),)},
        sees_points=True,
        has_image=True,
        words="one camera",
        is_linear=False,
    )

    def bind(
        self, stream: MeasurementStream, layout: StateLayout, noise: SensorNoise, view: CameraView | None
    ) -> BoundStream:
        """Rows whose landmark is not in the map are left out. InputError: no known map."""
        view, level = required_view(self.name, view), noise_level(stream, noise.pixel_std)
        if view.known_map is None:
            raise InputError(
                "mono-tracks need a known map: one camera does not show the scale; give landmarks.csv "
                "(simulate: --known-map), or stereo-tracks"
            )
        known, points = mapped_rows(stream, view.known_map)
        time, poses = stream.time[known], view.camera_poses(stream.time[known])
        camera, moves = monocular_camera(view.calibration), camera_pose_model(poses)
        model = model_over(MonocularLandmark, layout, noise_model(level, 2), camera, moves)
        parameters = camera_parameters(points, view.calibration, noise_of_rows(level, known))
        return BoundStream(model, time, stream.values[known], with_camera_poses(parameters, poses))

    def initial_motion(
        self, stream: MeasurementStream, noise: SensorNoise, view: CameraView | None
    ) -> MotionSamples:
        """Initial motion from a perspective pose (PnP) per epoch."""
        # here: every command lists the sensors, few need poses of tracks
        from spinfilters.models.tracks.track_poses import track_epochs

        view = required_view(self.name, view)
        bound = self.bind(
            stream, POSE_LAYOUT, noise, replace(view, inspector=None)
        )  # poses in the camera's frame
        assert isinstance(bound.model, MonocularLandmark)
        rows = MeasurementStream(self.name, bound.time, bound.values, np.arange(len(bound.time)))
        found = {
            time: perspective_pose(bound.model, bound.parameters[where], bound.values[where])
            for time, where in track_epochs(rows)
        }
        good = {time: pose for time, pose in found.items() if pose is not None}
        if not good:
            raise InputError(
                "no frame of the tracks sees four landmarks of the map; check landmark ids and the calibration"
            )
        return posed_samples(np.array(list(good)), np.array(list(good.values())), view)

    def simulate(self, scene: Scene) -> SimulatedStream:
        """Pixels of the landmarks in view of one camera."""
        surface, motion, std = scene.surface, scene.seen, scene.front_end.pixel_std
        parameters = camera_parameters(surface.points, CAMERA.calibration, std)
        camera = TrackCamera(model_over(MonocularLandmark, motion.layout), parameters, CAMERA)
        time, ids, values, landmarks = feature_tracks(
            camera, scene.front_end, surface, motion, scene.generator
        )
        stream = MeasurementStream(self.name, time, values, ids)
        return SimulatedStream(stream, {PIXEL_STD.name: std}, landmarks, CAMERA)

    def outliers(
        self, count: int, rig: Rig | None, generator: np.random.Generator
    ) -> Float[np.ndarray, "count 2"]:
        """Uniform over the image."""
        assert rig is not None  # a data set with a camera always has one
        return generator.uniform(0.0, [rig.left.width, rig.left.height], (count, 2))

    def points_at_infinity(
        self, count: int, rig: Rig | None, generator: np.random.Generator
    ) -> Float[np.ndarray, "count 2"]:
        """Anywhere in the image."""
        return self.outliers(count, rig, generator)


HYPOTHESES = 200
"""Most poses that are drawn."""
CONFIDENCE = 0.9999
"""Probability of a pose from right matches alone at which drawing ends."""
SEED = 0
"""Of the draws, so that the same matches give the same pose."""
AGREEMENT = 8.0
"""In standard deviations: the noise of the few matches of a hypothesis turns a body by some 0.05 rad."""
FEWEST = 4
"""Matches that must agree: three are fitted by any pose of theirs."""
SMALLEST_SHARE = 0.3
"""Of the matches that must agree."""
GATE = 5.0
"""In standard deviations beyond which a match counts as wrong at the end."""
OPENING = 6.0
"""Times the lower quartile of the residuals, by which the gate opens while the pose is rough."""
ITERATIONS = 10
SETTLED = 1e-6
"""Length of a step in standard deviations of the pose below which iterations end."""


def perspective_pose(
    model: MonocularLandmark, parameters: Float[np.ndarray, "k p"], pixels: Float[np.ndarray, "k 2"]
) -> Float[np.ndarray, " 7"] | None:
    """Pose (t, q_ig) that most matches agree on; None where too few do.

    Parameters
    ----------
    model : MonocularLandmark
        Of the camera over (t, a), frame i being its own.
    """
    if len(pixels) < FEWEST:
        return None
    points, calibration = parameters[:, :3], parameters[0, 3 : 3 + model.camera.parameter_dim]
    rays = model.camera.rays_of(pixels, calibration)[:, :2]
    usable = np.isfinite(rays).all(axis=1)
    if np.count_nonzero(usable) < FEWEST:
        return None
    std = float(np.median(1.0 / np.abs(model.whitening(model.layout.origin(), parameters)[:, 0, 0])))
    start = _rough_pose(points[usable], rays[usable], AGREEMENT * std / calibration[0])
    return None if start is None else _refine_pose(model, parameters, pixels, start)


def _rough_pose(
    points: Float[np.ndarray, "k 3"], rays: Float[np.ndarray, "k 2"], tolerance: float
) -> Float[np.ndarray, " 7"] | None:
    """Pose that most rays (x/z, y/z) agree on; None where OpenCV finds none."""
    import cv2  # takes as long to load as a short run; only one camera's tracks need it here

    options = cv2.UsacParams()
    options.threshold, options.maxIterations, options.confidence = tolerance, HYPOTHESES, CONFIDENCE
    options.sampler, options.score = cv2.SAMPLING_UNIFORM, cv2.SCORE_METHOD_MSAC
    options.loMethod, options.randomGeneratorState = cv2.LOCAL_OPTIM_INNER_LO, SEED
    try:
        found, _, turn, shift, _ = cv2.solvePnPRansac(points, rays, np.eye(3), None, params=options)
    except cv2.error:  # matches in one place
        return None
    if not found or not np.isfinite([turn, shift]).all():
        return None
    return np.concatenate([shift.ravel(), quaternion_from_rotation_vector(turn.ravel())])


def _refine_pose(
    model: MeasurementModel, parameters: np.ndarray, pixels: np.ndarray, pose: Float[np.ndarray, " 7"]
) -> Float[np.ndarray, " 7"] | None:
    """Gauss-Newton on the matches within a gate that closes while the pose settles."""

    def linearise(pose: Float[np.ndarray, " 7"]) -> StepEquations | None:
        innovation, jacobian, valid, _ = model.linearise(pose, parameters, pixels)
        size = np.linalg.norm(innovation, axis=1)
        quarter = float(np.partition(size, len(size) // 4)[len(size) // 4])
        inliers = valid & (size < max(GATE, OPENING * quarter))
        if not _are_enough(inliers):
            return None
        found = step_equations(innovation[inliers].reshape(-1), jacobian[inliers].reshape(-1, 6))
        return found if is_definite(found.information) else None

    found = gauss_newton(
        pose,
        linearise,
        model.layout.retract,
        lambda step, normal: bool(step @ normal.information @ step < SETTLED**2),
        ITERATIONS,
    )
    if found.end is LeastSquaresEnd.UNDETERMINED:
        return None
    innovation, _, valid, _ = model.linearise(found.state, parameters, pixels)
    agreeing = valid & (np.linalg.norm(innovation, axis=1) < GATE)
    return found.state if _are_enough(agreeing) else None


def _are_enough(inliers: Bool[np.ndarray, " k"]) -> bool:
    return bool(np.count_nonzero(inliers) >= max(FEWEST, SMALLEST_SHARE * len(inliers)))


MONOCULAR = MonocularSensor()
