"""Recordings that do not name their numbers, or name them by their places alone: the numbers show what they are."""

import json
import re
from collections.abc import Callable
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from scipy.io import netcdf_file
from scipy.spatial.transform import Rotation

import spinfilters
from spinfilters.core.errors import InputError
from spinfilters.io.unnamed_columns import proposed_columns
from tests.io.logger_motion import COUNT, DEGREES, PLACE, RATES, STAMPS_NS, TIME, TURN, require_motion, text

WXYZ = TURN[:, [3, 0, 1, 2]]
FORCE = np.column_stack([0.2 * np.sin(TIME), 9.8 + 0.01 * TIME, 0.1 * np.cos(TIME)])
SPUN = np.column_stack([np.zeros((COUNT, 2)), np.full(COUNT, 0.8)])  # rad/s, of TURN
SPUN_DEGREES = np.degrees(SPUN)
MATRICES = Rotation.from_quat(TURN).as_matrix()
HOMOGENEOUS = np.tile(np.eye(4), (COUNT, 1, 1))
HOMOGENEOUS[:, :3, :3], HOMOGENEOUS[:, :3, 3] = MATRICES, PLACE


@pytest.mark.parametrize(
    ("columns", "proposed"),
    [
        ((TIME, PLACE, TURN), ["t,px,py,pz,qx,qy,qz,qw", "t,px,py,pz,qw,qx,qy,qz"]),
        ((np.arange(COUNT), TIME, WXYZ), ["-,t,qx,qy,qz,qw", "-,t,qw,qx,qy,qz"]),
        ((np.arange(COUNT), -PLACE, TURN), ["-,px,py,pz,qx,qy,qz,qw", "-,px,py,pz,qw,qx,qy,qz"]),
        ((PLACE, TURN), ["px,py,pz,qx,qy,qz,qw", "px,py,pz,qw,qx,qy,qz"]),
        (
            (np.arange(COUNT), HOMOGENEOUS[:, :3].reshape(COUNT, 12)),
            ["-,r11,r12,r13,px,r21,r22,r23,py,r31,r32,r33,pz"],
        ),
        ((TIME, WXYZ, SPUN), ["t,-,-,-,-,wx,wy,wz"]),
        ((1e9 * TIME, TURN, FORCE, SPUN_DEGREES), ["t,-,-,-,-,-,-,-,gx_dps,gy_dps,gz_dps"]),
        ((TIME, PLACE, WXYZ, SPUN_DEGREES), ["t,px,py,pz,qw,qx,qy,qz,-,-,-"]),
        ((TIME, FORCE, RATES), ["t,-,-,-,x,y,z", "t,x,y,z,-,-,-"]),
        ((np.full(COUNT, 7.0), 2e7 * np.arange(COUNT), RATES), ["stamp.sec,stamp.nanosec,x,y,z"]),
        ((np.full(COUNT, np.nan), TIME, RATES), ["-,t,x,y,z"]),
    ],
)
def test_numbers_show_what_their_columns_are(columns: tuple[np.ndarray, ...], proposed: list[str]) -> None:
    assert [",".join(names) for names in proposed_columns(np.column_stack(columns))] == proposed


def test_nothing_is_proposed_of_few_rows_or_of_what_stays() -> None:
    assert not proposed_columns(np.column_stack([TIME, RATES])[:3])
    assert not proposed_columns(np.column_stack([TIME, np.ones((COUNT, 3))]))


def array(folder: Path) -> Path:
    np.save(folder / "run.npy", np.column_stack([TIME, RATES]))
    return folder / "run.npy"


def named_arrays(folder: Path) -> Path:
    np.savez(folder / "demo.npz", object_pos=PLACE, object_quat=TURN, time=TIME)
    return folder / "demo.npz"


def rows_of_lists(folder: Path) -> Path:
    path = folder / "log.json"
    path.write_text(json.dumps({"samples": np.column_stack([TIME, RATES]).tolist()}))
    return path


def marked_rows(folder: Path) -> Path:
    head = (
        "header:\n  variables:\n    - gps_time:\n        comment: 1st column of four\n# End of YAML header\n"
    )
    rows = [(f"{t:.3f}", "C", *p, *q) for t, p, q in zip(TIME, PLACE, WXYZ, strict=True)]
    return text(folder / "star.txt", head, rows, " ")


