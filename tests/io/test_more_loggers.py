"""More recordings of other people's loggers and simulators: clocks, rows of several sensors, ephemerides."""

import json
import re
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
    DEGREES,
    PLACE,
    RATES,
    STAMPS_NS,
    STAMPS_US,
    START_NS,
    TIME,
    TURN,
    require_motion,
    text,
)

COUNT = len(TIME)
MATRIX = matrix_from_quaternion(TURN)
WXYZ = TURN[:, [3, 0, 1, 2]]
FORCE = (0.1, 0.2, 9.8)
STAMPS_MS = [1_600_000_000_000 + 20 * k for k in range(COUNT)]


def lines(path: Path, head: str, rows: Sequence[Sequence[Any]], between: str = ",") -> Path:
    return text(path, head, rows, between)


def realsense(folder: Path) -> Path:
    columns = "\n\nStream Type,Index,F#,HW Timestamp (ms),Host Timestamp(ms)"
    whole = (
        "Configuration:\nStream Type,Stream Name,Format,FPS,Width,Height\nGyro,Gyro,MOTION_XYZ32F,200,0,0\n"
    )
    whole += columns + "\nColor,0,1,1600000000000.1,3.1\n"
    for name, values in (("Accel", np.tile(FORCE, (COUNT, 1))), ("Gyro", RATES)):
        whole += columns + ",3DOF_x,3DOF_y,3DOF_z\n"
        for k, stamp in enumerate(STAMPS_MS):
            whole += f"{name},0,{k},{stamp}.0,{20 * k + 3.1},{','.join(map(str, values[k]))}\n"
    return lines(folder / "collected.csv", whole, [])


def realsense_poses(folder: Path) -> Path:
    head = "Stream Type,Index,F#,HW Timestamp (ms),Host Timestamp(ms),t_x,t_y,t_z,r_x,r_y,r_z,r_w\n"
    rows = [("Pose", 0, k, s, 20 * k, *PLACE[k], *TURN[k]) for k, s in enumerate(STAMPS_MS)]
    return lines(folder / "t265.csv", head, rows)


def gnss_logger(folder: Path) -> Path:
    head = "# \n# Version: v3.0.5.6 Platform: 12\n# \n"
    for name, unit in (("Accel", "Mps2"), ("Gyro", "RadPerSec")):
        columns = ",".join(f"Uncal{name}{axis}{unit}" for axis in "XYZ")
        head += f"# Uncal{name},utcTimeMillis,elapsedRealtimeNanos,{columns}\n"
    rows: list[tuple[Any, ...]] = []
    for k, stamp in enumerate(STAMPS_MS):
        rows += [("UncalAccel", stamp, 10**14 + 20_000_000 * k, *FORCE)]
        rows += [("UncalGyro", stamp, 10**14 + 20_000_000 * k, *RATES[k])]
    return lines(folder / "gnss_log.txt", head, rows)


XSENS = "PacketCounter\tSampleTimeFine\tYear\tMonth\tDay\tSecond\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z\tQuat_q0\tQuat_q1\n"


def xsens(folder: Path) -> Path:
    head = "// General information: \n//  ProductCode: MTI-300\n" + XSENS
    rows = [
        (k, (2**32 - 4000 + 200 * k) % 2**32, *["NaN"] * 4, *FORCE, *RATES[k], *WXYZ[k, :2])
        for k in range(COUNT)
    ]
    return lines(folder / "MT_0370.txt", head, rows, "\t")


def xsens_without_clock(folder: Path) -> Path:
    """With a counter of 16 bits that begins again."""
    head = "// Start Time: Unknown\n// Update Rate: 50.0Hz\n" + XSENS
    rows = [((65520 + k) % 2**16, *[""] * 5, *FORCE, *RATES[k], *WXYZ[k, :2]) for k in range(COUNT)]
    return lines(folder / "MT_0120.txt", head, rows, "\t")


