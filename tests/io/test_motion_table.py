"""Motion tables with a header of their own: names, units, clocks."""

from pathlib import Path

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.stated_values import NOTHING_STATED, ReadingOptions
from spinfilters.run.readers import read_dataset

ROWS = np.array([[0.0, 0.1, 0.2, 0.3], [0.01, 0.4, 0.5, 0.6], [0.02, 0.7, 0.8, 0.9]])
DEG = np.pi / 180


def written(folder: Path, header: str, rows: np.ndarray = ROWS, delimiter: str = ",") -> Path:
    """A table with this header."""
    path = folder / "mine.csv"
    lines = [delimiter.join(map(repr, row)) for row in rows.tolist()]
    path.write_text("\n".join([header, *lines, ""]), encoding="utf-8")
    return path


def rates(path: Path, options: ReadingOptions = NOTHING_STATED) -> Dataset:
    """The data set, which must be of a gyro."""
    dataset = read_dataset(path, options=options)
    assert dataset.kind == "gyro"
    return dataset


@pytest.mark.parametrize(
    "header",
    [
        "time_s,wx,wy,wz",
        "time,wx,wy,wz",
        "t,omega_x,omega_y,omega_z",
        "Time (s),Gyroscope x (rad/s),Gyroscope y (rad/s),Gyroscope z (rad/s)",
        '"Zeit (s)","Gyroskop x (rad/s)","Gyroskop y (rad/s)","Gyroskop z (rad/s)"',
        "seconds_elapsed,gyro_x,gyro_y,gyro_z",
        "timestamp [s],x [rad/s],y [rad/s],z [rad/s]",
        "time,wx_rad_s,wy_rad_s,wz_rad_s",
        "time,x_radps,y_radps,z_radps",
        "TIME,Angular Velocity X,Angular Velocity Y,Angular Velocity Z",
        "t,angular_velocity.x,angular_velocity.y,angular_velocity.z",
        "%time,field.angular_velocity.x,field.angular_velocity.y,field.angular_velocity.z",
        "motionTimestamp_sinceReboot(s),motionRotationRateX(rad/s),motionRotationRateY(rad/s),motionRotationRateZ(rad/s)",
        "t,wx (rad/sec),wy (rad/sec),wz (rad/sec)",
    ],
)
def test_time_and_rates_are_found_by_their_headings(header: str, tmp_path: Path) -> None:
    stream = rates(written(tmp_path, header)).log.stream("gyro")
    np.testing.assert_array_equal(stream.time, ROWS[:, 0])
    np.testing.assert_array_equal(stream.values, ROWS[:, 1:])


@pytest.mark.parametrize(
    ("header", "scale"),
    [
        ("time,gyr_x_dps,gyr_y_dps,gyr_z_dps", DEG),
        ("time,GyroX(deg/s),GyroY(deg/s),GyroZ(deg/s)", DEG),
        ("time,AsX(°/s),AsY(°/s),AsZ(°/s)", DEG),
        ("time,gyroADC[0] (deg/s),gyroADC[1] (deg/s),gyroADC[2] (deg/s)", DEG),
        ("time,GYR_X [mdps],GYR_Y [mdps],GYR_Z [mdps]", DEG / 1e3),
        ("time,wx (rpm),wy (rpm),wz (rpm)", np.pi / 30),
    ],
)
def test_the_unit_of_rates_is_that_of_their_headings(header: str, scale: float, tmp_path: Path) -> None:
    stream = rates(written(tmp_path, header)).log.stream("gyro")
    np.testing.assert_allclose(stream.values, ROWS[:, 1:] * scale, rtol=1e-15)


