"""What is no checkpoint of a run is refused in words: damage, hostile files, and the checkpoints of other runs."""

import io
import json
import os
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.filters.history import GrowingHistory
from spinfilters.filters.timeline import run
from spinfilters.run.array_files import read_arrays, write_arrays
from spinfilters.run.checkpoints import CHECKPOINT_FILE, checkpoint_stores, load_checkpoint, save_checkpoint
from spinfilters.run.estimation import compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.simulation.scenario import Scenario, simulate
from tests.run.checkpoint_samples import SETTINGS, epochs_to_do, fingerprint, fresh, sample, silent


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A good checkpoint of the EKF after 9 epochs, not to be changed."""
    estimator, path = fresh("mekf"), tmp_path_factory.mktemp("checkpoint") / "checkpoint.npz"
    rows, rest = GrowingHistory(estimator.layout, sample().end_of_initialisation), sample().timeline
    run(estimator, sample().end_of_initialisation, rest[-epochs_to_do() :][:9], None, rows)
    save_checkpoint(path, estimator, rows, fingerprint("mekf"))
    return path


Change = Callable[[Path], object]


def arrays_with(**changes: object) -> Change:
    """Change arrays of a file; None leaves one out. Dots of the names are written as two underscores."""

    def change(path: Path) -> None:
        arrays = read_arrays(path) | {name.replace("__", "."): value for name, value in changes.items()}
        with path.open("wb") as stream:
            np.savez(stream, **{k: v for k, v in arrays.items() if v is not None})  # pyright: ignore[reportArgumentType]

    return change


def spoilt(array: str, value: float) -> Change:
    """Change the last element of an array."""

    def change(path: Path) -> None:
        arrays = read_arrays(path)
        arrays[array].flat[-1] = value
        write_arrays(path, arrays)

    return change


def meta_with(**changes: object) -> Change:
    """Change entries of the metadata."""

    def change(path: Path) -> None:
        arrays = read_arrays(path)
        meta = json.loads(str(arrays["meta"])) | changes
        write_arrays(path, arrays | {"meta": np.array(json.dumps(meta))})

    return change


def cut_to(size: int) -> Change:
    """Cut a file off."""
    return lambda path: path.write_bytes(path.read_bytes()[:size])


def flipped(place: int) -> Change:
    """Change a bit in the middle of the arrays."""

    def change(path: Path) -> None:
        data = bytearray(path.read_bytes())
        data[place] ^= 4
        path.write_bytes(data)

    return change


def member(data: bytes, compression: int = zipfile.ZIP_STORED) -> Change:
    """Put other bytes in the place of an array."""

    def change(path: Path) -> None:
        arrays = read_arrays(path)
        del arrays["state.factor"]
        write_arrays(path, arrays)
        with zipfile.ZipFile(path, "a", compression) as archive:
            archive.writestr("state.factor.npy", data)

    return change


def header(shape: tuple[int, ...], descr: str = "<f8") -> bytes:
    """A .npy file that claims a shape and holds a few bytes."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": descr, "fortran_order": False, "shape": shape})
    return stream.getvalue() + bytes(64)


DAMAGE: dict[str, Change] = {
    "nothing": cut_to(0),
    "cut off early": cut_to(200),
    "cut off in the middle": cut_to(20_000),
    "last byte missing": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    "a bit changed": flipped(20_000),
    "text": lambda path: path.write_text("checkpoint", encoding="utf-8"),
    "a folder": lambda path: (path.unlink(), path.mkdir()),
    "a pipe": lambda path: (path.unlink(), os.mkfifo(path)),
    "objects": arrays_with(state__mean=np.array([{}], dtype=object)),
    "metadata of objects": arrays_with(meta=np.array({}, dtype=object)),
    "no metadata": arrays_with(meta=None),
    "metadata that is no JSON": arrays_with(meta=np.array("{")),
    "metadata nested without end": arrays_with(meta=np.array(100_000 * "[")),
    "metadata that is a list": arrays_with(meta=np.array("[]")),
    "another format": meta_with(format=99),
    "identity missing": meta_with(identity={}),
    "identity that is none": meta_with(identity=3),
    "no beginning": meta_with(begin=None),
    "beginning that is not finite": meta_with(begin=float("nan")),
    "unknown verdict": meta_with(ended={"verdict": "fine", "reasons": []}),
    "state missing": arrays_with(state__factor=None),
    "state of another shape": arrays_with(state__mean=np.zeros(3)),
    "state of words": arrays_with(state__mean=np.array(["a"])),
    "state that is not finite": spoilt("state.mean", np.nan),
    "state of another frame": spoilt("state.mean", 0.25),
    "rows missing": arrays_with(rows__nis=None),
    "rows of another shape": arrays_with(rows__factor=np.zeros((9, 3, 3))),
    "a row too few": arrays_with(rows__nis=np.zeros(8)),
    "rows of fractions": arrays_with(rows__dof=np.zeros(9)),
    "rows that are not finite": spoilt("rows.nis", np.inf),
    "header of a petabyte": member(header((1 << 47,))),
    "header of more than there is": member(header((20, 20))),
    "header beyond all integers": member(header((10**30, 0))),
    "header of negative shape": member(header((-1, -1))),
    "header of objects": member(header((8,), "|O")),
    "header of nested brackets": member(b"\x93NUMPY\x01\x00\x00\x10" + 4096 * b"("),
    "bomb": member(header((1 << 24,)) + bytes(1 << 27), zipfile.ZIP_DEFLATED),
    "packed otherwise": member(header((8,)), zipfile.ZIP_LZMA),
}


