"""A run as MCAP: read back, it has the motions of every estimator."""

from pathlib import Path

import numpy as np
import pytest

import spinfilters


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
        np.testing.assert_allclose(rates.values, motion.rate_i, atol=1e-12)
