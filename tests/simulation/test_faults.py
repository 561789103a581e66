"""Faults do what they say, from a seed, to measurements only."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.io.sensor_format import dataset_kinds
from spinfilters.models.feature_tracks import RIG
from spinfilters.models.sensors.gyro import GYRO_FULL_SCALE
from spinfilters.models.sensors.pose import POSE_REACH_M
from spinfilters.run.readers import read_dataset
from spinfilters.simulation.measurement_faults import (
    Dropout,
    Fault,
    FrozenEpochs,
    Outliers,
    PointsAtInfinity,
    WrongAssociations,
    with_faults,
)
from spinfilters.simulation.scenario import Scenario, simulate

DATASETS = {kind: simulate(Scenario.simplified(kind=kind, epochs=20)) for kind in dataset_kinds()}
TRACKS = DATASETS["stereo-tracks"]
STEREO_FAULTS = (
    WrongAssociations(0.3),
    Outliers(0.2),
    Dropout(2.0, 4.0),
    FrozenEpochs(5, 3),
    PointsAtInfinity(2),
)


def stereo(dataset: Dataset) -> tuple[MeasurementStream, np.ndarray]:
    """The stereo stream and its ids."""
    stream = dataset.log.stream("stereo")
    assert stream.ids is not None
    return stream, stream.ids


def rows_at(dataset: Dataset, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Ids and values of the epoch of this index."""
    stream, ids = stereo(dataset)
    rows = np.s_[stream.epoch_offsets[frame] : stream.epoch_offsets[frame + 1]]
    return ids[rows], stream.values[rows]


def same(one: Dataset, other: Dataset) -> bool:
    """Whether all measurements are bit by bit the same."""
    return all(
        np.array_equal(a.time, b.time)
        and np.array_equal(a.values, b.values)
        and (a.ids is None or b.ids is None or np.array_equal(a.ids, b.ids))
        for a, b in zip(one.log.streams, other.log.streams, strict=True)
    )


@pytest.mark.parametrize("fault", STEREO_FAULTS, ids=lambda fault: type(fault).__name__)
def test_a_fault_is_the_same_from_the_same_seed_and_leaves_all_but_the_measurements_alone(
    fault: Fault,
) -> None:
    hit = with_faults(TRACKS, [fault], 1)
    assert same(hit, with_faults(TRACKS, [fault], 1))
    assert not same(hit, TRACKS)
    for name in ("kind", "truth", "rig", "known_map", "options", "description"):
        assert getattr(hit, name) is getattr(TRACKS, name)


@pytest.mark.parametrize("fault", [WrongAssociations(0.3), Outliers(0.2), PointsAtInfinity(2)], ids=str)
def test_another_seed_draws_another_fault(fault: Fault) -> None:
    assert not same(with_faults(TRACKS, [fault], 1), with_faults(TRACKS, [fault], 2))


def test_wrong_associations_exchange_landmarks_of_a_fraction_of_every_epoch() -> None:
    hit = with_faults(TRACKS, [WrongAssociations(0.3)], 0)
    for frame in range(20):
        (ids, values), (wrong, same_values) = rows_at(TRACKS, frame), rows_at(hit, frame)
        np.testing.assert_array_equal(values, same_values)
        assert np.count_nonzero(ids != wrong) == round(0.3 * len(ids))
        np.testing.assert_array_equal(np.sort(ids), np.sort(wrong))


def test_outliers_lie_anywhere_in_the_images() -> None:
    hit = with_faults(TRACKS, [Outliers(0.5)], 0)
    (before, ids), (after, same_ids) = stereo(TRACKS), stereo(hit)
    np.testing.assert_array_equal(ids, same_ids)
    wrong = (before.values != after.values).any(axis=1)
    assert wrong.sum() == round(0.5 * len(before))
    size, drawn = np.array([RIG.left.width, RIG.left.height, RIG.left.width]), after.values[wrong]
    assert (drawn >= 0).all()
    assert (drawn < size).all()
    assert (drawn[:, 0] >= drawn[:, 2]).all()
    sampling = 4 / np.sqrt(len(drawn))
    np.testing.assert_allclose(
        (drawn / size).mean(axis=0), [2 / 3, 1 / 2, 1 / 3], atol=sampling / np.sqrt(12)
    )
    columns = np.concatenate([drawn[:, 0], drawn[:, 2]]) / RIG.left.width
    np.testing.assert_allclose(np.quantile(columns, [0.25, 0.75]), [0.25, 0.75], atol=sampling / 2)


@pytest.mark.parametrize(("sensor", "limit"), [("gyro", GYRO_FULL_SCALE), ("pose", POSE_REACH_M)])
def test_gyros_and_poses_have_outliers_too(sensor: str, limit: float) -> None:
    dataset = DATASETS[sensor]
    before = dataset.log.stream(sensor).values
    after = with_faults(dataset, [Outliers(0.25, sensor)], 3).log.stream(sensor).values
    wrong = (before != after).any(axis=1)
    assert wrong.sum() == 5
    assert (np.abs(after[wrong, :3]) <= limit).all()
    assert np.abs(after[wrong, :3]).max() > 0.5 * limit


