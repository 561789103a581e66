"""Recordings of consoles, rapid prototyping systems and reconstructions, and bags with several kinds of messages."""

import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat
from scipy.spatial.transform import Rotation

import spinfilters
from spinfilters.core.errors import InputError
from tests.io.logger_motion import COUNT, PLACE, RATES, STAMPS_US, START_NS, TIME, TURN, require_motion, text

WXYZ = TURN[:, [3, 0, 1, 2]]
NAMES = ("x", "y", "z")


def array_of_stated_order(folder: Path) -> Path:
    path = folder / "run.npz"
    np.savez(path, time=TIME, position=PLACE, quat_wxyz=WXYZ)
    return path


def rigid_transformations(folder: Path) -> Path:
    whole = np.tile(np.eye(4), (COUNT, 1, 1))
    whole[:, :3, :3], whole[:, :3, 3] = Rotation.from_quat(TURN).as_matrix(), PLACE
    np.savez(folder / "poses.npz", timestamps=TIME, T_world_body=whole)
    return folder / "poses.npz"


def rotations_of_matlab(folder: Path) -> Path:
    turned = np.moveaxis(Rotation.from_quat(TURN).as_matrix(), 0, -1)
    savemat(folder / "turn.mat", {"time": TIME[:, None], "R_IB": turned})
    return folder / "turn.mat"


def timeseries_of_one_clock(folder: Path) -> Path:
    series = {"Time": TIME[:, None], "TimeInfo": {"Units": "seconds"}}
    savemat(
        folder / "out.mat", {"out": {"omega": {**series, "Data": RATES}, "force": {**series, "Data": PLACE}}}
    )
    return folder / "out.mat"


def yaml_documents(folder: Path) -> Path:
    whole = ""
    for time, rate in zip(TIME + 7.0, RATES, strict=True):
        whole += f"---\nstamp: {{secs: {int(time)}, nsecs: {round(time % 1 * 1e9)}}}\nangular_velocity:\n"
        whole += "".join(
            f"  {axis}: {value!r}\n" for axis, value in zip(NAMES, map(float, rate), strict=True)
        )
    return text(folder / "imu.yaml", whole, [])


def ulog2csv_folder(folder: Path) -> Path:
    head = "timestamp,timestamp_sample,xyz[0],xyz[1],xyz[2]\n"
    rows = [(stamp + 300, stamp, *rate) for stamp, rate in zip(STAMPS_US, RATES, strict=True)]
    text(folder / "log" / "log_12_vehicle_angular_velocity_0.csv", head, rows)
    text(folder / "log" / "log_12_battery_status_0.csv", "timestamp,voltage_v\n", [(5, 12.4), (6, 12.4)])
    return folder / "log"


def controldesk(folder: Path) -> Path:
    traces = [f'"Platform()://Model Root/IMU/Out1{{Gyro_{axis}}}"' for axis in "XYZ"]
    whole = '"fileversion",2.0\n"path","C:\\\\Project\\\\rec1.mf4"\n"trace_type","Timestamp","Float64","Float64","Float64"\n'
    whole += '"trace_unit","s","rad/s","rad/s","rad/s"\n"trace_name","HostService",' + ",".join(traces) + "\n"
    rows = [("trace_values" if k == 0 else "", TIME[k], *RATES[k]) for k in range(COUNT)]
    return text(folder / "rec1.csv", whole, rows)


def zephyr_console(folder: Path) -> Path:
    whole = "*** Booting Zephyr OS build v3.5.0 ***\n"
    for time, rate in zip(TIME + 2.0, RATES, strict=True):
        whole += f"[0:00:{time:06.3f}]:31.4 Cel\n  accel 0.100000 0.200000 9.800000 m/s/s\n"
        whole += "  gyro  " + " ".join(f"{value:.7f}" for value in rate) + " rad/s\n"
    return text(folder / "console.log", whole, [])


def grafana(folder: Path) -> Path:
    rows = [
        (f"2024-02-03 10:11:{12 + time:06.3f}", *(f"{value:.7f} rad/s" for value in rate))
        for time, rate in zip(TIME, RATES, strict=True)
    ]
    return text(folder / "panel.csv", '"Time","gyro_x","gyro_y","gyro_z"\n', rows)


def mcap_as_json(folder: Path) -> Path:
    whole = ""
    for k, rate in enumerate(RATES):
        stamp = START_NS + 20_000_000 * k
        header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": "imu"}
        turned = dict(zip(NAMES, map(float, rate), strict=True))
        data = {"header": header, "angular_velocity": turned}
        times = {"log_time": f"{stamp / 1e9 + 0.3 * (k % 2):.9f}", "publish_time": f"{stamp / 1e9:.9f}"}
        whole += json.dumps({"topic": "/imu", "sequence": k, **times, "data": data}) + "\n"
    return text(folder / "imu.jsonl", whole, [])


