"""Recordings of other people's loggers, made by hand from the documentation of each format: read as they are, or with one hint."""

import json
import struct
import tracemalloc
import zlib
from collections.abc import Callable
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


def euroc_imu(folder: Path) -> Path:
    head = (
        "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
        "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n"
    )
    rows = [(stamp, *rate, 9.8, 0.1, 0.2) for stamp, rate in zip(STAMPS_NS, RATES, strict=True)]
    return text(folder / "mav0" / "imu0" / "data.csv", head, rows)


def euroc_root(folder: Path) -> Path:
    euroc_imu(folder)
    (folder / "mav0" / "imu0" / "sensor.yaml").write_text("sensor_type: imu\nrate_hz: 50\n")
    return folder


def euroc_mav0(folder: Path) -> Path:
    return euroc_root(folder) / "mav0"


def euroc_truth(folder: Path) -> Path:
    head = (
        "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], "
        "v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], "
        "b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]\n"
    )
    rows = [
        (stamp, *p, q[3], *q[:3], 0.1, 0.2, 0.0, *[0.001] * 6)
        for stamp, p, q in zip(STAMPS_NS, PLACE, TURN, strict=True)
    ]
    return text(folder / "state_groundtruth_estimate0" / "data.csv", head, rows)


def euroc_vicon(folder: Path) -> Path:
    head = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"
    rows = [(stamp, *p, q[3], *q[:3]) for stamp, p, q in zip(STAMPS_NS, PLACE, TURN, strict=True)]
    text(folder / "mav0" / "vicon0" / "data.csv", head, rows)
    return folder


def tum_folder(folder: Path) -> Path:
    head = "# ground truth trajectory\n# file: 'rgbd_dataset.bag'\n# timestamp tx ty tz qx qy qz qw\n"
    rows = [
        (f"{1305031098.6659 + t:.4f}", *p, *q.round(6)) for t, p, q in zip(TIME, PLACE, TURN, strict=True)
    ]
    text(folder / "groundtruth.txt", head, rows, " ")
    (folder / "rgb.txt").write_text("# color images\n")
    return folder


def px4_csv(folder: Path) -> Path:
    head = "timestamp,timestamp_sample,xyz[0],xyz[1],xyz[2],xyz_derivative[0],xyz_derivative[1],xyz_derivative[2]\n"
    rows = [(stamp + 300, stamp, *rate, 0, 0, 0) for stamp, rate in zip(STAMPS_US, RATES, strict=True)]
    return text(folder / "log_0_2024_vehicle_angular_velocity_0.csv", head, rows)


def px4_combined_csv(folder: Path) -> Path:
    head = (
        "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],gyro_integral_dt,accelerometer_timestamp_relative,"
        "accelerometer_m_s2[0],accelerometer_m_s2[1],accelerometer_m_s2[2],accelerometer_integral_dt\n"
    )
    rows = [
        (stamp, *rate, 4000, 0, 0.1, 0.2, -9.8, 4000) for stamp, rate in zip(STAMPS_US, RATES, strict=True)
    ]
    return text(folder / "log_0_sensor_combined_0.csv", head, rows)


def px4_gyro_csv(folder: Path) -> Path:
    head = "timestamp,timestamp_sample,device_id,temperature,error_count,x,y,z\n"
    rows = [(s + 90, s, 2490378, 41.2, 0, *rate) for s, rate in zip(STAMPS_US, RATES, strict=True)]
    return text(folder / "log_0_sensor_gyro_0.csv", head, rows)


def px4_attitude_csv(folder: Path) -> Path:
    head = "timestamp,timestamp_sample,q[0],q[1],q[2],q[3],delta_q_reset[0],delta_q_reset[1],"
    head += "delta_q_reset[2],delta_q_reset[3],quat_reset_counter\n"
    rows = [(s + 90, s, q[3], *q[:3], 1, 0, 0, 0, 0) for s, q in zip(STAMPS_US, TURN, strict=True)]
    return text(folder / "log_0_vehicle_attitude_0.csv", head, rows)