def xsens_dot(folder: Path) -> Path:
    head = "sep=,\nDeviceTag:,Xsens DOT 1\nOutputRate:,50Hz\nStartTime:,2021-05-01\n\n"
    head += "PacketCounter,SampleTimeFine,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z\n"
    rows = [(k, (2**32 - 100_000 + 20_000 * k) % 2**32, *FORCE, *DEGREES[k]) for k in range(COUNT)]
    return lines(folder / "dot.csv", head, rows)


def vectornav(folder: Path) -> Path:
    head = "TimeStartup,Yaw,Pitch,Roll,AccelX,AccelY,AccelZ,AngularRateX,AngularRateY,AngularRateZ\n"
    rows = [(123_456_789_000 + 20_000_000 * k, 1, 2, 3, *FORCE, *RATES[k]) for k in range(COUNT)]
    return lines(folder / "vn.csv", head, rows)


def sensor_connect(folder: Path) -> Path:
    names = [f"inertial-6253.101234:scaled{kind}{axis}" for kind in ("Gyro", "Accel") for axis in "XYZ"]
    rows = [(f"11/26/2026 12:00:{t:09.6f}", *RATES[k], 0, 0, -1) for k, t in enumerate(TIME)]
    return lines(folder / "SensorConnect.csv", "DATA_START\nTime," + ",".join(names) + "\n", rows)


def serial_monitor(folder: Path) -> Path:
    rows = [
        [f"12:34:{5 + t:06.3f} -> Rotation X: {x}, Y: {y}, Z: {z} rad/s"]
        for t, (x, y, z) in zip(TIME, RATES, strict=True)
    ]
    return lines(folder / "serial.log", "Adafruit MPU6050 test!\n", rows)


def phyphox_zip(folder: Path) -> Path:
    path = folder / "Rotation.zip"
    with zipfile.ZipFile(path, "w") as archive:
        rows = "".join(f"{t:.9E},{x},{y},{z}\n" for t, (x, y, z) in zip(TIME, RATES, strict=True))
        archive.writestr("Gyroscope.csv", '"Time (s)","X (rad/s)","Y (rad/s)","Z (rad/s)"\n' + rows)
        archive.writestr("meta/device.csv", '"property","value"\n"version","1.1.9"\n')
    return path


def physics_toolbox(folder: Path) -> Path:
    head = "time,gFx,gFy,gFz,ax,ay,az,wx,wy,wz,p,Bx,By,Bz,Azimuth,Pitch,Roll,\n"
    rows = [(f"{t:.3f}", *FORCE, *FORCE, *RATES[k], 1013, 1, 2, 3, 4, 5, 6, "") for k, t in enumerate(TIME)]
    return lines(folder / "toolbox.csv", head, rows)


def core_motion(folder: Path) -> Path:
    names = ["loggingTime(txt)", "locationTimestamp_since1970(s)", "accelerometerTimestamp_sinceReboot(s)"]
    names += [f"accelerometerAcceleration{axis}(G)" for axis in "XYZ"] + ["gyroTimestamp_sinceReboot(s)"]
    names += [f"gyroRotation{axis}(rad/s)" for axis in "XYZ"] + ["motionTimestamp_sinceReboot(s)"]
    names += [f"motionRotationRate{axis}(rad/s)" for axis in "XYZ"] + [
        f"motionQuaternion{axis}(R)" for axis in "XYZW"
    ]
    rows = [
        (
            f"2026-11-26T12:00:0{t:.3f}+01:00",
            "",
            t,
            0,
            0,
            -1,
            t,
            *(2 * RATES[k]),
            405.5 + t,
            *RATES[k],
            *TURN[k],
        )
        for k, t in enumerate(TIME)
    ]
    return lines(folder / "stream.csv", ",".join(names) + "\n", rows)


