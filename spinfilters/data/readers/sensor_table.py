"""Single file of one sensor: TUM poses, whatever sensors say they read."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from spinfilters.data.dataset import DATASET_FILE, INSPECTOR_FILE, LANDMARK_FILE, Dataset
from spinfilters.data.dataset_reader import DatasetReader
from spinfilters.data.input_file import path_text, printable, require_file, value_text
from spinfilters.data.measurement_log import MeasurementLog
from spinfilters.data.sensor_files import read_sensor_file
from spinfilters.data.sensor_format import sensor_formats
from spinfilters.data.truth import TRUTH_TABLE
from spinfilters.errors import InputError

_LARGEST_FILE = 2**63  # the reader that follows has its own limit


@dataclass(frozen=True)
class SensorTableReader(DatasetReader):
    """Any path that no other reader recognises.

    Attributes
    ----------
    readers: gives all readers, whose words say what can be read.
    """

    readers: Callable[[], Iterable[DatasetReader]]
    name, order = "sensor-table", 100
    words = ""

    def recognises(self, path: Path) -> bool:
        """Always: this reader is asked last."""
        return True

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Data set of the one table."""
        return _read_file(path, self.readers)


def _read_file(path: Path, readers: Callable[[], Iterable[DatasetReader]]) -> Dataset:
    require_file(path, _LARGEST_FILE)
    formats = sensor_formats().values()
    parts = [form.file for form in formats if not form.suffixes]
    if path.name in (DATASET_FILE, LANDMARK_FILE, INSPECTOR_FILE, TRUTH_TABLE, *parts):
        raise InputError(f"{path_text(path)}: is one part of a data set; give the folder that holds it")
    form = next((form for form in formats if path.suffix.lower() in form.suffixes), None)
    if form is None:
        raise InputError(
            f"{path_text(path)}: {value_text(path.suffix)} is no known kind of file; "
            f"give {_readable(readers())}, and unpack archives first"
        )
    log = MeasurementLog((read_sensor_file(form, path),))
    return Dataset(kind=form.kind, log=log, path=path, description=printable(path.name))


def _readable(readers: Iterable[DatasetReader]) -> str:
    """List of the formats that can be read."""
    singles = [form.suffix_words for form in sensor_formats().values() if form.suffixes]
    *others, last = [*dict.fromkeys(reader.words for reader in readers if reader.words), *singles]
    return f"{', '.join(others)} or {last}"
