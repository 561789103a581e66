"""The table of readers: one file each; one from outside the package reads what the others do not know."""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from contracts.plugin import installed_plugin, program_of

import spinfilters
from spinfilters.core.errors import InputError
from spinfilters.io.dataset_reader import DatasetReader
from spinfilters.run.readers import dataset_readers, read_dataset

DOCS = Path(__file__).parents[2] / "docs" / "how-to"
PROGRAM = program_of(DOCS / "add-a-reader.md")


@pytest.fixture
def module(tmp_path: Path) -> Iterator[Path]:
    """The module of the how-to page in an installed distribution, on the path."""
    with installed_plugin("spinfilters.readers", "numpy-gyro = numpy_gyro:READER", PROGRAM, tmp_path) as file:
        yield file


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    stream = spinfilters.simulate("gyro", seed=1, frames=40, interval=0.1).log.stream("gyro")
    path = tmp_path / "toss.npy"
    np.save(path, np.column_stack([stream.time, stream.values]))
    return path


def test_the_documentation_tells_the_order_of_the_readers() -> None:
    page = (DOCS / "add-a-reader.md").read_text()
    rows = dict(re.findall(r"^\| (\d+) \| (.+) \|$", page, re.MULTILINE))
    assert rows.pop(str(DatasetReader.order)).startswith("yours")
    assert sorted(map(int, rows)) == [reader.order for reader in dataset_readers()]


def test_a_file_that_no_reader_recognises_is_refused_with_what_can_be_given(tmp_path: Path) -> None:
    recording = tmp_path / "toss.rec"
    recording.write_bytes(b"REC\x00\x01\x02")
    with pytest.raises(InputError, match=r"give a folder, a phyphox export, .*, a gyro \.csv or a TUM"):
        spinfilters.load(recording)


@pytest.mark.usefixtures("module")
def test_a_format_from_outside_is_loaded_and_estimated(recording: Path) -> None:
    dataset = spinfilters.load(recording)
    assert dataset.kind == "gyro"
    np.testing.assert_array_equal(dataset.log.stream("gyro").time, np.load(recording)[:, 0])
    assert spinfilters.compare(recording, estimators="mekf")["mekf"].status != "failed"


@pytest.mark.usefixtures("module")
def test_what_a_format_from_outside_refuses_is_one_line(recording: Path) -> None:
    np.save(recording, np.zeros((5, 3)))
    with pytest.raises(InputError, match=r"toss.npy: is of shape \(5, 3\); give columns"):
        spinfilters.load(recording)
    with pytest.raises(InputError, match="has no segments"):
        read_dataset(recording, 1)
    with pytest.raises(InputError, match=r"a gyro \.npy"):
        spinfilters.load(recording.rename(recording.with_suffix(".xyz")))


def test_a_name_that_stands_twice_is_refused(module: Path) -> None:
    module.write_text(PROGRAM.replace('"numpy-gyro"', '"folder"'))
    with pytest.raises(InputError, match="'folder' is registered twice"):
        dataset_readers()


def test_a_recording_imports_only_what_may_read_it(tmp_path: Path) -> None:
    path = tmp_path / "turn.csv"
    path.write_text("time_s,wx,wy,wz\n" + "".join(f"{k / 10},0.1,0.2,0.3\n" for k in range(20)))
    program = (
        "import sys, spinfilters; spinfilters.load(sys.argv[1]); "
        "print(*(name for name in sys.modules if name.startswith(('spinfilters.io.', 'spinfilters.simulation'))))"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", program, path], capture_output=True, text=True, check=True
    ).stdout.split()
    assert "spinfilters.io.motion_file" in loaded
    for name in (
        "flight_logs",
        "ros_bag",
        "array_exports",
        "mvnx_file",
        "phone_exports",
        "attitude_ephemeris",
    ):
        assert f"spinfilters.io.{name}" not in loaded
    assert "spinfilters.simulation.scenario" not in loaded
