"""Tables that are read as a sensor's format says: what is wrong with them is named with its line and the cure."""

from pathlib import Path

import pytest

from spinfilters.core.errors import InputError
from spinfilters.run.readers import read_dataset
from tests.io.log_samples import sensor_yaml, written

ATTITUDES = "time_s,qx,qy,qz,qw\n0,0,0,0,1\n0.5,0,0,0.6,0.8\n"
TRACKS = "time_s,landmark_id,u_px,v_px\n0,1,300,200\n0,2,310,210\n0.5,1,301,200\n"
FILES = {
    "attitude": ("attitudes.csv", ATTITUDES),
    "mono-tracks": ("tracks.csv", TRACKS),
}


def folder_of(folder: Path, kind: str, text: str, **more: str) -> Path:
    """A data set folder of that kind with this table."""
    files = {"dataset.toml": f'kind = "{kind}"\n', FILES[kind][0]: text, "cam0/sensor.yaml": sensor_yaml()}
    return written(folder, files | more)


@pytest.mark.parametrize("kind", FILES)
def test_a_table_of_the_format_is_read(tmp_path: Path, kind: str) -> None:
    (stream,) = read_dataset(folder_of(tmp_path, kind, FILES[kind][1])).log.streams
    assert len(stream) == FILES[kind][1].count("\n") - 1


@pytest.mark.parametrize(
    ("kind", "old", "new", "says"),
    [
        ("attitude", "0,0,0.6,0.8", "0,0,0.6,0.9", r"line 3: quaternion .* has norm 1\.08"),
        ("attitude", "0.5,0,0", "0,0,0", r"line 3: time 0\.0 s occurs twice"),
        ("attitude", "0.8", "nan", "line 3"),
        ("attitude", "qx,qy,qz,qw", "qw,qx,qy,qz", "expected 'time_s,qx,qy,qz,qw'"),
        ("mono-tracks", "0,2,", "0,1,", r"line 3: landmark 1 occurs twice at 0\.0 s"),
        ("mono-tracks", "0,2,", "0,2.5,", r"line 3: landmark_id 2\.5 is not a whole number"),
        ("mono-tracks", "310,210", "1e9,210", r"line 3: 'u_px' is 1000000000\.0"),
        (
            "mono-tracks",
            "u_px,v_px",
            "u_left_px,v_left_px,u_right_px",
            "expected 'time_s,landmark_id,u_px,v_px'",
        ),
    ],
)
def test_a_fault_of_a_table_is_named(tmp_path: Path, kind: str, old: str, new: str, says: str) -> None:
    with pytest.raises(InputError, match=says) as raised:
        read_dataset(folder_of(tmp_path, kind, FILES[kind][1].replace(old, new)))
    assert "\n" not in str(raised.value)
    assert len(str(raised.value)) < 300 + len(str(tmp_path))


def test_a_camera_without_calibration_is_refused(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, "mono-tracks", TRACKS)
    (folder / "cam0" / "sensor.yaml").unlink()
    with pytest.raises(InputError, match=r"cam0/sensor\.yaml: no such file"):
        read_dataset(folder)


def test_a_covariance_has_the_dimension_of_the_sensor(tmp_path: Path) -> None:
    header = "time_s,c00,c10,c11,c20,c21,c22\n"
    rows = "0,1e-4,0,1e-4,0,0,1e-4\n0.5,4e-4,0,1e-4,0,0,1e-4\n"
    more = {"attitudes_covariance.csv": header + rows}
    (stream,) = read_dataset(folder_of(tmp_path, "attitude", ATTITUDES, **more)).log.streams
    assert stream.covariance is not None
    assert stream.covariance[1, 0, 0] == 4e-4


def test_an_attitude_table_alone_is_part_of_a_data_set(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, "attitude", ATTITUDES)
    with pytest.raises(InputError, match="is one part of a data set; give the folder"):
        read_dataset(folder / "attitudes.csv")
