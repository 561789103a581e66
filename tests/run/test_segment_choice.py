"""Segments by number, by times and as they are found."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import spinfilters
from spinfilters.core.errors import InputError
from spinfilters.run.free_flight import find_flights, flights_within
from spinfilters.run.segment_choice import read_several, segment_choice
from tests.run.throws import FLIGHTS, carried

PHONE = "data/round1/Gyroscope rotation rate 2025-01-16 17-10-11"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A table of two throws in deg/s with a clock in ms."""
    log = carried(0.005, np.random.default_rng(1))
    path = tmp_path_factory.mktemp("throws") / "throws.csv"
    rows = np.column_stack([1e3 * log.time, np.rad2deg(log.rates)])
    np.savetxt(path, rows, delimiter=";", header="t_ms;gyr_x_dps;gyr_y_dps;gyr_z_dps", comments="")
    return path


def test_flights_are_found_and_numbered_from_one(recording: Path) -> None:
    found = read_several(recording, "auto")
    assert [each.segment.number for each in found if each.segment] == [1, 2]
    for dataset, (start, end) in zip(found, FLIGHTS, strict=True):
        assert dataset.log.start == pytest.approx(start, abs=0.06)
        assert dataset.log.end == pytest.approx(end, abs=0.06)
    second = spinfilters.load(recording, segment=2)
    assert second.log.start == found[1].log.start
    assert "momentum kept to" in second.description


def test_a_segment_is_chosen_by_its_times(recording: Path) -> None:
    dataset = spinfilters.load(recording, segment="2.1:2.9")
    assert (dataset.log.start, dataset.log.end) == pytest.approx((2.1, 2.9), abs=0.011)
    assert "segment 2.1:2.9" in dataset.name
    assert spinfilters.load(recording, segment=":1").log.end == pytest.approx(1.0, abs=0.011)


@pytest.mark.parametrize(
    ("segment", "says"),
    [
        (3, "has no segment 3; found are 1 to 2"),
        ("auto", "holds 2 segments; choose one"),
        ("soon", "is no segment; give a number, times START:END in s, 'all' or 'auto'"),
        (":", "is no segment"),
        ("nan:2", "is no segment"),
        ("3:2", "ends before it starts"),
        ("100:200", "no measurement between"),
    ],
)
def test_a_segment_that_is_none_is_refused_with_what_to_give(
    segment: int | str, says: str, recording: Path
) -> None:
    with pytest.raises(InputError, match=says):
        spinfilters.load(recording, segment=segment)


def test_a_recording_without_flight_says_so(tmp_path: Path) -> None:
    time = np.arange(0, 3, 0.01)
    path = tmp_path / "still.csv"
    np.savetxt(
        path,
        np.column_stack([time, np.zeros((len(time), 3))]),
        delimiter=",",
        header="time_s,wx,wy,wz",
        comments="",
    )
    with pytest.raises(
        InputError, match=r"no free flight found in 2\.99 s; give its times as --segment START:END"
    ):
        read_several(path, "auto")


def test_what_is_flight_of_a_whole_recording_is_told_unless_all_of_it_is(recording: Path) -> None:
    whole = spinfilters.load(recording)
    assert [round(flight.start, 1) for flight in flights_within(whole)] == [2.0, 4.5]
    assert flights_within(spinfilters.load(recording, segment=1)) == []


def test_flight_in_tracks_is_not_looked_for() -> None:
    choice = segment_choice("auto")
    assert choice.several == "auto"
    with pytest.raises(
        InputError, match="free flight is found in body rates and poses, these are stereo-tracks"
    ):
        find_flights(spinfilters.simulate("stereo-tracks", frames=10))


def test_the_throws_of_a_phone_are_found_where_they_were_marked(shared_data: Callable[[str], Path]) -> None:
    path = shared_data("racquet_phyphox") / PHONE
    marked, found = (read_several(path, which) for which in ("all", "auto"))
    spans = [(each.log.start, each.log.end) for each in found]
    assert len(found) == len(marked) + 1  # and one that was marked as no trial
    for dataset in marked:
        start, end = min(spans, key=lambda span: abs(span[0] - dataset.log.start))
        assert dataset.log.start - 0.1 < start < end < dataset.log.end + 0.05
        assert end - start > 0.45 * (dataset.log.end - dataset.log.start)
