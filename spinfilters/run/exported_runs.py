"""A run as one file for another tool: MCAP of ROS 2 messages (the extra ``ros``), or a recording of Rerun (the extra ``rerun``).

Foxglove, PlotJuggler and ros2 bag show the first. Rerun shows poses, points and scalars on one time line.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from spinfilters.core.attitude_conversions import matrix_from_quaternion, quaternion_from_matrix
from spinfilters.core.inertia_charts import box_of_equal_inertia
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.io.output_files import write_bytes
from spinfilters.io.truth import Truth
from spinfilters.run.run_report import box_edge
from spinfilters.vision.image_folder import LossCount, stamped_pairs

UNKNOWN_VARIANCE: Final = 1e9
"""In m^2, rad^2, (m/s)^2 and (rad/s)^2, of what is not estimated: a variance of zero would claim certainty."""
ODOMETRY, VECTOR = "nav_msgs/msg/Odometry", "geometry_msgs/msg/Vector3Stamped"


def write_mcap(path: Path, evaluations: Sequence[Evaluation]) -> None:
    """Write the motions of all estimators, atomically.

    ``/NAME/motion`` are nav_msgs/Odometry. Their pose is the position of the centre of mass (m) and the attitude of frame g, in
    frame i, with covariances along and about the axes of i. Their twist is the velocity of the centre of mass (m/s) and the rate
    (rad/s) in axes of g, the child frame. ``/NAME/rate`` are the same rates as vectors, as a gyro fixed to g measures them.
    Covariances between position, attitude, velocity and rate are left out, as are epochs that are not finite. What the layout
    does not have, position and velocity of a gyro log, is zero with a variance of `UNKNOWN_VARIANCE`.

    Parameters
    ----------
    path : Path
        Of the file.
    evaluations : Sequence[Evaluation]
        Of a run.

    Raises
    ------
    ImportError
        The package rosbags is not installed.
    InputError
        The file cannot be written.
    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer  # pyright: ignore[reportMissingImports]
        from rosbags.typesys import Stores, get_typestore  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise ImportError("MCAP needs rosbags; install it with pip install 'spinfilters[ros]'") from None
    store = get_typestore(Stores.ROS2_HUMBLE)
    with TemporaryDirectory() as folder:
        bag = Path(folder) / "run"
        with Writer(bag, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
            for each in evaluations:
                opened = {
                    kind: writer.add_connection(f"/{_topic(each.name)}/{word}", kind, typestore=store)
                    for kind, word in ((ODOMETRY, "motion"), (VECTOR, "rate"))
                }
                for stamp, kind, message in _messages(each, store.types):
                    writer.write(opened[kind], stamp, store.serialize_cdr(message, kind))
        (content,) = bag.glob("*.mcap")
        write_bytes(path, content.read_bytes())


def _topic(name: str) -> str:
    """An estimator's name as ROS admits it."""
    return name.replace("-", "_")


def _messages(evaluation: Evaluation, types: Any) -> Iterator[tuple[int, str, Any]]:
    """Stamp (ns), type and message of every finite epoch."""
    motion, history = evaluation.trajectory, evaluation.history
    vector, point, turn = (types[f"geometry_msgs/msg/{name}"] for name in ("Vector3", "Point", "Quaternion"))
    pose, twist = types["geometry_msgs/msg/Pose"], types["geometry_msgs/msg/Twist"]
    with_pose, with_twist = (types[f"geometry_msgs/msg/{name}WithCovariance"] for name in ("Pose", "Twist"))
    body_rate = history.mean[:, history.layout.mean_slice("w")]
    turning = [history.factor[:, history.layout.slice(block)] for block in "aw"]  # about the axes of g
    for k in np.flatnonzero(motion.is_finite).tolist():
        stamp = round(float(motion.time[k]) * 1e9)
        instant = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        R_ig = matrix_from_quaternion(motion.q_ig[k])
        attitude, rates = (factor[k] @ factor[k].T for factor in turning)
        speed = R_ig.T @ motion.velocity[k]
        places = [np.diag(std[k] ** 2) for std in (motion.std_position, motion.std_velocity)]
        if not motion.sees_position:
            places = 2 * [UNKNOWN_VARIANCE * np.eye(3)]
        yield (
            stamp,
            ODOMETRY,
            types[ODOMETRY](
                header=types["std_msgs/msg/Header"](stamp=instant, frame_id="i"),
                child_frame_id="g",
                pose=with_pose(
                    pose=pose(
                        position=point(*map(float, motion.position[k])),
                        orientation=turn(*map(float, motion.q_ig[k])),
                    ),
                    covariance=_covariance(places[0], R_ig @ attitude @ R_ig.T),
                ),
                twist=with_twist(
                    twist=twist(linear=vector(*map(float, speed)), angular=vector(*map(float, body_rate[k]))),
                    covariance=_covariance(R_ig.T @ places[1] @ R_ig, rates),
                ),
            ),
        )
        yield (
            stamp,
            VECTOR,
            types[VECTOR](
                header=types["std_msgs/msg/Header"](stamp=instant, frame_id="g"),
                vector=vector(*map(float, body_rate[k])),
            ),
        )


def _covariance(
    linear: Float[np.ndarray, "3 3"], angular: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, " 36"]:
    """Rows of the covariance of a pose or a twist; `UNKNOWN_VARIANCE` of a half that is not finite."""
    halves = [P if np.isfinite(P).all() else UNKNOWN_VARIANCE * np.eye(3) for P in (linear, angular)]
    return np.asarray(block_diag(*halves)).reshape(-1)


TIME_LINE: Final = "time"
DEVIATIONS: Final = 3.0
"""Half axes of the ellipsoids, in standard deviations."""
AXES: Final = ("x", "y", "z")
AXIS_COLORS: Final = ((200, 60, 60), (60, 150, 60), (60, 90, 210))


MOST_IMAGES: Final = 300
"""Of more images those at equal steps are shown: a file holds each as it is."""
MEDIA_TYPES: Final = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}