def simulator_42(folder: Path) -> Path:
    np.savetxt(folder / "time.42", TIME)
    np.savetxt(folder / "wbn00.42", RATES)
    return folder


def line_protocol(folder: Path) -> Path:
    whole = "# DML\n"
    for k, rate in enumerate(RATES):
        fields = ",".join(
            f"omega_{axis}={value!r}" for axis, value in zip(NAMES, map(float, rate), strict=True)
        )
        stamp = START_NS + 20_000_000 * k
        whole += f'imu,host=obc {fields},mode="spin" {stamp}\npower,host=obc volt=7.4 {stamp}\n'
    return text(folder / "export.lp", whole, [])


def colmap(folder: Path) -> Path:
    whole = (
        "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n#   POINTS2D[] as (X, Y, POINT3D_ID)\n"
    )
    for k in reversed(range(COUNT)):  # images are in no order of time
        pose = " ".join(map(repr, map(float, (*WXYZ[k], *PLACE[k]))))
        whole += f"{k + 3} {pose} 1 {START_NS + 20_000_000 * k}.png\n512.3 300.1 -1 211.0 99.9 7\n"
    return text(folder / "images.txt", whole, [])


@pytest.mark.parametrize(
    "made",
    [
        *(
            rigid_transformations,
            rotations_of_matlab,
            array_of_stated_order,
            timeseries_of_one_clock,
            yaml_documents,
            ulog2csv_folder,
            controldesk,
        ),
        *(zephyr_console, grafana, mcap_as_json, simulator_42, line_protocol, colmap),
    ],
)
def test_recordings_of_consoles_and_simulators_are_read_without_a_step(
    made: Callable[[Path], Path], tmp_path: Path
) -> None:
    require_motion(spinfilters.load(made(tmp_path)))


def test_a_cell_in_another_unit_than_its_column_is_refused(tmp_path: Path) -> None:
    path = grafana(tmp_path)
    path.write_text(path.read_text().replace(" rad/s", " mrad/s", 100).replace(" mrad/s", " rad/s", 99))
    with pytest.raises(InputError, match=r"line 35: gyro_x .* is '.* mrad/s', not a number"):
        spinfilters.load(path)


def test_a_column_named_in_another_unit_than_its_cells_is_refused(tmp_path: Path) -> None:
    path = grafana(tmp_path)
    path.write_text(path.read_text().replace('"gyro_x"', '"gyro_x (deg/s)"'))
    with pytest.raises(InputError, match=r"column 'gyro_x \(deg/s\)' holds numbers in rad/s"):
        spinfilters.load(path)


def test_line_protocol_of_two_units_asks_which(tmp_path: Path) -> None:
    path = line_protocol(tmp_path)
    path.write_text(
        path.read_text().replace("power,", "imu,pos=b ").replace("volt=", "omega_x=1,omega_y=2,omega_z=")
    )
    path.write_text(path.read_text().replace("imu,pos=b host=obc", "imu,pos=b,host=obc"))
    with pytest.raises(InputError, match="each describe a motion; give --topic"):
        spinfilters.load(path)
    require_motion(spinfilters.load(path, topic="imu,host=obc"))


def test_images_of_colmap_without_times_need_a_rate_and_keep_gaps(tmp_path: Path) -> None:
    path = colmap(tmp_path)
    words = path.read_text()
    for k in range(COUNT):
        words = words.replace(f"{START_NS + 20_000_000 * k}.png", f"frame_{k + (k > 20):05d}.png")
    path.write_text(words)
    with pytest.raises(InputError, match=r"frame_00040\.png' and no times; give --rate HZ"):
        spinfilters.load(path)
    time = spinfilters.load(path, rate=50).log.stream("pose").time
    np.testing.assert_allclose(np.diff(time)[[19, 20, 21]], [0.02, 0.04, 0.02], atol=1e-12)


def test_files_of_several_spacecraft_of_the_simulator_42_are_refused(tmp_path: Path) -> None:
    np.savetxt(simulator_42(tmp_path) / "wbn01.42", RATES)
    with pytest.raises(InputError, match=r"such as wbn01\.42"):
        spinfilters.load(tmp_path)