@pytest.mark.parametrize("kind", dataset_kinds())
def test_a_dropout_takes_every_measurement_of_its_stretch_and_no_other(kind: str) -> None:
    hit = with_faults(DATASETS[kind], [Dropout(2.0, 4.0)], 0)
    before, after = DATASETS[kind].log.streams[0], hit.log.streams[0]
    np.testing.assert_array_equal(after.epoch_times, [t for t in before.epoch_times if t < 2.0 or t > 4.0])
    kept = (before.time < 2.0) | (before.time > 4.0)
    np.testing.assert_array_equal(after.values, before.values[kept])
    assert hit.truth is DATASETS[kind].truth


def test_a_frozen_camera_shows_one_epoch_under_new_stamps() -> None:
    hit = with_faults(TRACKS, [FrozenEpochs(5, 3)], 0)
    np.testing.assert_array_equal(stereo(hit)[0].epoch_times, stereo(TRACKS)[0].epoch_times)
    for frame in range(20):
        (ids, values), (shown_ids, shown) = (
            rows_at(TRACKS, 5 if 5 <= frame <= 8 else frame),
            rows_at(hit, frame),
        )
        np.testing.assert_array_equal(shown_ids, ids)
        np.testing.assert_array_equal(shown, values)


def test_a_gyro_freezes_too() -> None:
    before = DATASETS["gyro"].log.stream("gyro").values
    after = with_faults(DATASETS["gyro"], [FrozenEpochs(2, 4, "gyro")], 0).log.stream("gyro").values
    np.testing.assert_array_equal(after[2:7], np.tile(before[2], (5, 1)))
    np.testing.assert_array_equal(after[7:], before[7:])


def test_points_at_infinity_stand_still_without_disparity_under_ids_of_their_own() -> None:
    hit = with_faults(TRACKS, [PointsAtInfinity(3, 0.5)], 0)
    (before, ids), (after, all_ids) = stereo(TRACKS), stereo(hit)
    far = all_ids > ids.max()
    np.testing.assert_array_equal(after.values[~far], before.values)
    np.testing.assert_array_equal(all_ids[~far], ids)
    np.testing.assert_array_equal(after.time[far], before.epoch_times.repeat(3))
    assert np.unique(all_ids[far]).tolist() == [ids.max() + 1, ids.max() + 2, ids.max() + 3]
    pixels = after.values[far].reshape(20, 3, 3)
    noise = pixels - pixels.mean(axis=0)
    assert noise.std() == pytest.approx(0.5 * np.sqrt(19 / 20), rel=0.2)
    disparity = pixels[..., 0] - pixels[..., 2]
    assert abs(disparity.mean()) < 4 * 0.5 * np.sqrt(2 / 60)
    assert disparity.std() == pytest.approx(0.5 * np.sqrt(2), rel=0.4)


def test_tracks_with_every_fault_go_into_a_folder_and_come_back(tmp_path: Path) -> None:
    faults = (*STEREO_FAULTS, PointsAtInfinity(20, 3.0))
    hit = with_faults(TRACKS, faults, 0)
    write_dataset(hit, tmp_path / "faulty")
    assert same(read_dataset(tmp_path / "faulty"), hit)


def test_rows_keep_the_covariance_that_belongs_to_them() -> None:
    stream, ids = stereo(TRACKS)
    covariance = (1.0 + ids)[:, np.newaxis, np.newaxis] * np.eye(3)
    dataset = replace(TRACKS, log=MeasurementLog((replace(stream, covariance=covariance),)))
    faults = [Dropout(1.0, 2.0), FrozenEpochs(3, 2), PointsAtInfinity(1, 7.0)]
    hit, hit_ids = stereo(with_faults(dataset, faults, 0))
    assert hit.covariance is not None
    expected = np.where(hit_ids > ids.max(), 49.0, 1.0 + hit_ids)
    np.testing.assert_allclose(hit.covariance[:, 1, 1], expected)


def test_faults_come_one_upon_the_other_and_draw_on_their_own() -> None:
    both = with_faults(TRACKS, [WrongAssociations(0.3), Outliers(0.2)], 5)
    alone = with_faults(TRACKS, [WrongAssociations(0.3)], 5)
    assert stereo(both)[1].tolist() == stereo(alone)[1].tolist()
    assert same(with_faults(TRACKS, [], 5), TRACKS)
    pair = with_faults(TRACKS, [WrongAssociations(0.3), Outliers(0.0)], 5)
    assert same(pair, alone)


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        (Dropout(-1.0, 100.0), "leaves no stereo"),
        (FrozenEpochs(18, 2), "18 to 20"),
        (FrozenEpochs(3, -1), "3 to 2"),
        (Outliers(0.1, "gyro"), "no 'gyro'"),
    ],
    ids=str,
)
def test_a_fault_that_a_data_set_cannot_have_is_refused(fault: Fault, text: str) -> None:
    with pytest.raises(InputError, match=text):
        with_faults(TRACKS, [fault], 0)


@pytest.mark.parametrize("fraction", [-0.1, 1.1, np.nan])
def test_a_fraction_beyond_all_is_refused(fraction: float) -> None:
    for make in (WrongAssociations, Outliers):
        with pytest.raises(InputError, match="fraction"):
            make(fraction)
