"""Files of strangers: each fault is one InputError of one line that names the file, the fault and a cure."""

from collections.abc import Callable
from pathlib import Path

import pytest

from spinfilters.core.errors import InputError
from spinfilters.io.sensor_format import sensor_format
from spinfilters.io.sensor_tables import read_sensor_file, read_tum
from spinfilters.run.readers import read_dataset, read_segments
from tests.io.log_samples import (
    DATASET,
    GYRO,
    LANDMARKS,
    PHYPHOX,
    SEGMENTS,
    TRACKS,
    TRUTH,
    TUM,
    phyphox_folder,
    sensor_yaml,
    stereo_folder,
    written,
)


def message_of(action: Callable[[], object]) -> str:
    """Text of the InputError that the action raises; it is one printable line that ends in a cure."""
    with pytest.raises(InputError) as caught:
        action()
    text = str(caught.value)
    assert text.isprintable()
    assert ";" in text, f"no cure in: {text}"
    return text


def gyro(*rows: str) -> str:
    return "time_s,wx,wy,wz\n" + "".join(row + "\n" for row in rows)


GYRO_FAULTS = {
    "only a header": (gyro(), "no rows"),
    "header and blank lines": (gyro() + "\n\n", "no rows"),
    "no header": ("0.0,0.1,0.2,0.3\n0.1,0.1,0.2,0.3\n", "'0.0,0.1,0.2,0.3'"),
    "a word in a cell": (GYRO + "0.03,0.1,fast,0.3\n", "line 5: wy is 'fast'"),
    "an empty cell": (gyro("0,1,2,3", "1,1,,3"), "line 3: wy is ''"),
    "NaN": (gyro("0,1,2,3", "1,1,nan,3"), "line 3: wy is 'nan'"),
    "infinity": (gyro("0,1,2,3", "1,-inf,2,3"), "line 3: wx is '-inf'"),
    "a number beyond float64": (gyro("0,1,2,3", "1,1e999,2,3"), "line 3: wx is '1e999'"),
    "a cell too few": (gyro("0,1,2,3", "1,1,2"), "line 3: '1,1,2' has 3 cells, expected 4"),
    "a cell too many": (gyro("0,1,2,3", "1,1,2,3,4"), "line 3: '1,1,2,3,4' has 5 cells"),
    "a cell too many everywhere": (gyro("0,1,2,3,4", "1,1,2,3,4"), "line 2: '0,1,2,3,4' has 5 cells"),
    "a file cut off": (gyro("0,1,2,3", "1,1")[:-1], "line 3: '1,1' has 2 cells"),
    "a missing column": ("time_s,wx,wy\n0,1,2\n1,1,2\n", "; add the missing column wz"),
    "a missing and another column": ("time_s,wx,wz0\n0,1,2\n1,1,2\n", "; rename the columns"),
    "missing columns": ("time_s,wx\n0,1\n1,1\n", "; add the missing columns wy, wz"),
    "columns in another order": ("time_s,wz,wy,wx\n0,1,2,3\n1,1,2,3\n", "; reorder the columns"),
    "degrees": ("time_s,wx_deg_s,wy_deg_s,wz_deg_s\n0,1,2,3\n1,1,2,3\n", "'wx_deg_s'"),
    "degrees in another spelling": ("time_s,wx (dps),wy (dps),wz (dps)\n0,1,2,3\n1,1,2,3\n", "is in degrees"),
    "rad/s in the name": ("time_s,wbx_radps,wby_radps,wbz_radps\n0,1,2,3\n1,1,2,3\n", "the header is"),
    "a temperature": ("time_s,wx,wy,wz,amb-temp-degC\n0,1,2,3,4\n1,1,2,3,4\n", "; leave out other columns"),
    "a rate beyond all": (gyro("0,1,2,3", "1,1e5,2,3"), "line 3: 'wx' is 100000.0"),
    "microseconds apart by nothing": (
        gyro("0,1,2,3", "1e-12,1,2,3"),
        "line 3: time 1e-12 s is 1e-12 s after",
    ),
    "milliseconds": ("time_ms,wx,wy,wz\n0,1,2,3\n1,1,2,3\n", "'time_ms,wx,wy,wz'"),
    "nanoseconds": (
        gyro("1403636579763555584,1,2,3", "1403636579863555584,1,2,3"),
        "line 2: time 1.4036365797635556e+18",
    ),
    "one wild stamp": (
        gyro("0,1,2,3", "0.1,1,2,3", "9e3,1,2,3", "0.3,1,2,3", "0.4,1,2,3"),
        "line 5: time 0.3 s follows 9000.0 s: it runs backwards; correct the wrong one of the two, or sort",
    ),
    "time backwards": (gyro("0,1,2,3", "", "0.5,1,2,3", "0.25,1,2,3"), "line 5: time 0.25 s follows 0.5 s"),
    "a time twice": (gyro("0,1,2,3", "0.5,1,2,3", "0.5,1,2,3"), "line 4: time 0.5 s occurs twice"),
    "one sample": (gyro("0,1,2,3"), "has 1 epoch"),
    "an underscore in a number": (gyro("0,1,2,3", "1,1_0,2,3"), "line 3: wx is '1_0'"),
    "Arabic digits": (gyro("0,1,2,3", "1,١,2,3"), "line 3: wx is '١'"),
    "a terminal escape": (gyro("0,1,2,3", "1,\x1b[31m,2,3"), "\\x1b[31m"),
    "HTML of a failed download": ("<!DOCTYPE html>\n<html><body>404</body></html>\n", "<!DOCTYPE html>"),
    "a very long cell": (gyro("0,1,2,3", "1,2," + "x" * 5000 + ",3"), "line 3: wy is 'xxx"),
}
TUM_FAULTS = {
    "only comments": ("# nothing\n", "no rows"),
    "seven columns": (TUM + "1.5 0 0 1 0 0 1\n", "line 5: '1.5 0 0 1 0 0 1' has 7 cells"),
    "commas": ("0.0,0,0,1,0,0,0,1\n0.5,0,0,1,0,0,0,1\n", "line 1:"),
    "quaternion of zero norm": (TUM + "1.5 0 0 1 0 0 0 0\n", "line 5: quaternion [0.0, 0.0, 0.0, 0.0]"),
    "quaternion of norm two": (TUM + "1.5 0 0 1 0 0 0 2\n", "norm 2"),
    "time backwards": (TUM + "0.75 0 0 1 0 0 0 1\n", "line 5: time 0.75 s follows 1.0 s"),
    "a time twice": (TUM + "1.0 0 0 1 0 0 0 1\n", "line 5: time 1.0 s occurs twice"),
    "NaN where the optics lost it": (TUM + "1.5 nan nan nan 0 0 0 1\n", "line 5: tx is 'nan'"),
    "one pose": ("0.0 0 0 1 0 0 0 1\n", "has 1 epoch"),
}
STEREO_FAULTS = {
    "no dataset.toml": ("dataset.toml", None, "no such file"),
    "no kind": ("dataset.toml", 'description = "x"\n', "kind"),
    "unknown kind": ("dataset.toml", 'kind = "sonar"\n', "'sonar'"),
    "kind a number": ("dataset.toml", "kind = 3\n", "3"),
    "bad TOML": ("dataset.toml", "kind = stereo-tracks\n", "line 1"),
    "nested TOML": ("dataset.toml", "kind = " + "[" * 5000, "not TOML"),
    "a misspelt key": ("dataset.toml", DATASET + "pixelstd = 2.0\n", "'pixelstd'"),
    "noise of zero": ("dataset.toml", 'kind = "stereo-tracks"\npixel_std = 0.0\n', "0.0"),
    "noise beyond float64": (
        "dataset.toml",
        f'kind = "stereo-tracks"\npixel_std = 1{"0" * 400}\n',
        "pixel_std is 1000",
    ),
    "noise a word": ("dataset.toml", 'kind = "stereo-tracks"\npixel_std = "one"\n', "'one'"),
    "stereo images": (
        "dataset.toml",
        'kind = "stereo-images"\n',
        "not part of this version; supply tracks.csv",
    ),
    "lidar scans": ("dataset.toml", 'kind = "lidar-scans"\n', "holds no .ply; put the scans there"),
    "tracks missing": ("tracks.csv", None, "no such file"),
    "tracks empty": ("tracks.csv", "", "empty"),
    "a landmark twice": ("tracks.csv", TRACKS + "0.5,1,1,2,0\n", "line 6: landmark 1 occurs twice at 0.5 s"),
    "a point behind": (
        "tracks.csv",
        TRACKS + "0.5,3,100.0,2.0,104.0\n",
        "line 6: u_left_px 100.0 - u_right_px 104.0",
    ),
    "half a landmark": ("tracks.csv", TRACKS + "0.5,3.5,300,2,200\n", "line 6: landmark_id 3.5"),
    "one epoch": ("tracks.csv", "".join(TRACKS.splitlines(True)[:3]), "has 1 epoch"),
    "epochs out of order": ("tracks.csv", TRACKS + "0.25,1,300,2,200\n", "line 6: time 0.25 s follows 0.5 s"),
    "a map without a number": ("landmarks.csv", LANDMARKS + "3,a,0,0\n", "line 4: x is 'a'"),
    "a map with an id twice": ("landmarks.csv", LANDMARKS + "2,0,0,0\n", "line 4: landmark 2"),
    "truth of other columns": ("truth.csv", TRUTH.replace("qw", "q0"), "q0"),
    "truth not unit": ("truth.csv", TRUTH + "1.0,0,0,1,0,0,0,0,0,0,0,0,0.1,0\n", "line 4: quaternion"),
    "truth without motion": ("truth.csv", None, "no such file"),
    "an impossible body": ("truth.toml", "principal_moments = [1.0, 1.0, 3.0]\n", "[1.0, 1.0, 3.0]"),
    "two moments": ("truth.toml", "principal_moments = [1.0, 1.0]\n", "[1.0, 1.0]"),
    "a left-handed epoch": ("truth.toml", "principal_axes_g = [[1,0,0],[0,1,0],[0,0,-1]]\n", "right-handed"),
    "an unknown truth": ("truth.toml", "inertia = 3\n", "'inertia'"),
    "no right camera": ("cam1/sensor.yaml", None, "no such file"),
    "bad YAML": ("cam0/sensor.yaml", "T_BS: [1, 2\nresolution: 3\n", "line 2"),
    "a Python tag": ("cam0/sensor.yaml", "!!python/object/apply:os.system ['true']\n", "python/object"),
    "nested YAML": ("cam0/sensor.yaml", "[" * 5000, "20 deep"),
    "a list instead of keys": ("cam0/sensor.yaml", "- 1\n- 2\n", "[1, 2]"),
    "focal length of zero": ("cam*/sensor.yaml", {"intrinsics": "[0, 466.7, 320.0, 240.0]"}, "fx is 0.0"),
    "focal length not finite": ("cam1/sensor.yaml", {"intrinsics": "[.inf, 466.7, 320.0, 240.0]"}, "inf"),
    "three intrinsics": ("cam1/sensor.yaml", {"intrinsics": "[1, 2, 3]"}, "[1, 2, 3]"),
    "other intrinsics": ("cam1/sensor.yaml", {"intrinsics": "[400, 400, 320, 240]"}, "400"),
    "image size of zero": ("cam*/sensor.yaml", {"resolution": "[0, 480]"}, "width is 0"),
    "half a pixel": ("cam1/sensor.yaml", {"resolution": "[640.5, 480]"}, "640.5"),
    "distortion of sixth order": (
        "cam1/sensor.yaml",
        {"distortion_coefficients": "[0, 0, 0, 0, 0.3]"},
        "0.3",
    ),
    "half a distortion": ("cam1/sensor.yaml", {"distortion_coefficients": "[-0.28, 0.07]"}, "-0.28"),
    "a fisheye's distortion": (
        "cam0/sensor.yaml",
        {"distortion_coefficients": "[0.1, 0, 0, 0]", "distortion_model": "equidistant"},
        "'equidistant'",
    ),
    "distortion beyond all lenses": ("cam0/sensor.yaml", {"distortion_coefficients": "[30, 0, 0, 0]"}, "30"),
    "an inspector that comes late": (
        "inspector.tum",
        "0.1 0 0 0 0 0 0 1\n1.0 0 0 0 0 0 0 1\n",
        "do not cover",
    ),
    "an inspector that leaves early": (
        "inspector.tum",
        "0.0 0 0 0 0 0 0 1\n0.4 0 0 0 0 0 0 1\n",
        "do not cover",
    ),
    "an inspector whose time goes back": (
        "inspector.tum",
        "1.0 0 0 0 0 0 0 1\n0.0 0 0 0 0 0 0 1\n",
        "line 2",
    ),
    "an inspector that is not finite": (
        "inspector.tum",
        "0.0 0 nan 0 0 0 0 1\n1.0 0 0 0 0 0 0 1\n",
        "line 1",
    ),
    "an inspector that does not rotate rigidly": (
        "inspector.tum",
        "0.0 0 0 0 0 0 0 2\n1.0 0 0 0 0 0 0 2\n",
        "norm 2",
    ),
    "an empty inspector": ("inspector.tum", "", "inspector.tum"),
    "a fisheye": ("cam1/sensor.yaml", {"camera_model": "omni"}, "'omni'"),
    "T_BS of 15 numbers": ("cam1/sensor.yaml", {"T_BS": "{rows: 4, cols: 4, data: [1, 0]}"}, "[1, 0]"),
    "T_BS not rigid": ("cam1/sensor.yaml", {"T_BS": "[[2,0,0,1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"}, "2.0"),
    "cameras not parallel": (
        "cam1/sensor.yaml",
        {"T_BS": "[[0,-1,0,1],[1,0,0,0],[0,0,1,0],[0,0,0,1]]"},
        "turns",
    ),
    "a baseline of zero": (
        "cam1/sensor.yaml",
        {"T_BS": "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"},
        "[0.0, 0.0",
    ),
    "cameras swapped": ("cam1/sensor.yaml", {"T_BS": "[[1,0,0,-0.1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"}, "-0.1"),
    "cameras one above the other": (
        "cam1/sensor.yaml",
        {"T_BS": "[[1,0,0,0.1],[0,1,0,0.1],[0,0,1,0],[0,0,0,1]]"},
        "0.1",
    ),
    "covariances of other rows": (
        "tracks_covariance.csv",
        "time_s,c00,c10,c11,c20,c21,c22\n0,1,0,1,0,0,1\n",
        "1 rows",
    ),
    "a covariance that is not positive definite": (
        "tracks_covariance.csv",
        "time_s,c00,c10,c11,c20,c21,c22\n0,1,0,1,0,0,1\n0,1,2,1,0,0,1\n0.5,1,0,1,0,0,1\n0.5,1,0,1,0,0,1\n",
        "line 3: the covariance is not positive definite",
    ),
    "a covariance that is no number": (
        "tracks_covariance.csv",
        "time_s,c00,c10,c11,c20,c21,c22\n0,1,0,1,0,0,1\n0,1,0,1,0,0,1\n0.5,1,0,nan,0,0,1\n0.5,1,0,1,0,0,1\n",
        "line 4: c11 is 'nan'",
    ),
}
PHYPHOX_FAULTS = {
    "gons per second": ("Raw Data.csv", PHYPHOX.replace("rad/s", "gon/s"), "Gyroscope x (gon/s)"),
    "an accelerometer": ("Raw Data.csv", PHYPHOX.replace("rad/s", "m/s^2"), "m/s^2"),
    "weeks": ("Raw Data.csv", PHYPHOX.replace("Time (s)", "Time (weeks)"), "Time (weeks)"),
    "a cell that is no number": (
        "Raw Data.csv",
        PHYPHOX + "2.0,x,0,0,0",
        "line 102: Gyroscope x (rad/s) is 'x'",
    ),
    "segments without a header": ("meta/segments.csv", "0,1,2,,x\n", "line 1"),
    "a segment that ends before it starts": (
        "meta/segments.csv",
        SEGMENTS + "\n3,0.9,0.8,,x",
        "line 5: start '0.9'",
    ),
    "a kept segment without times": ("meta/segments.csv", SEGMENTS + "\n3,,,,x", "line 5: start ''"),
    "a segment number twice": ("meta/segments.csv", SEGMENTS + "\n2,0.1,0.2,,x", "line 5: segment 2"),
    "a segment that is a word": (
        "meta/segments.csv",
        SEGMENTS + "\nthree,0.1,0.2,,x",
        "line 5: segment is 'three'",
    ),
    "a time that is a word": ("meta/segments.csv", SEGMENTS + "\n3,soon,0.2,,x", "line 5: 'soon'"),
    "keep perhaps": ("meta/segments.csv", SEGMENTS + "\n3,0.1,0.2,perhaps,x", "line 5: keep is 'perhaps'"),
    "a comment with a comma": ("meta/segments.csv", SEGMENTS + "\n3,0.1,0.2,,x, y", "line 5:"),
    "an open quote": ("meta/segments.csv", SEGMENTS + '\n3,0.1,0.2,,"x', "not CSV"),
}