@pytest.mark.parametrize(
    ("header", "stamps"),
    [
        ("time_ms,wx,wy,wz", [5.0, 15.0, 25.0]),
        ("time (us),wx,wy,wz", [5e3, 15e3, 25e3]),
        ("timestamp_ns,wx,wy,wz", [5e6, 15e6, 25e6]),
        ("millis,wx,wy,wz", [5.0, 15.0, 25.0]),
        ("time,wx,wy,wz", [5e6, 15e6, 25e6]),
        ("time,wx,wy,wz", [5.0, 15.0, 25.0]),
        ("time,wx,wy,wz", [1.7e18, 1.7e18 + 1e7, 1.7e18 + 2e7]),
        ("time,wx,wy,wz", [1.7e12, 1.7e12 + 10, 1.7e12 + 20]),
        ("time,seconds_elapsed,wx,wy,wz", [0.005, 0.015, 0.025]),
    ],
)
def test_the_unit_of_the_clock_is_that_of_its_heading_or_stamps(
    header: str, stamps: list[float], tmp_path: Path
) -> None:
    rows = np.column_stack([stamps, ROWS[:, 1:]])
    if "seconds" in header:
        rows = np.column_stack([np.array(stamps) * 1e9, rows])
    stream = rates(written(tmp_path, header, rows)).log.stream("gyro")
    np.testing.assert_allclose(np.diff(stream.time), 0.01, rtol=1e-4)


def test_a_rate_takes_the_place_of_a_clock_and_a_unit_that_of_a_heading(tmp_path: Path) -> None:
    path = written(tmp_path, "gx,gy,gz,temp", np.column_stack([ROWS[:, 1:], ROWS[:, 0]]))
    stream = rates(path, ReadingOptions(rate=104.0, unit="deg/s")).log.stream("gyro")
    np.testing.assert_allclose(stream.time, np.arange(3) / 104)
    np.testing.assert_allclose(stream.values, ROWS[:, 1:] * DEG)


def test_other_columns_and_another_order_do_no_harm(tmp_path: Path) -> None:
    rows = np.column_stack([ROWS[:, 3], np.full(3, 9.8), ROWS[:, 1], ROWS[:, 2], ROWS[:, 0]])
    stream = rates(written(tmp_path, "wz,pressure,wx,wy,time", rows)).log.stream("gyro")
    np.testing.assert_array_equal(stream.values, ROWS[:, 1:])
    np.testing.assert_array_equal(stream.time, ROWS[:, 0])


def test_an_accelerometer_beside_the_gyro_is_kept_in_si(tmp_path: Path) -> None:
    rows = np.column_stack([ROWS, np.full((3, 3), [0.0, 1.0, 0.0])])
    found = rates(written(tmp_path, "time,wx,wy,wz,acc_x (g),acc_y (g),acc_z (g)", rows)).acceleration
    assert found is not None
    np.testing.assert_allclose(found.values, np.full((3, 3), [0.0, 9.80665, 0.0]))
    counted = rates(
        written(tmp_path, "n,wx,wy,wz,ax_g,ay_g,az_g", rows), ReadingOptions(rate=50.0)
    ).acceleration
    assert counted is not None
    np.testing.assert_allclose(counted.time, [0.0, 0.02, 0.04])
    assert (
        rates(written(tmp_path, "time,wx,wy,wz,Linear Acceleration x,la y,la z", rows)).acceleration is None
    )


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le"])
def test_comments_blanks_semicolons_decimal_commas_and_encodings_do_no_harm(
    encoding: str, tmp_path: Path
) -> None:
    lines = ["# a flight", "device;MPU-6050", "", "Time;Gyr X (deg/s);Gyr Y (deg/s);Gyr Z (deg/s);note"]
    lines += [";".join(f"{value:.2f}".replace(".", ",") for value in row) + ";ok" for row in ROWS]
    path = tmp_path / "mine.csv"
    path.write_bytes("\r\n".join([*lines[:5], "", "# a remark", *lines[5:], ""]).encode(encoding))
    stream = rates(path).log.stream("gyro")
    np.testing.assert_allclose(stream.values, ROWS[:, 1:] * DEG)
    np.testing.assert_array_equal(stream.time, ROWS[:, 0])


def test_rows_of_other_sensors_in_a_merged_table_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("time,wx,wy,wz,temp\n0,1,2,3,\n0.005,,,,20\n0.01,1,2,3,\n0.02,1,2,3,\n")
    dataset = rates(path)
    assert len(dataset.log.times) == 3
    assert "1 rows without rates left out" in dataset.description