def ulog(folder: Path) -> Path:
    def message(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    path = folder / "flight.ulg"
    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1)
    data += message("B", bytes(40)) + message("I", b"\x0cchar[3] sysPX4")
    data += message("F", b"vehicle_status:uint64_t timestamp;uint8_t arming_state;uint8_t[7] _padding0;")
    data += message(
        "F",
        b"vehicle_angular_velocity:uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;uint8_t[4] _padding0;",
    )
    data += message("A", b"\x00" + struct.pack("<H", 3) + b"vehicle_status")
    data += message("A", b"\x00" + struct.pack("<H", 5) + b"vehicle_angular_velocity")
    for stamp, rate in zip(STAMPS_US, RATES, strict=True):
        data += message("D", struct.pack("<HQB", 3, stamp, 2))
        data += message("D", struct.pack("<HQQ3f", 5, stamp + 80, stamp, *rate))
    path.write_bytes(data)
    return path


def mavlink_attitude(folder: Path) -> Path:
    head = "timestamp_ms,roll,pitch,yaw,rollspeed,pitchspeed,yawspeed\n"
    rows = [(1000 + 20 * k, 0.1, 0.2, 0.3, *rate) for k, rate in enumerate(RATES)]
    return text(folder / "ATTITUDE.csv", head, rows)


def ardupilot(folder: Path) -> Path:
    head = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz\n"
    rows = [
        (s, 0, *rate, 0.1, 0.2, -9.8, 0, 0, 45.2, 1, 1, 1000, 1000)
        for s, rate in zip(STAMPS_US, RATES, strict=True)
    ]
    return text(folder / "IMU.csv", head, rows)


def betaflight(folder: Path) -> Path:
    head = '"Product","Blackbox flight data recorder by Nicholas Sherlock"\n"firmwareType","Cleanflight"\n'
    head += '"loopIteration","time (us)","gyroADC[0] (deg/s)","gyroADC[1] (deg/s)","gyroADC[2] (deg/s)","motor[0]"\n'
    rows = [(k, s, *np.degrees(rate), 300) for k, (s, rate) in enumerate(zip(STAMPS_US, RATES, strict=True))]
    return text(folder / "btfl_001.csv", head, rows)


def rostopic_echo(folder: Path) -> Path:
    names = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
    names += [f"field.orientation.{axis}" for axis in "xyzw"]
    names += [f"field.orientation_covariance{k}" for k in range(9)]
    names += [f"field.angular_velocity.{axis}" for axis in "xyz"]
    names += [f"field.linear_acceleration.{axis}" for axis in "xyz"]
    rows = [
        (s + 5000, k, s, "imu_link", *[0.0] * 4, -1, *[0] * 8, *rate, 0.1, 0.2, 9.8)
        for k, (s, rate) in enumerate(zip(STAMPS_NS, RATES, strict=True))
    ]
    return text(folder / "imu.csv", ",".join(names) + "\n", rows)


def sensor_logger_json(folder: Path) -> Path:
    rows: list[dict[str, str]] = [{"sensor": "Metadata", "version": "3", "device name": "phone"}]
    for stamp, time, rate in zip(STAMPS_NS, TIME, RATES, strict=True):
        shared = {"time": str(stamp), "seconds_elapsed": repr(float(time))}
        rows.append({"sensor": "Accelerometer", **shared, "z": "0.1", "y": "0.2", "x": "0.3"})
        values = {axis: repr(float(value)) for axis, value in zip("zyx", rate[::-1], strict=True)}
        rows.append({"sensor": "Gyroscope", **shared, **values})
    path = folder / "recording.json"
    path.write_text(json.dumps(rows))
    return path


def sensor_logger_csv(folder: Path) -> Path:
    rows = [(s, t, *rate[::-1]) for s, t, rate in zip(STAMPS_NS, TIME, RATES, strict=True)]
    text(folder / "Gyroscope.csv", "time,seconds_elapsed,z,y,x\n", rows)
    return folder


def phyphox_csv(folder: Path) -> Path:
    head = '"Time (s)","Gyroscope x (rad/s)","Gyroscope y (rad/s)","Gyroscope z (rad/s)","Absolute (rad/s)"\n'
    rows = [(t, *rate, float(np.linalg.norm(rate))) for t, rate in zip(TIME, RATES, strict=True)]
    return text(folder / "Gyroscope rotation rate.csv", head, rows)


def npz_named(folder: Path) -> Path:
    path = folder / "run.npz"
    np.savez(path, time=TIME, omega=RATES)
    return path


def npz_columns(folder: Path) -> Path:
    path = folder / "columns.npz"
    np.savez_compressed(
        path, t_ms=1e3 * TIME, wx=RATES[:, 0], wy=RATES[:, 1], wz=RATES[:, 2], note=np.array([1.0])
    )
    return path