def bag_of(path: Path, topics: dict[str, tuple[str, Callable[[Any, int], Any]]]) -> Path:
    """A bag of ROS 2 with a message of each topic at every epoch."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    with rosbag2.Writer(path, version=8) as bag:
        for name, (kind, made) in topics.items():
            connection = bag.add_connection(name, kind, typestore=store)
            for k in range(COUNT):
                bag.write(
                    connection, START_NS + 20_000_000 * k, store.serialize_cdr(made(store.types, k), kind)
                )
    return path


def header(types: Any, k: int, frame: str) -> Any:
    stamp = START_NS + 20_000_000 * k
    time = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    return types["std_msgs/msg/Header"](time, frame)


def transforms(types: Any, frames: dict[str, int]) -> Any:
    """Message with the transform of each frame at an epoch."""
    held = []
    for frame, k in frames.items():
        place = types["geometry_msgs/msg/Vector3"](*PLACE[k])
        turn = types["geometry_msgs/msg/Quaternion"](*TURN[k])
        both = types["geometry_msgs/msg/Transform"](place, turn)
        held.append(types["geometry_msgs/msg/TransformStamped"](header(types, k, "map"), frame, both))
    return types["tf2_msgs/msg/TFMessage"](held)


def test_the_one_frame_that_moves_is_read_of_transforms(tmp_path: Path) -> None:
    def fixed(types: Any, k: int) -> Any:
        message = transforms(types, {"panel": 3})
        message.transforms[0].header = header(types, k, "target")
        return message

    kind = "tf2_msgs/msg/TFMessage"
    path = bag_of(
        tmp_path / "tf",
        {"/tf_static": (kind, fixed), "/tf": (kind, lambda types, k: transforms(types, {"target": k}))},
    )
    require_motion(spinfilters.load(path))


def test_of_several_frames_that_move_one_is_asked_for(tmp_path: Path) -> None:
    def both(types: Any, k: int) -> Any:
        message = transforms(types, {"target": k, "chaser": COUNT - 1 - k})
        message.transforms[1].header = header(types, k, "map")
        return message

    path = bag_of(tmp_path / "tf", {"/tf": ("tf2_msgs/msg/TFMessage", both)})
    with pytest.raises(InputError, match="several frames that move; give --topic, one of chaser, target"):
        spinfilters.load(path)
    require_motion(spinfilters.load(path, topic="target"))


def test_twists_that_a_tracker_derives_are_left_out_beside_its_poses(tmp_path: Path) -> None:
    def pose(types: Any, k: int) -> Any:
        place = types["geometry_msgs/msg/Point"](*PLACE[k])
        held = types["geometry_msgs/msg/Pose"](place, types["geometry_msgs/msg/Quaternion"](*TURN[k]))
        return types["geometry_msgs/msg/PoseStamped"](header(types, k, "world"), held)

    def twist(types: Any, k: int) -> Any:  # in axes of the world, as vrpn_client_ros has it
        vector = types["geometry_msgs/msg/Vector3"]
        rate = Rotation.from_quat(TURN[k]).apply(RATES[k])
        held = types["geometry_msgs/msg/Twist"](vector(0.1, 0.2, 0.0), vector(*rate))
        return types["geometry_msgs/msg/TwistStamped"](header(types, k, "world"), held)

    kinds = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TwistStamped")
    path = bag_of(
        tmp_path / "own", {"/vrpn/target/pose": (kinds[0], pose), "/vrpn/target/twist": (kinds[1], twist)}
    )
    require_motion(spinfilters.load(path))
    other = bag_of(
        tmp_path / "other", {"/vrpn/target/pose": (kinds[0], pose), "/imu/twist": (kinds[1], twist)}
    )
    with pytest.raises(InputError, match="several topics that are read; give --topic"):
        spinfilters.load(other)


def tumbling() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Attitudes, scalar last, body rates, and rates in inertial axes, of a body that turns about all axes."""
    time = 0.01 * np.arange(200)
    rates = np.column_stack([np.sin(time), 1.0 + 0.0 * time, np.cos(2 * time)])
    turned = Rotation.identity()
    held = [turned]
    for before, after in itertools.pairwise(rates):
        turned = turned * Rotation.from_rotvec(0.005 * (before + after))
        held.append(turned)
    turns = Rotation.concatenate(held)
    return turns.as_quat(), rates, turns.apply(rates)


def table_of(
    path: Path, q: np.ndarray, rates: np.ndarray, names: str = "time_s,qx,qy,qz,qw,wx,wy,wz"
) -> Path:
    rows = np.column_stack([0.01 * np.arange(len(q)), q, rates])
    return text(path, f"{names}\n" if names else "", [[f"{value:.9f}" for value in row] for row in rows])


CONJUGATE = (-1.0, -1.0, -1.0, 1.0)


