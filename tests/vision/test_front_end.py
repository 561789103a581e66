"""Front end on rendered images whose truth is known."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from spinfilters.cli.main import main
from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.cameras import stereo_pair
from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.run.readers import read_dataset
from spinfilters.vision.front_end import FrontEndOptions, StereoPoints
from spinfilters.vision.image_folder import (
    STAGE,
    ImagePair,
    LossCount,
    PairReader,
    StampedPair,
    read_pairs,
    stamped_pairs,
)
from spinfilters.vision.stereo_matching import DETECTORS
from spinfilters.vision.track_images import (
    TrackedImages,
    read_image_source,
    track_images,
    track_images_online,
)


@pytest.fixture(scope="module")
def tracked(rendered_folder: Path) -> TrackedImages:
    """Tracks of the rendered sequence."""
    return track_images(rendered_folder)


def _spread(dataset: Dataset) -> np.ndarray:
    """Distance in m of each observation, carried into g by the true pose, from the median of its landmark."""
    (stream,), truth = dataset.log.streams, dataset.truth
    assert truth is not None
    assert truth.center_of_mass_g is not None
    assert stream.ids is not None
    assert dataset.rig is not None
    R = matrix_from_quaternion(truth.q_ig)
    t = truth.center_of_mass - R @ truth.center_of_mass_g
    row = np.searchsorted(truth.time, stream.time - 1e-6)
    points = np.einsum(
        "nji,nj->ni",
        R[row],
        stereo_pair(dataset.rig.calibration).points_of(stream.values, dataset.rig.calibration) - t[row],
    )
    median = {own: np.median(points[stream.ids == own], axis=0) for own in np.unique(stream.ids)}
    return np.linalg.norm(points - np.array([median[own] for own in stream.ids]), axis=1)


def test_tracks_are_points_of_the_body(tracked: TrackedImages) -> None:
    spread = _spread(tracked.dataset)
    assert len(spread) > 200
    assert np.median(spread) < 0.003
    assert (spread > 0.015).mean() <= 0.01  # wrong tracks


def test_every_row_has_a_covariance_in_which_the_place_is_common_to_both_images(
    tracked: TrackedImages,
) -> None:
    (stream,) = tracked.dataset.log.streams
    assert stream.covariance is not None
    np.testing.assert_allclose(stream.covariance[:, 0, 2], stream.covariance[:, 0, 0])
    assert (stream.covariance[:, 2, 2] > stream.covariance[:, 0, 0]).all()


def test_the_same_images_give_the_same_tracks(rendered_folder: Path, tracked: TrackedImages) -> None:
    again = track_images(rendered_folder)
    np.testing.assert_array_equal(again.dataset.log.streams[0].values, tracked.dataset.log.streams[0].values)
    assert again.losses.document == tracked.losses.document


@pytest.mark.parametrize("brightness", [1.0, 0.1])
def test_around_the_last_points_the_same_points_are_found_as_in_whole_images(
    brightness: float, rendered_folder: Path
) -> None:
    source = read_image_source(rendered_folder, LossCount())
    reader = PairReader(source.rectification.rig.size, LossCount())
    first, second = [
        ImagePair(pair.time, *((brightness * image).astype(np.uint8) for image in pair[1:]))
        for pair in read_pairs(source.pairs[:2], reader)
        if pair is not None
    ]
    of_part, of_whole = (StereoPoints(source.rectification, FrontEndOptions(), LossCount()) for _ in range(2))
    of_part.of(first)
    part, whole = (finder.of(second).values for finder in (of_part, of_whole))
    apart = np.linalg.norm(part[:, None] - whole, axis=2).min(axis=0)
    assert (apart < 0.05).mean() > 0.8


@pytest.mark.parametrize("detector", DETECTORS)
def test_online_tracks_do_not_look_ahead(detector: str, rendered_folder: Path, tmp_path: Path) -> None:
    for camera in ("cam0", "cam1"):
        shutil.copytree(rendered_folder / camera, tmp_path / camera)
        lines = (tmp_path / camera / "data.csv").read_text().splitlines()
        (tmp_path / camera / "data.csv").write_text("\n".join(lines[:-2]) + "\n")
    options = FrontEndOptions(detector)
    short, whole = (track_images_online(folder, options) for folder in (tmp_path, rendered_folder))
    (first,), (all_of_it,) = short.dataset.log.streams, whole.dataset.log.streams
    np.testing.assert_array_equal(first.values, all_of_it.values[: len(first)])
    assert first.ids is not None
    assert all_of_it.ids is not None
    np.testing.assert_array_equal(first.ids, all_of_it.ids[: len(first)])
    assert (_spread(whole.dataset) > 0.02).mean() < 0.03


def test_the_command_writes_a_data_set_of_tracks(
    rendered_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["track", str(rendered_folder), "-o", str(tmp_path / "tracks")]) == 0
    assert "stereo matches:" in capsys.readouterr().out
    dataset = read_dataset(tmp_path / "tracks")
    assert dataset.kind == "stereo-tracks"
    assert dataset.truth is not None
    document = json.loads((tmp_path / "tracks" / "front_end.json").read_text())
    assert document["losses"]["image pairs"]["kept"] == 6


@pytest.fixture
def damaged(rendered_folder: Path, tmp_path: Path) -> Path:
    """A copy of the rendered sequence."""
    shutil.copytree(rendered_folder, tmp_path / "images")
    return tmp_path / "images"


def _image(folder: Path, camera: str, number: int) -> Path:
    return sorted((folder / camera / "data").iterdir())[number]


def test_images_that_cannot_be_used_are_counted_by_cause(damaged: Path) -> None:
    _image(damaged, "cam1", 2).unlink()
    names = sorted((damaged / "cam0" / "data").iterdir())
    names[2].write_bytes(b"no image")
    shutil.copy(_image(damaged, "cam0", 3), _image(damaged, "cam0", 4))
    cv2.imwrite(str(_image(damaged, "cam0", 5)), np.zeros((50, 40), dtype=np.uint8))
    tracked = track_images(damaged)
    lost = {cause: count for (stage, cause), count in tracked.losses.lost.items() if stage == STAGE}
    assert lost == {
        "not an image": 1,
        "repeated by a frozen camera (cam0)": 1,
        "of another size than 320 x 240": 1,
    }
    assert tracked.losses.kept[STAGE] == 3


def test_images_that_are_cut_short_are_counted_and_say_nothing(
    damaged: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = _image(damaged, "cam0", 1).read_bytes()
    _image(damaged, "cam0", 1).write_bytes(whole[: len(whole) // 2])
    _image(damaged, "cam1", 2).write_bytes(whole[:30])
    grey = cv2.imread(str(_image(damaged, "cam1", 3)), cv2.IMREAD_GRAYSCALE)
    assert grey is not None
    jpeg = cv2.imencode(".jpg", grey)[1].tobytes()
    _image(damaged, "cam1", 3).write_bytes(jpeg[: len(jpeg) // 2])
    reader = PairReader((320, 240), LossCount())
    pairs = list(read_pairs(stamped_pairs(damaged, reader.losses), reader))
    assert [pair is None for pair in pairs] == [False, True, True, True, False, False]
    assert reader.losses.lost == {(STAGE, "cut short"): 3}
    assert capfd.readouterr() == ("", "")


def test_a_damaged_image_is_counted_and_says_nothing(
    damaged: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = _image(damaged, "cam0", 1)
    content = bytearray(path.read_bytes())
    content[200:260] = bytes(60)
    path.write_bytes(content)
    reader = PairReader((320, 240), LossCount())
    pairs = list(read_pairs(stamped_pairs(damaged, reader.losses), reader))
    assert [pair is None for pair in pairs] == [False, True, False, False, False, False]
    assert reader.losses.lost == {(STAGE, "damaged"): 1}
    assert capfd.readouterr() == ("", "")


def test_an_eclipse_is_no_frozen_camera(damaged: Path) -> None:
    for number in (2, 3):
        for camera in ("cam0", "cam1"):
            cv2.imwrite(str(_image(damaged, camera, number)), np.zeros((240, 320), np.uint8))
    reader = PairReader((320, 240), LossCount())
    pairs = list(read_pairs(stamped_pairs(damaged, reader.losses), reader))
    assert [pair is None for pair in pairs] == [False, False, True, True, False, False]
    assert reader.losses.lost == {(STAGE, "of one grey value (cam0 and cam1)"): 2}


def test_a_body_that_never_moves_is_refused_for_its_frozen_cameras(damaged: Path) -> None:
    for camera in ("cam0", "cam1"):
        for number in range(1, 6):
            shutil.copy(_image(damaged, camera, 0), _image(damaged, camera, number))
    with pytest.raises(InputError, match=r"lost: 5 repeated by a frozen camera \(both cameras\)"):
        track_images(damaged)


@pytest.mark.parametrize(("bits", "channels"), [(8, 3), (12, 1), (16, 1), (16, 3)])
def test_colour_and_more_bits_tell_what_eight_grey_bits_tell(bits: int, channels: int, damaged: Path) -> None:
    paths = [_image(damaged, camera, 0) for camera in ("cam0", "cam1")]
    images = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths]
    for path, image in zip(paths, images, strict=True):
        assert image is not None
        deep = image.astype(np.uint16) << (bits - 8) if bits > 8 else image
        cv2.imwrite(str(path), np.repeat(deep[..., None], channels, axis=2))
    pair = PairReader((320, 240), LossCount()).read(StampedPair(0.0, paths[0], paths[1]))
    assert pair is not None
    for image, expected in zip(pair[1:], images, strict=True):
        np.testing.assert_array_equal(image, expected)


def test_a_calibration_of_another_camera_is_refused(damaged: Path) -> None:
    for camera in ("cam0", "cam1"):
        path = damaged / camera / "sensor.yaml"
        path.write_text(path.read_text().replace("[320, 240]", "[640, 480]"))
    with pytest.raises(
        InputError, match=r"none of 6 pairs.*cam0/sensor\.yaml.*6 of another size than 640 x 480"
    ):
        track_images(damaged)


def test_exchanged_cameras_are_refused_with_the_cure(damaged: Path) -> None:
    (damaged / "cam0" / "data").rename(damaged / "other")
    (damaged / "cam1" / "data").rename(damaged / "cam0" / "data")
    (damaged / "other").rename(damaged / "cam1" / "data")
    with pytest.raises(InputError, match=r"pose of 0 pair.*cam0 the left camera"):
        track_images(damaged)


def test_darker_images_of_one_epoch_lose_no_epoch(damaged: Path) -> None:
    for camera in ("cam0", "cam1"):
        path = _image(damaged, camera, 3)
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        cv2.imwrite(str(path), image // 2)
    tracked = track_images(damaged)
    assert tracked.losses.kept["epochs"] == 6


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda folder: shutil.rmtree(folder / "cam1" / "data"), "cam1/data.*no such folder"),
        (
            lambda folder: (folder / "cam0" / "sensor.yaml").unlink(),
            r"cam0/sensor\.yaml.*spinfilters calibrate",
        ),
        (
            lambda folder: (folder / "cam0" / "data.csv").write_text("1,2,3,/etc/passwd\n"),
            "line 1.*no name of a file",
        ),
        (lambda folder: (folder / "cam0" / "data.csv").write_text("soon,a.png\n"), "line 1.*no time in ns"),
        (lambda folder: (folder / "cam0" / "data.csv").write_text("5,a.png\n"), "common time stamps"),
        (
            lambda folder: [_image(folder, "cam0", k).write_bytes(b"x") for k in range(6)],
            "none of 6 pairs.*6 not an image",
        ),
    ],
)
def test_an_unusable_folder_is_refused_in_one_line(damage, words: str, damaged: Path) -> None:
    damage(damaged)
    with pytest.raises(InputError, match=words) as caught:
        track_images(damaged)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value).replace(str(damaged), "")) < 300


def test_black_images_have_no_motion(damaged: Path) -> None:
    for camera in ("cam0", "cam1"):
        for number in range(6):
            noise = np.random.default_rng(number).integers(0, 3, (240, 320)).astype(np.uint8)
            cv2.imwrite(str(_image(damaged, camera, number)), noise)
    with pytest.raises(InputError, match="pose of 0 pair"):
        track_images(damaged)