def android(folder: Path) -> Path:
    rows = [(stamp, 3, *RATES[k]) for k, stamp in enumerate(STAMPS_NS)]
    return lines(folder / "TYPE_GYROSCOPE.csv", "timestamp_ns,accuracy,x,y,z\n", rows)


def motive_with_markers(folder: Path) -> Path:
    head = "Format Version,1.24,Capture Frame Rate,50.0,Rotation Type,Quaternion,Length Units,Meters\n\n"
    head += ",Type," + ",".join(["Rigid Body"] * 8 + ["Rigid Body Marker"] * 4) + "\n"
    head += ",Name," + ",".join(["Cube"] * 8 + ["Cube:Marker1"] * 4) + "\n\n"
    head += ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Error,Position,Position,Position,Quality\n"
    head += "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,,X,Y,Z,\n"
    rows = [(k, t, *TURN[k], *PLACE[k], 0.001, *(PLACE[k] + 1), 1) for k, t in enumerate(TIME)]
    return lines(folder / "Take.csv", head, rows)


def qualisys(folder: Path) -> Path:
    head = "NO_OF_FRAMES\t40\nNO_OF_BODIES\t1\nFREQUENCY\t50\nANALOG_FREQUENCY\t0\nBODY_NAMES\tcube\n"
    head += "cube X\tY\tZ\tRoll\tPitch\tYaw\tResidual\t" + "\t".join(f"Rot[{k}]" for k in range(9)) + "\n"
    rows = [(*(1e3 * PLACE[k]), 1, 2, 3, 0.3, *MATRIX[k].T.reshape(-1)) for k in range(COUNT)]
    return lines(folder / "cube_6D.tsv", head, rows, "\t")


def rotation_matrices(folder: Path) -> Path:
    head = "time_s," + ",".join(f"R{row}{column}" for row in "123" for column in "123") + "\n"
    return lines(folder / "matrices.csv", head, np.column_stack([TIME, MATRIX.reshape(-1, 9)]).tolist())


def orb_slam(folder: Path) -> Path:
    rows = [(f"{stamp}.000000", *PLACE[k], *TURN[k]) for k, stamp in enumerate(STAMPS_NS)]
    return lines(folder / "f_dataset-MH01.txt", "", rows, " ")


def kitti_raw(folder: Path) -> Path:
    drive = folder / "2011_09_26_drive_0001_sync"
    for k, rate in enumerate(RATES):
        rows = [[*range(17), *rate, *(5 * rate), 0.1, 0.2, 4, 10, 4, 4, 0]]
        lines(drive / "oxts" / "data" / f"{k:010d}.txt", "", rows, " ")
    lines(
        drive / "oxts" / "timestamps.txt",
        "",
        [[f"2011-09-26 13:02:25.{20_000_000 * k:09d}"] for k in range(COUNT)],
    )
    lines(drive / "oxts" / "dataformat.txt", "lat: latitude of the oxts-unit (deg)\n", [])
    return drive


def uzh_fpv(folder: Path) -> Path:
    head = "# id timestamp ang_vel_x ang_vel_y ang_vel_z lin_acc_x lin_acc_y lin_acc_z\n"
    return lines(folder / "imu.txt", head, [(k, t, *RATES[k], *FORCE) for k, t in enumerate(TIME)], " ")


def topic_of_poses(folder: Path) -> Path:
    names = ["__time", "/vrpn/pose/header/stamp", *(f"/vrpn/pose/pose/orientation/{axis}" for axis in "wxyz")]
    names += [f"/vrpn/pose/pose/position/{axis}" for axis in "xyz"]
    rows = [(1403.5 + t, 1403.4 + t, *WXYZ[k], *PLACE[k]) for k, t in enumerate(TIME)]
    return lines(folder / "pj.csv", ",".join(names) + "\n", rows)