def mat_variables(folder: Path) -> Path:
    from scipy.io import savemat

    path = folder / "run.mat"
    savemat(path, {"t": TIME[:, None], "omega": RATES})
    return path


def mat_structure(folder: Path) -> Path:
    from scipy.io import savemat

    path = folder / "struct.mat"
    savemat(path, {"imu": {"time": TIME, "omega": RATES.T, "name": "xsens"}})
    return path


def mat_of_version_7_3(folder: Path) -> Path:
    """As MATLAB writes with -v7.3: HDF5 behind 512 bytes of header, arrays transposed, a structure as a group, text as numbers."""
    import h5py

    path = folder / "run73.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        imu = file.create_group("imu")
        imu.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, values in (("time", TIME[None]), ("omega", RATES.T)):
            stored = imu.create_dataset(name, data=values, compression="gzip")
            stored.attrs["MATLAB_class"] = np.bytes_("double")
        name = imu.create_dataset("name", data=np.frombuffer(b"xsens", np.uint8)[:, None].astype(np.uint16))
        name.attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return path


def hdf5(folder: Path) -> Path:
    import h5py

    path = folder / "run.h5"
    with h5py.File(path, "w") as file:
        file["imu/time"], file["imu/omega"] = TIME, RATES
        file["elsewhere"] = h5py.ExternalLink("/etc/hostname", "/")
    return path


def parquet(folder: Path) -> Path:
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet as files

    path = folder / "run.parquet"
    columns = {"time_s": TIME, **dict(zip(("wx", "wy", "wz"), RATES.T, strict=True)), "label": ["a"] * COUNT}
    files.write_table(pyarrow.table(columns), path)
    return path


def blanks_with_names(folder: Path) -> Path:
    rows = [(f"{t:8.3f}", *(f"{value:12.6f}" for value in rate)) for t, rate in zip(TIME, RATES, strict=True)]
    return text(folder / "sim.dat", "  time_s   wx   wy   wz\n", rows, "  ")


def tabs(folder: Path) -> Path:
    rows = list(np.column_stack([TIME, RATES]).tolist())
    return text(
        folder / "log.txt", "time (s)\tomega_x (rad/s)\tomega_y (rad/s)\tomega_z (rad/s)\n", rows, "\t"
    )


def semicolons(folder: Path) -> Path:
    rows = [[str(cell).replace(".", ",") for cell in row] for row in np.column_stack([TIME, RATES])]
    return text(folder / "messung.csv", "Zeit (s);wx (rad/s);wy (rad/s);wz (rad/s)\n", rows, ";")


def body_rates_in_degrees(folder: Path) -> Path:
    rows = np.column_stack([TIME, np.degrees(RATES)]).tolist()
    return text(folder / "simulink.csv", "Time (s),p (deg/s),q (deg/s),r (deg/s)\n", rows)


def roll_rate_in_degrees(folder: Path) -> Path:
    rows = np.column_stack([TIME, np.degrees(RATES)]).tolist()
    return text(folder / "dji.csv", "time_s,roll_rate [deg/s],pitch_rate [deg/s],yaw_rate [deg/s]\n", rows)


def motion_capture(folder: Path) -> Path:
    rows = [(t, *(1e3 * p), *q) for t, p, q in zip(TIME, PLACE, TURN, strict=True)]
    return text(
        folder / "mocap.csv",
        "t_s,x_mm,y_mm,z_mm,qx,qy,qz,qw\n".replace("x_mm,y_mm,z_mm", "px_mm,py_mm,pz_mm"),
        rows,
    )


def tum_text(folder: Path) -> Path:
    rows = [(t, *p, *q) for t, p, q in zip(TIME, PLACE, TURN, strict=True)]
    return text(folder / "poses.txt", "", rows, " ")


def p_q_r(folder: Path) -> Path:
    return text(folder / "flightgear.csv", "time,p,q,r\n", np.column_stack([TIME, RATES]).tolist())


def no_header(folder: Path) -> Path:
    return text(folder / "bare.csv", "", np.column_stack([TIME, np.degrees(RATES)]).tolist())


def bare_blanks(folder: Path) -> Path:
    return text(folder / "bare.txt", "", np.column_stack([TIME, RATES]).tolist(), " ")


