"""A log is valid when constructed, and cuts into shorter logs."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from spinfilters.core.errors import InputError, RowError, ShapeError
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.io.sensor_tables import KnownMap
from tests.io.log_samples import random_gyro, random_pose, random_stereo, random_truth

TIME = np.array([0.0, 1.0, 2.0])
POSES = np.tile([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], (3, 1))
GOOD: dict[str, dict[str, Any]] = {
    "gyro": {"time": TIME, "values": np.ones((3, 3))},
    "pose": {"time": TIME, "values": POSES},
    "stereo": {"time": np.array([0.0, 0.0, 1.0]), "values": np.ones((3, 3)), "ids": np.array([1, 2, 1])},
}
FAULTS: dict[str, tuple[str, dict[str, Any], type[InputError], str]] = {
    "two columns": ("gyro", {"values": np.ones((3, 2))}, ShapeError, r"\(3, 2\)"),
    "fewer values than times": ("gyro", {"values": np.ones((2, 3))}, ShapeError, r"\(2, 3\)"),
    "no rows": ("gyro", {"time": np.ones(0), "values": np.ones((0, 3))}, ShapeError, "at least one"),
    "a column of times": ("gyro", {"time": np.ones((3, 1))}, ShapeError, r"\(3, 1\)"),
    "a time that is not finite": ("gyro", {"time": np.array([0.0, np.nan, 2.0])}, InputError, "row 1"),
    "a value that is not finite": ("gyro", {"values": np.diag([1.0, 1.0, np.inf])}, InputError, "row 2"),
    "a time twice": ("gyro", {"time": np.array([0.0, 1.0, 1.0])}, RowError, "row 2: time 1.0 s occurs twice"),
    "time backwards": ("stereo", {"time": np.array([0.0, 1.0, 0.5])}, InputError, "0.5 s follows 1.0 s"),
    "ids of a gyro": ("gyro", {"ids": np.array([1, 2, 3])}, InputError, "ids"),
    "no ids of a stereo camera": ("stereo", {"ids": None}, InputError, "ids"),
    "too few ids": ("stereo", {"ids": np.array([1, 2])}, ShapeError, r"\(2,\)"),
    "a landmark twice": ("stereo", {"ids": np.array([2, 2, 1])}, InputError, "landmark 2 occurs twice"),
    "a zero quaternion": ("pose", {"values": POSES * 0.0}, InputError, "unit"),
    "a long quaternion": ("pose", {"values": POSES * 1.1}, InputError, "unit"),
    "a 3x3 pose covariance": (
        "pose",
        {"covariance": np.tile(np.eye(3), (3, 1, 1))},
        ShapeError,
        r"\(3, 6, 6\)",
    ),
    "a singular covariance": ("gyro", {"covariance": np.zeros((3, 3, 3))}, InputError, "positive definite"),
    "a skew covariance": ("gyro", {"covariance": np.tile(np.tri(3), (3, 1, 1))}, InputError, "symmetric"),
    "an infinite covariance": ("gyro", {"covariance": np.full((3, 3, 3), np.inf)}, InputError, "finite"),
}


@pytest.mark.parametrize("sensor", GOOD)
def test_a_sound_stream_is_made_and_cannot_be_changed(sensor: str) -> None:
    stream = MeasurementStream(sensor, **GOOD[sensor])
    with pytest.raises(ValueError, match="read-only"):
        stream.values[0, 0] = 5.0
    assert GOOD[sensor]["values"].flags.writeable  # the caller's array stays the caller's


@pytest.mark.parametrize("fault", FAULTS)
def test_an_unsound_stream_cannot_be_made(fault: str) -> None:
    sensor, changed, error, text = FAULTS[fault]
    with pytest.raises(error, match=text) as caught:
        MeasurementStream(sensor, **(GOOD[sensor] | changed))
    assert str(caught.value).isprintable()
    assert sensor in str(caught.value)


@pytest.mark.parametrize("name", ["stereo", "stereo-tracks"])
def test_a_sensor_is_found_by_its_name_and_by_that_of_its_data_sets(name: str) -> None:
    stream = MeasurementStream(name, **GOOD["stereo"])
    assert stream.sensor == "stereo"
    assert MeasurementLog((stream,)).stream(name) is stream


def test_an_unknown_sensor_is_named() -> None:
    with pytest.raises(InputError, match="'sonar' is unknown"):
        MeasurementStream("sonar", **GOOD["gyro"])


def test_quaternions_are_normalised_once_and_then_left_alone() -> None:
    values = POSES * np.array([1, 1, 1, 1, 1, 1, 1.0005])
    once = MeasurementStream("pose", TIME, values)
    np.testing.assert_array_equal(once.values, POSES)
    np.testing.assert_array_equal(MeasurementStream("pose", TIME, once.values).values, once.values)


@pytest.mark.parametrize("seed", range(5))
def test_normalising_random_quaternions_twice_changes_no_bit(seed: int) -> None:
    once = random_pose(np.random.default_rng(seed), 500)
    np.testing.assert_array_equal(MeasurementStream("pose", once.time, once.values).values, once.values)


def test_epochs_are_the_rows_of_one_time_stamp() -> None:
    stream = random_stereo(np.random.default_rng(1), frames=4, landmarks=3)
    assert stream.epoch_offsets.tolist() == [0, 3, 6, 9, 12]
    np.testing.assert_array_equal(stream.epoch_times, np.unique(stream.time))


def test_a_slice_includes_both_ends_and_everything_of_its_rows() -> None:
    stream = random_stereo(np.random.default_rng(2))
    times = stream.epoch_times
    part = stream.slice(times[2], times[4])
    assert part is not None
    rows = slice(stream.epoch_offsets[2], stream.epoch_offsets[5])
    for name in ("time", "values", "ids", "covariance"):
        np.testing.assert_array_equal(getattr(part, name), getattr(stream, name)[rows])


def test_a_log_interleaves_sensors_on_one_clock() -> None:
    gyro, stereo = random_gyro(np.random.default_rng(3)), random_stereo(np.random.default_rng(4))
    log = MeasurementLog((gyro, stereo))
    assert log.sensors == ("gyro", "stereo")
    assert log.start == min(gyro.time[0], stereo.time[0])
    assert log.end == max(gyro.time[-1], stereo.time[-1])
    assert log.stream("stereo") is stereo
    np.testing.assert_array_equal(log.times, sorted({*gyro.time.tolist(), *stereo.time.tolist()}))


def test_a_slice_of_a_log_leaves_out_sensors_without_measurements() -> None:
    late = MeasurementStream("gyro", TIME + 10.0, np.ones((3, 3)))
    log = MeasurementLog((late, MeasurementStream("pose", TIME, POSES)))
    assert log.slice(0.5, 2.0).sensors == ("pose",)
    assert log.slice(0.5, 10.0).sensors == ("gyro", "pose")


def test_a_slice_without_any_measurement_is_an_error_that_names_the_span() -> None:
    log = MeasurementLog((MeasurementStream("pose", TIME, POSES),))
    with pytest.raises(InputError, match=r"between 3\.0 s and 4\.0 s; the log runs from 0\.0 s to 2\.0 s"):
        log.slice(3.0, 4.0)


def test_a_log_needs_a_stream_and_one_stream_per_sensor() -> None:
    stream = MeasurementStream("pose", TIME, POSES)
    with pytest.raises(InputError, match="no stream"):
        MeasurementLog(())
    with pytest.raises(InputError, match="pose, pose"):
        MeasurementLog((stream, stream))
    with pytest.raises(InputError, match="only pose"):
        MeasurementLog((stream,)).stream("gyro")


def test_a_known_map_ascends_in_its_ids_and_keeps_points_with_them() -> None:
    known = KnownMap(np.array([7, 3]), np.array([[7.0, 7, 7], [3.0, 3, 3]]))
    assert known.ids.tolist() == [3, 7]
    np.testing.assert_array_equal(known.points[:, 0], known.ids)


@pytest.mark.parametrize(("ids", "points"), [([1, 1], np.ones((2, 3))), ([1, 2], np.full((2, 3), np.nan))])
def test_an_ambiguous_or_unfinished_map_cannot_be_made(ids: list[int], points: np.ndarray) -> None:
    with pytest.raises(InputError, match="known map"):
        KnownMap(np.array(ids), points)


@pytest.mark.parametrize(
    "name", ["center_of_mass", "q_ig", "velocity", "rate_i", "principal_moments", "time"]
)
def test_truth_that_is_not_finite_cannot_be_made(name: str) -> None:
    truth = random_truth(np.random.default_rng(5))
    with pytest.raises(InputError, match="finite"):
        replace(truth, **{name: getattr(truth, name) * np.nan})


def test_a_flat_body_is_possible_and_a_flatter_one_is_not() -> None:
    truth = random_truth(np.random.default_rng(6))
    replace(truth, principal_moments=np.array([0.1, 0.2, 0.1 + 0.2]))
    with pytest.raises(InputError, match="no body"):
        replace(truth, principal_moments=np.array([0.1, 0.2, 0.3001]))