def airsim(folder: Path) -> Path:
    head = "VehicleName\tTimeStamp\tPOS_X\tPOS_Y\tPOS_Z\tQ_W\tQ_X\tQ_Y\tQ_Z\tImageFile\n"
    rows = [("", s, *PLACE[k], *WXYZ[k], f"img_{k}.png") for k, s in enumerate(STAMPS_MS)]
    return lines(folder / "airsim_rec.txt", head, rows, "\t")


def simulator_42(folder: Path) -> Path:
    lines(folder / "time.42", "", TIME[:, None].tolist())
    lines(folder / "wbn.42", "", RATES.tolist(), " ")
    lines(folder / "qbn.42", "", TURN.tolist(), " ")
    return folder


def gmat_attitudes(folder: Path) -> Path:
    head = (
        "Sat.UTCGregorian              Sat.Q1              Sat.Q2              Sat.Q3              Sat.Q4\n"
    )
    rows = [(f"26 Nov 2026 12:00:0{t:.3f}", *TURN[k]) for k, t in enumerate(TIME)]
    return lines(folder / "att.txt", head, rows, "     ")


def stk(folder: Path) -> Path:
    head = "stk.v.11.0\n\nBEGIN Attitude\nNumberOfAttitudePoints 40\nScenarioEpoch 26 Nov 2026 12:00:00.000\n"
    head += "CoordinateAxes ICRF\nAttitudeTimeQuaternions\n\n"
    path = lines(folder / "sat.a", head, np.column_stack([TIME, TURN]).tolist(), " ")
    path.write_text(path.read_text() + "END Attitude\n")
    return path


def ccsds(
    folder: Path, frames: tuple[str, str] = ("EME2000", "SC_BODY_1"), to: str = "A2B", turned: bool = False
) -> Path:
    head = "CCSDS_AEM_VERS = 1.0\nMETA_START\nOBJECT_NAME = SAT\n"
    head += f"REF_FRAME_A = {frames[0]}\nREF_FRAME_B = {frames[1]}\nATTITUDE_DIR = {to}\nATTITUDE_TYPE = QUATERNION\n"
    head += "QUATERNION_TYPE = FIRST\nMETA_STOP\nDATA_START\n"
    components = WXYZ * ([1, -1, -1, -1] if turned else 1)
    rows = [(f"2026-330T12:00:0{t:.4f}", *components[k]) for k, t in enumerate(TIME)]
    return lines(folder / "sat.aem", head, rows, " ")


def mavlogdump(folder: Path) -> Path:
    head = "timestamp,TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ\n"
    rows = [(f"{1.6e9 + TIME[k]:.6f}", s, 0, *RATES[k], *FORCE) for k, s in enumerate(STAMPS_US)]
    return lines(folder / "imu.csv", head, rows)


def witmotion(folder: Path) -> Path:
    head = "StartTime: 2026-11-26 12:00:00.123\nTime(s)\tChipTime\tax(g)\tay(g)\taz(g)\twx(deg/s)\twy(deg/s)\twz(deg/s)\tT(°)\tq0\n"
    rows = [
        (f"12:00:00:{20 * k:03d}", f"2026-11-26 12:00:00.{20 * k:03d}", 0, 0, 1, *DEGREES[k], 25, 1)
        for k in range(COUNT)
    ]
    return lines(folder / "wit.txt", head, rows, "\t")


def delsys(folder: Path) -> Path:
    head = ",".join(f"X[s],Avanti sensor 1: Gyro.{axis} 1 [deg/s]" for axis in "XYZ") + "\n"
    rows = [(t, x, t, y, t, z) for t, (x, y, z) in zip(TIME, DEGREES, strict=True)]
    return lines(folder / "run.csv", head, rows)


def x_plane(folder: Path) -> Path:
    head = "   _real,_time |   _totl,_time |       Q,rad/s |       P,rad/s |       R,rad/s |\n"
    rows = [(t, t + 5, RATES[k, 1], RATES[k, 0], RATES[k, 2], "") for k, t in enumerate(TIME)]
    return lines(folder / "Data.txt", head, rows, " | ")