def test_a_quaternion_to_body_axes_is_turned_round_where_body_rates_show_it(tmp_path: Path) -> None:
    q, rates, _ = tumbling()
    straight = spinfilters.load(table_of(tmp_path / "straight.csv", q, rates))
    turned = spinfilters.load(table_of(tmp_path / "turned.csv", q * CONJUGATE, rates))
    np.testing.assert_allclose(
        turned.log.stream("attitude").values, straight.log.stream("attitude").values, atol=1e-8
    )
    assert "maps from inertial to body axes" in turned.description
    assert "maps from inertial to body axes" not in straight.description


def test_rates_in_inertial_axes_do_not_turn_a_quaternion_round(tmp_path: Path) -> None:
    q, _, inertial = tumbling()
    read = spinfilters.load(table_of(tmp_path / "rates.csv", q, inertial))
    np.testing.assert_allclose(read.log.stream("attitude").values, q, atol=1e-8)


def test_rates_that_turn_back_are_refused_beside_a_quaternion(tmp_path: Path) -> None:
    q, rates, inertial = tumbling()
    for name, other in (("signs.csv", (q, -rates)), ("spice.csv", (q * CONJUGATE, inertial))):
        path = table_of(tmp_path / name, *other)
        with pytest.raises(
            InputError, match=f"{name}: its rates are minus the derivative of its attitude"
        ) as refused:
            spinfilters.load(path)
        cure = "time_s,qx,qy,qz,qw,-,-,-"
        assert f"--columns {cure} (Python" in str(refused.value)
        np.testing.assert_allclose(
            spinfilters.load(path, columns=cure).log.stream("attitude").values, other[0], atol=1e-8
        )


def test_no_names_are_proposed_that_would_take_a_quaternion_the_wrong_way(tmp_path: Path) -> None:
    q, rates, inertial = tumbling()
    for name, other in (("body.csv", (q * CONJUGATE, rates)), ("spice.csv", (q * CONJUGATE, inertial))):
        with pytest.raises(InputError, match="is no header") as refused:
            spinfilters.load(table_of(tmp_path / name, *other, names=""))
        assert "qw" not in str(refused.value)


def test_the_order_that_an_attribute_states_is_taken(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "run.h5", "w") as file:
        group = file.create_group("target/pose")
        group["time_s"], group["position_m"], group["orientation"] = TIME, PLACE, WXYZ
        group["orientation"].attrs["order"] = "wxyz"
    dataset = spinfilters.load(tmp_path / "run.h5")
    assert dataset.kind == "pose"
    require_motion(dataset)


def test_an_annotated_table_of_influxdb_is_read_by_its_own_clock(tmp_path: Path) -> None:
    head = "#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,double,string,string\n"
    head += ",result,table,_start,_time,_value,_field,_measurement\n"
    rows = [
        (
            "",
            "",
            k,
            "2024-01-01T00:00:00Z",
            f"2024-01-01T01:00:{time:09.6f}Z",
            value,
            f"gyro_{axis}_rad_s",
            "imu",
        )
        for k, axis in enumerate(NAMES)
        for time, value in zip(TIME, map(float, RATES[:, k]), strict=True)
    ]
    require_motion(spinfilters.load(text(tmp_path / "query.csv", head, rows)))


@pytest.mark.parametrize("name", ["T_body_world", "dcm", "C_BN", "R_b_w", "T_cw", "extrinsics"])
def test_matrices_that_may_map_to_the_body_are_refused(name: str, tmp_path: Path) -> None:
    turned = Rotation.from_quat(TURN).as_matrix()
    np.savez(tmp_path / "run.npz", **{"time": TIME, name: turned})
    with pytest.raises(InputError, match=f"array '{name}' may map from inertial to body axes; save its"):
        spinfilters.load(tmp_path / "run.npz")


def test_a_matrix_to_body_axes_is_turned_round_where_body_rates_show_it(tmp_path: Path) -> None:
    q, rates, _ = tumbling()
    names = "time_s,px,py,pz," + ",".join(f"R{i}{j}" for i in "123" for j in "123") + ",wx,wy,wz"
    for name, turns in (("straight.csv", Rotation.from_quat(q)), ("turned.csv", Rotation.from_quat(q).inv())):
        matrices = np.column_stack([np.zeros((len(q), 3)), turns.as_matrix().reshape(-1, 9)])
        read = (
            spinfilters.load(table_of(tmp_path / name, matrices, rates, names))
            .log.stream("pose")
            .values[:, 3:]
        )
        assert (Rotation.from_quat(read).inv() * Rotation.from_quat(q)).magnitude().max() < 1e-6