def rosbag(folder: Path) -> Path:
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types: Any = store.types
    vector, time = types["geometry_msgs/msg/Vector3"], types["builtin_interfaces/msg/Time"]
    header, twist = types["std_msgs/msg/Header"], types["geometry_msgs/msg/Twist"]
    name = "geometry_msgs/msg/TwistStamped"
    path = folder / "bag"
    with Writer(path, version=8, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection("/target/twist", name, typestore=store)
        for stamp, rate in zip(STAMPS_NS, RATES, strict=True):
            at = header(stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id="body")
            message = types[name](header=at, twist=twist(linear=vector(0.0, 0.0, 0.0), angular=vector(*rate)))
            bag.write(connection, stamp, store.serialize_cdr(message, name))
    return path


def optitrack(folder: Path) -> Path:
    head = "Format Version,1.23,Take Name,Take 1,Capture Frame Rate,50.000000,Rotation Type,Quaternion,Length Units,Millimeters\n\n"
    for cell in ("Rigid Body", "Body", "4F1E"):
        head += ",," + ",".join([cell] * 8) + "\n"
    head += ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Marker Error\n"
    head += "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,\n"
    rows = [(k, t, *TURN[k], *(1e3 * PLACE[k]), 0.3) for k, t in enumerate(TIME)]
    return text(folder / "Take 001.csv", head, rows)


def androsensor(folder: Path) -> Path:
    head = "sep=;\nACCELEROMETER X (m/s²);ACCELEROMETER Y (m/s²);ACCELEROMETER Z (m/s²);GYROSCOPE X (rad/s);GYROSCOPE Y (rad/s);"
    head += "GYROSCOPE Z (rad/s);LIGHT (lux);Time since start in ms ;YYYY-MO-DD HH-MI-SS_SSS\n"
    rows = [
        (0.1, 0.2, 9.8, *rate, 90, 20 * k, f"2024-01-01 10:00:00:{k:03d}") for k, rate in enumerate(RATES)
    ]
    return text(folder / "AndroSensor.csv", head, rows, ";")


def shimmer(folder: Path) -> Path:
    names = ["Timestamp_Unix", *(f"Gyro_{axis}" for axis in "XYZ"), *(f"Accel_LN_{axis}" for axis in "XYZ")]
    head = "sep=\t\n" + "".join(f"Shimmer_72C5_{name}_CAL\t" for name in names)
    head += "\nms\tdeg/s\tdeg/s\tdeg/s\tm/(s^2)\tm/(s^2)\tm/(s^2)\t\n"
    rows = [(1403636579763.5 + 20 * k, *rate, 0.1, 0.2, 9.8, "") for k, rate in enumerate(DEGREES)]
    return text(folder / "Session1_Shimmer_72C5_Calibrated_SD.csv", head, rows, "\t")


def metawear(folder: Path) -> Path:
    head = "epoc (ms),timestamp (+0000),elapsed (s),x-axis (deg/s),y-axis (deg/s),z-axis (deg/s)\n"
    rows = [
        (1403636579763 + 20 * k, f"2014-06-24T19:02:59.{k:03d}", f"{0.02 * k:.3f}", *rate)
        for k, rate in enumerate(DEGREES)
    ]
    return text(folder / "MetaWear_Gyroscope_50.000Hz_1.5.0.csv", head, rows)


def gmat(folder: Path) -> Path:
    head = "Sat.ElapsedSecs      Sat.AngularVelocityX      Sat.AngularVelocityY      Sat.AngularVelocityZ      \n"
    return text(folder / "ReportFile1.txt", head, np.column_stack([TIME, DEGREES]).tolist(), "     ")


def microstrain(folder: Path) -> Path:
    head = "HEADER_START\nDevice,3DM-GX5\nHEADER_END\nDATA_START\nGPS TFlags,GPS Week,GPS TOW,"
    head += (
        ",".join([*(f"{axis} Accel [x8004]" for axis in "XYZ"), *(f"{axis} Gyro [x8005]" for axis in "XYZ")])
        + "\n"
    )
    rows = [(6, 2100, f"{345600 + t:.4f}", 0.1, 0.2, -1.0, *RATES[k]) for k, t in enumerate(TIME)]
    return text(folder / "GX5.csv", head, rows)


def plotjuggler(folder: Path) -> Path:
    head = (
        "__time,/imu/angular_velocity/x,/imu/angular_velocity/y,/imu/angular_velocity/z,/imu/header/stamp\n"
    )
    rows = [(f"{1403636579.7635 + t:.6f}", *RATES[k], f"{1403636579.76 + t:.6f}") for k, t in enumerate(TIME)]
    return text(folder / "pj.csv", head, rows)


def basilisk(folder: Path) -> Path:
    np.savez(folder / "bsk.npz", times=(1e9 * TIME).astype(np.int64), omega_BN_B=RATES, sigma_BN=0 * RATES)
    return folder / "bsk.npz"


IMU_FIELDS = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"
IMU_REST = (0.1, 0.2, -9.8, 0, 0, 45.2, 1, 1, 1000, 1000)


def dataflash_text(folder: Path) -> Path:
    head = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n"
    head += f"FMT, 132, 60, IMU, QBffffffIIfBBHH, {IMU_FIELDS}\nFMT, 133, 15, ATT, Qcc, TimeUS,Roll,Pitch\n"
    rows: list[tuple[Any, ...]] = [("PARM", 4000000, "SYSID_THISMAV", 1)]
    for stamp, rate in zip(STAMPS_US, RATES, strict=True):
        rows += [
            ("IMU", stamp, 0, *rate, *IMU_REST),
            ("IMU", stamp, 1, *(2 * rate), *IMU_REST),
            ("ATT", stamp, 1, 2),
        ]
    return text(folder / "00000012.log", head, rows, ", ")


def dataflash(folder: Path) -> Path:
    def described(number: int, size: int, name: bytes, kinds: bytes, fields: bytes) -> bytes:
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, size, name, kinds, fields)

    data = described(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    data += described(129, 31, b"PARM", b"QNf", b"TimeUS,Name,Value")
    data += described(132, 54, b"IMU", b"QBffffffIIfBBHH", IMU_FIELDS.encode())
    data += b"\xa3\x95\x81" + struct.pack("<Q16sf", 1, b"GYRO_RATE", 1.0)
    for stamp, rate in zip(STAMPS_US, RATES, strict=True):
        for instance in (0, 1):
            numbers = (stamp, instance, *((1 + instance) * rate), *IMU_REST)
            data += b"\xa3\x95\x84" + struct.pack("<QB6fIIfBBHH", *numbers)
    (folder / "00000012.BIN").write_bytes(data + b"\xa3\x95\x84\x00")
    return folder / "00000012.BIN"


def vicon(folder: Path) -> Path:
    head = "Objects\n50\n,,body:body,,,,,,\nFrame,Sub Frame,RX,RY,RZ,RW,TX,TY,TZ\n,,,,,,mm,mm,mm\n"
    rows = [(k + 1, 0, *TURN[k], *(1e3 * PLACE[k])) for k in range(COUNT)]
    return text(folder / "trial01.csv", head, rows)


def kitti(folder: Path) -> Path:
    rows = np.concatenate([matrix_from_quaternion(TURN), PLACE[:, :, np.newaxis]], axis=2).reshape(COUNT, 12)
    return text(folder / "00.txt", "", rows.tolist(), " ")


def gopro(folder: Path) -> Path:
    head = '"cts","date","Gyroscope [rad/s]","1","2","temperature [°C]"\n'
    rows = [(20 * k, f"2024-01-01T10:00:00.{k:03d}Z", z, x, y, 40) for k, (x, y, z) in enumerate(RATES)]
    return text(folder / "GX010001_Hero8-GYRO.csv", head, rows)


AS_IT_IS: tuple[Callable[[Path], Path], ...] = (
    *(euroc_imu, euroc_root, euroc_mav0, euroc_truth, euroc_vicon, tum_folder, tum_text),
    *(
        px4_csv,
        px4_combined_csv,
        px4_gyro_csv,
        px4_attitude_csv,
        ulog,
        mavlink_attitude,
        ardupilot,
        betaflight,
    ),
    *(rostopic_echo, rosbag, sensor_logger_json, sensor_logger_csv, phyphox_csv),
    *(npz_named, npz_columns, mat_variables, mat_structure, mat_of_version_7_3, hdf5, parquet),
    *(blanks_with_names, tabs, semicolons, body_rates_in_degrees, roll_rate_in_degrees, motion_capture),
    *(
        optitrack,
        androsensor,
        shimmer,
        metawear,
        gmat,
        microstrain,
        plotjuggler,
        basilisk,
        dataflash_text,
        dataflash,
        vicon,
        gopro,
    ),
)
WITH_A_HINT: tuple[tuple[Callable[[Path], Path], dict[str, Any], str], ...] = (
    (p_q_r, {"unit": "rad/s"}, "--unit"),
    (no_header, {"columns": "t,x,y,z", "unit": "deg/s"}, "--columns"),
    (bare_blanks, {"columns": "t,wx,wy,wz"}, "--columns"),
    (kitti, {"rate": 50.0}, "--rate"),
)


@pytest.mark.parametrize("make", AS_IT_IS, ids=lambda make: make.__name__)
def test_a_recording_of_another_logger_is_read_as_it_is(make: Callable[[Path], Path], tmp_path: Path) -> None:
    require_motion(spinfilters.load(make(tmp_path)))


@pytest.mark.parametrize(
    ("make", "hint", "asked"), WITH_A_HINT, ids=lambda each: getattr(each, "__name__", "")
)
def test_what_a_recording_does_not_say_is_asked_for(
    make: Callable[[Path], Path], hint: dict[str, Any], asked: str, tmp_path: Path
) -> None:
    path = make(tmp_path)
    with pytest.raises(InputError) as refusal:
        spinfilters.load(path)
    assert asked in str(refusal.value)
    require_motion(spinfilters.load(path, **hint))


@pytest.mark.parametrize("suffix", [".npz", ".mat", ".h5", ".parquet", ".json", ".ulg"])
@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 nothing", b"\x00" * 300, b"[[1, 2], [3]]", b"{}"])
def test_a_damaged_file_is_refused_in_one_line(suffix: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"mine{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError) as refusal:
        spinfilters.load(path)
    assert path.name in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize("make", [ulog, npz_named, mat_variables, mat_of_version_7_3, sensor_logger_json])
def test_a_truncated_file_is_read_or_refused_in_one_line(
    make: Callable[[Path], Path], tmp_path: Path
) -> None:
    whole = make(tmp_path)
    data = whole.read_bytes()
    for share in (0.1, 0.5, 0.9):
        whole.write_bytes(data[: int(share * len(data))])
        refusals = []
        try:
            spinfilters.load(whole)
        except InputError as refusal:
            refusals.append(str(refusal))
        assert all(len(each.splitlines()) == 1 for each in refusals)


def test_pickled_objects_are_never_loaded(tmp_path: Path) -> None:
    path = tmp_path / "objects.npz"
    np.savez(path, allow_pickle=True, time=TIME, omega=np.array([{"a": 1}] * COUNT, dtype=object))
    with pytest.raises(InputError, match=r"no \.npz of plain arrays"):
        spinfilters.load(path)


def _packed_mat(stated: int, held: int, begin: int = 0, end: int | None = None) -> bytes:
    """A .mat with one compressed variable that states so many numbers and holds others, all zero."""
    name = (
        struct.pack("<2I", 5, 8)
        + struct.pack("<2i", stated, 1)
        + struct.pack("<2I", 1, 1)
        + b"x".ljust(8, b"\0")
    )
    whole = struct.pack("<2I2I", 6, 8, 6, 0) + name + struct.pack("<2I", 9, 8 * stated)
    packer = zlib.compressobj(1)
    packed = packer.compress(struct.pack("<2I", 14, len(whole) + 8 * stated) + whole)
    for _ in range(0, 8 * held, 1 << 20):
        packed += packer.compress(bytes(min(8 * held, 1 << 20)))
    packed = (packed + packer.flush())[begin:end]
    return (
        b"MATLAB 5.0".ljust(124)
        + struct.pack("<H", 0x0100)
        + b"IM"
        + struct.pack("<2I", 15, len(packed))
        + packed
    )


def test_a_packed_variable_is_refused_before_memory_is_taken_for_it(tmp_path: Path) -> None:
    path = tmp_path / "bomb.mat"
    path.write_bytes(_packed_mat(stated=40 << 20, held=40 << 20))
    tracemalloc.start()
    try:
        with pytest.raises(
            InputError, match=r"is no whole \.mat \(it unpacks to \d+ bytes, at most \d+ are read\)"
        ):
            spinfilters.load(path)
        assert tracemalloc.get_traced_memory()[1] < 64 << 20
    finally:
        tracemalloc.stop()


def test_a_packed_variable_that_holds_less_than_it_states_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cut.mat"
    for content in (_packed_mat(stated=2000, held=1000), _packed_mat(stated=20, held=20, end=-2)):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"is no whole \.mat \(it is cut off\)"):
            spinfilters.load(path)
