"""The trajectory of a history: covariance with all cross terms, and the files that hold it."""

from pathlib import Path

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.errors import InputError, ShapeError
from spinfilters.evaluation.estimated_motion import (
    TRAJECTORY_COLUMNS,
    Trajectory,
    trajectory_of,
    write_map_ply,
    write_trajectory_csv,
    write_trajectory_tum,
)
from spinfilters.io.sensor_tables import read_tum
from spinfilters.io.text_table import read_csv
from spinfilters.models.state_layout import ROTATION_BLOCKS, StateLayout
from tests.evaluation.estimate_samples import FULL, history_of, sample_factor, sample_point

SAMPLES = 20000
SAMPLING = 4 / np.sqrt(2 * SAMPLES)


def trajectory(seed: int = 0, count: int = 5, layout: StateLayout = FULL) -> Trajectory:
    generator = np.random.default_rng(seed)
    mean = np.array([sample_point(generator, layout) for _ in range(count)])
    factor = np.array([sample_factor(generator, layout.error_dim, 0.01) for _ in range(count)])
    return trajectory_of(history_of(mean, factor, layout))


def test_position_and_rate_uncertainty_are_those_of_samples_and_need_the_cross_terms() -> None:
    generator = np.random.default_rng(1)
    mean, factor = sample_point(generator), sample_factor(generator, FULL.error_dim, 0.01)
    errors = generator.standard_normal((SAMPLES, FULL.error_dim)) @ factor.T
    points = FULL.retract(mean, errors)
    R = matrix_from_quaternion(points[:, FULL.mean_slice("a")])
    t, c, w = (points[:, FULL.mean_slice(block)] for block in "tcw")
    found = trajectory_of(history_of(mean[np.newaxis], factor[np.newaxis]))
    std = (t + np.einsum("nij,nj->ni", R, c)).std(axis=0)
    np.testing.assert_allclose(found.std_position[0], std, rtol=SAMPLING)
    np.testing.assert_allclose(found.std_rate[0], np.einsum("nij,nj->ni", R, w).std(axis=0), rtol=SAMPLING)
    independent = np.diag(np.linalg.norm(factor, axis=1))
    wrong = trajectory_of(history_of(mean[np.newaxis], independent[np.newaxis])).std_position[0]
    assert np.abs(wrong / std - 1).max() > 3 * SAMPLING


def test_position_is_the_centre_of_mass_and_the_rate_stands_in_inertial_axes() -> None:
    generator = np.random.default_rng(2)
    x = sample_point(generator)
    found = trajectory_of(history_of(x[np.newaxis], np.eye(FULL.error_dim)[np.newaxis]))
    R = matrix_from_quaternion(x[FULL.mean_slice("a")])
    np.testing.assert_allclose(found.position[0], x[FULL.mean_slice("t")] + R @ x[FULL.mean_slice("c")])
    np.testing.assert_allclose(found.rate_i[0], R @ x[FULL.mean_slice("w")])
    np.testing.assert_array_equal(found.velocity[0], x[FULL.mean_slice("v")])


def test_a_layout_of_rotations_has_no_position_and_no_doubt_about_it() -> None:
    found = trajectory(layout=StateLayout(ROTATION_BLOCKS))
    assert not found.sees_position
    for zero in (found.position, found.velocity, found.std_position, found.std_velocity):
        np.testing.assert_array_equal(zero, np.zeros((5, 3)))
    assert (found.std_rate > 0).all()


def test_the_csv_gives_back_the_same_bits_in_the_columns_of_the_truth(tmp_path: Path) -> None:
    written = trajectory(3)
    write_trajectory_csv(tmp_path / "trajectory.csv", written)
    table = read_csv(tmp_path / "trajectory.csv", TRAJECTORY_COLUMNS)
    assert TRAJECTORY_COLUMNS[:3] == ("time_s", "rx", "ry")
    assert TRAJECTORY_COLUMNS[14:18] == ("std_rx", "std_ry", "std_rz", "std_ax")
    np.testing.assert_array_equal(table.values[:, 1:4], written.position)
    np.testing.assert_array_equal(table.values[:, 4:8], written.q_ig)
    np.testing.assert_array_equal(table.values[:, -3:], written.std_rate)


def test_the_tum_file_holds_the_centre_of_mass_and_the_attitude(tmp_path: Path) -> None:
    written = trajectory(4)
    write_trajectory_tum(tmp_path / "trajectory.tum", written)
    read = read_tum(tmp_path / "trajectory.tum")
    np.testing.assert_array_equal(read.values, np.hstack([written.position, written.q_ig]))


def test_the_ply_declares_its_points_and_holds_their_bits(tmp_path: Path) -> None:
    points = np.random.default_rng(5).standard_normal((17, 3))
    write_map_ply(tmp_path / "map.ply", points)
    header, body = (tmp_path / "map.ply").read_bytes().split(b"end_header\n")
    lines = header.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    assert "element vertex 17" in lines
    assert [line for line in lines if line.startswith("property")] == [f"property double {a}" for a in "xyz"]
    np.testing.assert_array_equal(np.frombuffer(body, dtype="<f8").reshape(17, 3), points)


def test_a_map_of_another_shape_or_into_no_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ShapeError, match=r"\(4, 2\)"):
        write_map_ply(tmp_path / "map.ply", np.zeros((4, 2)))
    with pytest.raises(InputError, match="cannot be written"):
        write_map_ply(tmp_path / "nowhere" / "map.ply", np.zeros((4, 3)))