def write_rrd(
    path: Path,
    evaluations: Sequence[Evaluation],
    maps: Mapping[str, Float[np.ndarray, "k 3"]],
    name: str,
    images: Path | None = None,
) -> None:
    """Write motions, bodies and maps of all estimators, and the truth, atomically.

    Everything spatial lies below ``/i``, the inertial frame in metres. ``/i/NAME/body`` moves with the centre of mass and frame g:
    it holds the principal axes, a box of equal inertia and the landmarks. ``/i/NAME/position`` is an ellipsoid of 3 standard
    deviations along the axes of i, ``/i/NAME/rate`` an arrow (rad/s). ``/NAME/...`` are courses over time: rate, velocity,
    principal moments, their deviations, and NIS. ``/camera/left`` are the images of the left camera, at most 300 of them.

    Parameters
    ----------
    path : Path
        Of the file.
    evaluations : Sequence[Evaluation]
        Of a run.
    maps : Mapping[str, ndarray of float, shape (k, 3)]
        Landmarks in g, m, of the estimators that have a map, by name.
    name : str
        Of the data set.
    images : Path or None
        Folder of the stereo images that the run was made of; None where there are none.

    Raises
    ------
    ImportError
        The package rerun-sdk is not installed.
    InputError
        The file cannot be written.
    """
    try:
        import rerun as rr  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise ImportError(
            "a .rrd needs rerun-sdk; install it with pip install 'spinfilters[rerun]'"
        ) from None
    with TemporaryDirectory() as folder:
        file = Path(folder) / "run.rrd"
        recording = rr.RecordingStream("spinfilters", recording_id=name)
        recording.save(str(file))
        recording.log("i", rr.ViewCoordinates.RDF, static=True)  # x right, y down, z forward, as the camera
        for each in evaluations:
            _record_motion(rr, recording, each)
            _record_body(rr, recording, each, maps.get(each.name))
        if images is not None:
            _record_images(rr, recording, images)
        truths = (each.truth_in_own_frames for each in evaluations)
        truth = next((each for each in truths if each is not None), None)
        if truth is not None:
            _record_truth(rr, recording, truth)
        recording.flush()
        recording.disconnect()
        write_bytes(path, file.read_bytes())


