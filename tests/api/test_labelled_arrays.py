"""Back from a run: labelled arrays, NetCDF, and the tracked frame beside the centre of mass."""

import sys
from pathlib import Path

import numpy as np
import pytest

import spinfilters
from spinfilters.io.sensor_tables import read_tum


@pytest.fixture(scope="module")
def poses() -> spinfilters.Run:
    """A small run of poses, by two estimators."""
    return spinfilters.compare(spinfilters.simulate(kind="pose", frames=30), "mekf,ukf")


def test_labelled_arrays_hold_the_trajectories_of_all_estimators(poses: spinfilters.Run) -> None:
    pytest.importorskip("xarray")
    arrays = poses.to_xarray()
    for name in poses:
        chosen = arrays.sel(estimator=name)
        np.testing.assert_array_equal(chosen.position, poses[name].trajectory.position)
        np.testing.assert_array_equal(chosen.q_ig, poses[name].trajectory.q_ig)
        np.testing.assert_array_equal(chosen.principal_moments, poses[name].body.principal_moments)
        assert str(chosen.status.values) == poses[name].status
    assert arrays.rate_i.attrs["units"] == "rad/s"


def test_a_file_of_netcdf_holds_the_labelled_arrays(poses: spinfilters.Run, tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    path = poses.save(tmp_path / "run.nc")
    with xarray.open_dataset(path, engine="scipy") as read:
        np.testing.assert_array_equal(read.std_rate, poses.to_xarray().std_rate)
        assert read.sizes["estimator"] == 2


def test_a_gyro_has_no_position_in_labelled_arrays(gyro: spinfilters.Dataset) -> None:
    pytest.importorskip("xarray")
    arrays = spinfilters.compare(gyro, "mekf").to_xarray()
    assert np.isnan(arrays.position).all()
    assert np.isnan(arrays.center_of_mass_g).all()


def test_without_xarray_one_line_says_how_to_get_it(
    poses: spinfilters.Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ImportError, match="pip install xarray"):
        poses.save(tmp_path / "run.nc")
    assert not (tmp_path / "run.nc").exists()


def test_the_tracked_frame_stands_beside_the_centre_of_mass(
    poses: spinfilters.Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from spinfilters.plots import figures

    monkeypatch.setattr(figures, "_figures", lambda run: [])
    folder = poses.save(tmp_path / "run")
    history = poses["mekf"].evaluation.history
    read = read_tum(folder / "mekf" / "trajectory_g.tum")
    np.testing.assert_allclose(
        read.values[:, :3], history.mean[:, history.layout.mean_slice("t")], atol=1e-12
    )
    centre = read_tum(folder / "mekf" / "trajectory.tum").values[:, :3]
    lever = np.linalg.norm(centre - read.values[:, :3], axis=1)
    offset = history.mean[:, history.layout.mean_slice("c")]
    np.testing.assert_allclose(lever, np.linalg.norm(offset, axis=1), atol=1e-9)
