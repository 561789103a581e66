"""Recordings that nest, pack or name their numbers in ways of their own: JSON at any depth, packets, increments, other clocks."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

import spinfilters
from spinfilters.core.errors import InputError
from tests.io.logger_motion import COUNT, DEGREES, PLACE, RATES, STAMPS_US, TIME, TURN, require_motion, text

WXYZ = TURN[:, [3, 0, 1, 2]]
MRP = TURN[:, :3] / (1 + TURN[:, 3:])
MILLISECONDS = 20 * np.arange(COUNT)


def document(folder: Path, content: Any) -> Path:
    path = folder / "log.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def vector(values: np.ndarray, axes: str = "xyz") -> dict[str, float]:
    return dict(zip(axes, map(float, values), strict=True))


def gopro_json(folder: Path) -> Path:
    def samples(values: np.ndarray) -> list[dict[str, Any]]:
        return [{"value": list(v), "cts": float(t)} for v, t in zip(values, MILLISECONDS, strict=True)]

    streams = {
        "ACCL": {"samples": samples(PLACE), "name": "Accelerometer", "units": "m/s2"},
        "GYRO": {"samples": samples(RATES[:, [2, 0, 1]]), "name": "Gyroscope (z,x,y)", "units": "rad/s"},
    }
    return document(folder, {"1": {"streams": streams, "device name": "Hero"}, "frames/second": 59.94})


def movesense(folder: Path) -> Path:
    rows = [
        {"Imu6": {"Timestamp": 20 * k, "ArrayGyro": [vector(each) for each in DEGREES[k : k + 4]]}}
        for k in range(0, COUNT, 4)
    ]
    return document(folder, {"Samples": rows})


def isaac(folder: Path) -> Path:
    rows = [
        {"current_time": t, "current_time_step": k, "data": {"position": list(p), "orientation": list(q)}}
        for k, (t, p, q) in enumerate(zip(TIME, PLACE, WXYZ, strict=True))
    ]
    return document(folder, {"Isaac Sim Data": rows})


def gazebo_lines(folder: Path) -> Path:
    rows = [
        {
            "header": {"stamp": {"sec": str(ms // 1000), "nsec": int(ms % 1000) * 1_000_000}},
            "pose": [{"name": "box", "position": vector(p), "orientation": vector(q, "xyzw")}],
        }
        for ms, p, q in zip(MILLISECONDS, PLACE, TURN, strict=True)
    ]
    return document(folder, "\n".join(map(json.dumps, rows)))


def mavlogdump(folder: Path) -> Path:
    rows = []
    for k in range(COUNT):
        rates = dict(zip(("GyrX", "GyrY", "GyrZ"), map(float, RATES[k]), strict=True))
        rows += [
            {
                "meta": {"type": "IMU", "timestamp": 1.7e9 + k},
                "data": {"TimeUS": STAMPS_US[k], "I": 0, **rates},
            }
        ]
        rows += [
            {"meta": {"type": "MODE", "timestamp": 1.7e9 + k}, "data": {"TimeUS": STAMPS_US[k], "Mode": 1}}
        ]
    return document(folder, "\n".join(map(json.dumps, rows)))


def split_frame(folder: Path) -> Path:
    data = np.column_stack([TIME, RATES]).tolist()
    return document(folder, {"columns": ["t", "wx", "wy", "wz"], "index": list(range(COUNT)), "data": data})


def frame_of_columns(folder: Path) -> Path:
    columns = np.column_stack([TIME, RATES]).T.tolist()
    named = dict(zip(("t", "wx", "wy", "wz"), columns, strict=True))
    return document(folder, {name: {str(k): v for k, v in enumerate(c)} for name, c in named.items()})


def record3d(folder: Path) -> Path:
    return document(
        folder, {"fps": 50, "dw": 192, "K": [1.0] * 9, "poses": np.column_stack([TURN, PLACE]).tolist()}
    )


def vehicle_imu(folder: Path) -> Path:
    head = "timestamp,timestamp_sample,delta_angle[0],delta_angle[1],delta_angle[2],delta_angle_dt\n"
    rows = zip(STAMPS_US, STAMPS_US, *(0.02 * RATES).T, [20_000] * COUNT, strict=True)
    return text(folder / "log_vehicle_imu_0.csv", head, rows)


def two_sensors(folder: Path) -> Path:
    rows = []
    for k in range(COUNT):
        rows += [(STAMPS_US[k], 0, *RATES[k]), (STAMPS_US[k] + 40, 1, *(RATES[k] + 0.1))]
    return text(folder / "imu.csv", "TimeUS,I,GyrX,GyrY,GyrZ\n", rows)


def basilisk(folder: Path) -> Path:
    rows = zip((TIME * 1e9).round().astype(int), *MRP.T, strict=True)
    return text(folder / "s.csv", "time [ns],sigma_BN_0,sigma_BN_1,sigma_BN_2\n", rows)


def julian_days(folder: Path) -> Path:
    head = "Sat.A1ModJulian   Sat.Q1   Sat.Q2   Sat.Q3   Sat.Q4\n"
    return text(folder / "r.txt", head, zip(28000.5 + TIME / 86400, *TURN.T, strict=True), "   ")


def timetable(folder: Path) -> Path:
    head = "Time,AngularVelocity_1,AngularVelocity_2,AngularVelocity_3\n"
    return text(folder / "t.csv", head, zip([f"{t:.2f} sec" for t in TIME], *RATES.T, strict=True))


def seconds_and_microseconds(folder: Path) -> Path:
    head = "Unix Time,Microseconds,omega_body_x,omega_body_y,omega_body_z\n"
    ms = 999_500 + MILLISECONDS
    return text(
        folder / "s.csv", head, zip(1_700_000_000 + ms // 1000, ms % 1000 * 1000, *RATES.T, strict=True)
    )


def simulink(folder: Path) -> Path:
    savemat(
        folder / "s.mat",
        {"simout": {"time": TIME[:, None], "signals": {"values": RATES, "label": "omega_b"}}},
    )
    return folder / "s.mat"


def modelica(folder: Path) -> Path:
    names = ["time", "w[1]", "w[2]", "w[3]", "minus"]
    names[1:4] = [f"body.w_a[{k}]" for k in (1, 2, 3)]
    letters = np.array([list(each) for each in zip(*(name.ljust(12) for name in names), strict=True)])
    info = np.array([[0, 1, 0, -1], [2, -2, 0, -1], [2, 3, 0, -1], [2, 4, 0, -1], [1, 1, 0, -1]], np.int32).T
    held = {
        "Aclass": np.array(["Atrajectory", "1.1", "", "binTrans"]),
        "name": np.array(["".join(row) for row in letters]),
        "dataInfo": info,
        "data_1": np.zeros((1, 2)),
        "data_2": np.vstack([TIME, -RATES[:, 0], RATES[:, 1], RATES[:, 2]]),
    }
    savemat(folder / "m_res.mat", held, format="4")
    return folder / "m_res.mat"


LVM = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t,\nX_Columns\tOne\n***End_of_Header***\t\n\t\n"
    "Channels\t3\t\t\nY_Unit_Label\trad/s\trad/s\trad/s\nDelta_X\t0,020\t0,020\t0,020\n***End_of_Header***\t\t\t\n"
)


def labview(folder: Path) -> Path:
    rows = [[f"{v:.9f}".replace(".", ",") for v in (t, *w)] for t, w in zip(TIME, RATES, strict=True)]
    return text(folder / "r.lvm", LVM + "X_Value\tGyro X\tGyro Y\tGyro Z\tComment\n", rows, "\t")


def labview_without_times(folder: Path) -> Path:
    rows = [["", *(f"{v:.9f}".replace(".", ",") for v in w)] for w in RATES]
    return text(folder / "r.lvm", LVM + "X_Value\tGyro X\tGyro Y\tGyro Z\tComment\n", rows, "\t")


def opensim(folder: Path) -> Path:
    head = "DataRate=50.0\nDataType=Quaternion\nversion=3\nendheader\ntime\ttorso_imu\n"
    return text(folder / "o.sto", head, zip(TIME, [",".join(map(str, q)) for q in WXYZ], strict=True), "\t")


AS_IT_IS: tuple[Callable[[Path], Path], ...] = (
    *(gopro_json, movesense, isaac, gazebo_lines, mavlogdump, split_frame, frame_of_columns, record3d),
    *(vehicle_imu, two_sensors, basilisk, julian_days, timetable, seconds_and_microseconds),
    *(simulink, modelica, labview, labview_without_times, opensim),
)


@pytest.mark.parametrize("make", AS_IT_IS, ids=lambda make: make.__name__)
def test_a_log_of_a_stranger_is_read_as_it_is(make: Callable[[Path], Path], tmp_path: Path) -> None:
    require_motion(spinfilters.load(make(tmp_path)))


def pose_graph(folder: Path) -> Path:
    rows = [("VERTEX_SE3:QUAT", k, *p, *q) for k, (p, q) in enumerate(zip(PLACE, TURN, strict=True))]
    return text(folder / "g.g2o", "FIX 0\n", rows[::-1], " ")


def drake(folder: Path) -> Path:
    np.savez(folder / "d.npz", t=TIME, x=np.column_stack([WXYZ, PLACE, 0 * RATES, 0 * RATES]).T)
    return folder / "d.npz"


def two_bodies(folder: Path) -> Path:
    rows = [{"t": t, "quaternion": vector(q, "xyzw")} for t, q in zip(TIME, TURN, strict=True)]
    return document(folder, {"box": rows, "arm": rows})


WITH_A_HINT: tuple[tuple[Callable[[Path], Path], dict[str, Any], str], ...] = (
    (pose_graph, {"rate": 50.0}, "--rate"),
    (drake, {"columns": "qw,qx,qy,qz,px,py,pz,-,-,-,-,-,-"}, "--columns"),
    (two_bodies, {"topic": "box"}, "--topic"),
)


@pytest.mark.parametrize(
    ("make", "hint", "asked"), WITH_A_HINT, ids=lambda each: getattr(each, "__name__", "")
)
def test_what_a_stranger_leaves_open_is_asked_for(
    make: Callable[[Path], Path], hint: dict[str, Any], asked: str, tmp_path: Path
) -> None:
    path = make(tmp_path)
    with pytest.raises(InputError, match=asked):
        spinfilters.load(path)
    require_motion(spinfilters.load(path, **hint))


def openrocket(folder: Path) -> Path:
    head = (
        "# Time (s),Roll rate (°/s),Pitch rate (°/s),Yaw rate (°/s)\n# Event LAUNCH occurred at t=0 seconds\n"
    )
    return text(folder / "o.csv", head, zip(TIME, *DEGREES.T, strict=True))


def twice_one_vertex(folder: Path) -> Path:
    return text(folder / "g.g2o", "", [("VERTEX_SE3:QUAT", 3, 0, 0, 0, 0, 0, 0, 1)] * 2, " ")


def no_period(folder: Path) -> Path:
    path = vehicle_imu(folder)
    path.write_text(path.read_text().replace("20000\n", "0\n"))
    return path


REFUSED: tuple[tuple[Callable[[Path], Path], str], ...] = (
    (openrocket, "do not turn with the body"),
    (twice_one_vertex, "stands twice"),
    (no_period, "not above 0"),
    (lambda folder: text(folder / "a.lvm", "LabVIEW Measurement\n", []), "no header"),
    (
        lambda folder: text(folder / "a.sto", "inDegrees=yes\nendheader\ntime\ta\n0\t1\n", []),
        "DataType=Quaternion",
    ),
    (lambda folder: document(folder, '{"a": 1}\n{"b":\n{"c": 1}\n'), "line 2: is not JSON"),
)


def deep(folder: Path) -> Path:
    inner = '{"a":' * 400 + "1" + "}" * 400
    return document(
        folder, f'[{{"t": 1{"0" * 400}, "gx": [1, 2], "b": {inner}}}, {{"t": 2, "gx": [1, 2], "b": 1}}]'
    )


@pytest.mark.parametrize(
    "make", [deep, lambda folder: text(folder / "a.sto", "DataType=Quaternion\nendheader\ntime a\n \n", [])]
)
def test_a_deep_or_empty_log_is_refused_in_one_line(make: Callable[[Path], Path], tmp_path: Path) -> None:
    with pytest.raises(InputError):
        spinfilters.load(make(tmp_path))
    rows = document(tmp_path, [{"t": k, "name": "a", "x": k, "y": 1, "z": 0} for k in range(3)])
    with pytest.raises(InputError, match="'x' is 'a', not a number"):
        spinfilters.load(rows, columns="t,x,y,z,-", unit="rad/s")


@pytest.mark.parametrize(("make", "why"), REFUSED)
def test_what_a_stranger_wrote_otherwise_is_refused_in_one_line(
    make: Callable[[Path], Path], why: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=why) as refusal:
        spinfilters.load(make(tmp_path), rate=50.0 if make is twice_one_vertex else None)
    assert len(str(refusal.value).splitlines()) == 1


def vendor(head: str, *columns: Any) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        rows = zip(*columns, strict=True)
        cells = [[v for cell in row for v in (cell if np.ndim(cell) else [cell])] for row in rows]
        return text(folder / "v.csv", head + "\n", cells)

    return make


def foxglove(folder: Path) -> Path:
    rows = [
        {
            "receiveTime": {"sec": int(ms) // 1000, "nsec": int(ms) % 1000 * 1_000_000 + 77},
            "message": {
                "header": {"stamp": {"sec": int(ms) // 1000, "nsec": int(ms) % 1000 * 1_000_000}},
                "angular_velocity": vector(w),
            },
        }
        for ms, w in zip(1_700_000_000_000 + MILLISECONDS, RATES, strict=True)
    ]
    return document(folder, rows)


def timeseries(folder: Path) -> Path:
    savemat(folder / "t.mat", {"omega": {"Time": TIME[:, None], "Data": RATES, "Name": "omega"}})
    return folder / "t.mat"


def german(folder: Path) -> Path:
    head = "catman\nSample rate: 50 Hz\nZeit [s];Drehrate X [°/s];Drehrate Y [°/s];Drehrate Z [°/s]\n"
    rows = [[f"{v:.6f}".replace(".", ",") for v in (t, *w)] for t, w in zip(TIME, DEGREES, strict=True)]
    return text(folder / "c.asc", head, rows, ";")


def mujoco(folder: Path) -> Path:
    np.savez(folder / "m.npz", time=TIME, xquat=WXYZ, xpos=PLACE)
    return folder / "m.npz"


def adams(unit: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        head = f"A\tFile: Last_Run\n\tTime\tWX\tWY\tWZ\n\t(sec)\t{unit}\t{unit}\t{unit}\n"
        return text(folder / "a.tab", head, zip(TIME, *DEGREES.T, strict=True), "\t")

    return make


UNUSUAL: dict[str, Callable[[Path], Path]] = {
    "host and node": vendor(
        "HostTimestamp,NodeTimestamp,X (dps),Y (dps),Z (dps)",
        1_710_496_800_000 + MILLISECONDS,
        MILLISECONDS // 8,
        DEGREES,
    ),
    "Euler parameters": vendor("t,x,y,z,e0,e1,e2,e3", TIME, PLACE, WXYZ),
    "letters of mathematics": vendor("timestamp,ω₁(t),ω₂(t),ω₃(t)", TIME, RATES),
    "a source in front": vendor(
        "t,probe_angular_velocity_x,probe_angular_velocity_y,probe_angular_velocity_z", TIME, RATES
    ),
    "a preamble and decimal commas": german,
    "units of Adams": adams("(deg/sec)"),
    "MuJoCo": mujoco,
    "Foxglove": foxglove,
    "a timeseries": timeseries,
}


@pytest.mark.parametrize("case", UNUSUAL)
def test_a_table_of_unusual_names_is_read_as_it_is(case: str, tmp_path: Path) -> None:
    require_motion(spinfilters.load(UNUSUAL[case](tmp_path)))


OTHER_RATES = (
    "world_angular_velocity_x",
    "target_angular_velocity_x",
    "wheel_omega_x",
    "gyro_b_x",
    "w_x1",
    "omega_i_x",
)


@pytest.mark.parametrize("first", [*OTHER_RATES, "w1", "w_1"])
def test_a_rate_in_other_axes_or_of_something_else_is_no_body_rate(first: str, tmp_path: Path) -> None:
    own = [first.replace("x", axis).replace("1", number) for axis, number in zip("xyz", "123", strict=True)]
    head = ",".join(["t", *own])
    with pytest.raises(InputError, match="no body rate"):
        spinfilters.load(vendor(head, TIME, RATES)(tmp_path))


def test_a_unit_below_the_names_that_is_unknown_is_not_left_out(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no unit known here"):
        spinfilters.load(adams("(gradians/s)")(tmp_path))
