"""Exports of phones as folders and archives, and ROS bags."""

import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest

import spinfilters
from spinfilters.core.errors import InputError
from spinfilters.io.stated_values import ReadingOptions
from spinfilters.run.readers import read_dataset, read_segments, read_whole
from tests.io.log_samples import PHYPHOX, SEGMENTS

SENSOR_LOGGER = "time,seconds_elapsed,z,y,x\n" + "".join(
    f"{1_700_000_000_000_000_000 + 10_000_000 * k},{0.01 * k},3.0,2.0,1.0\n" for k in range(30)
)


def archive(path: Path, **files: str) -> Path:
    """A zip of these members; two underscores in a name are a slash."""
    with zipfile.ZipFile(path, "w") as made:
        for name, text in files.items():
            made.writestr(name.replace("__", "/").replace("_csv", ".csv"), text)
    return path


def test_a_folder_of_sensor_logger_gives_gyro_and_accelerometer(tmp_path: Path) -> None:
    (tmp_path / "Gyroscope.csv").write_text(SENSOR_LOGGER)
    (tmp_path / "TotalAcceleration.csv").write_text(SENSOR_LOGGER.replace("3.0,2.0,1.0", "9.8,0.1,0.2"))
    dataset = read_dataset(tmp_path)
    stream = dataset.log.stream("gyro")
    np.testing.assert_array_equal(stream.values[0], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(np.diff(stream.time), 0.01)
    assert dataset.acceleration is not None
    np.testing.assert_array_equal(dataset.acceleration.values[0], [0.2, 0.1, 9.8])


def test_a_zip_of_phyphox_is_read_as_its_folder(tmp_path: Path) -> None:
    path = archive(tmp_path / "toss.zip", **{"Raw Data_csv": PHYPHOX, "meta__segments_csv": SEGMENTS})
    assert read_whole(path).log.end == pytest.approx(0.99)
    assert [each.segment.number for each in read_segments(path) if each.segment] == [1, 2]
    second = read_dataset(path, 2)
    assert second.path == path
    assert second.log.start == pytest.approx(0.5)
    assert second.description == "phyphox recording toss, segment 2: second"


def test_a_zip_with_one_table_within_a_folder_is_read(tmp_path: Path) -> None:
    path = archive(tmp_path / "mine.zip", deep__log_csv="time_s,wx,wy,wz\n0,1,2,3\n1,1,2,3\n")
    assert len(read_dataset(path).log.times) == 2


@pytest.mark.parametrize(
    ("members", "says"),
    [
        ({"notes": "nothing"}, "holds no table"),
        ({"..__evil_csv": PHYPHOX}, "holds no table"),
        ({"Raw Data_csv": "Time (s)\n1\n"}, r"mine\.zip/Raw Data\.csv: "),
    ],
)
def test_a_zip_that_is_no_recording_is_refused_by_its_name(
    members: dict[str, str], says: str, tmp_path: Path
) -> None:
    path = archive(tmp_path / "mine.zip", **members)
    with pytest.raises(InputError, match=says) as refusal:
        read_dataset(path)
    assert str(refusal.value).startswith(str(path))


def test_a_damaged_zip_is_refused_in_one_line(tmp_path: Path) -> None:
    path = archive(tmp_path / "mine.zip", log_csv="time_s,wx,wy,wz\n0,1,2,3\n1,1,2,3\n")
    content = path.read_bytes()
    for damaged in (content[: len(content) // 2], content.replace(b"0,1,2,3", b"0,1,2,4", 1), b"PK"):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=r"mine\.zip: cannot be unpacked .*; unpack it yourself"):
            read_dataset(path)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag in MCAP with a gyro on two topics."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="needs the extra ros")
    from rosbags.typesys import Stores, get_typestore  # pyright: ignore[reportMissingImports]

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    folder = tmp_path_factory.mktemp("bags") / "toss"
    stream = spinfilters.simulate("gyro", seed=1, frames=20, interval=0.1).log.stream("gyro")
    with rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
        topics = [
            writer.add_connection(name, "sensor_msgs/msg/Imu", typestore=store) for name in ("/imu", "/raw")
        ]
        vector, time = types["geometry_msgs/msg/Vector3"], types["builtin_interfaces/msg/Time"]
        for stamp, rate in zip(stream.time, stream.values, strict=True):
            header = types["std_msgs/msg/Header"](
                time(1_700_000_000 + int(stamp), int(1e9 * (stamp % 1))), "imu"
            )
            turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
            zeros = np.zeros(9)
            message = types["sensor_msgs/msg/Imu"](
                header, turn, zeros, vector(*rate), zeros, vector(0.0, 0.0, 9.8), zeros
            )
            for topic in topics:
                writer.write(topic, int(1e9 * stamp), store.serialize_cdr(message, "sensor_msgs/msg/Imu"))
    return folder


def test_a_bag_gives_the_rates_and_forces_of_a_topic(bag: Path) -> None:
    expected = spinfilters.simulate("gyro", seed=1, frames=20, interval=0.1).log.stream("gyro")
    for path in (bag, *bag.glob("*.mcap")):
        dataset = read_dataset(path, options=ReadingOptions(topic="/imu"))
        stream = dataset.log.stream("gyro")
        np.testing.assert_array_equal(stream.values, expected.values)
        np.testing.assert_allclose(stream.time - 1.7e9, expected.time, atol=1e-6)
        assert dataset.acceleration is not None
        assert dataset.acceleration.values[0, 2] == 9.8


def test_an_mcap_whose_data_have_another_checksum_is_refused(bag: Path, tmp_path: Path) -> None:
    whole = next(bag.glob("*.mcap")).read_bytes()
    end = whole.index(b"\x0f\x04" + bytes(11))  # the record DataEnd, which states no checksum
    stated = zlib.crc32(whole[:end]).to_bytes(4, "little")
    path = tmp_path / "a.mcap"
    told = whole[: end + 9] + stated + whole[end + 13 :]
    path.write_bytes(told)
    assert len(read_dataset(path, options=ReadingOptions(topic="/imu")).log.stream("gyro").time) == 20
    path.write_bytes(told[:2000] + bytes([told[2000] ^ 1]) + told[2001:])
    with pytest.raises(InputError, match="checksum"):
        read_dataset(path, options=ReadingOptions(topic="/imu"))


def test_a_bag_with_several_topics_asks_for_one(bag: Path) -> None:
    with pytest.raises(InputError, match="several topics that are read; give --topic, one of /imu, /raw"):
        read_dataset(bag)
    with pytest.raises(InputError, match="has no topic '/camera' that is read; give --topic /imu, /raw"):
        read_dataset(bag, options=ReadingOptions(topic="/camera"))


def test_a_file_that_is_no_bag_is_refused_in_one_line(bag: Path, tmp_path: Path) -> None:
    for suffix in (".mcap", ".bag", ".db3"):
        path = tmp_path / f"toss{suffix}"
        path.write_bytes(next(bag.glob("*.mcap")).read_bytes()[:200])
        with pytest.raises(InputError, match=r"is no whole ROS bag .*; record or copy it again"):
            read_dataset(path)
