"""Scans whose points are the measurements: against the true motion they are consistent, however the body turns in a scan."""

from pathlib import Path

import numpy as np
import pytest
from plain_comparison import plainly_compared
from scipy.spatial import ConvexHull

from spinfilters.api.simulation import simulate
from spinfilters.core.errors import InputError
from spinfilters.evaluation.consistency import true_states
from spinfilters.io.dataset import Dataset
from spinfilters.io.sensor_format import SensorNoise
from spinfilters.lidar.mesh import TriangleMesh, box
from spinfilters.lidar.scan import LidarNoise, RayPattern
from spinfilters.lidar.scan_streams import POINTS_KIND
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.run.preparation import prepare
from spinfilters.run.readers import read_dataset
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.lidar_scanner import LidarSettings, Scanner
from spinfilters.simulation.lidar_sequence import (
    Initial,
    scan_sequence,
    scan_times,
    truth_of,
    tumble_of,
    write_sequence,
)

BOX = box((1.0, 1.3, 0.8))


def recording(folder: Path, mesh: TriangleMesh = BOX, seconds: float = 0.5, rays: int = 61) -> Dataset:
    rotation = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    start = Initial(
        rotation, np.array([10.0, 0, 0]), np.array([0.15, 0.2, 0.12]), np.array([2e-3, 1e-3, -1e-3])
    )
    motion, noise = tumble_of(mesh, start), LidarNoise(range_std=0.003)
    scanner = Scanner.of(mesh, LidarSettings(RayPattern((11.0, 11.0), (rays, rays)), noise, duration=seconds))
    begin, epochs = scan_times(8, 1.0, seconds)
    scans = scan_sequence(scanner, motion, begin, 0, lambda *_: None)
    write_sequence(folder, scans, truth_of(motion, epochs), "a box", POINTS_KIND)
    return read_dataset(folder)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return recording(tmp_path_factory.mktemp("scans"))


def test_points_of_a_body_that_moves_in_a_scan_fit_the_true_motion_within_their_noise(
    dataset: Dataset,
) -> None:
    (stream,) = dataset.log.streams
    assert (dataset.kind, stream.sensor) == ("lidar-points", "lidar-points")
    assert len(stream.epoch_times) == 8
    assert np.ptp(stream.values[:, 3]) > 0.2
    bound = sensor_of("lidar-points").bind(stream, StateLayout(FULL_BLOCKS), SensorNoise({}), None)
    assert dataset.truth is not None
    squares = []
    for time, x in zip(dataset.truth.time, true_states(dataset.truth, bound.model.layout), strict=True):
        rows = np.flatnonzero(np.isclose(bound.time, time))
        about = bound.model.linearise(x, bound.parameters[rows], bound.values[rows])
        assert about.valid.all()
        squares.extend(about.innovation[:, 0] ** 2)
    assert 0.5 < np.mean(squares) < 1.3


def test_the_initial_motion_of_points_is_a_pose_of_every_scan(dataset: Dataset) -> None:
    samples = sensor_of("lidar-points").initial_motion(dataset.log.streams[0], SensorNoise({}), None)
    assert samples is not None
    assert samples.attitude is not None
    assert dataset.truth is not None
    assert len(samples.time) == 8
    off = np.abs(np.einsum("ni,ni->n", samples.attitude, dataset.truth.q_ig))
    assert np.rad2deg(2 * np.arccos(np.clip(off, 0, 1))).max() < 3.0


def test_a_body_without_faces_is_told_to_use_the_poses(tmp_path: Path) -> None:
    sphere = np.random.default_rng(3).standard_normal((1000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    faces = ConvexHull(sphere).simplices
    a, b, c = np.moveaxis(sphere[faces], 1, 0)
    flip = np.einsum("ni,ni->n", np.cross(b - a, c - a), a) < 0
    faces[flip] = faces[flip][:, ::-1]
    mesh = TriangleMesh(sphere * [0.5, 0.7, 0.4], faces)
    with pytest.raises(InputError, match="no plane faces"):
        recording(tmp_path / "scans", mesh, 0.0, 41)


def test_errors_of_the_models_are_looked_for_in_points_whose_angles_have_no_innovation() -> None:
    """A row has three noises and one innovation: the run was called degraded, out of an index."""
    settings = Settings(estimators=("mekf",), process={"gravity": False})  # pyright: ignore[reportArgumentType]
    prepared = prepare(simulate("lidar-points", seed=0, frames=8, interval=1.0), settings)
    (found,) = plainly_compared(prepared, settings).evaluations
    assert not [reason for reason in found.history.status.reasons if "models could not be tested" in reason]
