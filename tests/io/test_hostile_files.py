"""Paths and files that are not what they seem: refused before anything large or dangerous is read."""

import os
from pathlib import Path

import pytest
from test_malformed_inputs import message_of

from spinfilters.io import input_file
from spinfilters.io.sensor_format import sensor_format
from spinfilters.io.sensor_tables import read_sensor_file
from spinfilters.run.readers import read_dataset, read_segments
from tests.io.log_samples import DATASET, GYRO, PHYPHOX, SEGMENTS, phyphox_folder, stereo_folder, written


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    assert "nothing.csv: no such file" in message_of(lambda: read_dataset(tmp_path / "nothing.csv"))


def test_a_directory_in_place_of_a_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "gyro.csv").mkdir()
    assert "is a directory" in message_of(
        lambda: read_sensor_file(sensor_format("gyro"), tmp_path / "gyro.csv")
    )


def test_an_empty_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "gyro.csv").touch()
    assert "is empty" in message_of(lambda: read_dataset(tmp_path / "gyro.csv"))


def test_an_unreadable_file_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, {"gyro.csv": GYRO}) / "gyro.csv"
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # root, as in a container, may read anything
    assert "permission denied" in message_of(lambda: read_sensor_file(sensor_format("gyro"), path))


def test_an_unreadable_folder_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stereo_folder(tmp_path)
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert "permission denied" in message_of(lambda: read_dataset(tmp_path))


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "gyro.csv")
    assert "device or pipe" in message_of(lambda: read_dataset(tmp_path / "gyro.csv"))


def test_a_loop_of_links_is_an_input_error(tmp_path: Path) -> None:
    (tmp_path / "gyro.csv").symlink_to(tmp_path / "gyro.csv")
    assert "gyro.csv" in message_of(lambda: read_dataset(tmp_path / "gyro.csv"))


def test_a_path_with_a_nul_character_is_an_input_error() -> None:
    assert "\\x00" in message_of(lambda: read_dataset("gyro\0.csv"))


def test_a_file_name_with_a_line_feed_gives_an_error_of_one_line(tmp_path: Path) -> None:
    assert "a\\nb.csv" in message_of(lambda: read_dataset(tmp_path / "a\nb.csv"))


def test_a_file_beyond_the_size_limit_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "gyro.csv"
    path.touch()
    os.truncate(path, 2 * 1024**3 + 1)  # sparse: takes no disk
    assert f"has {2 * 1024**3 + 1} bytes" in message_of(lambda: read_sensor_file(sensor_format("gyro"), path))


def test_a_table_beyond_the_row_limit_is_not_parsed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, {"gyro.csv": GYRO}) / "gyro.csv"
    monkeypatch.setattr(input_file, "MAX_TABLE_ROWS", 3)
    assert "more than 3 rows" in message_of(lambda: read_sensor_file(sensor_format("gyro"), path))


def test_a_line_without_end_is_not_parsed(tmp_path: Path) -> None:
    path = written(tmp_path, {"gyro.csv": "1," * 600_000}) / "gyro.csv"
    assert "line of more than" in message_of(lambda: read_sensor_file(sensor_format("gyro"), path))


@pytest.mark.parametrize("name", ["dataset.toml", "cam0/sensor.yaml", "truth.toml"])
def test_a_settings_file_beyond_a_mebibyte_is_not_read(tmp_path: Path, name: str) -> None:
    written(stereo_folder(tmp_path), {name: DATASET + "#" * 1024**2})
    message = message_of(lambda: read_dataset(tmp_path))
    assert name in message
    assert "at most 1048576" in message


def test_yaml_that_multiplies_itself_is_refused_quickly(tmp_path: Path) -> None:
    bomb = "a0: &a0 [x, x]\n" + "".join(f"a{k}: &a{k} [*a{k - 1}, *a{k - 1}]\n" for k in range(1, 60))
    keys = "camera_model: pinhole\nresolution: [1, 1]\nT_BS: 1\n"
    written(stereo_folder(tmp_path), {"cam0/sensor.yaml": bomb + keys + "intrinsics: *a59\n"})
    assert "line 2: refers to another value (*a0)" in message_of(lambda: read_dataset(tmp_path))


def test_yaml_whose_keys_merge_without_end_is_refused_quickly(tmp_path: Path) -> None:
    merges = "a0: &a0 {x0: 1}\n" + "".join(
        f"a{k}: &a{k}\n  <<: [{', '.join([f'*a{k - 1}'] * 9)}]\n  x{k}: 1\n" for k in range(1, 9)
    )
    written(stereo_folder(tmp_path), {"cam0/sensor.yaml": merges})
    assert "merge key" in message_of(lambda: read_dataset(tmp_path))