def jsbsim(folder: Path) -> Path:
    head = "Time,Altitude ASL (ft),P (deg/s),Q (deg/s),R (deg/s),P Aero (deg/s)\n"
    return lines(folder / "out.csv", head, [(t, 1000, *DEGREES[k], 0) for k, t in enumerate(TIME)])


def midnight(folder: Path) -> Path:
    times = [f"{'23:59:59' if t < 0.3 else '00:00:00'}.{round(1e6 * (t + 0.7)) % 10**6:06d}" for t in TIME]
    return lines(folder / "night.csv", "time,wx,wy,wz\n", [(times[k], *RATES[k]) for k in range(COUNT)])


def micros_begin_again(folder: Path) -> Path:
    rows = [((2**32 - 100_000 + 20_000 * k) % 2**32, *RATES[k]) for k in range(COUNT)]
    return lines(folder / "micros.csv", "t_us,wx,wy,wz\n", rows)


def serial_without_unit(folder: Path) -> Path:
    rows = [[f"12:00:0{t:.3f} -> gx:{x} gy:{y} gz:{z}"] for t, (x, y, z) in zip(TIME, DEGREES, strict=True)]
    return lines(folder / "mine.txt", "", rows)


def dat_con(folder: Path) -> Path:
    head = "Clock:Tick#,Clock:offsetTime,IMU_ATTI(0):roll:C,IMU_ATTI(0):gyroX,IMU_ATTI(0):gyroY,IMU_ATTI(0):gyroZ,Attribute|Value\n"
    return lines(folder / "FLY125.csv", head, [(9 * k, t, 1, *DEGREES[k], "") for k, t in enumerate(TIME)])


AS_IT_IS: tuple[Callable[[Path], Path], ...] = (
    *(
        realsense,
        realsense_poses,
        gnss_logger,
        xsens,
        xsens_without_clock,
        xsens_dot,
        vectornav,
        sensor_connect,
    ),
    *(serial_monitor, phyphox_zip, physics_toolbox, core_motion, android, motive_with_markers, qualisys),
    *(rotation_matrices, orb_slam, kitti_raw, uzh_fpv, topic_of_poses, airsim, simulator_42, gmat_attitudes),
    *(stk, ccsds, mavlogdump, witmotion, delsys, x_plane, jsbsim, midnight, micros_begin_again),
    *(serial_without_unit, dat_con),  # no gyro measures as many rad/s
)


@pytest.mark.parametrize("make", AS_IT_IS, ids=lambda make: make.__name__)
def test_a_recording_of_another_logger_is_read_as_it_is(make: Callable[[Path], Path], tmp_path: Path) -> None:
    require_motion(spinfilters.load(make(tmp_path)))


def vins_mono(folder: Path) -> Path:
    return lines(folder / "vins.csv", "", [(s, *PLACE[k], *WXYZ[k], 1, "") for k, s in enumerate(STAMPS_NS)])