def _record_motion(rr: Any, recording: Any, evaluation: Evaluation) -> None:
    motion, name = evaluation.trajectory, evaluation.name
    when = [rr.TimeColumn(TIME_LINE, duration=motion.time)]
    place = motion.position if motion.sees_position else np.zeros_like(motion.position)
    moved = rr.Transform3D.columns(translation=place, quaternion=motion.q_ig)
    recording.send_columns(f"i/{name}/body", indexes=when, columns=moved)
    arrow = rr.Arrows3D.columns(origins=place, vectors=motion.rate_i)
    recording.send_columns(f"i/{name}/rate", indexes=when, columns=arrow)
    courses = {"rate": (motion.rate_i, motion.std_rate)}
    if motion.sees_position:
        spread = rr.Ellipsoids3D.columns(centers=place, half_sizes=DEVIATIONS * motion.std_position)
        recording.send_columns(f"i/{name}/position", indexes=when, columns=spread)
        finite = place[np.isfinite(place).all(axis=1)]
        recording.log(f"i/{name}/path", rr.LineStrips3D([finite]), static=True)
        courses["velocity"] = (motion.velocity, motion.std_velocity)
    bodies = evaluation.bodies
    variances = np.diagonal(bodies.principal_moments_cov, axis1=1, axis2=2)
    courses["principal_moments"] = (bodies.principal_moments, np.sqrt(variances))
    for word, (values, std) in courses.items():
        for suffix, array in (("", values), ("_std", std)):
            recording.log(
                f"{name}/{word}{suffix}", rr.SeriesLines(names=AXES, colors=AXIS_COLORS), static=True
            )
            columns = rr.Scalars.columns(scalars=array)
            recording.send_columns(f"{name}/{word}{suffix}", indexes=when, columns=columns)
    nis = rr.Scalars.columns(scalars=evaluation.history.nis)
    recording.send_columns(f"{name}/nis", indexes=when, columns=nis)


def _record_body(
    rr: Any, recording: Any, evaluation: Evaluation, landmarks: Float[np.ndarray, "k 3"] | None
) -> None:
    """What does not change in frame g, about the centre of mass, and the verdict in words."""
    body, motion, name = evaluation.body, evaluation.trajectory, evaluation.name
    status = evaluation.history.status
    words = "\n".join([f"**{status.verdict}**", *(f"- {reason}" for reason in status.reasons)])
    recording.log(f"{name}/verdict", rr.TextDocument(words, media_type=rr.MediaType.MARKDOWN), static=True)
    axes = body.principal_axes_g
    if not np.isfinite(axes).all():
        return
    edge = box_edge(motion.position, motion.sees_position)
    box = rr.Boxes3D(
        half_sizes=[edge * box_of_equal_inertia(body.principal_moments) / 2],
        quaternions=[quaternion_from_matrix(axes.T)],
    )
    recording.log(f"i/{name}/body/box_of_equal_inertia", box, static=True)
    arrows = rr.Arrows3D(vectors=edge * axes, colors=AXIS_COLORS)
    recording.log(f"i/{name}/body/principal_axes", arrows, static=True)
    if landmarks is not None:
        centre = np.zeros(3) if body.center_of_mass_g is None else body.center_of_mass_g
        recording.log(f"i/{name}/body/map", rr.Points3D(landmarks - centre), static=True)


def _record_images(rr: Any, recording: Any, folder: Path) -> None:
    """Images of the left camera on the time line; one whose format Rerun does not take is left out."""
    pairs = stamped_pairs(folder, LossCount())
    for pair in pairs[:: -(-len(pairs) // MOST_IMAGES)]:
        media_type = MEDIA_TYPES.get(pair.left.suffix.lower())
        if media_type is None or not pair.left.is_file():
            continue
        recording.set_time(TIME_LINE, duration=pair.time)
        content = rr.EncodedImage(contents=pair.left.read_bytes(), media_type=media_type)
        recording.log("camera/left", content)


def _record_truth(rr: Any, recording: Any, truth: Truth) -> None:
    """The true motion in the frames of the estimates."""
    when = [rr.TimeColumn(TIME_LINE, duration=truth.time)]
    moved = rr.Transform3D.columns(translation=truth.center_of_mass, quaternion=truth.q_ig)
    recording.send_columns("i/truth/body", indexes=when, columns=moved)
    recording.log("i/truth/path", rr.LineStrips3D([truth.center_of_mass]), static=True)
    recording.log("truth/rate", rr.SeriesLines(names=AXES, colors=AXIS_COLORS), static=True)
    rates = rr.Scalars.columns(scalars=truth.rate_i)
    recording.send_columns("truth/rate", indexes=when, columns=rates)
