"""Compiled libraries are loaded, and kept, only where nobody but their user could have put or exchanged one."""

import logging
import os
import stat
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import casadi as ca
import platformdirs
import pytest

from spinfilters.cli.installation_checks import CHECKS
from spinfilters.core import c_library
from spinfilters.core import c_library as library_folder
from spinfilters.core.compiled import Compiled

NOBODY = 65534


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Where libraries are to be kept; not made yet, and neither is the folder above it."""
    monkeypatch.setenv("SPINFILTERS_CACHE", str(tmp_path / "above" / "cache"))
    monkeypatch.delenv("SPINFILTERS_COMPILE", raising=False)
    monkeypatch.setattr(c_library.LOGGER.filters[0], "given", False)
    c_library.compiler.cache_clear()
    if c_library.compiler() is None:
        pytest.skip("no C compiler on this machine")
    yield tmp_path / "above" / "cache"
    c_library.compiler.cache_clear()


def shifted(by: float) -> ca.Function:
    """x + by, of the same name whatever ``by`` is."""
    x = ca.SX.sym("x")
    return ca.Function("shifted", [x], [x + by])


def of_one() -> float:
    """1 + 1, in C where a library may be loaded."""
    function = Compiled(shifted(1.0))
    function.build()
    return float(function(1.0)[0][0])


def planted(folder: Path) -> Path:
    """A library that adds 5, under the name of the one that adds 1: whoever loads it gets 6."""
    assert of_one() == 2.0
    (own,) = folder.glob("*.so")
    assert Compiled(shifted(5.0)).is_c
    (other,) = set(folder.glob("*.so")) - {own}
    stem = own.stem.rpartition("-")[0]
    own.unlink()
    return other.rename(folder / f"{stem}-{other.stem.rpartition('-')[2]}.so")


def given_away(path: Path) -> None:
    """To another user, as root alone can do it."""
    if os.geteuid() != 0:
        pytest.skip("only root can give a file to another user")
    os.chown(path, NOBODY, -1)


def linked(path: Path) -> None:
    """The same content behind a symbolic link."""
    path.symlink_to(path.rename(path.with_suffix(".elsewhere")))


def linked_twice(path: Path) -> None:
    """A second name, by which its content may be written."""
    path.with_suffix(".second").hardlink_to(path)


def replaced_by_a_pipe(path: Path) -> None:
    """Opening it would wait for ever."""
    path.unlink()
    os.mkfifo(path)


def replaced_by_a_folder(path: Path) -> None:
    """Reading it fails."""
    path.unlink()
    path.mkdir()


def replaced_by_something_huge(path: Path) -> None:
    """A file with holes that would fill the memory."""
    with path.open("r+b") as file:
        file.truncate(1 << 40)


def open_to_all(path: Path) -> None:
    """All may write."""
    path.chmod(0o777)


def open_to_the_group(path: Path) -> None:
    """The group may write."""
    path.chmod(0o770)


FILES = [
    open_to_all,
    open_to_the_group,
    given_away,
    linked,
    linked_twice,
    replaced_by_a_pipe,
    replaced_by_a_folder,
    replaced_by_something_huge,
]


def test_a_library_of_the_users_own_is_loaded(folder: Path) -> None:
    planted(folder)
    assert of_one() == 6.0


@pytest.mark.parametrize("change", FILES)
def test_a_library_that_others_could_have_written_is_built_again(
    folder: Path, change: Callable[[Path], None]
) -> None:
    change(planted(folder))
    found = Compiled(shifted(1.0))
    assert found(1.0)[0][0] == 2.0
    assert found.is_c


@pytest.mark.parametrize("place", ["cache", "above"])
@pytest.mark.parametrize("change", [open_to_all, open_to_the_group, given_away])
def test_in_a_folder_that_others_may_write_to_nothing_is_loaded_or_built(
    folder: Path,
    place: str,
    change: Callable[[Path], None],
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(library_folder, "_has_one_member", lambda group: False)
    planted(folder)
    change(folder if place == "cache" else folder.parent)
    before = sorted(folder.iterdir())
    assert of_one() == 2.0
    assert not Compiled(shifted(7.0)).is_c
    assert sorted(folder.iterdir()) == before
    (warning,) = [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]
    assert str(folder if place == "cache" else folder.parent) in warning
    assert len(warning) < 300


def test_a_link_in_place_of_the_folder_is_not_followed(folder: Path) -> None:
    planted(folder)
    folder.symlink_to(folder.rename(folder.with_name("elsewhere")))
    assert of_one() == 2.0
    assert not Compiled(shifted(1.0)).is_c


def test_a_link_above_the_folder_is_followed_and_what_it_leads_to_is_looked_at(folder: Path) -> None:
    planted(folder)
    target = folder.parent.rename(folder.parent.with_name("target"))
    folder.parent.symlink_to(target)
    assert of_one() == 6.0
    target.chmod(0o777)
    assert of_one() == 2.0


def test_below_a_folder_like_tmp_where_none_can_rename_what_others_own_it_is_private(folder: Path) -> None:
    planted(folder)
    folder.parent.chmod(0o1777)
    assert of_one() == 6.0


def test_the_group_of_the_user_alone_may_write_above_the_folder(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planted(folder)
    folder.parent.chmod(0o775)
    for private, found in ((True, 6.0), (False, 2.0)):
        monkeypatch.setattr(library_folder, "_has_one_member", lambda group, private=private: private)
        assert of_one() == found


@pytest.mark.parametrize("umask", [0o000, 0o002, 0o777])
def test_whatever_the_umask_what_is_made_is_the_users_alone(folder: Path, umask: int) -> None:
    before = os.umask(umask)
    try:
        assert Compiled(shifted(1.0)).is_c
    finally:
        os.umask(before)
    (library,) = folder.iterdir()
    modes = [stat.S_IMODE(path.stat().st_mode) for path in (folder.parent, folder, library)]
    assert modes == [0o700, 0o700, 0o600]


def no_home(*_: object) -> str:
    """What is said of a user without a home."""
    raise RuntimeError("could not determine the home directory")


@pytest.mark.parametrize("found", [no_home, lambda *_: "~/.cache/spinfilters"])
def test_without_a_home_functions_are_interpreted(
    folder: Path,
    found: Callable[..., str],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.delenv("SPINFILTERS_CACHE")
    monkeypatch.setattr(platformdirs, "user_cache_dir", found)
    assert of_one() == 2.0
    assert "no home" in caplog.text
    assert not folder.exists()


def test_a_build_that_was_killed_long_ago_is_cleared_away(folder: Path) -> None:
    assert of_one() == 2.0
    old, new = folder / "building-old", folder / "building-new"
    for scratch in (old, new):
        scratch.mkdir()
        (scratch / "built.so").touch()
    os.utime(old, (0, 0))
    assert Compiled(shifted(3.0)).is_c
    assert not old.exists()
    assert new.exists()


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("home", ["absent", "a file", "foreign", "not text"])
def test_doctor_works_whatever_the_home_is(tmp_path: Path, home: str) -> None:
    place = tmp_path / (os.fsdecode(b"home\xff") if home == "not text" else "home")
    if home == "foreign":
        place.mkdir()
        given_away(place)
    else:
        place.touch()
    ours = ("HOME", "SPINFILTERS", "XDG")
    environment = {name: value for name, value in os.environ.items() if not name.startswith(ours)}
    program = "import platformdirs, sys\nfrom spinfilters.cli.main import main\n"
    if home == "absent":
        program += "def none(*_): raise RuntimeError('no home')\nplatformdirs.user_cache_dir = none\n"
    else:
        environment["HOME"] = str(place)
    command = [sys.executable, "-c", f"{program}sys.exit(main(['doctor']))"]
    done = subprocess.run(command, env=environment, capture_output=True, cwd=tmp_path, check=False)
    text = done.stdout.decode()
    assert done.returncode == 1, text
    assert "FAILED  cache folder" in text
    assert "mkdir -m 700" in text
    assert text.count("\nok ") == len(CHECKS) - 1
    assert len(done.stderr.splitlines()) == 1, done.stderr


def test_a_compiler_without_space_names_the_folders_that_are_full(folder: Path) -> None:
    text = b"cc1: fatal error: error writing to /x.s: No space left on device"
    why = c_library.reason(subprocess.CalledProcessError(1, ["cc"], stderr=text))
    assert why.startswith("No space left on device")
    assert str(folder) in why


def test_any_other_failure_of_a_compiler_has_its_exit_code() -> None:
    assert c_library.reason(subprocess.CalledProcessError(3, ["cc"])) == "cc ends with exit code 3"