def test_a_quoted_cell_beyond_all_measure_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text('time_s,wx,wy,wz\n0,1,2,3\n1,"' + "9" * 200_000 + '",2,3\n')
    with pytest.raises(InputError, match=r"line 3: wx is .*; correct or delete the line"):
        read_dataset(path)


def test_a_date_that_may_be_read_in_two_ways_is_refused_with_what_to_give_in_its_place(
    tmp_path: Path,
) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("time,wx,wy,wz\n" + "".join(f"06/01/2025 17:10:{k:02d}.5,1,2,3\n" for k in range(9)))
    with pytest.raises(InputError, match=r"line 2: time is .*; give seconds, or --rate HZ"):
        read_dataset(path)


def test_poses_are_found_by_name_whatever_the_order_of_the_quaternion(tmp_path: Path) -> None:
    rows = np.array([[0.0, 1, 2, 3, 1, 0, 0, 0], [0.1, 1, 2, 3, 0, 1, 0, 0]])
    dataset = read_dataset(written(tmp_path, "t_s,px_mm,py_mm,pz_mm,qw,qx,qy,qz", rows))
    assert dataset.kind == "pose"
    np.testing.assert_allclose(
        dataset.log.stream("pose").values,
        [[0.001, 0.002, 0.003, 0, 0, 0, 1], [0.001, 0.002, 0.003, 1, 0, 0, 0]],
    )


@pytest.mark.parametrize("header", ["time_s,x,y,z,qx,qy,qz,qw", "t,x,y,z,q_x,q_y,q_z,q_w"])
def test_x_y_z_beside_a_quaternion_are_a_position(header: str, tmp_path: Path) -> None:
    rows = np.array([[0.0, 1, 2, 3, 0, 0, 0, 1], [0.1, 1, 2, 3, 1, 0, 0, 0]])
    dataset = read_dataset(written(tmp_path, header, rows))
    assert dataset.kind == "pose"
    np.testing.assert_array_equal(dataset.log.stream("pose").values, rows[:, 1:])
    assert repr(dataset).startswith("Dataset pose: 2 of pose in 0.1 s")


@pytest.mark.parametrize(
    ("header", "says"),
    [
        ("time,wx,wy,other", "contains no body rate about each of x, y, z"),
        ("time,x,y,z", "such as time_s,wx,wy,wz"),
        ("step,wx,wy,wz", "--rate HZ"),
        ("time,wx,wy (deg/s),wz", "no unit known here is that of"),
        ("time,wx (gon/s),wy (gon/s),wz (gon/s)", "name all three in one of rad/s"),
        ("time,wx,wx,wz", "about each"),
        ("time,wx,gyro_x,wy,wz", "'wx' and 'gyro_x' may both be the rate"),
        ("time,t,wx,wy,wz", "'time' and 't' may both be the clock"),
        ("time,gyroX,gyroY,gyroZ", "give --unit deg/s or rad/s (Python: unit=...)"),
    ],
)
def test_headings_that_cannot_be_told_are_refused_in_one_line(header: str, says: str, tmp_path: Path) -> None:
    rows = np.column_stack([ROWS, ROWS[:, 0]])[:, : header.count(",") + 1]
    with pytest.raises(InputError, match=r"mine\.csv: ") as refusal:
        read_dataset(written(tmp_path, header, rows))
    assert says in str(refusal.value)
    assert len(str(refusal.value)) - len(str(tmp_path)) < 280


def test_outliers_do_not_tell_the_unit(tmp_path: Path) -> None:
    rates = np.random.default_rng(1).normal(0, 2, (200, 3))
    rates[::12, 1] = 200.0
    path = tmp_path / "gyro.csv"
    rows = np.column_stack([np.arange(200) / 100, rates])
    np.savetxt(path, rows, delimiter=",", header="time,gyroX,gyroY,gyroZ", comments="")
    with pytest.raises(InputError, match=r"do not say their unit \(largest 200\)"):
        read_dataset(path)


