"""A run as a recording of Rerun: read back, it has bodies, ellipsoids and courses of every estimator, and the truth."""

from pathlib import Path

import numpy as np
import pytest

import spinfilters


def test_a_run_saved_for_rerun_is_read_back(tmp_path: Path) -> None:
    chunks = pytest.importorskip("rerun.chunk", reason="needs rerun-sdk of the extra rerun")
    data = spinfilters.simulate("pose", frames=20, seed=2)
    run = spinfilters.compare(data, ("mekf", "ukf"), settings={"verdict": "filter"})
    path = run.save(tmp_path / "run.rrd")
    assert [each.name for each in tmp_path.iterdir()] == ["run.rrd"]
    found = {each.entity_path: each for each in chunks.RrdReader(path).stream().to_chunks()}
    assert {"/i/truth/body", "/truth/rate", "/i/mekf/body/principal_axes", "/mekf/verdict"} <= set(found)
    for name in run:
        motion = run[name].evaluation.trajectory
        moved = found[f"/i/{name}/body"].to_record_batch().to_pydict()
        places = np.array(moved["Transform3D:translation"])[:, 0]
        np.testing.assert_allclose(places, motion.position, atol=1e-6)  # Rerun holds single precision
        spread = found[f"/i/{name}/position"].to_record_batch().to_pydict()
        half_axes = np.array(spread["Ellipsoids3D:half_sizes"])[:, 0]
        np.testing.assert_allclose(half_axes, 3 * motion.std_position, rtol=1e-6)
        nis = found[f"/{name}/nis"].to_record_batch().to_pydict()["Scalars:scalars"]
        np.testing.assert_allclose(np.array(nis)[:, 0], run[name].evaluation.history.nis, rtol=1e-12)


def test_without_rerun_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "rerun", None)
    run = spinfilters.compare(
        spinfilters.simulate("gyro", frames=20, seed=2), ("mekf",), settings={"verdict": "filter"}
    )
    with pytest.raises(ImportError, match=r"pip install 'spinfilters\[rerun\]'"):
        run.save(tmp_path / "run.rrd")
    assert list(tmp_path.iterdir()) == []