@pytest.mark.parametrize("change", DAMAGE.values(), ids=DAMAGE.keys())
def test_a_damaged_checkpoint_is_refused_in_one_line(
    change: Change, checkpoint: Path, tmp_path: Path
) -> None:
    path = tmp_path / "checkpoint.npz"
    path.write_bytes(checkpoint.read_bytes())
    change(path)
    with pytest.raises(InputError) as refused:
        load_checkpoint(path, fresh("mekf"), fingerprint("mekf"))
    text = str(refused.value)
    assert text.startswith(f"{path}: is no whole checkpoint (")
    assert "without --resume" in text
    assert len(text) < len(str(path)) + 320
    assert text.isprintable()


def test_epochs_of_another_time_are_refused(checkpoint: Path, tmp_path: Path) -> None:
    path = tmp_path / "mekf" / CHECKPOINT_FILE
    path.parent.mkdir()
    path.write_bytes(checkpoint.read_bytes())
    arrays = read_arrays(path)
    write_arrays(path, arrays | {"rows.time": arrays["rows.time"] + 0.5})
    with pytest.raises(InputError, match="epochs are not the first"):
        checkpoint_stores(tmp_path, sample(), SETTINGS)("mekf").resume(fresh("mekf"))


def test_a_checkpoint_of_other_settings_names_the_setting(checkpoint: Path) -> None:
    with pytest.raises(InputError, match=r"process\.force_psd = 'auto', now it is 1e-07; .*--resume"):
        load_checkpoint(checkpoint, fresh("mekf"), fingerprint("mekf", force_psd=1e-7))


def test_a_checkpoint_of_other_estimators_in_the_list_goes_on(checkpoint: Path) -> None:
    mine = fingerprint("mekf")
    assert "estimators" not in mine.settings
    assert len(load_checkpoint(checkpoint, fresh("mekf"), mine).rows) == 9


def test_a_checkpoint_of_another_estimator_is_refused(checkpoint: Path) -> None:
    with pytest.raises(InputError, match="of the estimator 'mekf', not of ukf"):
        load_checkpoint(checkpoint, fresh("ukf"), fingerprint("ukf"))


def test_a_checkpoint_of_another_version_names_both(checkpoint: Path) -> None:
    mine = fingerprint("mekf")
    newer = replace(mine, versions={**mine.versions, "casadi": "99.1"})
    with pytest.raises(InputError, match=r"made with casadi '.*', this is '99\.1'"):
        load_checkpoint(checkpoint, fresh("mekf"), newer)


def test_a_checkpoint_of_another_start_is_refused(checkpoint: Path) -> None:
    other = replace(fingerprint("mekf"), start="0" * 64)
    with pytest.raises(InputError, match="initialisation gives other numbers"):
        load_checkpoint(checkpoint, fresh("mekf"), other)


def test_a_checkpoint_of_other_measurements_is_refused(checkpoint: Path, tmp_path: Path) -> None:
    """Of the same shape, time stamps and settings: another seed."""
    other = prepare(simulate(Scenario.simplified(epochs=70, landmarks=60, seed=1)), SETTINGS)
    (tmp_path / "mekf").mkdir()
    (tmp_path / "mekf" / CHECKPOINT_FILE).write_bytes(checkpoint.read_bytes())
    with pytest.raises(InputError, match="other measurements"):
        compare_estimators(other, SETTINGS, silent, checkpoint_stores(tmp_path, other, SETTINGS))