@pytest.mark.parametrize(
    "text", ["a: " + "[" * 30_000, "- " * 20_000, "{a: " * 5000, "a: [" + "1, " * 30_000 + "1]"]
)
def test_yaml_of_endless_depth_or_length_is_refused_quickly(tmp_path: Path, text: str) -> None:
    written(stereo_folder(tmp_path), {"cam0/sensor.yaml": text})
    assert "more than" in message_of(lambda: read_dataset(tmp_path))


@pytest.mark.parametrize("text", ["a." * 65 + "b = 1", "[a" + ".a" * 400_000 + "]"])
def test_a_toml_key_of_endless_parts_takes_no_memory(tmp_path: Path, text: str) -> None:
    written(stereo_folder(tmp_path), {"truth.toml": text})
    assert "truth.toml: line 1: has more than 64 dots" in message_of(lambda: read_dataset(tmp_path))


@pytest.mark.parametrize("content", [b"\x89PNG\r\n\x1a\n\0\0", "time_s,wx".encode("utf-16"), b"\0" * 100])
def test_a_binary_file_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "gyro.csv").write_bytes(content)
    assert "not UTF-8 text" in message_of(
        lambda: read_sensor_file(sensor_format("gyro"), tmp_path / "gyro.csv")
    )


@pytest.mark.parametrize(
    ("content", "line"), [(b"\xff" + GYRO.encode(), 1), (GYRO.encode() + b"1,2,\xb5,3\n", 5)]
)
def test_bytes_that_are_not_utf8_are_named_with_their_line(tmp_path: Path, content: bytes, line: int) -> None:
    (tmp_path / "gyro.csv").write_bytes(content)
    assert f"line {line}: byte 0x" in message_of(
        lambda: read_sensor_file(sensor_format("gyro"), tmp_path / "gyro.csv")
    )


def test_settings_that_are_not_utf8_are_named_with_their_line(tmp_path: Path) -> None:
    stereo_folder(tmp_path)
    (tmp_path / "dataset.toml").write_bytes(b'kind = "gyro"\ndescription = "\xb5"\n')
    assert "line 2: byte 0xb5" in message_of(lambda: read_dataset(tmp_path))


def test_an_euroc_image_folder_is_told_what_to_supply(tmp_path: Path) -> None:
    written(tmp_path, {"cam0/data.csv": "#timestamp [ns],filename\n"})
    assert "supply tracks.csv" in message_of(lambda: read_dataset(tmp_path))


@pytest.mark.parametrize("name", ["recording.zip", "scan.ply", "noending"])
def test_an_unknown_kind_of_file_is_named(tmp_path: Path, name: str) -> None:
    assert "unpack" in message_of(lambda: read_dataset(written(tmp_path, {name: "x"}) / name))


@pytest.mark.parametrize("name", ["tracks.csv", "truth.csv", "landmarks.csv", "dataset.toml"])
def test_one_file_of_a_data_set_is_told_to_give_the_folder(tmp_path: Path, name: str) -> None:
    assert "give the folder" in message_of(lambda: read_dataset(stereo_folder(tmp_path) / name))


def test_several_segments_and_none_chosen_lists_them_and_the_option(tmp_path: Path) -> None:
    message = message_of(lambda: read_dataset(phyphox_folder(tmp_path)))
    assert "--segment" in message
    assert "1 (first, 0.1 s to 0.4 s), 2 (second, 0.5 s to 0.9 s)" in message


def test_a_segment_that_is_not_kept_is_not_a_trial(tmp_path: Path) -> None:
    assert "segment 0 is not a trial" in message_of(lambda: read_dataset(phyphox_folder(tmp_path), 0))


def test_a_segment_that_is_not_there_is_named(tmp_path: Path) -> None:
    assert "has no segment 7" in message_of(lambda: read_dataset(phyphox_folder(tmp_path), 7))


def test_a_segment_outside_the_recording_is_named(tmp_path: Path) -> None:
    written(phyphox_folder(tmp_path), {"meta/segments.csv": SEGMENTS + "\n3,5.0,6.0,,late"})
    assert "runs from 5.0 s to 6.0 s" in message_of(lambda: read_dataset(tmp_path, 3))


def test_a_segment_of_one_sample_is_named(tmp_path: Path) -> None:
    written(phyphox_folder(tmp_path), {"meta/segments.csv": SEGMENTS + "\n3,0.495,0.505,,short"})
    assert "segment 3" in message_of(lambda: read_dataset(tmp_path, 3))


def test_a_recording_without_a_kept_segment_has_no_trial(tmp_path: Path) -> None:
    files = {
        "Raw Data.csv": PHYPHOX,
        "meta/segments.csv": "segment,start,end,keep,comment\n0,,,false,noise\n",
    }
    written(tmp_path, files)
    assert "no trial" in message_of(lambda: read_dataset(tmp_path))
    assert "no trial" in message_of(lambda: read_segments(tmp_path))


def test_a_segment_of_a_data_set_without_segments_is_an_error(tmp_path: Path) -> None:
    assert "--segment 1" in message_of(lambda: read_dataset(stereo_folder(tmp_path), 1))
