"""The recordings of `../shared/data`, as their PROVENANCE.md describes them."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spinfilters.core.errors import InputError
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.io.phone_exports import read_phyphox
from spinfilters.models.sensors.gyro import saturated
from spinfilters.run.readers import read_dataset, read_segments
from tests.io.log_samples import REAL_DATA

PHYPHOX = REAL_DATA / "racquet_phyphox" / "data"
ROUND1 = PHYPHOX / "round1" / "Gyroscope rotation rate 2025-01-16 17-10-11"


def present(path: Path) -> Path:
    """The path, or a skip when this machine does not have the recording."""
    if not path.exists():
        pytest.skip(f"no recording at {path}")
    return path


@pytest.mark.parametrize(("name", "rows"), [("thesis-0", 24723), ("thesis-2", 24465), ("rich-1", 24723)])
def test_disam115_has_the_epochs_landmarks_and_rig_of_its_provenance(name: str, rows: int) -> None:
    dataset = read_dataset(present(REAL_DATA / "disam115" / name))
    stereo, rig = dataset.log.stream("stereo"), dataset.rig
    assert stereo.ids is not None
    assert (len(stereo), len(stereo.epoch_times), len(np.unique(stereo.ids))) == (rows, 115, 2447)
    assert rig is not None
    assert rig.calibration.tolist() == [466.7, 466.7, 320.0, 240.0, 0.09]
    assert dataset.options.pixel_std == 1.0


def test_disam115_truth_turns_at_the_rate_it_states() -> None:
    truth = read_dataset(present(REAL_DATA / "disam115" / "thesis-0")).truth
    assert truth is not None
    assert truth.body == {}
    np.testing.assert_array_equal(truth.time, 0.5 * np.arange(115))
    turned = Rotation.from_quat(truth.q_ig[1:]) * Rotation.from_quat(truth.q_ig[:-1]).inv()
    mean_rate = 0.5 * (truth.rate_i[1:] + truth.rate_i[:-1])
    assert (
        np.abs(turned.as_rotvec() / 0.5 - mean_rate).max() < 0.02
    )  # body axes or q_gi would miss by 1 rad/s


def test_disam115_survives_being_written_and_read(tmp_path: Path) -> None:
    dataset = read_dataset(present(REAL_DATA / "disam115" / "thesis-0"))
    write_dataset(dataset, tmp_path)
    again = read_dataset(tmp_path)
    for name in ("time", "values", "ids"):
        first, second = dataset.log.stream("stereo"), again.log.stream("stereo")
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_round1_keeps_six_flights_and_refuses_segment_0() -> None:
    flights = read_segments(present(ROUND1))
    assert [flight.segment.number for flight in flights if flight.segment] == [1, 2, 3, 4, 5, 6]
    with pytest.raises(InputError, match="segment 0 is not a trial"):
        read_dataset(ROUND1, 0)
    with pytest.raises(InputError, match="--segment"):
        read_dataset(ROUND1)


def test_a_flight_is_sampled_at_100_hz_within_its_segment() -> None:
    flight = read_dataset(present(ROUND1), 3)
    stream = flight.log.stream("gyro")
    assert flight.log.start >= 25.2
    assert flight.log.end <= 26.25
    np.testing.assert_allclose(np.diff(stream.time), 0.01002, atol=2e-6)


@pytest.mark.parametrize(
    ("recording", "rows", "kept"),
    [
        ("round1/Gyroscope rotation rate 2025-01-16 17-03-03", 882, 1),
        ("round1/Gyroscope rotation rate 2025-01-16 17-10-11", 5459, 6),
        ("round2/Gyroscope rotation rate 2025-01-23 18-29-01", 10064, 5),
        ("round3/Gyroscope rotation rate 2025-02-14 09-35-02", 34471, 25),
        ("round3/Gyroscope rotation rate 2025-02-14 10-47-18", 31138, 32),
    ],
)
def test_the_gyro_never_clips_inside_a_kept_flight(recording: str, rows: int, kept: int) -> None:
    folder = present(PHYPHOX / recording)
    assert len(read_phyphox(folder).time) == rows
    flights = read_segments(folder)
    assert len(flights) == kept
    clipped = [int(saturated(flight.log.stream("gyro").values).sum()) for flight in flights]
    assert sum(clipped) == 0


@pytest.mark.parametrize(
    ("recording", "count"),
    [
        ("round3/Gyroscope rotation rate 2025-02-14 09-35-02", 3),
        ("round3/Gyroscope rotation rate 2025-02-14 10-47-18", 4),
    ],
)
def test_the_gyro_clips_at_the_catches_between_the_flights(recording: str, count: int) -> None:
    rate = read_phyphox(present(PHYPHOX / recording)).rate
    clipped = saturated(rate)
    assert np.count_nonzero(clipped) == count
    assert (np.abs(rate[clipped]).max(axis=1) > 34.8).all()