def test_rates_in_degrees_are_noticed_where_the_header_states_no_unit(tmp_path: Path) -> None:
    rows = ROWS * [1.0, 200.0, 200.0, 200.0]
    with pytest.raises(InputError, match=r"line 4: a rate of 278\.6 rad/s .* give --unit deg/s"):
        read_dataset(written(tmp_path, "time,wx,wy,wz", rows))
    stated = "time,wx (rad/s),wy (rad/s),wz (rad/s)"
    assert rates(written(tmp_path, stated, rows))
    with pytest.raises(
        InputError,
        match=r"a rate of 2786 rad/s is more than a gyro measures \('wz .*\); correct the unit",
    ):
        read_dataset(written(tmp_path, stated, rows * [1.0, 10.0, 10.0, 10.0]))


@pytest.mark.parametrize("value", [1e300, -1.7e308, 1e9])
@pytest.mark.parametrize(
    "header", ["time,wx,wy,wz", "time,wx_dps,wy_dps,wz_dps", "time,wx (rad/s),wy (rad/s),wz (rad/s)"]
)
def test_a_cell_that_no_unit_explains_is_named_with_its_line(
    header: str, value: float, tmp_path: Path
) -> None:
    rows = ROWS.copy()
    rows[2, 2] = value
    says = r"line 4: a rate of \S+e\+\d+ rad/s is more than a gyro measures \('wy.* is "
    with pytest.raises(InputError, match=says) as refusal:
        read_dataset(written(tmp_path, header, rows))
    assert f" is {value:.6g} " in str(refusal.value)
    assert str(refusal.value).endswith("; correct or delete the line")


def test_a_clock_in_doubt_is_refused_and_taken_once_it_is_stated(tmp_path: Path) -> None:
    path = written(tmp_path, "time,wx,wy,wz", ROWS * [1e5, 1.0, 1.0, 1.0])
    with pytest.raises(InputError, match=r"steps by 1000, .* give --clock ms or us"):
        read_dataset(path)
    assert rates(path, ReadingOptions(clock="us")).log.end == pytest.approx(0.002)


def test_stamps_in_nanoseconds_under_a_header_that_says_seconds_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"would turn .* times between samples"):
        read_dataset(written(tmp_path, "time_s,wx,wy,wz", ROWS * [1e9, 1.0, 1.0, 1.0]))


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (ReadingOptions(unit="deg/s"), "its header says rad/s, and the stated unit is deg/s"),
        (ReadingOptions(clock="ms"), "named in s, and the stated unit is ms"),
        (ReadingOptions(topic="/imu"), "topic does not apply"),
    ],
)
def test_a_statement_that_contradicts_the_file_is_refused(
    options: ReadingOptions, says: str, tmp_path: Path
) -> None:
    path = written(tmp_path, "time_s,wx (rad/s),wy (rad/s),wz (rad/s)")
    with pytest.raises(InputError, match=says):
        read_dataset(path, options=options)


def test_an_unknown_unit_is_refused() -> None:
    with pytest.raises(InputError, match="unit 'furlong' is unknown; give rad/s"):
        ReadingOptions(unit="furlong")


@pytest.mark.parametrize(
    ("clocks", "first"),
    [
        (("2026-11-26T12:00:00Z", "2026-11-26T12:00:00.01Z", "2026-11-26T12:00:00.020Z"), 1795694400.0),
        (
            ("2026-11-26 13:00:00+01:00", "2026-11-26 13:00:00.01+0100", "2026-11-26 12:00:00.02Z"),
            1795694400.0,
        ),
        (("2026/11/26 12:00:00.000", "2026/11/26 12:00:00.010", "2026/11/26 12:00:00.020"), 1795694400.0),
        (("09:05:07.000000", "09:05:07.010000", "09:05:07.020000"), 32707.0),
    ],
)
@pytest.mark.parametrize("name", ["time", "timestamp", "time_ms"])
def test_dates_and_times_of_the_day_are_seconds(
    tmp_path: Path, clocks: tuple[str, str, str], first: float, name: str
) -> None:
    lines = [f"{clock},{w[0]},{w[1]},{w[2]}" for clock, w in zip(clocks, ROWS[:, 1:].tolist(), strict=True)]
    path = tmp_path / "dated.csv"
    path.write_text("\n".join([f"{name},wx,wy,wz", *lines, ""]))
    stream = rates(path).log.stream("gyro")
    np.testing.assert_allclose(stream.time - first, ROWS[:, 0], atol=1e-6)
    np.testing.assert_array_equal(stream.values, ROWS[:, 1:])