@pytest.mark.parametrize(
    ("make", "choice", "stated"),
    [
        (named_arrays, 0, {}),
        (array, 0, {"unit": "rad/s"}),
        (rows_of_lists, 0, {"unit": "rad/s"}),
        (marked_rows, 1, {}),
    ],
)
def test_the_columns_that_a_refusal_proposes_are_read(
    make: Callable[[Path], Path], choice: int, stated: dict[str, Any], tmp_path: Path
) -> None:
    path = make(tmp_path)
    with pytest.raises(InputError, match="--columns") as refusal:
        spinfilters.load(path)
    proposed = re.search(r"--columns (\S+)(?: or (\S+))? \(", str(refusal.value))
    assert proposed is not None
    require_motion(spinfilters.load(path, columns=proposed[1 + choice], **stated))


def records(folder: Path) -> Path:
    kind: Final = [("t", "f8"), ("position", "f8", (3,)), *((f"q{axis}", "f8") for axis in "wxyz")]
    table = np.zeros(COUNT, dtype=kind)
    table["t"], table["position"] = TIME, PLACE
    for axis, column in zip("wxyz", WXYZ.T, strict=True):
        table[f"q{axis}"] = column
    np.save(folder / "run.npy", table)
    return folder / "run.npy"


def netcdf(folder: Path) -> Path:
    with netcdf_file(folder / "run.nc", "w") as file:
        file.createDimension("time", COUNT)
        for name, unit, values in (
            ("time", "seconds since 2026-01-01", TIME),
            *((f"omega_{axis}", "deg s-1", column) for axis, column in zip("xyz", DEGREES.T, strict=True)),
        ):
            variable = file.createVariable(name, "f8", ("time",))
            variable.units, variable[:] = unit, values
    return folder / "run.nc"


def four_of_one_stem(folder: Path) -> Path:
    rows = np.column_stack([PLACE, TURN]).tolist()
    head = "timestamp[ns];tx[m];ty[m];tz[m];ox;oy;oz;ow\n"
    return text(folder / "zed.txt", head, [(ns, *row) for ns, row in zip(STAMPS_NS, rows, strict=True)], ";")


def printed_arrays(folder: Path) -> Path:
    rows = [(t, f'"[{x} {y} {z}]"') for t, (x, y, z) in zip(TIME, RATES.tolist(), strict=True)]
    return text(folder / "log.csv", "t,angular_velocity\n", rows)


def printed_degrees(folder: Path) -> Path:
    rows = [(t, f"({x}, {y}, {z})") for t, (x, y, z) in zip(TIME, DEGREES.tolist(), strict=True)]
    return text(folder / "log.txt", "# time gyro(deg/s)\n", rows, "\t").rename(folder / "log.out")


def units_below_names(folder: Path) -> Path:
    return text(
        folder / "a.out",
        "Time wx wy wz\n(s) (deg/s) (deg/s) (deg/s)\n",
        np.column_stack([TIME, DEGREES]),
        " ",
    )


def blocks(folder: Path) -> Path:
    def vector(name: str, values: np.ndarray, axes: str) -> str:
        held = "".join(f"  {axis}: {v!r}\n" for axis, v in zip(axes, values.tolist(), strict=True) if v)
        return f"{name} {{\n{held}}}\n"

    path = folder / "pose.txt"
    path.write_text(
        "".join(
            f'header {{\n  stamp {{\n    sec: {10 + k // 50}\n    nsec: {k % 50 * 20_000_000}\n  }}\n}}\nname: "box"\n'
            + vector("position", PLACE[k], "xyz")
            + vector("orientation", TURN[k], "xyzw")
            + "\n"
            for k in range(COUNT)
        )
    )
    return path


def homogeneous_rows(folder: Path) -> Path:
    (folder / "times.txt").write_text("".join(f"{t}\n" for t in TIME))
    return text(folder / "traj.txt", "", HOMOGENEOUS.reshape(COUNT, 16).tolist(), " ")


def matrices_in_json(folder: Path) -> Path:
    path = folder / "transforms.json"
    frames = [{"time": t, "transform_matrix": m.tolist()} for t, m in zip(TIME, HOMOGENEOUS, strict=True)]
    path.write_text(json.dumps({"camera_angle_x": 0.7, "frames": frames}))
    return path


def vectornav_sentences(folder: Path) -> Path:
    rows = np.column_stack([TURN, 0.3 * PLACE, FORCE, RATES]).tolist()
    bodies = [f"VNQMR,{','.join(map(repr, row))}" for row in rows]
    return text(folder / "vn.txt", "", [(f"${body}*{reduce(xor, body.encode()):02X}",) for body in bodies])


