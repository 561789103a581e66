"""Logs of simulators, flight controllers and inertial units whose headers, factors or neighbours say what their names do not."""

import json
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spinfilters
from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.errors import InputError
from tests.io.logger_motion import (
    COUNT,
    DEGREES,
    PLACE,
    RATES,
    STAMPS_NS,
    STAMPS_US,
    TIME,
    TURN,
    require_motion,
    text,
)

WXYZ = TURN[:, [3, 0, 1, 2]]
POSES = np.column_stack([PLACE, TURN])
WRONG_RATES = 2 * RATES  # in other axes, as simulators state them beside poses
COUNTS = 1e-4  # rad/s


def table(name: str, head: str, *columns: Any, between: str = ",", end: str = "") -> Callable[[Path], Path]:
    """Maker of a table of these columns: numbers by row, or one cell for all rows."""

    def make(folder: Path) -> Path:
        whole = [
            np.reshape(np.broadcast_to(np.array(c).T, (np.size(c) // COUNT or 1, COUNT)), (-1, COUNT)).T
            for c in columns
        ]
        rows = [[cell for part in whole for cell in part[k].tolist()] for k in range(COUNT)]
        path = text(folder / name, head + "\n", rows, between)
        path.write_text(path.read_text() + end)
        return path

    return make


def kitti(folder: Path) -> Path:
    text(folder / "sequences" / "00" / "times.txt", "", [(f"{t:.6e}",) for t in TIME])
    rows = np.concatenate([matrix_from_quaternion(TURN), PLACE[:, :, None]], axis=2).reshape(COUNT, -1)
    return text(folder / "poses" / "00.txt", "", rows.tolist(), " ")


def mvnx(folder: Path, segments: Sequence[str] = ("Prop1",)) -> Path:
    still = {"orientation": "1 0 0 0 ", "position": "0 0 0 "}
    frames = ""
    for k in range(COUNT):
        own = {"orientation": WXYZ[k], "position": PLACE[k]}
        parts = [
            f"<{name}>{still[name] * (len(segments) - 1)}{' '.join(map(repr, own[name].tolist()))}</{name}>"
            for name in own
        ]
        frames += f'<frame time="{20 * k}" index="{k}" type="normal">{"".join(parts)}</frame>'
    labels = "".join(f'<segment label="{label}" id="1"/>' for label in segments)
    path = folder / "take.mvnx"
    path.write_text(
        f'<mvnx xmlns="http://www.xsens.com/mvn/mvnx"><subject><segments>{labels}</segments><frames>'
        f'<frame time="0" type="identity"/>{frames}</frames></subject></mvnx>'
    )
    return path


def aem_xml(folder: Path) -> Path:
    states = ""
    for t, q in zip(TIME, TURN, strict=True):
        numbers = "".join(
            f"<{name}>{value!r}</{name}>"
            for name, value in zip(("Q1", "Q2", "Q3", "QC"), q.tolist(), strict=True)
        )
        epoch = f"<EPOCH>2021-11-28T21:29:0{t:.4f}</EPOCH>"
        ephemeris = f"<quaternionEphemeris>{epoch}<quaternion>{numbers}</quaternion></quaternionEphemeris>"
        states += f"<attitudeState>{ephemeris}</attitudeState>"
    stated = {"REF_FRAME_A": "J2000", "REF_FRAME_B": "SC_BODY", "ATTITUDE_TYPE": "QUATERNION"}
    metadata = "".join(f"<{name}>{value}</{name}>" for name, value in stated.items())
    path = folder / "sat.xml"
    path.write_text(
        f"<aem><body><segment><metadata>{metadata}</metadata><data>{states}</data></segment></body></aem>"
    )
    return path


def echoed(folder: Path) -> Path:
    whole = ""
    for stamp, rate in zip(STAMPS_NS, RATES.tolist(), strict=True):
        whole += f'header: \n  stamp: \n    secs: {stamp // 10**9}\n    nsecs: {stamp % 10**9}\n  frame_id: "imu"\n'
        whole += "orientation: \n  x: 0.0\n  y: 0.0\n  z: 0.0\n  w: 1.0\norientation_covariance: [0.0, 0.0]\n"
        whole += "angular_velocity: \n" + "".join(f"  {a}: {v}\n" for a, v in zip("xyz", rate, strict=True))
        whole += "linear_acceleration: \n  x: 0.0\n  y: 0.0\n  z: 9.8\n---\n"
    path = folder / "imu.txt"
    path.write_text(whole)
    return path


def mujoco(folder: Path) -> Path:
    path = folder / "rollout.npz"
    np.savez(path, time=TIME, qpos=np.column_stack([PLACE, WXYZ]), qvel=np.column_stack([PLACE, WRONG_RATES]))
    return path


def simulink_structure(folder: Path) -> Path:
    from scipy.io import savemat

    signals = {"values": RATES, "dimensions": 3.0, "label": ""}
    savemat(folder / "out.mat", {"omega": {"time": TIME[:, None], "signals": signals}})
    return folder / "out.mat"


def apdm(folder: Path) -> Path:
    h5py = pytest.importorskip("h5py")
    path = folder / "opal.h5"
    with h5py.File(path, "w") as file:
        group = file.create_group("Sensors/1234")
        group["Time"] = np.array([1_577_836_800_000_000 + 20_000 * k for k in range(COUNT)], dtype=np.uint64)
        group["Gyroscope"] = RATES
        group["Gyroscope"].attrs["Units"] = "rad/s"
    return path


GYROFLOW = "GYROFLOW IMU LOG\nversion,1.3\norientation,YxZ\ntscale,0.001\ngscale,0.0001\nascale,0.0005\nt,gx,gy,gz,ax,ay,az"
BLACKBOX = '"Product","Blackbox flight data recorder by Nicholas Sherlock"\n"gyroScale",1.7453292519943295e-8\n"looptime",125\n'
BLACKBOX += '"loopIteration","time","axisP[0]","gyroADC[0]","gyroADC[1]","gyroADC[2]","motor[0]"'
SIMULINK = "time,omega:1(1),omega:1(2),omega:1(3)\n,Type: double,Type: double,Type: double\n,Unit: deg/s,Unit: deg/s,Unit: deg/s\n"
SIMULINK += ",BlockPath: m/a,BlockPath: m/b,BlockPath: m/c"
ODOMETRY = "timestamp,timestamp_sample,position[0],position[1],position[2],q[0],q[1],q[2],q[3]"
ODOMETRY += ",angular_velocity[0],angular_velocity[1],angular_velocity[2]"
PYBULLET = "stepCount,timeStamp,objectId,posX,posY,posZ,oriX,oriY,oriZ,oriW,omegaX,omegaY,omegaZ"
STATES = ",".join(
    ["time", "field.name0", "field.name1"]
    + [
        f"field.pose{k}.{part}"
        for k in (0, 1)
        for part in (*(f"position.{a}" for a in "xyz"), *(f"orientation.{a}" for a in "xyzw"))
    ]
    + [f"field.twist1.angular.{a}" for a in "xyz"]
)
SECONDS = [f"{t:g} sec" for t in TIME]
MILLISECONDS = (12000 + 1000 * TIME).round().astype(int)
STILL = [0, 0, 0, 0, 0, 0, 1]

MOTIVE = "Format Version,1.24,Rotation Type,Quaternion,Length Units,Meters\n\n,Type," + ",".join(
    ["Rigid Body"] * 14
)
MOTIVE += (
    "\n,Name,"
    + ",".join(["Table"] * 7 + ["Cube"] * 7)
    + "\n,,"
    + ",".join((["Rotation"] * 4 + ["Position"] * 3) * 2)
)
MOTIVE += "\nFrame,Time (Seconds)," + ",".join("XYZWXYZ" * 2)
PASCO = ['"Time (s) Run #1"', *(f'"Angular Velocity - {axis} (rad/s) Run #1"' for axis in "xyz")]


def edge_impulse(folder: Path) -> Path:
    sensors = [{"name": f"gyr{axis}", "units": "deg/s"} for axis in "XYZ"]
    path = folder / "walk.json"
    path.write_text(
        json.dumps({"payload": {"interval_ms": 20, "sensors": sensors, "values": DEGREES.tolist()}})
    )
    return path


AS_IT_IS: dict[str, Callable[[Path], Path]] = {
    "Edge Impulse": edge_impulse,
    "quaternion of Xsens": table(
        "x.csv",
        "PacketCounter,SampleTimeFine,Quat_q0,Quat_q1,Quat_q2,Quat_q3",
        range(COUNT),
        range(0, 200 * COUNT, 200),
        WXYZ,
    ),
    "report of STK": table(
        "k.csv",
        '"Time (UTCG)","wx (deg/sec)","wy (deg/sec)","wz (deg/sec)"',
        [f"1 Jul 2020 00:00:0{t:.3f}" for t in TIME],
        *DEGREES.astype(str).T,
    ),
    "PASCO": table("p.csv", ",".join(PASCO), TIME, RATES),
    "Inertial Sense": table("i.csv", "time,I[0].pqr[0],I[0].pqr[1],I[0].pqr[2],I[0].acc[0]", TIME, RATES, 0),
    "Modelica": table("m.csv", '"time","body.w_a[1]","body.w_a[2]","body.w_a[3]"', TIME, RATES),
    "RocketPy": table("r.csv", "# Time (s),ω1 (rad/s),ω2 (rad/s),ω3 (rad/s)", TIME, RATES),
    "KITTI's poses and times": kitti,
    "one segment of Xsens MVN": mvnx,
    "attitudes of CCSDS in XML": aem_xml,
    "text of rostopic echo": echoed,
    "state of MuJoCo": mujoco,
    "structure with time of Simulink": simulink_structure,
    "unit in an attribute of HDF5": apdm,
    "Gyroflow": table("v.gcsv", GYROFLOW, 1000 * TIME, RATES / COUNTS, 0, 0, 0),
    "Blackbox Explorer": table("b.csv", BLACKBOX, range(COUNT), STAMPS_US, 0, DEGREES, 48),
    "Simulation Data Inspector": table("s.csv", SIMULINK, TIME, DEGREES),
    "HIGHRES_IMU of MAVLink": table(
        "h.csv", "time_usec,xgyro,ygyro,zgyro,abs_pressure", STAMPS_US, RATES, 1013
    ),
    "SCALED_IMU of MAVLink": table("i.csv", "time_boot_ms,xgyro,ygyro,zgyro", MILLISECONDS, 1e3 * RATES),
    "Trick": table(
        "t.csv",
        "sys.exec.out.time {s},dyn.w.omega[0] {rad/s},dyn.w.omega[1] {rad/s},dyn.w.omega[2] {rad/s}",
        TIME,
        RATES,
    ),
    "pose of a Crazyflie": table(
        "c.csv",
        "Timestamp," + ",".join(f"stateEstimate.{n}" for n in ("x", "y", "z", "qx", "qy", "qz", "qw")),
        MILLISECONDS,
        POSES,
    ),
    "gyro of a Crazyflie": table(
        "g.csv", "Timestamp,gyro.x,gyro.y,gyro.z,stabilizer.roll", MILLISECONDS, DEGREES, 1
    ),
    "odometry of PX4": table("o.csv", ODOMETRY, STAMPS_US, STAMPS_US, PLACE, WXYZ, WRONG_RATES),
    "state of Drake": table(
        "d.csv",
        "time,box_qw,box_qx,box_qy,box_qz,box_x,box_y,box_z,box_wx,box_wy,box_wz",
        TIME,
        WXYZ,
        PLACE,
        WRONG_RATES,
    ),
    "PyBullet": table("p.csv", PYBULLET, range(COUNT), TIME, 1, POSES, WRONG_RATES),
    "Unity": table("u.csv", "Time,PosX,PosY,PosZ,RotX,RotY,RotZ,RotW", TIME, POSES),
    "durations of MATLAB": table("w.csv", "Time,wx,wy,wz", SECONDS, *(RATES.astype(str).T)),
    "Vernier": table(
        "v.csv",
        "Data Set 1:Time(s)," + ",".join(f"Data Set 1:{a}-axis gyro 1(rad/s)" for a in "XYZ"),
        TIME,
        RATES,
    ),
    "a clock of nanoseconds that might be a date": table(
        "e.csv",
        "time,field.pose.position.x,field.pose.position.y,field.pose.position.z,"
        + ",".join(f"field.pose.orientation.{a}" for a in "xyzw"),
        1_000_000_000 + (2e7 * np.arange(COUNT)).astype(int),
        POSES,
    ),
}


def printed(name: str, form: str, before: str = "") -> Callable[[Path], Path]:
    """Maker of a text of lines of this form: of a time t, rates w, degrees a second d, a quaternion q and a date."""

    def make(folder: Path) -> Path:
        dates = [f"2024-03-15 10:00:0{t:.3f}" for t in TIME]
        each = zip(TIME, RATES, DEGREES, TURN, dates, strict=True)
        lines = [form.format(t=t, w=w, d=d, q=q, date=date) for t, w, d, q, date in each]
        return text(folder / name, before, [[line] for line in lines])

    return make


def workbook(folder: Path) -> Path:
    """A workbook whose second sheet has the rates, the header as shared texts."""
    head = "".join(f'<c r="{column}1" t="s"><v>{k}</v></c>' for k, column in enumerate("ABCD"))
    rows = "".join(
        f"<row>{''.join(f'<c><v>{cell!r}</v></c>' for cell in (float(t), *map(float, w)))}</row>"
        for t, w in zip(TIME, RATES, strict=True)
    )
    texts = "".join(f"<si><t>{name}</t></si>" for name in ("Time (s)", "wx", "wy", "wz"))
    with zipfile.ZipFile(folder / "phyphox.xlsx", "w") as archive:
        archive.writestr("xl/sharedStrings.xml", f"<sst>{texts}</sst>")
        archive.writestr(
            "xl/worksheets/sheet1.xml", '<worksheet><row><c r="A1"><v>1</v></c></row></worksheet>'
        )
        archive.writestr(
            "xl/worksheets/sheet2.xml", f'<worksheet xmlns="a"><row>{head}</row>{rows}</worksheet>'
        )
    return folder / "phyphox.xlsx"


def records(folder: Path) -> Path:
    h5py = pytest.importorskip("h5py")
    held = np.zeros(COUNT, dtype=[("t", "f8"), ("timestamp", "f8"), ("wx", "f8"), ("wy", "f8"), ("wz", "f8")])
    held["t"], held["timestamp"], (held["wx"], held["wy"], held["wz"]) = TIME, 5e6 + 1e6 * TIME, RATES.T
    with h5py.File(folder / "flight.h5", "w") as file:
        file["imu/data"] = held
    return folder / "flight.h5"


MAVSDK = ",".join(f"angular_velocity_frd.{axis}_rad_s" for axis in ("forward", "right", "down"))
ARIA = ",".join(f"{name}_world_device" for name in ("tx", "ty", "tz", "qx", "qy", "qz", "qw"))
STK_REPORT = "Sat: Axes\n\n  Time (UTCG)    wx (deg/sec)    wy (deg/sec)    wz (deg/sec)\n------    -----    -----    -----"
ACM = (
    "CCSDS_ACM_VERS = 2.0\nMETA_START\nEPOCH_TZERO = 2024-03-15T10:00:00\nMETA_STOP\nATT_START\nREF_FRAME_A = EME2000\n"
    "REF_FRAME_B = SC_BODY_1\nATT_TYPE = QUATERNION"
)
AS_IT_IS |= {
    "axes by words, of MAVSDK": table(
        "i.csv", f"timestamp_us,acceleration_frd.forward_m_s2,{MAVSDK}", STAMPS_US, 0, RATES
    ),
    "frames behind the components, of Aria": table(
        "a.csv", f"tracking_timestamp_us,{ARIA},quality", STAMPS_US, POSES, 1
    ),
    "variables of Modelica": table(
        "m.csv", ",".join(("time", *(f"body.frame_a.R.w[{k}]" for k in (1, 2, 3)))), TIME, RATES
    ),
    "paths of FlightGear": table(
        "f.csv", ",".join(("Time", *(f"/fdm/velocities/{a}-rad_sec" for a in "pqr"))), TIME, RATES
    ),
    "parameters of Yamcs": table(
        "y.csv",
        "Generation Time\t/SIM/Gyro.x\t/SIM/Gyro.y\t/SIM/Gyro.z",
        [f"2024-03-15T10:00:0{t:.3f}Z" for t in TIME],
        *DEGREES.astype(str).T,
        between="\t",
    ),
    "report of STK with blanks between": table(
        "r.txt",
        STK_REPORT,
        [f"1 Jul 2020 00:00:0{t:.3f}" for t in TIME],
        *DEGREES.astype(str).T,
        between="    ",
    ),
    "pose of Blender": table(
        "b.csv", "time_sec,loc_x,loc_y,loc_z,rot_quat_w,rot_quat_x,rot_quat_y,rot_quat_z", TIME, PLACE, WXYZ
    ),
    "a title with the unit": table(
        "s.txt", "Gyroscope in degrees/second\nsample rate = 50.00 Hz\nX\tY\tZ", DEGREES, between="\t"
    ),
    "name of the file of MATLAB Mobile": table(
        "AngularVelocity.csv",
        "Timestamp,X,Y,Z",
        [f"15-Mar-2024 10:00:0{t:.3f}" for t in TIME],
        *RATES.astype(str).T,
    ),
    "words below the rows": table("e.csv", "time_s,wx,wy,wz", TIME, RATES, end="Total samples: 40\nEnd\n"),
    "a last line that is cut": table("e.csv", "time_s,wx,wy,wz", TIME, RATES, end="0.82,0.3"),
    "lists of MAVSDK": printed(
        "t.txt", "{t:.2f} AngularVelocityBody: [roll_rad_s: {w[0]}, pitch_rad_s: {w[1]}, yaw_rad_s: {w[2]}]"
    ),
    "lines of printf": printed("t.txt", "t={t:.2f} omega=[{w[0]} {w[1]} {w[2]}] n=(1, 2)"),
    "messages in JSON": printed("t.log", '{date} imu/raw {{"gx": {d[0]}, "gy": {d[1]}, "gz": {d[2]}}}'),
    "radians/s behind the numbers": printed(
        "t.log", "{date} -> Gyro X: {w[0]} \tY: {w[1]} \tZ: {w[2]} radians/s"
    ),
    "a time in the line above": printed(
        "t.log", "Timestamp: {t} s\nRotation X: {w[0]}, Y: {w[1]}, Z: {w[2]} rad/s\n"
    ),
    "transformations of 4 x 4 by name": table(
        "h.csv",
        "timestamp_s," + ",".join(f"T_{row}{column}" for row in range(4) for column in range(4)),
        TIME,
        np.concatenate(
            [np.dstack([matrix_from_quaternion(TURN), PLACE]).reshape(COUNT, 12), COUNT * [[0, 0, 0, 1]]],
            axis=1,
        ),
    ),
    "quoted numbers with a line of units": table(
        "q.csv",
        '"Sample";"Timestamp";"Angular velocity X";"Angular velocity Y";"Angular velocity Z"\n"#";"ms";"rad/s";"rad/s";"rad/s"',
        range(COUNT),
        MILLISECONDS,
        *([f'"{cell}"'.replace(".", ",") for cell in column] for column in RATES.T),
        between=";",
    ),
    "a rate elsewhere in a document": lambda folder: text(
        folder / "r.json",
        "",
        [
            [
                json.dumps(
                    {
                        "meta": {"fs": 50},
                        "data": {"gyro": dict(zip(("x", "y", "z"), DEGREES.T.tolist(), strict=True))},
                    }
                )
            ]
        ],
    ),
    "workbook": workbook,
    "records of HDF5": records,
    "attitudes of an ACM": lambda folder: text(
        folder / "s.acm", ACM + "\n", [*np.column_stack([TIME, TURN]).tolist(), ["ATT_STOP"]], " "
    ),
}


def tlog(folder: Path, *messages: str) -> Path:
    """The text of Mission Planner, a line for each of the messages at each time."""
    lines = [
        f"2024-03-15T10:00:0{t:.3f},FD,1C,0,{k:X},1,1E,{name},time_boot_ms,{20 * k},"
        f"rollspeed,{w[0]},pitchspeed,{w[1]},yawspeed,{w[2]},"
        for k, (t, w) in enumerate(zip(TIME, RATES.tolist(), strict=True))
        for name in messages or ("mavlink_attitude_t",)
    ]
    return text(folder / "flight.csv", "", [[line] for line in lines])


def french(folder: Path, damaged: bool = False) -> Path:
    """A table of Excel in the encoding of Windows."""
    head = "Temps (s);Vitesse angulaire X (°/s);Vitesse angulaire Y (°/s);Vitesse angulaire Z (°/s);Accélération X (m/s²)"
    path = table("essai.csv", head, TIME, DEGREES, 9.8, between=";")(folder)
    whole = path.read_text().replace(".", ",").encode("cp1252")
    path.write_bytes(whole[:-400] + b"\xb5" + whole[-400:] if damaged else whole)
    return path


def array_of_structures(folder: Path) -> Path:
    from scipy.io import savemat

    held = np.zeros((1, COUNT), dtype=[("t", object), ("omega", object)])
    for k in range(COUNT):
        held[0, k] = (TIME[k], RATES[k][:, None])
    savemat(folder / "log.mat", {"log": held})
    return folder / "log.mat"


def structures_in_parquet(folder: Path) -> Path:
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    rows = [{"gyro_rad_s": dict(zip("xyz", rate, strict=True)), "state": "ok"} for rate in RATES.tolist()]
    times = pyarrow.array(
        [1_700_000_000_000_000_000 + 1000 * stamp for stamp in STAMPS_US], pyarrow.timestamp("ns")
    )
    parquet.write_table(pyarrow.table({"stamp": times, "imu": rows}), folder / "imu.parquet")
    return folder / "imu.parquet"


def long_form(folder: Path, name: str, form: str, head: str) -> Path:
    lines = [
        form.format(t=t, name=name, axis=axis, value=value, date=f"2024-03-15T10:00:0{t:.3f}Z")
        for t, rate in zip(TIME, RATES.tolist(), strict=True)
        for axis, value in zip("xyz", rate, strict=True)
    ]
    return text(folder / "long.csv", head + "\n", [[line] for line in lines])


AS_IT_IS |= {
    "pairs of Mission Planner": tlog,
    "letters of Windows in a header": french,
    "array of structures of MATLAB": array_of_structures,
    "structures within Parquet": structures_in_parquet,
    "long form": lambda folder: long_form(
        folder, "gyro", "{t},{name},{axis},{value},rad/s", "time_s,sensor,axis,value,unit"
    ),
    "long form of InfluxDB": lambda folder: long_form(
        folder,
        "omega",
        ",,0,{date},{value},{name}_{axis}",
        "#default,_result,,,,\n,result,table,_time,_value,_field",
    ),
    "dates of Excel beside decimal commas": table(
        "d.csv",
        "Datum;Drehrate X [°/s];Drehrate Y [°/s];Drehrate Z [°/s]",
        [f"15.03.2024 10:00:0{t:.3f}".replace("0.", "0,") for t in TIME],
        *([str(cell).replace(".", ",") for cell in column] for column in DEGREES.T),
        between=";",
    ),
    "rows of YAML": lambda folder: text(
        folder / "r.yaml",
        "",
        [
            [f"- omega:\n  - {w[0]}\n  - {w[1]}\n  - {w[2]}\n  t: {t}"]
            for t, w in zip(TIME, RATES.tolist(), strict=True)
        ],
    ),
    "two filters of ArduPilot": lambda folder: text(
        folder / "x.csv",
        "timestamp,TimeUS,C,Q1,Q2,Q3,Q4\n",
        [
            (f"{1_700_000_000 + t:.2f}", round(1e6 * t) + 7 * core, core, *WXYZ[k - core])
            for k, t in enumerate(TIME)
            for core in (0, 1)
        ],
    ),
    "ticks of ESP-IDF": lambda folder: text(
        folder / "e.log",
        "I (312) boot: v5.1\n",
        [
            [f"I ({ms}) imu: gyro x={d[0]} y={d[1]} z={d[2]}"]
            for ms, d in zip(MILLISECONDS, DEGREES, strict=True)
        ],
    ),
    "nanoseconds since 1970 by another name": table(
        "p.csv",
        "# frame_id, translation_x, translation_y, translation_z, quaternion_x, quaternion_y, quaternion_z, quaternion_w, scale",
        [1_700_000_000_000_000_000 + 20_000_000 * k for k in range(COUNT)],
        POSES,
        1,
    ),
}


@pytest.mark.parametrize("case", AS_IT_IS)
def test_a_log_is_read_as_it_is(case: str, tmp_path: Path) -> None:
    require_motion(spinfilters.load(AS_IT_IS[case](tmp_path)))


def test_one_of_two_messages_of_body_rates_is_asked_for(tmp_path: Path) -> None:
    path = tlog(tmp_path, "first_t", "second_t")
    with pytest.raises(InputError, match="first_t, second_t each have body rates; give --topic"):
        spinfilters.load(path)
    require_motion(spinfilters.load(path, topic="second_t"))


RATE_OF_TURN = 0.8  # rad/s about z
NUMBERED = "Sat.ElapsedTime.ToSeconds(),Sat.Q[0],Sat.Q[1],Sat.Q[2],Sat.Q[3],"


@pytest.mark.parametrize(
    ("head", "unit"),
    [
        (NUMBERED + "Sat.BodyRates[0],Sat.BodyRates[1],Sat.BodyRates[2]", 1.0),
        (NUMBERED + "Sat.BodyRates[0],Sat.BodyRates[1],Sat.BodyRates[2]", np.degrees(1.0)),
        (NUMBERED + "a,b,c", np.degrees(1.0)),
        ("", 1.0),
    ],
)
@pytest.mark.parametrize("order", [[0, 1, 2, 3], [3, 0, 1, 2]])
def test_rates_beside_a_quaternion_prove_what_both_are(
    head: str, unit: float, order: list[int], tmp_path: Path
) -> None:
    rates = unit * np.array([0.0, 0.0, RATE_OF_TURN])
    rows = [[t, *q[order], *rates] for t, q in zip(TIME, TURN, strict=True)]
    path = text(tmp_path / "log.csv", f"{head}\n" if head else "", rows)
    stream = spinfilters.load(path).log.streams[0]
    assert stream.sensor == "gyro"
    np.testing.assert_allclose(stream.values, COUNT * [[0.0, 0.0, RATE_OF_TURN]], rtol=1e-6)


def folder_of_matrices(folder: Path) -> Path:
    matrices = np.tile(np.eye(4), (COUNT, 1, 1))
    matrices[:, :3, :3] = matrix_from_quaternion(TURN)
    matrices[:, :3, 3] = PLACE
    for k, matrix in enumerate(matrices):
        text(folder / "seq" / f"frame-{k:06d}.pose.txt", "", matrix.tolist(), "\t")
    return folder / "seq"


WITH_A_HINT: dict[str, tuple[Callable[[Path], Path], dict[str, Any], str]] = {
    "two bodies of Motive": (
        table("take.csv", MOTIVE, range(COUNT), TIME, 0, 0, 0, 1, 0, 0, 0, TURN, PLACE),
        {"topic": "Cube"},
        "'Table', 'Cube'",
    ),
    "Sensor Kinetics": (
        table("gyroscope.csv", "time,X_value,Y_value,Z_value", TIME, RATES),
        {"unit": "rad/s"},
        "--unit",
    ),
    "names of several levels": (
        table("l.csv", """"('time', 's')","('gyro', 'x')","('gyro', 'y')","('gyro', 'z')\"""", TIME, RATES),
        {"unit": "rad/s"},
        "--unit",
    ),
    "dates without a header": (
        lambda folder: text(
            folder / "ck.txt",
            "",
            [(f"2004-05-06T10:00:0{t:.3f}", *q) for t, q in zip(TIME, WXYZ, strict=True)],
            " ",
        ),
        {"columns": "t,qw,qx,qy,qz"},
        "--columns t,qx,qy,qz,qw or t,qw,qx,qy,qz",
    ),
    "eight numbers that are no pose": (
        lambda folder: text(folder / "t.dat", "", np.column_stack([TIME, WXYZ, RATES]).tolist(), "\t"),
        {"columns": "t,qw,qx,qy,qz,-,-,-"},
        "not 1 as a unit quaternion",
    ),
    "two segments": (
        lambda folder: mvnx(folder, ("Pelvis", "Prop1")),
        {"topic": "Prop1"},
        "segments 'Pelvis', 'Prop1'",
    ),
    "states of Gazebo": (
        table("m.csv", STATES, STAMPS_NS, "ground", "box", *STILL, POSES, WRONG_RATES),
        {"topic": "pose1"},
        "'field.pose0', 'field.pose1'",
    ),
    "Blender": (
        table("b.csv", "frame,loc_x,loc_y,loc_z,rot_w,rot_x,rot_y,rot_z", range(COUNT), PLACE, WXYZ),
        {"rate": 50.0},
        "--rate",
    ),
    "RAW_IMU of MAVLink": (
        table("r.csv", "time_usec,xgyro,ygyro,zgyro", STAMPS_US, RATES),
        {"unit": "rad/s"},
        "--unit",
    ),
    "counts of Betaflight": (
        table("l.csv", BLACKBOX.replace("e-8", "e-9"), range(COUNT), STAMPS_US, 0, DEGREES, 48),
        {"unit": "deg/s"},
        "--unit",
    ),
    "the unit of a clock beside numbered columns": (
        table("q.csv", "time_ms,Q1,Q2,Q3,Q4", MILLISECONDS, WXYZ),
        {"columns": "t_ms,qw,qx,qy,qz"},
        "--columns t_ms,qx,qy,qz,qw or t_ms,qw,qx,qy,qz",
    ),
    "a grade of a gyro, which is no clock": (
        printed("b.txt", "qW: {q[3]} qX: {q[0]} qY: {q[1]} qZ: {q[2]}\t\tSys:3 Gyro:3 Accel:3"),
        {"rate": 50.0},
        "no column is a clock",
    ),
    "a folder with a matrix in each file": (folder_of_matrices, {"rate": 50.0}, "--rate"),
    "slow rates without a unit": (
        printed("t.log", "{date} INFO gyro=({w[0]}, {w[1]}, {w[2]})"),
        {"unit": "rad/s"},
        "--unit",
    ),
    "SparkFun": (
        lambda folder: text(
            folder / "p.log",
            "",
            [
                [f"Scaled. Acc (mg) [ 1, 2, 1000 ], Gyr (DPS) [ {', '.join(map(str, r))} ], Tmp (C) [ 25 ]"]
                for r in DEGREES
            ],
        ),
        {"rate": 50.0},
        "--rate",
    ),
}


@pytest.mark.parametrize("case", WITH_A_HINT)
def test_what_a_log_leaves_open_is_asked_for(case: str, tmp_path: Path) -> None:
    make, hint, asked = WITH_A_HINT[case]
    with pytest.raises(InputError, match=asked):
        spinfilters.load(make(tmp_path))
    require_motion(spinfilters.load(make(tmp_path), **hint))


def opaque(folder: Path) -> Path:
    """A variable of the class of objects, as MATLAB keeps timetables."""
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    body = np.array([6, 8, 17, 0], "<u4").tobytes() + b"\x01\x00\x02\x00tt\x00\x00"
    (folder / "tt.mat").write_bytes(head + np.array([14, len(body)], "<u4").tobytes() + body)
    return folder / "tt.mat"


def entities(folder: Path) -> Path:
    (folder / "e.mvnx").write_text('<!DOCTYPE a [<!ENTITY b "c">]><mvnx>&b;</mvnx>')
    return folder / "e.mvnx"


def other_times(folder: Path) -> Path:
    path = kitti(folder)
    (folder / "sequences" / "00" / "times.txt").write_text("0\n1\n")
    return path


REFUSED: dict[str, tuple[Callable[[Path], Path], str]] = {
    "words between the rows": (
        table("w.csv", "t_s,wx,wy,wz", TIME, RATES, end="Pause\n0.82,1,1,1\n"),
        "line 42: 'Pause' has 1 cells",
    ),
    "a damaged line without a clock": (
        lambda folder: text(
            folder / "d.log",
            "",
            [["gx: 1 gy: 2 gz: 3" if k != 7 else "gx: 1 gy: 2g: 3"] for k in range(COUNT)],
        ),
        "line 8: has other labels",
    ),
    "two rates of one body": (
        table(
            "w.csv",
            "t_s," + ",".join(f"imu{k}/rate/{a}-rad_s" for k in "01" for a in "xyz"),
            TIME,
            RATES,
            RATES,
        ),
        "may both be the body rate about x",
    ),
    "a byte of Windows in a number": (lambda folder: french(folder, damaged=True), "not a number; correct"),
    "rows of YAML that name another value": (
        lambda folder: text(folder / "a.yaml", "- &a {t: 0, omega: [1, 2, 3]}\n", [["- *a"]]),
        "refers to another value",
    ),
    "two columns of instants": (
        table(
            "i.csv",
            "id,x,y,z,qx,qy,qz,qw,capture",
            range(1_400_000_000_000, 1_400_000_000_000 + COUNT),
            POSES,
            range(1_400_000_000_000_000, 1_400_000_000_000_000 + 20_000 * COUNT, 20_000),
        ),
        "no column is a clock",
    ),
    "a component that is twice at one time": (
        lambda folder: long_form(folder, "gyro", "{t},{name},{value}", "time_s,sensor,value"),
        "line 3: 'gyro' is twice",
    ),
    "long form without a number": (
        lambda folder: text(
            folder / "l.csv",
            "time_s,name,value\n",
            [(t, f"gyro_{a}", 1.0) for t in TIME for a in "xyz" if a == "x" or t != TIME[3]],
        ),
        "has other times",
    ),
    "a timetable": (opaque, "writetimetable"),
    "XML with entities": (entities, "document type"),
    "times of another sequence": (other_times, "2 times for 40 poses"),
    "left-handed axes": (
        table("v.gcsv", GYROFLOW.replace("YxZ", "YXZ"), MILLISECONDS, RATES, 0, 0, 0),
        "right-handed",
    ),
    "a factor that is none": (
        table("v.gcsv", GYROFLOW.replace("gscale,0.0001", "gscale,none"), MILLISECONDS, RATES, 0, 0, 0),
        "gscale is 'none'",
    ),
    "rates in axes of the inertial frame": (
        table("n.csv", "t_s,omega_BN_N_x,omega_BN_N_y,omega_BN_N_z", TIME, RATES),
        "no body rate",
    ),
    "a body that is not there": (table("d.csv", "time,box_qw,box_qx,box_qy,box_qz", TIME, WXYZ), "'box'"),
    "a message without a stamp": (
        table("e.txt", "header: \n  seq: 1\n---", range(COUNT)),
        "no column is a clock",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_would_be_read_wrongly_is_refused(case: str, tmp_path: Path) -> None:
    make, cure = REFUSED[case]
    topic = "arm" if case == "a body that is not there" else None
    with pytest.raises(InputError, match=cure) as refusal:
        spinfilters.load(make(tmp_path), topic=topic)
    assert len(str(refusal.value).splitlines()) == 1
