"""Images and clouds of bags, and videos of a stereo pair, become data sets; what cannot is refused in one line."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from spinfilters.cli.main import main
from spinfilters.core.errors import InputError
from spinfilters.io.stated_values import NOTHING_STATED, ReadingOptions
from spinfilters.lidar.scan import read_scan
from spinfilters.run.bag_recording import stereo_pair, unpacked_recording
from spinfilters.vision.image_folder import LossCount, read_image, stamped_pairs
from spinfilters.vision.rectification import read_raw_rig, write_raw_rig

COUNT, SIZE = 5, (24, 32)
SIDES = ("left", "right")
START = 1_700_000_000_000_000_000
GENERATOR = np.random.default_rng(3)
GREY = GENERATOR.integers(0, 255, (2, COUNT, *SIZE), dtype=np.uint8)
POINTS = GENERATOR.normal((0.0, 0.0, 5.0), size=(COUNT, 40, 3)).astype(np.float32)


def _header(types: Any, stamp: int) -> Any:
    time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    return types["std_msgs/msg/Header"](stamp=time, frame_id="camera")


def _image(types: Any, stamp: int, grey: np.ndarray, encoding: str) -> Any:
    pixels = {"mono8": grey, "rgb8": np.repeat(grey[..., None], 3, 2), "mono16": grey.astype("<u2") * 256}[
        encoding
    ]
    lines = pixels.reshape(SIZE[0], -1).view(np.uint8)
    padded = np.hstack([lines, np.zeros((SIZE[0], 7), np.uint8)])  # a step longer than a line
    return types["sensor_msgs/msg/Image"](
        header=_header(types, stamp),
        height=SIZE[0],
        width=SIZE[1],
        encoding=encoding,
        is_bigendian=0,
        step=padded.shape[1],
        data=padded.reshape(-1),
    )


def _compressed(types: Any, stamp: int, grey: np.ndarray) -> Any:
    data = cv2.imencode(".png", grey)[1].reshape(-1)
    return types["sensor_msgs/msg/CompressedImage"](header=_header(types, stamp), format="png", data=data)


def _cloud(types: Any, stamp: int, points: np.ndarray) -> Any:
    """Points with an intensity between y and z, and one that is none."""
    rows = np.zeros(len(points) + 1, np.dtype([("x", "<f4"), ("y", "<f4"), ("i", "<f4"), ("z", "<f4")]))
    rows["x"], rows["y"], rows["z"] = np.vstack([points, [np.nan] * 3]).T
    field = types["sensor_msgs/msg/PointField"]
    return types["sensor_msgs/msg/PointCloud2"](
        header=_header(types, stamp),
        height=1,
        width=len(rows),
        fields=[field(name=name, offset=4 * k, datatype=7, count=1) for k, name in enumerate("xyiz")],
        is_bigendian=False,
        point_step=16,
        row_step=16 * len(rows),
        data=np.frombuffer(rows.tobytes(), np.uint8),
        is_dense=False,
    )


def bag(folder: Path, version: int, encoding: str) -> Path:
    """Two cameras whose stamps differ by 20 us, the last right image missing, and clouds."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    types, path = store.types, folder / ("two.bag" if version == 1 else "two")
    if version == 1:
        header = types["std_msgs/msg/Header"]
        types = {
            **types,
            "std_msgs/msg/Header": lambda stamp, frame_id: header(seq=0, stamp=stamp, frame_id=frame_id),
        }
    with Writer1(path) if version == 1 else Writer2(path, version=9) as writer:
        serialise = store.serialize_ros1 if version == 1 else store.serialize_cdr
        kinds = ["sensor_msgs/msg/CompressedImage" if encoding == "png" else "sensor_msgs/msg/Image"] * 2
        topics = dict(
            zip(("/left", "/right", "/points"), (*kinds, "sensor_msgs/msg/PointCloud2"), strict=True)
        )
        opened = {
            topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in topics.items()
        }
        for k in range(COUNT):
            stamp = START + k * 100_000_000
            for camera, topic in enumerate(("/left", "/right")):
                if camera == 1 and k == COUNT - 1:
                    continue
                own, grey = stamp + 20_000 * camera, GREY[camera, k]
                made = (
                    _compressed(types, own, grey) if encoding == "png" else _image(types, own, grey, encoding)
                )
                writer.write(opened[topic], own, serialise(made, topics[topic]))
            writer.write(
                opened["/points"], stamp, serialise(_cloud(types, stamp, POINTS[k]), topics["/points"])
            )
    return path


def require_images(folder: Path) -> None:
    pairs = stamped_pairs(folder, LossCount())
    assert [pair.stamp for pair in pairs] == [START + k * 100_000_000 for k in range(COUNT - 1)]
    for k, pair in enumerate(pairs):
        for camera, path in enumerate((pair.left, pair.right)):
            image, cause = read_image(path)
            assert image is not None, cause
            np.testing.assert_allclose(image.astype(int), GREY[camera, k].astype(int), atol=1)


