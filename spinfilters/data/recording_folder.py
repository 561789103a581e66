"""A folder of several recordings of one body, which ``--segment auto`` takes together."""

import os
from pathlib import Path

from spinfilters.data.dataset_reader import dataset_readers, reader_of
from spinfilters.data.sensor_format import sensor_formats


def recordings_in(folder: Path) -> tuple[Path, ...]:
    """Recordings in a folder that is none itself, by name.

    Those of the commonest kind (data set folders and exports, or files of one suffix); none where there are not two.
    """
    if not os.path.isdir(folder) or _is_recording(folder):
        return ()
    by_kind: dict[str, list[Path]] = {}
    for path in sorted(folder.iterdir()):
        if _is_recording(path):
            by_kind.setdefault("" if os.path.isdir(path) else path.suffix.lower(), []).append(path)
    found = max(by_kind.values(), key=len, default=[])
    return tuple(found) if len(found) > 1 else ()


def _is_recording(path: Path) -> bool:
    """Whether a path, by its name or its files, looks like a recording."""
    reader, anything = reader_of(path), dataset_readers()[-1]
    if os.path.isdir(path):
        return reader.order < _FOLDERS
    suffixes = [suffix for form in sensor_formats().values() for suffix in form.suffixes]
    return reader.name != anything.name or path.suffix.lower() in suffixes


_FOLDERS = 90
"""Order of the reader of folders that no other recognises: see `DatasetReader`."""
