"""Rows that only repeat the row before, or were interpolated, are left out where a logger wrote them, and nowhere else."""

from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float
from scipy.interpolate import interp1d
from scipy.spatial.transform import Rotation

from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.run.readers import read_dataset, read_segments, read_whole

TIME = np.arange(400) / 100.0
DEVIATION = 0.01


def rates() -> Float[np.ndarray, "n 3"]:
    """Of a tumbling body, rad/s, with noise."""
    turning = np.stack([np.sin(2 * TIME), 2 * np.cos(2 * TIME), 3 + 0.5 * np.sin(TIME)], axis=1)
    return turning + DEVIATION * np.random.default_rng(0).standard_normal(turning.shape)


def read(folder: Path, values: Float[np.ndarray, "n 3"]) -> Dataset:
    """The data set of a table of these rates at 100 Hz."""
    path = folder / "mine.csv"
    rows = [",".join(map(repr, row)) for row in np.column_stack([TIME, values]).tolist()]
    path.write_text("\n".join(["time_s,wx,wy,wz", *rows, ""]))
    return read_dataset(path)


@pytest.mark.parametrize("every", [2, 3, 5])
def test_rates_written_several_times_are_taken_once_at_their_first_stamp(every: int, tmp_path: Path) -> None:
    values = rates()
    dataset = read(tmp_path, values[np.arange(len(TIME)) // every * every])
    stream = dataset.log.stream("gyro")
    np.testing.assert_array_equal(stream.time, TIME[::every])
    np.testing.assert_array_equal(stream.values, values[::every])
    left_out = len(TIME) - len(stream)
    assert f"{left_out} of 400 rows of the gyro repeat the row before and are left out" in dataset.description
    assert f"about {100 / every:.3g} Hz" in dataset.description
    write_dataset(dataset, tmp_path / "written")
    for again in (
        read_dataset(tmp_path / "written"),
        read_whole(tmp_path / "mine.csv"),
        *read_segments(tmp_path / "mine.csv"),
    ):
        np.testing.assert_array_equal(again.log.stream("gyro").time, stream.time)
        assert again.description.count("left out") == 1


def frozen(values: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """A sensor that hung for a while."""
    values[200:230] = values[200]
    return values


def rare(values: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """One row in four twice."""
    values[1::4] = values[::4]
    return values


UNTOUCHED = {
    "as they are": lambda values: values,
    "coarse": lambda values: np.round(values / (4 * DEVIATION)) * 4 * DEVIATION,
    "very coarse": lambda values: np.round(values / 0.5) * 0.5,
    "one axis": lambda values: np.round(values * [0.0, 0.0, 1.0] / 0.2) * 0.2,
    "constant": lambda values: np.tile(values[0], (len(values), 1)),
    "a step": lambda values: np.where(TIME[:, np.newaxis] < 2.0, values[0], values[-1]),
    "at rest": np.zeros_like,
    "frozen": frozen,
    "rare": rare,
}


@pytest.mark.parametrize("name", UNTOUCHED)
def test_what_resolution_or_a_fault_repeats_is_kept(name: str, tmp_path: Path) -> None:
    dataset = read(tmp_path, UNTOUCHED[name](rates()))
    assert len(dataset.log.stream("gyro")) == len(TIME)
    assert "left out" not in dataset.description


def poses(columns: slice) -> Float[np.ndarray, "n c"]:
    """Positions (m) and quaternions of a drifting body that spins about z, or some of these columns, with noise."""
    random = np.random.default_rng(1)
    turned = Rotation.from_rotvec(np.outer(2 * TIME, [0.0, 0.0, 1.0]))
    turned = turned * Rotation.from_rotvec(DEVIATION * random.standard_normal((len(TIME), 3)))
    position = np.outer(TIME, [0.1, -0.2, 0.0]) + DEVIATION * random.standard_normal((len(TIME), 3))
    return np.hstack([position, turned.as_quat()])[:, columns]


SLOW_SENSORS = {
    "pose": ("t,px,py,pz,qx,qy,qz,qw", slice(None)),
    "attitude": ("time_s,qx,qy,qz,qw", slice(3, None)),
}


def read_poses(folder: Path, header: str, values: Float[np.ndarray, "n c"]) -> Dataset:
    """The data set of a table of these columns at 100 Hz."""
    path = folder / "mine.csv"
    rows = [",".join(map(repr, row)) for row in np.column_stack([TIME[: len(values)], values]).tolist()]
    path.write_text("\n".join([header, *rows, ""]))
    return read_dataset(path)


@pytest.mark.parametrize("decimals", [12, 3])
@pytest.mark.parametrize("sensor", SLOW_SENSORS)
def test_values_of_a_slower_tracker_are_taken_once(sensor: str, decimals: int, tmp_path: Path) -> None:
    header, columns = SLOW_SENSORS[sensor]
    values = poses(columns).round(decimals)[np.arange(len(TIME)) // 2 * 2]
    dataset = read_poses(tmp_path, header, values)
    np.testing.assert_array_equal(dataset.log.stream(sensor).time, TIME[::2])
    assert f"200 of 400 rows of the {sensor} repeat the row before" in dataset.description


def resampled(values: Float[np.ndarray, "n c"], every: int) -> Float[np.ndarray, "n c"]:
    """Every so manieth row, and what linear interpolation over time puts between them; unit quaternions."""
    between = interp1d(TIME[::every], values[::every], axis=0, fill_value="extrapolate")(TIME)  # pyright: ignore[reportCallIssue, reportArgumentType]
    between[:, -4:] /= np.linalg.norm(between[:, -4:], axis=1, keepdims=True)
    return between


@pytest.mark.parametrize("every", [2, 3])
@pytest.mark.parametrize("sensor", SLOW_SENSORS)
def test_poses_interpolated_between_measured_ones_are_left_out(
    sensor: str, every: int, tmp_path: Path
) -> None:
    header, columns = SLOW_SENSORS[sensor]
    count = len(TIME) // every * every - every + 1
    dataset = read_poses(tmp_path, header, resampled(poses(columns), every)[:count])
    np.testing.assert_array_equal(dataset.log.stream(sensor).time, TIME[:count:every])
    assert f"rows of the {sensor} lie on the line between their neighbours and are left out" in (
        dataset.description
    )


def test_rates_interpolated_between_measured_ones_are_left_out(tmp_path: Path) -> None:
    values = rates()
    values[1:-1:2] = (values[:-2:2] + values[2::2]) / 2
    stream = read(tmp_path, values).log.stream("gyro")
    np.testing.assert_array_equal(stream.time, [*TIME[::2], TIME[-1]])


@pytest.mark.parametrize("sensor", SLOW_SENSORS)
@pytest.mark.parametrize("every", [1, 1.5, 2.5])
def test_rows_that_no_interpolation_explains_or_leaves_measured_are_kept(
    sensor: str, every: float, tmp_path: Path
) -> None:
    header, columns = SLOW_SENSORS[sensor]
    values = poses(columns)
    if every > 1:  # no measured rows are left then
        knots = np.arange(0.0, TIME[-1] + 0.1, 0.01 * every)
        measured = interp1d(TIME, values, axis=0, kind="nearest", fill_value="extrapolate")(knots)  # pyright: ignore[reportCallIssue, reportArgumentType]
        values = interp1d(knots, measured, axis=0)(TIME)
        values[:, -4:] /= np.linalg.norm(values[:, -4:], axis=1, keepdims=True)
    assert len(read_poses(tmp_path, header, values).log.stream(sensor)) == len(TIME)


@pytest.mark.parametrize("sensor", SLOW_SENSORS)
def test_rows_of_a_body_that_came_to_rest_are_kept(sensor: str, tmp_path: Path) -> None:
    header, columns = SLOW_SENSORS[sensor]
    values = poses(columns)
    values[150:] = values[150]
    assert len(read_poses(tmp_path, header, values).log.stream(sensor)) == len(TIME)


def test_a_straight_path_without_noise_is_kept(tmp_path: Path) -> None:
    header, columns = SLOW_SENSORS["pose"]
    values = poses(columns)
    values[:, :3] = np.outer(TIME + 4.0, [0.1, -0.2, 0.3])
    assert len(read_poses(tmp_path, header, values).log.stream("pose")) == len(TIME)
