"""Zip archive of an export, unpacked for as long as it is read."""

import tempfile
import zipfile
from pathlib import Path, PurePosixPath
from typing import Final

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import MAX_TABLE_BYTES, largest_unpacked, path_text, reason, require_file

MOST_MEMBERS: Final = 1000
_READ = (".csv", ".tsv", ".txt", ".tum", ".toml")
_CHUNK = 1024**2


class Unpacked:
    """Temporary folder of an archive's text tables, as a context; InputErrors of what is done in it name the archive."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.place = tempfile.TemporaryDirectory(prefix="spinfilters-")

    def __enter__(self) -> Path:
        require_file(self.path, MAX_TABLE_BYTES)
        try:
            folder = Path(self.place.name) / self.path.stem
            folder.mkdir()
            return _unpack(self.path, folder)
        except InputError:
            self.place.cleanup()
            raise
        except Exception as error:  # the package meets a damaged archive with whatever its parsers raise
            self.place.cleanup()
            raise InputError(
                f"{path_text(self.path)}: cannot be unpacked ({reason(error)}); unpack it yourself and give the folder"
            ) from None
        except BaseException:
            self.place.cleanup()
            raise

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        inner = self.place.name
        self.place.cleanup()
        if isinstance(error, InputError):
            raise InputError(
                str(error).replace(str(Path(inner) / self.path.stem), path_text(self.path))
            ) from None


def _unpack(path: Path, place: Path) -> Path:
    """Write the tables of an archive, by their file names, into a folder; returns that."""
    with zipfile.ZipFile(path) as archive:
        members = [m for m in archive.infolist() if _is_table(m)]
        allowed = min(MAX_TABLE_BYTES, largest_unpacked(path.stat().st_size))
        if len(members) > MOST_MEMBERS or sum(m.file_size for m in members) > allowed:
            raise InputError(
                f"{path_text(path)}: holds too much; unpack it and give the folder of one recording"
            )
        if not members:
            raise InputError(f"{path_text(path)}: holds no table (.csv); export the recording as CSV")
        roots = {
            PurePosixPath(m.filename).parts[0] for m in members if len(PurePosixPath(m.filename).parts) > 1
        }
        nested = len(roots) == 1 and all(len(PurePosixPath(m.filename).parts) > 1 for m in members)
        for member in members:
            parts = PurePosixPath(member.filename).parts[1 if nested and roots != {"meta"} else 0 :]
            target = place.joinpath(*parts)
            target.parent.mkdir(parents=True, exist_ok=True)
            _write(archive, member, target)
    tables = [each for each in place.iterdir() if each.is_file()]
    return (
        tables[0] if len(tables) == 1 and tables[0].name not in ("Raw Data.csv", "Gyroscope.csv") else place
    )


def _is_table(member: zipfile.ZipInfo) -> bool:
    name = PurePosixPath(member.filename)
    safe = not name.is_absolute() and ".." not in name.parts and "\\" not in member.filename
    hidden = any(part.startswith((".", "__")) for part in name.parts)
    return (
        safe and not member.is_dir() and not hidden and name.suffix.lower() in _READ and len(name.parts) <= 3
    )


def _write(archive: zipfile.ZipFile, member: zipfile.ZipInfo, target: Path) -> None:
    """Unpack a member, no further than the size that it states."""
    with archive.open(member) as source, open(target, "xb") as file:
        left = member.file_size
        while chunk := source.read(_CHUNK):
            left -= len(chunk)
            if left < 0:
                raise zipfile.BadZipFile("a member is larger than it states")
            file.write(chunk)
