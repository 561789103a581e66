"""Tables in memory: arrays, mappings, data frames and files of the same numbers are one data set, with the same refusals."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spinfilters
from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.io.text_table import write_csv

GYRO = ("time_s", "wx", "wy", "wz")
POSES = ("time_s", "tx", "ty", "tz", "qx", "qy", "qz", "qw")


def same_measurements(first: Dataset, second: Dataset) -> bool:
    """Whether two data sets have the same streams, bit for bit."""
    pairs = zip(first.log.streams, second.log.streams, strict=True)
    return all(
        (a.sensor, a.time.tobytes(), a.values.tobytes()) == (b.sensor, b.time.tobytes(), b.values.tobytes())
        for a, b in pairs
    )


def table(kind: str) -> np.ndarray:
    """Time and values of a simulated sensor, a row each."""
    stream = spinfilters.simulate(kind, frames=30, seed=3).log.streams[0]
    return np.column_stack([stream.time, stream.values])


FORMS: dict[str, Callable[[np.ndarray, tuple[str, ...]], Any]] = {
    "array": lambda rows, _names: rows,
    "pair": lambda rows, _names: (rows[:, 0], rows[:, 1:]),
    "mapping": lambda rows, names: dict(zip(names, rows.T, strict=True)),
    "lists": lambda rows, names: {name: column.tolist() for name, column in zip(names, rows.T, strict=True)},
    "records": lambda rows, names: np.array(
        list(map(tuple, rows.tolist())), dtype=[(name, float) for name in names]
    ),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("kind", "names"), [("gyro", GYRO), ("pose", POSES)])
def test_a_table_in_memory_is_the_file_of_the_same_numbers(
    tmp_path: Path, kind: str, names: tuple[str, ...], form: str
) -> None:
    rows = table(kind)
    write_csv(tmp_path / "mine.csv", names, list(rows.T))
    given = FORMS[form](rows, names)
    assert same_measurements(spinfilters.load(given, kind=kind), spinfilters.load(tmp_path / "mine.csv"))


def test_a_data_frame_is_the_file_of_the_same_numbers(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    rows = table("gyro")
    write_csv(tmp_path / "mine.csv", GYRO, list(rows.T))
    frame = pandas.DataFrame(rows, columns=GYRO)
    read = spinfilters.load(tmp_path / "mine.csv")
    assert same_measurements(spinfilters.load(frame), read)
    assert same_measurements(spinfilters.load(frame.set_index("time_s")), read)


START = np.datetime64("2026-11-26T12:00:00.25")
CLOCKS: dict[str, tuple[list[str], Callable[[Any, np.ndarray], Any] | None]] = {
    "ISO text": ([], None),
    "dates of NumPy": ([], lambda _pandas, instants: instants),
    "dates in us": ([], lambda _pandas, instants: instants.astype("M8[us]")),
    "Timestamps": ([], lambda pandas, instants: list(pandas.to_datetime(instants))),
    "a time zone": (
        ["+02:00"],
        lambda pandas, instants: pandas.to_datetime(instants).tz_localize("Etc/GMT-2"),
    ),
    "Python's datetimes": ([], lambda _pandas, instants: instants.astype("M8[us]").tolist()),
    "times of the day": ([], None),
    "durations": ([], lambda pandas, instants: pandas.to_timedelta(instants - START)),
}
"""Zone behind the text of an instant, and the same clock of a data frame; None for the text itself."""


@pytest.mark.parametrize("clock", CLOCKS)
def test_a_clock_of_dates_in_memory_is_that_of_the_file(tmp_path: Path, clock: str) -> None:
    pandas = pytest.importorskip("pandas")
    instants = START + np.arange(30) * np.timedelta64(20_000_123, "ns")
    instants = instants.astype("M8[us]").astype("M8[ns]")
    zone, make = CLOCKS[clock]
    written = [f"{instant}{''.join(zone)}" for instant in instants]
    if clock == "times of the day":
        written = [each.split("T")[1] for each in written]
    if clock == "durations":
        written = [f"0 days 00:00:0{(i - START) / np.timedelta64(1, 's'):.6f}" for i in instants]
    rates = table("gyro")[:30, 1:]
    rows = [",".join([when, *map(repr, rate)]) for when, rate in zip(written, rates.tolist(), strict=True)]
    (tmp_path / "mine.csv").write_text("time,wx,wy,wz\n" + "\n".join(rows) + "\n")
    read = spinfilters.load(tmp_path / "mine.csv")
    held = written if make is None else make(pandas, instants)
    columns = {"time": held, **dict(zip(("wx", "wy", "wz"), rates.T, strict=True))}
    frame = pandas.DataFrame(columns)
    given = [columns, frame, frame.set_index("time")]
    if make is None or isinstance(held, np.ndarray):
        pair = np.asarray(held), rates
        assert same_measurements(spinfilters.load(pair, kind="gyro"), read)
    assert all(same_measurements(spinfilters.load(each), read) for each in given)
    np.testing.assert_allclose(np.diff(read.log.streams[0].time), 0.02, atol=2e-6)


@pytest.mark.parametrize(
    ("clock", "message"),
    [
        (
            ["2026-11-26T12:00:00Z", "soon", "2026-11-26T12:00:02Z"],
            "row 1: 'time' is 'soon', no date or time",
        ),
        (np.array(["2026-01-01", "NaT", "2026-01-03"], dtype="M8[s]"), "row 1: 'time' is nan, not finite"),
        (
            [0.0, "2026-11-26T12:00:01Z", 2.0],
            "row 1: 'time' is '2026-11-26T12:00:01Z', not a number; give seconds",
        ),
    ],
)
def test_a_cell_that_is_no_date_among_dates_is_named(clock: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        spinfilters.load({"time": clock, "wx": [0.1, 0.2, 0.3], "wy": [0.1, 0.2, 0.3], "wz": [0.1, 0.2, 0.3]})


def test_every_form_gives_the_same_estimates_bit_for_bit(tmp_path: Path) -> None:
    rows = table("gyro")
    write_csv(tmp_path / "mine.csv", GYRO, list(rows.T))
    runs = [
        spinfilters.compare(data, "mekf", kind=kind)
        for data, kind in (
            (str(tmp_path / "mine.csv"), None),
            (rows, "gyro"),
            (dict(zip(GYRO, rows.T, strict=True)), None),
        )
    ]
    ends = [
        run["mekf"].trajectory.rate_i.tobytes() + run["mekf"].body.principal_moments.tobytes() for run in runs
    ]
    assert ends[0] == ends[1] == ends[2]


def test_tracks_and_covariances_are_taken_as_from_a_folder(tmp_path: Path) -> None:
    made = spinfilters.simulate("mono-tracks", frames=12, seed=2)
    write_dataset(made, tmp_path / "tracks")
    stream = made.log.streams[0]
    ids = stream.ids
    given = Dataset.from_arrays("mono-tracks", stream.time, stream.values, ids=ids, rig=made.rig)
    assert same_measurements(given, spinfilters.load(tmp_path / "tracks"))
    assert given.log.streams[0].ids is not None
    np.testing.assert_array_equal(given.log.streams[0].ids, ids)
    rows = table("gyro")
    weights = np.tile(1e-4 * np.eye(3), (len(rows), 1, 1))
    weighted = Dataset.from_arrays("gyro", rows[:, 0], rows[:, 1:], covariance=weights)
    np.testing.assert_array_equal(weighted.log.streams[0].covariance, weights)


def test_units_of_a_table_are_those_of_a_file() -> None:
    rows = table("gyro")
    degrees = {"t": 1e3 * rows[:, 0], **dict(zip(("gx", "gy", "gz"), np.degrees(rows[:, 1:]).T, strict=True))}
    read = spinfilters.load(degrees, units={"time": "ms", "rate": "deg/s"}).log.streams[0]
    np.testing.assert_allclose(read.values, rows[:, 1:], rtol=1e-14)
    np.testing.assert_allclose(read.time, rows[:, 0], rtol=1e-14)
    with pytest.raises(InputError, match="do not say their unit"):
        spinfilters.load(degrees, units={"time": "ms"})


@pytest.mark.parametrize(
    ("kind", "options", "unit"),
    [
        ("gyro", {"units": {"time": "ms", "rate": "deg/s"}}, np.radians(1.0)),
        ("gyro", {"clock": "ms"}, 1.0),
        ("pose", {"units": {"time": "ms", "position": "m"}}, 1.0),
    ],
)
def test_the_clock_of_an_array_is_in_the_stated_unit(kind: str, options: dict[str, Any], unit: float) -> None:
    rows = table(kind)
    time, values = 1e3 * rows[:, 0], rows[:, 1:] / unit
    for given in (np.column_stack([time, values]), (time, values)):
        read = spinfilters.load(given, kind=kind, **options).log.streams[0]
        np.testing.assert_allclose(read.time, rows[:, 0], rtol=1e-14)
        np.testing.assert_allclose(read.values, rows[:, 1:], rtol=1e-14)


def test_rows_without_rates_are_left_out_as_empty_cells_are() -> None:
    rows = table("gyro")
    rows[3, 1:] = np.nan
    dataset = spinfilters.load(rows, kind="gyro")
    assert len(dataset.log.streams[0]) == len(rows) - 1
    assert "1 rows without rates left out" in dataset.description


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"wx": [0.1, 0.2, np.nan, 0.4, 0.5]}, "row 2: 'wx' is nan, not finite"),
        ({"wx": [0.1, "fast", 0.3, 0.4, 0.5]}, "row 1: 'wx' is 'fast', not a number"),
        ({"time_s": [0.0, 0.1, 0.3, 0.2, 0.4]}, "row 3: time 0.2 s follows 0.3 s"),
        ({"wy": [0.1, 0.2]}, "columns differ in length"),
        ({"wy": np.zeros((5, 2))}, "give one value a row"),
        ({"wy": [0.1, 0.2, 500.0, 0.2, 0.1]}, "row 2: a rate of"),
    ],
)
def test_a_wrong_row_is_named_with_its_number(change: dict[str, Any], message: str) -> None:
    good = {name: [0.0, 0.1, 0.2, 0.3, 0.4] for name in GYRO}
    with pytest.raises(InputError, match=message):
        spinfilters.load({**good, **change})


@pytest.mark.parametrize(
    ("given", "options", "message"),
    [
        (np.zeros((5, 4)), {}, "give kind="),
        (np.zeros((5, 3)), {"kind": "gyro"}, "has 4 columns: time_s, wx, wy, wz"),
        (np.zeros((5, 4)), {"kind": "gyro", "rate": 2.0}, "wx, wy, wz; with a rate, leave the clock out"),
        (5, {}, "give a path, a data set, a DataFrame"),
        ({}, {}, "give a path, a data set, a DataFrame"),
        ({"time_s": [0.0, 1.0]}, {"kind": "mono-tracks"}, "has no column landmark_id"),
        ({"time_s": [0.0, 1.0]}, {"kind": "scent"}, "kind 'scent' is unknown"),
        (np.zeros((5, 4)), {"kind": "gyro", "units": "knots"}, "knots"),
        (np.zeros((5, 4)), {"kind": "gyro", "units": {"smell": "m"}}, "use time, rate, position"),
    ],
)
def test_what_is_no_table_is_refused_with_what_to_give(
    given: Any, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        spinfilters.load(given, **options)