def nclt(folder: Path) -> Path:
    rows = [(START_NS // 1000 + 20_000 * k, 1, 2, 3, *RATES[k]) for k in range(COUNT)]
    return lines(folder / "ms25.csv", "", rows)


def ros2_echo(folder: Path) -> Path:
    rows = [(s // 10**9, s % 10**9, "imu_link", *TURN[k], *RATES[k]) for k, s in enumerate(STAMPS_NS)]
    return lines(folder / "echo.csv", "", rows)


def polaris(folder: Path) -> Path:
    head = "Tools,Port 1,Frame,Face,State,Q0,Qx,Qy,Qz,Tx,Ty,Tz,Error\n"
    rows = [(1, "P1", k, 1, "OK", *WXYZ[k], *(1e3 * PLACE[k]), 0.1) for k in range(COUNT)]
    return lines(folder / "ndi.csv", head, rows)


def simulink(folder: Path) -> Path:
    from scipy.io import savemat

    savemat(folder / "sim.mat", {"ans": np.vstack([TIME, RATES.T])})
    return folder / "sim.mat"


def nested_json(folder: Path) -> Path:
    rows = [
        {"timestamp": 5.5 + t, "rotationRate": dict(zip("xyz", RATES[k], strict=True))}
        for k, t in enumerate(TIME)
    ]
    (folder / "motion.json").write_text(json.dumps(rows))
    return folder / "motion.json"


WITH_A_HINT: tuple[tuple[Callable[[Path], Path], dict[str, Any], str], ...] = (
    (vins_mono, {"columns": "t,px,py,pz,qw,qx,qy,qz,-"}, "--columns"),
    (nclt, {"columns": "utime,-,-,-,wx,wy,wz"}, "--columns"),
    (
        ros2_echo,
        {"columns": "stamp.sec,stamp.nanosec,-,-,-,-,-,wx,wy,wz"},
        "--columns stamp.sec,stamp.nanosec,-,",
    ),
    (polaris, {"rate": 50.0}, "--rate"),
    (simulink, {"columns": "t,wx,wy,wz"}, "--columns"),
    (nested_json, {"unit": "rad/s"}, "--unit"),
)


@pytest.mark.parametrize(
    ("make", "hint", "asked"), WITH_A_HINT, ids=lambda each: getattr(each, "__name__", "")
)
def test_what_a_recording_does_not_say_is_asked_for(
    make: Callable[[Path], Path], hint: dict[str, Any], asked: str, tmp_path: Path
) -> None:
    path = make(tmp_path)
    with pytest.raises(InputError, match=re.escape(asked)):
        spinfilters.load(path)
    require_motion(spinfilters.load(path, **hint))


REFUSED = {
    "an ephemeris of positions": ("sat.oem", "CCSDS_OEM_VERS = 2.0\n", "holds no attitude"),
    "three angles": (
        "v.csv",
        "Frame,RX (deg),RY (deg),RZ (deg),TX (mm),TY (mm),TZ (mm)\n1,2,3,4,5,6,7\n",
        "no column is a clock",
    ),
    "angles beside positions": (
        "v.csv",
        "t_s,RX (deg),px,py,pz\n1,2,3,4,5\n2,2,3,4,5\n",
        "three angles do not show their order",
    ),
    "numbered quaternions": ("ck.csv", "t_s,q0,q1,q2,q3\n0,1,0,0,0\n1,1,0,0,0\n", "no body rate"),
    "a quaternion called w, x, y, z": ("gyro.csv", "t_s,w,x,y,z\n0,1,0,0,0\n1,2,0,0,0\n", "line 3: .* unit"),
    "rates that are wanted": (
        "pj.csv",
        "__time,/bias/angular_velocity/x,/bias/angular_velocity/y,/bias/angular_velocity/z\n0,1,1,1\n",
        "no body rate",
    ),
    "a matrix that is no rotation": (
        "m.csv",
        "t_s,"
        + ",".join(f"R{r}{c}" for r in "123" for c in "123")
        + "\n"
        + "0"
        + ",1" * 9
        + "\n1"
        + ",1" * 9
        + "\n",
        "line 2: its matrix is no rotation",
    ),
    "a date of two meanings": (
        "d.csv",
        "time,wx,wy,wz\n06/01/2026 12:00:00,1,2,3\n06/01/2026 12:00:01,1,2,3\n",
        "give seconds",
    ),
    "frames that do not show the body": (
        "s.aem",
        "CCSDS_AEM_VERS = 1\nREF_FRAME_A = X\nREF_FRAME_B = Y\nATTITUDE_TYPE = QUATERNION\nDATA_START\n2026-330T12:00:00 0 0 0 1\n",
        "SC_BODY_1",
    ),
    "other attitudes of STK": (
        "s.a",
        "BEGIN Attitude\nAttitudeTimeYPRAngles\n0 1 2 3\nEND Attitude\n",
        "AttitudeTimeQuaternions",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_may_be_read_in_two_ways_is_refused_with_the_cure(case: str, tmp_path: Path) -> None:
    name, content, cure = REFUSED[case]
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=cure) as refusal:
        spinfilters.load(tmp_path / name)
    assert name in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("frames", "to", "turned"),
    [
        (("SC_BODY_1", "EME2000"), "B2A", False),
        (("SC_BODY_1", "EME2000"), "A2B", True),
        (("EME2000", "SC_BODY_1"), "B2A", True),
    ],
)
def test_the_frames_of_an_ephemeris_decide_its_direction(
    frames: tuple[str, str], to: str, turned: bool, tmp_path: Path
) -> None:
    require_motion(spinfilters.load(ccsds(tmp_path, frames, to, turned)))


def test_lost_packets_leave_gaps_in_a_clock_of_counts(tmp_path: Path) -> None:
    path = xsens_without_clock(tmp_path)
    kept = path.read_text().splitlines(keepends=True)
    path.write_text("".join(kept[:10] + kept[15:]))
    stream = spinfilters.load(path).log.streams[0]
    assert float(np.diff(stream.time).max()) == pytest.approx(6 * 0.02)


def test_matrices_of_four_digits_are_rotations(tmp_path: Path) -> None:
    head = "time_s," + ",".join(f"R{row}{column}" for row in "123" for column in "123") + "\n"
    path = lines(tmp_path / "m.csv", head, np.column_stack([TIME, MATRIX.reshape(-1, 9).round(4)]).tolist())
    np.testing.assert_allclose(spinfilters.load(path).log.streams[0].values, TURN, atol=1e-4)


def test_a_topic_chooses_among_the_sensors_of_a_table(tmp_path: Path) -> None:
    path = realsense(tmp_path)
    path.write_text(path.read_text() + realsense_poses(tmp_path).read_text())
    require_motion(spinfilters.load(path))
    assert spinfilters.load(path, topic="Pose").kind == "pose"
    with pytest.raises(InputError, match="has no rows of 'Fisheye', only of Accel"):
        spinfilters.load(path, topic="Fisheye")


SPOILS: dict[str, Callable[[bytes], bytes]] = {
    "cut off": lambda data: data[: 2 * len(data) // 3],
    "binary in the middle": lambda data: data[: len(data) // 2] + bytes(range(256)) + data[len(data) // 2 :],
    "no number": lambda data: data[: len(data) // 2] + data[len(data) // 2 :].replace(b"1", b"nan", 1),
    "5000 digits": lambda data: data[: len(data) // 2] + data[len(data) // 2 :].replace(b"1", b"9" * 5000, 1),
    "backwards": lambda data: b"\n".join(
        data.split(b"\n")[: data.count(b"\n") // 2] + data.split(b"\n")[data.count(b"\n") // 2 :][::-1]
    ),
    "twice": lambda data: data + data,
    "empty": lambda _data: b"",
}
SPOILED = (
    realsense,
    gnss_logger,
    serial_monitor,
    simulator_42,
    stk,
    ccsds,
    xsens,
    xsens_without_clock,
    qualisys,
    x_plane,
)


@pytest.mark.parametrize("make", SPOILED, ids=lambda make: make.__name__)
def test_a_spoiled_recording_is_read_or_refused_in_one_line(
    make: Callable[[Path], Path], tmp_path: Path
) -> None:
    path = make(tmp_path)
    file = path / "wbn.42" if path.is_dir() else path
    whole = file.read_bytes()
    for spoil in SPOILS.values():
        file.write_bytes(spoil(whole))
        refusals = []
        try:
            stream = spinfilters.load(path).log.streams[0]
        except InputError as refusal:
            refusals.append(str(refusal))
        else:
            assert np.isfinite(stream.values).all()
            assert (np.diff(stream.time) > 0).all()
        assert all(len(each.splitlines()) == 1 and file.name in each for each in refusals)
