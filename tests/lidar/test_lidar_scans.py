"""Scans of a tumbling body are compared like any recording."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plain_comparison import plain_comparison
from scipy.spatial.transform import Rotation

from spinfilters.core.attitude_conversions import angle_between, multiply, quaternion_from_rotation_vector
from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.lidar.mesh import box
from spinfilters.lidar.scan import RayPattern, rvs_noise
from spinfilters.lidar.scan_streams import in_frame_of
from spinfilters.models.status import Verdict
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


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set of 25 scans with the noise of the specification, which nobody states."""
    mesh, place = box((1.0, 1.3, 0.8)), tmp_path_factory.mktemp("scans")
    start = Initial(
        Rotation.from_rotvec([0.3, 0.4, 0.2]).as_matrix(),
        np.array([30.0, 0, 0]),
        np.array([0.15, 0.2, 0.12]),
        np.zeros(3),
    )
    motion = tumble_of(mesh, start)
    scanner = Scanner.of(mesh, LidarSettings(RayPattern((4.0, 4.0), (61, 61)), rvs_noise()))
    begin, epochs = scan_times(25, 1.0, 0.0)
    scans = scan_sequence(scanner, motion, begin, 0, lambda *_: None)
    write_sequence(place, scans, truth_of(motion, epochs), "25 scans")
    return place


@pytest.fixture(scope="module")
def dataset(folder: Path) -> Dataset:
    return read_dataset(folder)


def test_scans_become_poses_with_covariance_in_a_frame_of_their_own(dataset: Dataset) -> None:
    (stream,) = dataset.log.streams
    assert (dataset.kind, stream.sensor, len(stream)) == ("lidar-poses", "lidar-poses", 25)
    assert stream.covariance is not None
    assert dataset.truth is not None
    assert dataset.truth.center_of_mass_g is not None
    assert np.linalg.norm(dataset.truth.center_of_mass_g) < 0.02  # g's origin is the centre of rotation


def test_scans_tell_rates_centre_of_mass_and_moments(dataset: Dataset) -> None:
    settings = Settings(estimators=("mekf",))
    (found,) = plain_comparison(dataset, settings).evaluations
    moments = found.body.principal_moments
    assert dataset.truth is not None
    assert dataset.truth.principal_moments is not None
    np.testing.assert_allclose(moments, dataset.truth.principal_moments, atol=0.02)


def test_one_wrong_pose_does_not_displace_the_truth(dataset: Dataset) -> None:
    (stream,), truth = dataset.log.streams, dataset.truth
    assert truth is not None
    assert truth.center_of_mass_g is not None
    values = stream.values.copy()
    values[7, :3] += [0.0, 0.0, 0.8]
    values[9, 3:] = [1.0, 0.0, 0.0, 0.0]
    told = in_frame_of(replace(stream, values=values), truth)
    assert told.center_of_mass_g is not None
    np.testing.assert_allclose(told.center_of_mass_g, truth.center_of_mass_g, rtol=0, atol=3e-5)
    assert angle_between(told.q_ig, truth.q_ig).max() < 1e-4


def test_a_folder_of_scans_that_cannot_be_used_is_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    (tmp_path / "dataset.toml").write_text('kind = "lidar-scans"\n')
    with pytest.raises(InputError, match=r"holds no \.ply"):
        read_dataset(tmp_path)
    for name in ("0.ply", "1.ply"):
        (tmp_path / "scans" / name).write_bytes((folder / "scans" / "00.ply").read_bytes())
    with pytest.raises(InputError, match="as the scan before"):
        read_dataset(tmp_path)


def test_planes_that_contradict_the_drift_are_a_doubt_of_every_estimate(dataset: Dataset) -> None:
    assert dataset.doubts == ()
    settings, doubted = Settings(estimators=("mekf",)), replace(dataset, doubts=("7 of 25 scans",))
    (found,) = plain_comparison(doubted, settings).evaluations
    assert found.history.status.verdict is Verdict.DEGRADED
    (doubt,) = (each for each in found.history.status.findings if each.check == "data-set")
    assert doubt.sentence == "7 of 25 scans"


def test_what_a_front_end_doubts_is_stated_first_and_no_other_cause_is_named(dataset: Dataset) -> None:
    """Scans that are turned wrongly look like contact."""
    (stream,) = dataset.log.streams
    values = stream.values.copy()
    turn = quaternion_from_rotation_vector(np.array([0.0, 2.5, 0.0]))
    values[-4:, 3:] = multiply(np.broadcast_to(turn, (4, 4)), values[-4:, 3:])
    log = replace(dataset.log, streams=(replace(stream, values=values),))
    doubted = replace(dataset, log=log, doubts=("3 of 25 scans may be turned wrongly",))
    (found,) = plain_comparison(doubted, Settings(estimators=("smoother",))).evaluations
    first, *others = found.history.status.findings
    assert first.check == "data-set"
    assert not [
        each.sentence for each in others if "most like" in each.sentence and "contact" in each.sentence
    ]


def test_stamps_that_fall_with_the_names_are_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    (tmp_path / "dataset.toml").write_text('kind = "lidar-scans"\n')
    paths = sorted((folder / "scans").iterdir())[:3]
    for name, path in zip(("scan9", "scan10", "scan11"), paths, strict=True):
        (tmp_path / "scans" / f"{name}.ply").write_bytes(path.read_bytes())
    assert len(read_dataset(tmp_path).log.streams[0]) == 3
    (tmp_path / "scans" / "scan10.ply").rename(tmp_path / "scans" / "scan12.ply")
    with pytest.raises(InputError, match="time runs backwards; name the scans in the order"):
        read_dataset(tmp_path)