@pytest.mark.parametrize(
    ("version", "encoding"), [(1, "mono8"), (2, "rgb8"), (2, "mono16"), (1, "png"), (2, "png")]
)
def test_images_of_a_bag_become_a_folder_of_pairs(
    version: int, encoding: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bag(tmp_path, version, encoding)
    assert main(["unpack", str(path), "-o", str(tmp_path / "images")]) == 0
    said = capsys.readouterr().out
    assert "4 pairs of images, left /left, right /right (1 without a partner), in " in said
    assert "no calibration yet" in said
    require_images(tmp_path / "images")


def test_a_calibration_is_copied_beside_the_images(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = tmp_path / "rig"
    for camera in ("cam0", "cam1"):
        (rig / camera).mkdir(parents=True)
        (rig / camera / "sensor.yaml").write_text(f"# of {camera}\n")
    path = bag(tmp_path, 2, "png")
    assert main(["unpack", str(path), "-o", str(tmp_path / "images"), "--rig", str(rig)]) == 0
    assert "no calibration yet" not in capsys.readouterr().out
    for camera in ("cam0", "cam1"):
        assert (tmp_path / "images" / camera / "sensor.yaml").read_text() == f"# of {camera}\n"


def test_clouds_of_a_bag_become_scans(tmp_path: Path) -> None:
    path = bag(tmp_path, 2, "png")
    assert main(["unpack", str(path), "-o", str(tmp_path / "scans"), "--topic", "/points"]) == 0
    files = sorted((tmp_path / "scans" / "scans").iterdir())
    assert len(files) == COUNT
    for k, file in enumerate(files):
        scan = read_scan(file)
        np.testing.assert_allclose(scan.points, POINTS[k], atol=1e-6)
        np.testing.assert_allclose(scan.time, 0.1 * k, atol=1e-9)
    assert (tmp_path / "scans" / "dataset.toml").read_text().startswith('kind = "lidar-scans"')


def video(path: Path, images: np.ndarray) -> Path:
    film = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, images.shape[:0:-1])
    for image in images:
        film.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    film.release()
    return path


@pytest.mark.parametrize("is_side_by_side", [True, False])
def test_videos_become_a_folder_of_pairs(is_side_by_side: bool, tmp_path: Path) -> None:
    smooth = np.stack(
        [np.tile(np.arange(0, 240, 5, dtype=np.uint8), (48, 1)) // (1 + camera) for camera in (0, 1)]
    )
    films = np.repeat(smooth[:, None], 4, axis=1)
    if is_side_by_side:
        given = [str(video(tmp_path / "both.avi", np.concatenate(films, axis=2)))]
    else:
        given = [str(video(tmp_path / f"{name}.avi", film)) for name, film in zip("lr", films, strict=True)]
    assert main(["unpack", *given, "-o", str(tmp_path / "images")]) == 0
    pairs = stamped_pairs(tmp_path / "images", LossCount())
    np.testing.assert_allclose([pair.time for pair in pairs], [0.0, 0.1, 0.2, 0.3])
    for camera, path in enumerate((pairs[0].left, pairs[0].right)):
        image, cause = read_image(path)
        assert image is not None, cause
        assert np.abs(image.astype(int) - smooth[camera]).mean() < 4


def test_what_cannot_be_unpacked_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, nothing = bag(tmp_path, 2, "png"), tmp_path / "none.avi"
    nothing.write_bytes(b"RIFF nothing")
    for given, why in (
        ([str(path), "--topic", "/left"], "two of images"),
        ([str(path), "--topic", "/left", "/other"], "two of images"),
        ([str(path), "--rate", "10"], "of videos"),
        ([str(nothing)], "no decoder"),
    ):
        assert main(["unpack", *given, "-o", str(tmp_path / "out")]) == 2
        assert why in capsys.readouterr().err
        assert not (tmp_path / "out" / "cam0").exists()


def camera_bag(path: Path, topics: dict[str, str], infos: bool = True, count: int = 3) -> Path:
    """A ROS 2 bag of grey images, clouds and rates on the given topics, with the calibration of each camera."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types, told = store.types, set[str]()
    with Writer(path, version=9) as writer:

        def write(topic: str, kind: str, messages: list[Any]) -> None:
            opened = writer.add_connection(topic, kind, typestore=store)
            for k, message in enumerate(messages):
                stamp = START + k * 100_000_000
                writer.write(opened, stamp, store.serialize_cdr(message, kind))

        for side, (topic, kind) in enumerate(topics.items()):
            stamps = [START + k * 100_000_000 for k in range(count)]
            if kind == "image":
                made = [_image(types, each, GREY[side % 2, k], "mono8") for k, each in enumerate(stamps)]
                write(topic, "sensor_msgs/msg/Image", made)
                camera = topic.rsplit("/", 1)[0]
                if infos and camera not in told:
                    told.add(camera)
                    info = [_camera_info(types, each, side) for each in stamps[:1]]
                    write(f"{camera}/camera_info", "sensor_msgs/msg/CameraInfo", info)
            elif kind == "cloud":
                made = [_cloud(types, each, POINTS[k]) for k, each in enumerate(stamps)]
                write(topic, "sensor_msgs/msg/PointCloud2", made)
    return path


def _camera_info(types: Any, stamp: int, side: int) -> Any:
    """Calibration of a rectified pair with a baseline of 0.1 m."""
    P = [40.0, 0, 16, -4.0 * side, 0, 40, 12, 0, 0, 0, 1, 0]
    return types["sensor_msgs/msg/CameraInfo"](
        header=_header(types, stamp),
        height=SIZE[0],
        width=SIZE[1],
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.array([40.0, 0, 16, 0, 40, 12, 0, 0, 1]),
        r=np.eye(3).reshape(-1),
        p=np.array(P),
        binning_x=0,
        binning_y=0,
        roi=types["sensor_msgs/msg/RegionOfInterest"](
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        ),
    )


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache folder."""
    monkeypatch.setenv("SPINFILTERS_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_a_bag_of_two_calibrated_cameras_is_its_folder_of_images(cache: Path, tmp_path: Path) -> None:
    topics = {f"/stereo/{side}/{name}": "image" for name in ("image_raw", "debug") for side in SIDES}
    path = camera_bag(tmp_path / "bag", topics)
    found, left = unpacked_recording(str(path), NOTHING_STATED)
    assert cache in Path(found).parents
    assert left == NOTHING_STATED
    rig = read_raw_rig(Path(found))
    np.testing.assert_allclose(rig.relative_position, [-0.1, 0, 0])
    assert len(stamped_pairs(Path(found), LossCount())) == 3
    before = (Path(found) / "cam0" / "data.csv").stat().st_mtime_ns
    assert unpacked_recording(str(path), NOTHING_STATED)[0] == found
    assert (Path(found) / "cam0" / "data.csv").stat().st_mtime_ns == before  # it is unpacked once


@pytest.mark.usefixtures("cache")
def test_images_without_a_calibration_need_one_hint(tmp_path: Path) -> None:
    path = camera_bag(tmp_path / "bag", {f"/cam{k}/image_raw": "image" for k in (0, 1)}, infos=False)
    with pytest.raises(InputError, match="--rig"):
        unpacked_recording(str(path), NOTHING_STATED)
    write_raw_rig(read_raw_rig(Path(unpacked_recording(_calibrated(tmp_path), NOTHING_STATED)[0])), tmp_path)
    found, _ = unpacked_recording(str(path), ReadingOptions(rig=str(tmp_path)))
    assert (Path(found) / "cam1" / "sensor.yaml").is_file()


def _calibrated(place: Path) -> str:
    return str(camera_bag(place / "calibrated", {f"/{side}/image_raw": "image" for side in SIDES}))


@pytest.mark.usefixtures("cache")
def test_clouds_of_a_bag_are_its_scans_and_what_is_not_clear_is_listed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = camera_bag(tmp_path / "one", {"/points": "cloud"})
    found, _ = unpacked_recording(str(path), NOTHING_STATED)
    assert len(list((Path(found) / "scans").glob("*.ply"))) == 3
    several = camera_bag(tmp_path / "two", {"/front": "cloud", "/rear": "cloud"})
    assert main(["compare", str(several), "-o", str(tmp_path / "run")]) == 2
    said = capsys.readouterr().err
    assert "/front, /rear; give --topic" in said
    assert said.count("\n") == 1
    chosen, _ = unpacked_recording(str(several), ReadingOptions(topic="/rear"))
    assert chosen != found


@pytest.mark.parametrize(
    ("topics", "pair"),
    [
        (["/a/left/image_raw", "/a/right/image_raw"], 0),
        (
            [
                "/left/image_raw",
                "/left/image_raw/compressed",
                "/right/image_raw",
                "/right/image_raw/compressed",
            ],
            0,
        ),
        (["/camera/infra1/image_rect_raw", "/camera/infra2/image_rect_raw", "/camera/color"], 0),
        (["/a", "/b"], 0),
        (["/a", "/b", "/c"], None),
        (["/front/left/image", "/front/right/image", "/rear/left/image", "/rear/right/image"], None),
    ],
)
def test_the_left_and_the_right_are_told_by_their_names(topics: list[str], pair: int | None) -> None:
    found = stereo_pair(topics)
    assert (found is None) == (pair is None)
    assert found is None or found[0] == topics[0]
