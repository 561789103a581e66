"""Gyro tables with a header of their own."""

from pathlib import Path

import numpy as np
import pytest

from spinfilters.data.dataset import read_dataset
from spinfilters.errors import InputError

ROWS = np.array([[0.0, 0.1, 0.2, 0.3], [0.01, 0.4, 0.5, 0.6], [0.02, 0.7, 0.8, 0.9]])


def written(folder: Path, header: str, rows: np.ndarray = ROWS) -> Path:
    """A table with this header."""
    path = folder / "mine.csv"
    lines = [",".join(map(repr, row)) for row in rows.tolist()]
    path.write_text("\n".join([header, *lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "header",
    [
        "time_s,wx,wy,wz",
        "time,wx,wy,wz",
        "t,omega_x,omega_y,omega_z",
        "Time (s),Gyroscope x (rad/s),Gyroscope y (rad/s),Gyroscope z (rad/s)",
        "seconds_elapsed,gyro_x,gyro_y,gyro_z",
        "timestamp [s],x [rad/s],y [rad/s],z [rad/s]",
        "time,wx_rad_s,wy_rad_s,wz_rad_s",
        "time,x_radps,y_radps,z_radps",
        "TIME,Angular Velocity X,Angular Velocity Y,Angular Velocity Z",
    ],
)
def test_time_and_rates_are_found_by_their_headings(header: str, tmp_path: Path) -> None:
    stream = read_dataset(written(tmp_path, header)).log.stream("gyro")
    np.testing.assert_array_equal(stream.time, ROWS[:, 0])
    np.testing.assert_array_equal(stream.values, ROWS[:, 1:])


def test_other_columns_and_another_order_do_no_harm(tmp_path: Path) -> None:
    rows = np.column_stack([ROWS[:, 3], np.full(3, 9.8), ROWS[:, 1], ROWS[:, 2], ROWS[:, 0]])
    stream = read_dataset(written(tmp_path, "wz,az,wx,wy,time", rows)).log.stream("gyro")
    np.testing.assert_array_equal(stream.values, ROWS[:, 1:])
    np.testing.assert_array_equal(stream.time, ROWS[:, 0])


@pytest.mark.parametrize(
    ("header", "says"),
    [
        ("time,wx,wy,other", "one rate in rad/s about each axis"),
        ("time,x,y,z", "such as time_s,wx,wy,wz"),
        ("time_ms,wx,wy,wz", "one column of time in s"),
        ("time (ms),wx,wy,wz", "one column of time in s"),
        ("time,wx (rpm),wy (rpm),wz (rpm)", "rate in rad/s"),
        ("time,wx,wy (deg/s),wz", "in degrees"),
        ("time,wx,wx,wz", "about each axis"),
        ("time,t,wx,wy,wz", "one column of time"),
    ],
)
def test_headings_that_cannot_be_told_are_refused_in_one_line(header: str, says: str, tmp_path: Path) -> None:
    rows = np.column_stack([ROWS, ROWS[:, 0]])[:, : header.count(",") + 1]
    with pytest.raises(InputError, match=r"mine\.csv: line 1: ") as refusal:
        read_dataset(written(tmp_path, header, rows))
    assert says in str(refusal.value)
    assert len(str(refusal.value)) - len(str(tmp_path)) < 280


def test_rates_in_degrees_are_noticed_where_the_header_states_no_unit(tmp_path: Path) -> None:
    rows = ROWS * [1.0, 300.0, 300.0, 300.0]
    with pytest.raises(InputError, match=r"line 4: a rate of 417\.9 rad/s .* convert the rates to rad/s"):
        read_dataset(written(tmp_path, "time,wx,wy,wz", rows))
    assert read_dataset(written(tmp_path, "time,wx (rad/s),wy (rad/s),wz (rad/s)", rows)).kind == "gyro"


def test_milliseconds_are_noticed_where_the_header_states_no_unit(tmp_path: Path) -> None:
    rows = ROWS * [1e4, 1.0, 1.0, 1.0]
    with pytest.raises(InputError, match=r"turn by .* rad between samples; convert the time to s"):
        read_dataset(written(tmp_path, "time,wx,wy,wz", rows))
    assert read_dataset(written(tmp_path, "time (s),wx,wy,wz", rows)).kind == "gyro"
