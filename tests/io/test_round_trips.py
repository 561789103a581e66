"""What is written is read back bit for bit, and what other programs write is read as they mean it."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from spinfilters.core.errors import InputError
from spinfilters.io.camera import read_stereo_rig, write_stereo_rig
from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.io.phone_exports import read_phyphox
from spinfilters.io.sensor_format import sensor_format
from spinfilters.io.sensor_tables import read_sensor_file, read_tum, write_tum
from spinfilters.io.truth import Truth
from spinfilters.models.sensors.gyro import saturated
from spinfilters.run.readers import read_dataset, read_segments
from tests.io.log_samples import (
    GYRO,
    PHYPHOX,
    RIG,
    SEGMENTS,
    full_dataset,
    phyphox_folder,
    random_gyro,
    random_pose,
    random_truth,
    sensor_yaml,
    stereo_folder,
    written,
)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20)


def assert_same(first: Dataset, second: Dataset) -> None:
    """Every array of both data sets has the same bits, everything else is equal."""
    assert (first.kind, first.description, first.rig) == (second.kind, second.description, second.rig)
    assert first.options.document == second.options.document
    assert set(first.log.sensors) == set(second.log.sensors)
    for stream in first.log.streams:
        other = second.log.stream(stream.sensor)
        for name in ("time", "values", "ids", "covariance"):
            np.testing.assert_array_equal(getattr(stream, name), getattr(other, name))
    for a, b in ((first.truth, second.truth), (first.known_map, second.known_map)):
        assert (a is None) == (b is None)
        for name in vars(a) if a is not None else ():
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def test_a_data_set_of_three_sensors_is_read_back_bit_for_bit(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    dataset = full_dataset(rng)
    write_dataset(dataset, tmp_path / "new" / "folder")
    assert_same(dataset, read_dataset(tmp_path / "new" / "folder"))


@pytest.mark.parametrize("kind", ["gyro", "pose"])
def test_a_data_set_of_one_sensor_is_read_back_bit_for_bit(
    tmp_path: Path, rng: np.random.Generator, kind: str
) -> None:
    stream = random_gyro(rng) if kind == "gyro" else random_pose(rng)
    dataset = Dataset(kind=kind, log=MeasurementLog((stream,)))
    write_dataset(dataset, tmp_path)
    assert_same(dataset, read_dataset(tmp_path))


def test_reading_and_writing_again_gives_the_same_bytes(tmp_path: Path, rng: np.random.Generator) -> None:
    write_dataset(full_dataset(rng), tmp_path / "a")
    write_dataset(read_dataset(tmp_path / "a"), tmp_path / "b")
    files = [file.relative_to(tmp_path / "a") for file in (tmp_path / "a").rglob("*") if file.is_file()]
    assert len(files) == 11
    assert all((tmp_path / "a" / f).read_bytes() == (tmp_path / "b" / f).read_bytes() for f in files)


def test_a_data_set_replaces_one_of_the_same_files(tmp_path: Path, rng: np.random.Generator) -> None:
    for _ in range(2):
        dataset = full_dataset(rng)
        write_dataset(dataset, tmp_path)
        assert_same(dataset, read_dataset(tmp_path))


def test_a_folder_with_files_of_another_data_set_is_not_written(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    write_dataset(full_dataset(rng), tmp_path)
    before = (tmp_path / "gyro.csv").read_bytes()
    with pytest.raises(InputError, match=r"poses\.tum: is not of the data set"):
        write_dataset(Dataset(kind="gyro", log=MeasurementLog((random_gyro(rng),))), tmp_path)
    assert (tmp_path / "gyro.csv").read_bytes() == before


def test_truth_without_a_body_writes_no_truth_toml(tmp_path: Path, rng: np.random.Generator) -> None:
    full = random_truth(rng)
    truth = Truth(full.time, full.center_of_mass, full.q_ig, full.velocity, full.rate_i)
    write_dataset(Dataset(kind="gyro", log=MeasurementLog((random_gyro(rng),)), truth=truth), tmp_path)
    assert not (tmp_path / "truth.toml").exists()
    read = read_dataset(tmp_path).truth
    assert read is not None
    assert read.body == {}
    np.testing.assert_array_equal(read.q_ig, truth.q_ig)


def test_tum_lines_have_at_least_nine_decimals_and_eight_numbers(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    path = tmp_path / "poses.tum"
    write_tum(path, random_pose(rng))
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    assert all(re.fullmatch(r"(-?\d+\.\d{9,} ?){8}", line) for line in lines)


def test_tum_quaternions_of_four_decimals_are_normalised(tmp_path: Path) -> None:
    text = "0 0 0 0 0.5773 0.5773 0.5773 0.0001\n1 0 0 0 0 0 0 -1\n"
    stream = read_tum(written(tmp_path, {"a.tum": text}) / "a.tum")
    np.testing.assert_allclose(np.linalg.norm(stream.values[:, 3:], axis=1), 1.0, atol=1e-15)
    assert stream.values[1, 6] == -1.0


def test_the_rig_is_read_back_bit_for_bit_in_the_euroc_layout(tmp_path: Path) -> None:
    write_stereo_rig(RIG, tmp_path)
    assert read_stereo_rig(tmp_path) == RIG
    right = yaml.safe_load((tmp_path / "cam1" / "sensor.yaml").read_text())
    assert right["T_BS"]["data"][3] == RIG.baseline_m
    assert right["resolution"] == [640, 480]


def test_the_baseline_does_not_depend_on_the_body_frame_of_the_calibration(tmp_path: Path) -> None:
    body = "[[0,-1,0,{y}],[1,0,0,{x}],[0,0,1,3e-1],[0,0,0,1]]"  # camera x is body y; 3e-1 is text to YAML
    for camera, x in (("cam0", 0.5), ("cam1", 0.59)):
        text = sensor_yaml(T_BS=body.format(x=x, y=0.2))
        written(tmp_path, {f"{camera}/sensor.yaml": text})
    assert read_stereo_rig(tmp_path).baseline_m == pytest.approx(0.09, abs=1e-15)


def test_a_far_point_with_a_disparity_a_little_below_zero_is_kept(tmp_path: Path) -> None:
    text = "time_s,landmark_id,u_left_px,v_left_px,u_right_px\n0,1,300,200,302.5\n1,1,300,200,299\n"
    assert (
        len(read_sensor_file(sensor_format("stereo"), written(tmp_path, {"tracks.csv": text}) / "tracks.csv"))
        == 2
    )


@pytest.mark.parametrize(("delimiter", "decimal"), [(";", "."), ("\t", "."), (";", ","), ("\t", ",")])
def test_every_csv_format_of_phyphox_gives_the_same_numbers(
    tmp_path: Path, delimiter: str, decimal: str
) -> None:
    expected = read_phyphox(phyphox_folder(tmp_path / "comma"))
    text = PHYPHOX.replace(",", delimiter).replace(".", decimal)
    found = read_phyphox(written(tmp_path, {"Raw Data.csv": text}))
    np.testing.assert_array_equal(found.rate, expected.rate)
    np.testing.assert_array_equal(found.time, expected.time)


@pytest.mark.parametrize("change", [("\n", "\r\n"), ("time_s", "\ufefftime_s"), ("\n", "\n\n"), (",", " , ")])
def test_line_ends_byte_order_marks_and_blanks_do_not_matter(tmp_path: Path, change: tuple[str, str]) -> None:
    (tmp_path / "a.csv").write_text(GYRO.replace(*change), encoding="utf-8", newline="")
    stream = read_dataset(tmp_path / "a.csv").log.stream("gyro")
    np.testing.assert_array_equal(stream.time, [0.0, 0.01, 0.02])
    np.testing.assert_array_equal(stream.values, np.tile([0.1, 0.2, 0.3], (3, 1)))


def test_a_phyphox_segment_holds_the_samples_between_its_ends(tmp_path: Path) -> None:
    dataset = read_dataset(phyphox_folder(tmp_path), segment=1)
    assert dataset.log.start == pytest.approx(0.1)
    assert dataset.log.end == pytest.approx(0.4)
    assert dataset.segment is not None
    assert dataset.segment.comment == "first"


def test_all_segments_leave_out_what_is_not_a_trial(tmp_path: Path) -> None:
    folder = phyphox_folder(tmp_path)
    numbers = [dataset.segment.number for dataset in read_segments(folder) if dataset.segment]
    assert numbers == [1, 2]
    assert len(read_segments(folder / "Raw Data.csv")) == 2


def test_the_only_kept_segment_needs_no_number(tmp_path: Path) -> None:
    folder = written(phyphox_folder(tmp_path), {"meta/segments.csv": SEGMENTS.rsplit("\n", 1)[0]})
    segment = read_dataset(folder).segment
    assert segment is not None
    assert segment.number == 1


def test_a_recording_without_marks_is_one_data_set(tmp_path: Path) -> None:
    folder = written(tmp_path, {"Raw Data.csv": PHYPHOX})
    assert len(read_dataset(folder).log.stream("gyro")) == 100
    assert len(read_segments(folder)) == 1


def test_all_segments_of_a_data_set_without_segments_are_the_data_set(tmp_path: Path) -> None:
    assert [dataset.kind for dataset in read_segments(stereo_folder(tmp_path))] == ["stereo-tracks"]


@pytest.mark.parametrize("limit", [4.36, 34.9, 69.8])
def test_clipped_gyro_samples_are_found_at_any_full_scale(limit: float) -> None:
    time = np.linspace(0.0, 20.0, 400)
    rate = np.stack([1.3 * limit * np.sin(time), 0.5 * limit * np.cos(time), 0 * time], axis=1)
    clipped = np.clip(rate, -limit, limit)
    assert saturated(clipped).tolist() == (np.abs(rate[:, 0]) >= limit * (1 - 1e-3)).tolist()


@pytest.mark.parametrize("samples", [15, 40, 120, 400, 2000])
@pytest.mark.parametrize("scale", [0.1, 34.8, 40.0])
def test_a_smooth_spin_is_not_clipped_however_fast_it_is(samples: int, scale: float) -> None:
    time = np.linspace(0.0, 20.0, samples)
    rate = scale * np.stack([np.sin(time), np.cos(1.7 * time), 1 + 0 * time], axis=1)
    assert not saturated(rate).any()


@pytest.mark.parametrize("field", ["fx", "fy", "width", "height", "baseline_m"])
@pytest.mark.parametrize("value", [0, -1])
def test_a_rig_without_extent_cannot_be_made(field: str, value: int) -> None:
    changed: dict[str, Any] = {field: value if field in ("width", "height") else float(value)}
    of = RIG if field == "baseline_m" else RIG.left
    with pytest.raises(InputError, match=field):
        replace(of, **changed)


@pytest.mark.parametrize("field", ["fx", "fy", "cx", "cy", "baseline_m"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_rig_that_is_not_finite_cannot_be_made(field: str, value: float) -> None:
    changed: dict[str, Any] = {field: value}
    of = RIG if field == "baseline_m" else RIG.left
    with pytest.raises(InputError, match=field):
        replace(of, **changed)


def test_a_data_set_of_stereo_measurements_needs_a_rig() -> None:
    stream = MeasurementStream("stereo", np.array([0.0]), np.array([[3.0, 2.0, 1.0]]), np.array([1]))
    with pytest.raises(InputError, match="rig"):
        Dataset(kind="stereo-tracks", log=MeasurementLog((stream,)))