def paparazzi(folder: Path) -> Path:
    lines = [
        line
        for k, (t, rate) in enumerate(zip(TIME, DEGREES, strict=True))
        for line in (
            [f"{t:.3f}", 42, "IMU_ACCEL", *FORCE[k]],
            [f"{t:.3f}", 42, "IMU_GYRO", *rate],
        )
    ]
    return text(folder / "17_05.data", "", lines, " ")


def told_by_a_word(folder: Path) -> Path:
    lines = [
        line
        for k, t in enumerate(TIME)
        for line in (["ACCE", t, t + 1e3, *FORCE[k], 3], ["GYRO", t, t + 1e3, *DEGREES[k], 3])
    ]
    return text(folder / "logfile.txt", "% LogFile created by an app\n", lines, ";")


def skeleton(folder: Path) -> Path:
    head = (
        "HIERARCHY\nROOT Hips\n{\n OFFSET 0 0 0\n CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n"
        f" End Site\n {{\n  OFFSET 0 1 0\n }}\n}}\nMOTION\nFrames: {COUNT}\nFrame Time: 0.02\n"
    )
    angles = Rotation.from_quat(TURN).as_euler("ZXY", degrees=True)
    return text(folder / "take.bvh", head, np.column_stack([100 * PLACE, angles]).tolist(), " ")


def lists_in_parquet(folder: Path) -> Path:
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    columns = {"timestamp": TIME, "observation.angular_velocity": pyarrow.array(RATES.tolist())}
    parquet.write_table(pyarrow.table(columns), folder / "episode.parquet")
    return folder / "episode.parquet"


def a_unit_in_front_of_the_axis(folder: Path) -> Path:
    np.savez(folder / "a.npz", t=TIME, gyro_dps=DEGREES)
    return folder / "a.npz"


def words_below_a_header(folder: Path) -> Path:
    rows = [
        row
        for k, t in enumerate(TIME)
        for row in (("ACC", 1000 * t, *FORCE[k]), ("GYRO", 1000 * t, *DEGREES[k]))
    ]
    return text(folder / "all.csv", "sensor,time_ms,x,y,z\n", rows)


@pytest.mark.parametrize(
    ("make", "stated"),
    [
        (words_below_a_header, {"unit": "deg/s"}),
        (skeleton, {"unit": "cm"}),
        (lists_in_parquet, {}),
        (a_unit_in_front_of_the_axis, {}),
        (records, {}),
        (netcdf, {}),
        (four_of_one_stem, {}),
        (printed_arrays, {}),
        (printed_degrees, {}),
        (units_below_names, {}),
        (blocks, {}),
        (homogeneous_rows, {}),
        (matrices_in_json, {}),
        (vectornav_sentences, {"rate": 50.0}),
        (paparazzi, {"unit": "deg/s"}),
        (told_by_a_word, {"unit": "deg/s"}),
    ],
)
def test_a_recording_of_another_shape_is_read(
    make: Callable[[Path], Path], stated: dict[str, Any], tmp_path: Path
) -> None:
    require_motion(spinfilters.load(make(tmp_path), **stated))