@pytest.mark.parametrize(
    ("second", "says"),
    [
        ("12", r"line 3: time is '12', no date or time of the day as in the line above; correct or delete"),
        ("25:00:00", "line 3: time is '25:00:00', no date"),
    ],
)
def test_a_row_whose_time_is_written_otherwise_is_named(tmp_path: Path, second: str, says: str) -> None:
    path = tmp_path / "mixed.csv"
    path.write_text(f"time,wx,wy,wz\n12:00:00,0,0,1\n{second},0,0,1\n")
    with pytest.raises(InputError, match=says):
        read_dataset(path)


@pytest.mark.parametrize("names", ["header.stamp.sec,header.stamp.nanosec", "secs,nsecs", "time_s,time_ns"])
def test_whole_seconds_and_nanoseconds_are_one_clock(tmp_path: Path, names: str) -> None:
    whole = np.column_stack([np.full(3, 1_795_000_000), np.rint(1e9 * ROWS[:, 0]), ROWS[:, 1:]])
    path = tmp_path / "ros.csv"
    rows = [f"{row[0]:.0f},{row[1]:.0f},{row[2]},{row[3]},{row[4]}" for row in whole]
    path.write_text("\n".join([f"{names},wx,wy,wz", *rows, ""]))
    stream = rates(path).log.stream("gyro")
    np.testing.assert_allclose(stream.time - 1_795_000_000, ROWS[:, 0], atol=1e-6)


def test_a_second_clock_of_all_nanoseconds_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "both.csv"
    rows = [f"{t},{1e9 * t + 5e9:.0f},{x},{y},{z}" for t, x, y, z in ROWS.tolist()]
    path.write_text("\n".join(["time_s,time_ns,wx,wy,wz", *rows, ""]))
    np.testing.assert_array_equal(rates(path).log.stream("gyro").time, ROWS[:, 0])


@pytest.mark.parametrize("gap", [0.0, 3.0])
def test_seconds_and_their_nanoseconds_are_one_clock_across_a_dropout(tmp_path: Path, gap: float) -> None:
    time = 100.0 + 0.01 * np.arange(1000)
    time[500:] += gap
    second = np.floor(time + 1e-9)
    path = tmp_path / "imu.csv"
    rows = [f"{s:.0f},{(t - s) * 1e9:.0f},0.3,0.5,0.2" for t, s in zip(time, second, strict=True)]
    path.write_text("\n".join(["stamp.sec,stamp.nanosec,wx_rad_s,wy_rad_s,wz_rad_s", *rows, ""]))
    np.testing.assert_allclose(rates(path).log.streams[0].time, time, atol=1e-6)


@pytest.mark.parametrize("incomplete", [(), (10,), (10, 58)])
def test_a_last_number_that_was_cut_off_is_left_out(tmp_path: Path, incomplete: tuple[int, ...]) -> None:
    rows = [f"{0.01 * k:.6f},{0.3:.6f},{0.5 + 0.001 * k:.6f},{0.2:.6f}" for k in range(60)]
    for k in incomplete:
        rows[k] = f"{0.01 * k:.6f},,,"
    path = tmp_path / "mine.csv"
    path.write_text("\n".join(["time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s", *rows])[:-6])
    (stream,) = rates(path).log.streams
    assert len(stream.time) == 59 - len(incomplete)
    np.testing.assert_array_equal(stream.values[:, 2], 0.2)


def test_a_part_of_a_second_that_is_none_is_named(tmp_path: Path) -> None:
    rows = [f"{100 + k // 20},{50_000_000 * (k % 20)},0.3,0.5,0.2" for k in range(100)]
    rows[29] = "101,1500000000,0.3,0.5,0.2"
    path = tmp_path / "imu.csv"
    path.write_text("\n".join(["stamp.sec,stamp.nanosec,wx_rad_s,wy_rad_s,wz_rad_s", *rows, ""]))
    with pytest.raises(InputError, match=r"line 31: 'stamp.nanosec' is 1500000000, no part of a second"):
        rates(path)
