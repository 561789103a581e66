"""A gross error hits one measurement of one epoch and nothing else."""

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.simulation.measurement_faults import GrossError, with_faults
from spinfilters.simulation.scenario import Scenario, simulate

DATASETS = {
    kind: simulate(Scenario.simplified(kind=kind, epochs=12)) for kind in ("gyro", "pose", "stereo-tracks")
}


def changed(dataset: Dataset, error: GrossError) -> tuple[np.ndarray, Dataset]:
    """Numbers of the rows that differ, and the data set with the error."""
    hit = with_faults(dataset, [error], 1)
    (old,), (new,) = dataset.log.streams, hit.log.streams
    differ = (old.values != new.values).any(axis=1)
    if old.ids is not None and new.ids is not None:
        differ |= old.ids != new.ids
    assert np.array_equal(old.time, new.time)
    return np.flatnonzero(differ), hit


@pytest.mark.parametrize(
    ("kind", "error"),
    [
        *(("gyro", error) for error in ("outlier", "flipped")),
        *(("pose", error) for error in ("outlier", "flipped", "turned")),
        *(("stereo-tracks", error) for error in ("outlier", "flipped")),
    ],
)
@pytest.mark.parametrize("epoch", [0, 5, -1])
def test_one_row_of_the_epoch_is_wrong(kind: str, error: str, epoch: int) -> None:
    dataset = DATASETS[kind]
    (row,), _ = changed(dataset, GrossError(error, epoch))
    stream = dataset.log.streams[0]
    assert stream.time[row] == np.unique(stream.time)[epoch]


def test_a_wrong_identity_exchanges_two_landmarks_of_the_epoch() -> None:
    dataset = DATASETS["stereo-tracks"]
    rows, hit = changed(dataset, GrossError("identity", 3))
    (old,), (new,) = dataset.log.streams, hit.log.streams
    assert old.ids is not None
    assert new.ids is not None
    assert np.array_equal(old.values, new.values)
    assert new.ids[rows].tolist() == old.ids[rows][::-1].tolist()
    assert len(rows) == 2
    assert set(old.time[rows]) == {np.unique(old.time)[3]}


def test_a_turned_pose_keeps_its_place_and_a_unit_quaternion() -> None:
    (row,), hit = changed(DATASETS["pose"], GrossError("turned", 4))
    old, new = DATASETS["pose"].log.streams[0].values[row], hit.log.streams[0].values[row]
    assert np.array_equal(old[:3], new[:3])
    assert np.linalg.norm(new[3:]) == pytest.approx(1.0)
    assert 2 * np.arccos(abs(old[3:] @ new[3:])) > 0.25


@pytest.mark.parametrize(
    ("kind", "error", "epoch", "message"),
    [
        ("gyro", "turned", 0, "no measurement of gyro is turned"),
        ("gyro", "identity", 0, "no landmarks among gyro measurements"),
        ("pose", "outlier", 12, "epoch 12 is none of the 12"),
        ("pose", "outlier", -13, "epoch -13 is none of the 12"),
    ],
)
def test_an_error_that_a_recording_cannot_have_is_refused(
    kind: str, error: str, epoch: int, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        with_faults(DATASETS[kind], [GrossError(error, epoch)], 0)


def test_a_kind_that_is_not_known_is_refused_with_all_that_are() -> None:
    with pytest.raises(InputError, match="give one of outlier, flipped, turned, identity"):
        GrossError("odd", 0)


@pytest.mark.parametrize("kind", ["gyro", "pose", "stereo-tracks"])
@pytest.mark.parametrize("epoch", [0, 5, -1])
def test_the_measurement_that_is_missing_is_the_one_that_an_outlier_spoils(kind: str, epoch: int) -> None:
    (row,), _ = changed(DATASETS[kind], GrossError("outlier", epoch))
    (old,) = DATASETS[kind].log.streams
    (new,) = with_faults(DATASETS[kind], [GrossError("missing", epoch)], 1).log.streams
    assert np.array_equal(new.values, np.delete(old.values, row, axis=0))
    assert np.array_equal(new.time, np.delete(old.time, row))
