"""A run as an MCAP file of ROS 2 messages, which Foxglove, PlotJuggler and ros2 bag show; needs the extra ``ros``."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.io.output_files import write_bytes

ODOMETRY, VECTOR = "nav_msgs/msg/Odometry", "geometry_msgs/msg/Vector3Stamped"


def write_mcap(path: Path, evaluations: Sequence[Evaluation]) -> None:
    """Write the motions of all estimators, atomically.

    ``/NAME/motion`` are nav_msgs/Odometry: position of the centre of mass (m) and attitude of frame g in frame i with
    covariances, velocity (m/s) and rate (rad/s) in axes of frame i. ``/NAME/rate`` repeats the rate as a vector.

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
    """Stamp (ns), type and message of every epoch."""
    motion = evaluation.trajectory
    vector, point, turn = (types[f"geometry_msgs/msg/{name}"] for name in ("Vector3", "Point", "Quaternion"))
    pose, twist = types["geometry_msgs/msg/Pose"], types["geometry_msgs/msg/Twist"]
    with_pose, with_twist = (types[f"geometry_msgs/msg/{name}WithCovariance"] for name in ("Pose", "Twist"))
    for k, time in enumerate(motion.time):
        stamp = round(float(time) * 1e9)
        instant = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        header = types["std_msgs/msg/Header"](stamp=instant, frame_id="i")
        place = [float(x) if motion.sees_position else 0.0 for x in motion.position[k]]
        speed = [float(x) if motion.sees_position else 0.0 for x in motion.velocity[k]]
        rate = [float(x) for x in motion.rate_i[k]]
        pose_covariance = np.diag([*motion.std_position[k] ** 2, *motion.std_attitude[k] ** 2]).reshape(-1)
        twist_covariance = np.diag([*motion.std_velocity[k] ** 2, *motion.std_rate[k] ** 2]).reshape(-1)
        yield (
            stamp,
            ODOMETRY,
            types[ODOMETRY](
                header=header,
                child_frame_id="g",
                pose=with_pose(
                    pose=pose(position=point(*place), orientation=turn(*map(float, motion.q_ig[k]))),
                    covariance=np.nan_to_num(pose_covariance),
                ),
                twist=with_twist(
                    twist=twist(linear=vector(*speed), angular=vector(*rate)),
                    covariance=np.nan_to_num(twist_covariance),
                ),
            ),
        )
        yield stamp, VECTOR, types[VECTOR](header=header, vector=vector(*rate))