@pytest.mark.parametrize("fault", GYRO_FAULTS)
def test_a_faulty_gyro_file_is_refused_in_one_line_that_names_the_fault(tmp_path: Path, fault: str) -> None:
    text, value = GYRO_FAULTS[fault]
    path = tmp_path / "gyro.csv"
    path.write_text(text, encoding="utf-8")
    message = message_of(lambda: read_sensor_file(sensor_format("gyro"), path))
    assert message.startswith(str(path))
    assert value in message


@pytest.mark.parametrize("fault", TUM_FAULTS)
def test_a_faulty_tum_file_is_refused_in_one_line_that_names_the_fault(tmp_path: Path, fault: str) -> None:
    text, value = TUM_FAULTS[fault]
    path = tmp_path / "poses.tum"
    path.write_text(text, encoding="utf-8")
    message = message_of(lambda: read_tum(path))
    assert message.startswith(str(path))
    assert value in message


@pytest.mark.parametrize("fault", STEREO_FAULTS)
def test_a_faulty_data_set_is_refused_in_one_line_that_names_the_fault(tmp_path: Path, fault: str) -> None:
    name, content, value = STEREO_FAULTS[fault]
    spoil(stereo_folder(tmp_path), name, content)
    message = message_of(lambda: read_dataset(tmp_path))
    assert message.startswith(str(tmp_path / name.replace("*", "0")))
    assert value in message


@pytest.mark.parametrize("fault", PHYPHOX_FAULTS)
def test_a_faulty_phyphox_export_is_refused_in_one_line_that_names_the_fault(
    tmp_path: Path, fault: str
) -> None:
    name, text, value = PHYPHOX_FAULTS[fault]
    spoil(phyphox_folder(tmp_path), name, text)
    message = message_of(lambda: read_segments(tmp_path))
    assert message.startswith(str(tmp_path / name))
    assert value in message


def spoil(folder: Path, name: str, content: str | dict[str, str] | None) -> None:
    """Remove, replace or change the files of that name (a dict changes lines of a sensor.yaml)."""
    for file in [name.replace("*", "0"), name.replace("*", "1")]:
        if content is None:
            (folder / file).unlink(missing_ok=True)
        elif isinstance(content, dict):
            written(folder, {file: sensor_yaml(0.09 if "cam1" in file else 0.0, **content)})
        else:
            written(folder, {file: content})
