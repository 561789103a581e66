"""A run as MCAP: read back, it has the motions of every estimator."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spinfilters
from spinfilters.core.attitude_conversions import inverse, matrix_from_quaternion, rotate


def test_a_run_saved_as_mcap_is_read_back(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="needs rosbags of the extra ros")
    data = spinfilters.simulate("pose", frames=20, seed=2)
    run = spinfilters.compare(data, ("mekf", "ukf"), settings={"verdict": "filter"})
    path = run.save(tmp_path / "run.mcap")
    assert [each.name for each in tmp_path.iterdir()] == ["run.mcap"]
    for name in run:
        motion = run[name].evaluation.trajectory
        stream = spinfilters.load(path, topic=f"/{name}/motion").log.streams[0]
        assert stream.sensor == "pose"
        np.testing.assert_allclose(stream.time - stream.time[0], motion.time - motion.time[0], atol=1e-8)
        np.testing.assert_allclose(stream.values[:, :3], motion.position, atol=1e-12)
        turned = np.abs(np.sum(stream.values[:, 3:] * motion.q_ig, axis=1))
        np.testing.assert_allclose(turned, 1.0, atol=1e-12)
        rates = spinfilters.load(path, topic=f"/{name}/rate").log.streams[0]
        body_rates = rotate(inverse(motion.q_ig), motion.rate_i)
        np.testing.assert_allclose(rates.values, body_rates, atol=1e-12)
        assert np.abs(body_rates - motion.rate_i).max() > 0.01


def _last_odometry(path: Path) -> Any:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
        found = [
            (connection, raw) for connection, _, raw in bag.messages() if connection.topic == "/mekf/motion"
        ]
        return bag.deserialize(found[-1][1], found[-1][0].msgtype)


@pytest.mark.parametrize("kind", ["pose", "gyro"])
def test_twists_of_an_mcap_are_in_axes_of_the_child_frame(tmp_path: Path, kind: str) -> None:
    pytest.importorskip("rosbags", reason="needs rosbags of the extra ros")
    run = spinfilters.compare(
        spinfilters.simulate(kind, frames=30, seed=3), ("mekf",), settings={"verdict": "filter"}
    )
    message = _last_odometry(run.save(tmp_path / "run.mcap"))
    motion = run["mekf"].evaluation.trajectory
    R_ig = matrix_from_quaternion(motion.q_ig[-1])
    history = run["mekf"].evaluation.history
    twist, P = message.twist.twist, np.reshape(message.twist.covariance, (6, 6))
    rate = [getattr(twist.angular, axis) for axis in "xyz"]
    np.testing.assert_allclose(rate, R_ig.T @ motion.rate_i[-1], atol=1e-12)
    np.testing.assert_allclose(
        [getattr(twist.linear, axis) for axis in "xyz"], R_ig.T @ motion.velocity[-1], atol=1e-12
    )
    own = history.factor[-1, history.layout.slice("w")]
    np.testing.assert_allclose(P[3:, 3:], own @ own.T, rtol=1e-9)
    pose = np.reshape(message.pose.covariance, (6, 6))
    np.testing.assert_allclose(
        np.sqrt(np.diag(R_ig.T @ pose[3:, 3:] @ R_ig)), motion.std_attitude[-1], rtol=1e-9
    )
    if kind == "gyro":
        assert (np.diag(pose)[:3] >= 1e9).all()
        assert (np.diag(P)[:3] >= 1e9).all()
    else:
        np.testing.assert_allclose(np.diag(pose)[:3], motion.std_position[-1] ** 2, rtol=1e-12)
