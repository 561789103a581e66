"""Libraries that come with a wheel: found by their text, the best of this machine's instructions, without a compiler."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from spinfilters.core import c_library, shipped_libraries
from spinfilters.core.c_library import FLAGS, load_text
from spinfilters.core.shipped_libraries import NATIVE, levels, shipped_library, shipped_name

TEXT = "long long number(void) { return 3; }\n"
OTHER = "long long number(void) { return 4; }\n"


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of shipped libraries of this test alone."""
    monkeypatch.setattr(shipped_libraries, "FOLDER", tmp_path)
    if not levels():
        pytest.skip("no instruction set of this machine is known")
    shipped_libraries._files.cache_clear()  # pyright: ignore[reportPrivateUsage]
    yield tmp_path
    shipped_libraries._files.cache_clear()  # pyright: ignore[reportPrivateUsage]


@pytest.fixture
def built(shipped: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A library of `TEXT` for this machine, on which there is no compiler from then on."""
    cc = c_library.compiler()
    if cc is None:
        pytest.skip("no C compiler on this machine")
    path = shipped / shipped_name(TEXT, FLAGS, levels()[0])
    (shipped / "number.c").write_text(TEXT)
    subprocess.run([cc, *FLAGS, "-o", path, shipped / "number.c"], check=True)
    monkeypatch.setattr(c_library, "compiler", lambda: None)
    monkeypatch.setenv("SPINFILTERS_COMPILE", "on")
    return path


def test_a_shipped_library_is_loaded_without_a_compiler(built: Path) -> None:
    library = load_text("number", TEXT, FLAGS)
    assert library is not None
    assert library._name == str(built)
    assert library.number() == 3


def test_another_text_or_other_flags_have_no_library(built: Path) -> None:
    assert load_text("number", OTHER, FLAGS) is None
    assert load_text("number", TEXT, (*FLAGS, "-O3")) is None


def test_nothing_shipped_is_loaded_where_compiled_code_is_off(
    built: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SPINFILTERS_COMPILE", "off")
    assert load_text("number", TEXT, FLAGS) is None


def test_a_library_that_cannot_be_loaded_is_passed_over(built: Path) -> None:
    built.write_bytes(b"of another system")
    assert load_text("number", TEXT, FLAGS) is None


def test_the_best_of_the_instruction_sets_is_taken_and_none_that_the_machine_lacks(
    shipped: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flags = (*FLAGS, NATIVE)
    monkeypatch.setattr(shipped_libraries, "levels", lambda: ("x86-64-v3", "x86-64"))
    for level in ("x86-64-v4", "x86-64"):
        (shipped / shipped_name(TEXT, flags, level)).touch()
    assert shipped_library(TEXT, flags) == shipped / shipped_name(TEXT, flags, "x86-64")
    (shipped / shipped_name(TEXT, flags, "x86-64-v3")).touch()
    shipped_libraries._files.cache_clear()  # pyright: ignore[reportPrivateUsage]
    assert shipped_library(TEXT, flags) == shipped / shipped_name(TEXT, flags, "x86-64-v3")