@pytest.mark.parametrize(
    ("name", "lines", "why"),
    [
        (
            "a.csv",
            ['0,"[1 2 3]"', '1,"[1 2 3]"', '2,"[1 2 3]"', '3,"[1 2]"'],
            "line 5: does not have the cells",
        ),
        (
            "a.csv",
            ['0,"[1 2 3]"', '1,"[1 2 3]"', '2,"[1 2 3]"', '3,"[1 2 x]"'],
            "line 5: .* a vector that is none",
        ),
        (
            "a.txt",
            ["GYRO 0 1 2 3", "GYRO 1 2 1 4", "GYRO 2 1 3 5", "GYRO 3 1"],
            "line 5: has 2 numbers, expected 4",
        ),
        (
            "a.txt",
            ["GYRO 0 1 2 3", "IMU_GYRO 1 2 3 4", "GYRO 2 2 1 2", "GYRO 3 1 2 1"],
            "GYRO, IMU_GYRO; give --topic",
        ),
        (
            "a.txt",
            ["GYRO 0 1 2 3 4", "GYRO 1 2 3 4 5", "GYRO 2 1 3 1 2", "GYRO 3 1 1 1 2"],
            "are not clocks and three rates",
        ),
    ],
)
def test_a_spoiled_line_is_refused_with_its_number(
    name: str, lines: list[str], why: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_text("# t gyro\n" + "\n".join(lines) + "\n")
    with pytest.raises(InputError, match=why) as refusal:
        spinfilters.load(path)
    assert "\n" not in str(refusal.value)


def test_a_unit_of_a_variable_that_is_unknown_is_not_left_out(tmp_path: Path) -> None:
    path = netcdf(tmp_path)
    path.write_bytes(path.read_bytes().replace(b"deg s-1", b"arc s-1"))
    with pytest.raises(InputError, match="no unit known here"):
        spinfilters.load(path)


def test_the_rates_of_openfoam_in_axes_of_space_are_no_body_rates(tmp_path: Path) -> None:
    rows = [(t, *("(0.5 0.25 1.5)" for _ in range(4)), "(0.1 0.2 0.3)") for t in TIME]
    head = "# Motion State\n# Angle Units : radians\n# Time centreOfRotation centreOfMass rotation velocity omega\n"
    with pytest.raises(InputError, match="contains no body rate"):
        spinfilters.load(text(tmp_path / "sixDoFRigidBodyState.dat", head, rows, "\t"))


def paths_of_topics(folder: Path) -> Path:
    names = [
        *("/imu/data/header/stamp/sec", "/imu/data/header/stamp/nanosec", "/imu/data/header/frame_id"),
        *(f"/imu/data/angular_velocity/{axis}" for axis in "xyz"),
    ]
    rows = [(7, 20_000_000 * k, "imu", *rate) for k, rate in enumerate(RATES.tolist())]
    return text(folder / "imu.csv", ",".join(names) + "\n", rows)


def date_and_time(folder: Path) -> Path:
    head = "Date (UTC),Time (UTC),Angular rate X (deg/s),Angular rate Y (deg/s),Angular rate Z (deg/s)\n"
    rows = [("25/11/2026", f"10:11:{t:06.3f}", *rate) for t, rate in zip(TIME, DEGREES.tolist(), strict=True)]
    return text(folder / "rt.csv", head, rows)


def units_beside_values(folder: Path) -> Path:
    rows = [
        {"ts_ms": 20 * k, "angular_velocity": {**dict(zip("xyz", rate, strict=True)), "unit": "deg/s"}}
        for k, rate in enumerate(DEGREES.tolist())
    ]
    path = folder / "stream.ndjson"
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return path


@pytest.mark.parametrize("make", [paths_of_topics, date_and_time, units_beside_values])
def test_a_recording_whose_names_say_more_than_their_quantity_is_read(
    make: Callable[[Path], Path], tmp_path: Path
) -> None:
    require_motion(spinfilters.load(make(tmp_path)))


def test_an_empty_cell_behind_each_row_is_no_column_to_name(tmp_path: Path) -> None:
    rows = np.column_stack([TIME, PLACE, WXYZ]).tolist()
    path = text(tmp_path / "vio.csv", "", [(*row, "") for row in rows])
    with pytest.raises(InputError, match="or t,px,py,pz,qw,qx,qy,qz "):
        spinfilters.load(path)
    require_motion(spinfilters.load(path, columns="t,px,py,pz,qw,qx,qy,qz"))


def test_a_skeleton_that_lacks_a_frame_is_refused(tmp_path: Path) -> None:
    path = skeleton(tmp_path)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join([*lines[:-5], *lines[-4:]]))
    with pytest.raises(InputError, match=f"has {COUNT - 1} frames, and states '{COUNT}'"):
        spinfilters.load(path, unit="cm")


def test_the_unit_of_a_skeleton_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--unit cm or m"):
        spinfilters.load(skeleton(tmp_path))


@pytest.mark.parametrize("damage", [("VNQMR", "VNQMQ", 0), ("VNQMR,0", "VNQMR,1", 0), ("*", "#", 12)])
def test_a_damaged_sentence_of_a_log_without_a_clock_is_refused(
    damage: tuple[str, str, int], tmp_path: Path
) -> None:
    path, (found, put, skipped) = vectornav_sentences(tmp_path), damage
    lines = path.read_text().splitlines(keepends=True)
    lines[skipped + 3] = lines[skipped + 3].replace(found, put)
    path.write_text("".join(lines))
    with pytest.raises(InputError, match=r"line \d+: .* is damaged"):
        spinfilters.load(path, rate=50.0)
