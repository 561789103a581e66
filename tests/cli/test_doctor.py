"""The page of `spinfilters doctor`: complete, honest about failures, and leaving nothing behind."""

import os
import subprocess
import sys
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

import spinfilters
from spinfilters.cli import installation_checks
from spinfilters.cli.commands.doctor import doctor
from spinfilters.cli.installation_checks import (
    CHECKS,
    CheckError,
    InstallationCheck,
    compare_with_virtual_machine,
)
from spinfilters.core import c_library
from spinfilters.core import c_library as library_folder
from spinfilters.models.process import TorqueFreeProcess


def page(checks: tuple[InstallationCheck, ...] | None = None) -> tuple[int, str]:
    """Exit code and text of the page."""
    console = Console(file=StringIO(), width=100)
    code = doctor(console, checks)
    assert isinstance(console.file, StringIO)
    return code, console.file.getvalue()


def test_every_self_check_passes_on_this_machine() -> None:
    code, text = page()
    assert code == 0, text
    assert text.count("\nok ") == len(CHECKS)
    assert "FAILED" not in text


def test_the_page_names_versions_compiler_and_cache() -> None:
    _, text = page(())
    assert f"spinfilters                 {spinfilters.__version__}" in text
    for name in ("Python", "platform", "numpy", "scipy", "casadi", "filterpy", "matplotlib", "C compiler"):
        assert f"\n{name:<28}" in text
    assert str(library_folder.cache_folder()) in text


def test_a_failed_check_shows_its_numbers_and_a_cure_and_the_others_still_run() -> None:
    def fail() -> str:
        raise CheckError("error 1, allowed [0]")

    code, text = page(
        (InstallationCheck("broken", fail, "mend it"), InstallationCheck("sound", lambda: "fine", ""))
    )
    assert code == 1
    lines = [line.split() for line in text.splitlines()[-3:]]
    assert lines[0] == ["FAILED", "broken", "CheckError:", "error", "1,", "allowed", "[0]"]
    assert lines[1] == ["cure", "mend", "it"]
    assert lines[2] == ["ok", "sound", "fine"]


def test_a_wrong_derivative_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    exact = TorqueFreeProcess.linearise

    def off_by_a_thousandth(self: TorqueFreeProcess, x: object, dt: float) -> tuple[object, ...]:
        after, transition, noise = exact(self, x, dt)  # pyright: ignore[reportArgumentType]
        return after, 1.001 * transition, noise

    monkeypatch.setattr(TorqueFreeProcess, "linearise", off_by_a_thousandth)
    with pytest.raises(CheckError, match="largest difference of an entry 1"):
        installation_checks.process_linearisation()


def test_an_inexact_attitude_conversion_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    exact = installation_checks.conversions.matrix_from_quaternion
    monkeypatch.setattr(
        installation_checks.conversions, "matrix_from_quaternion", lambda q: exact(q) * (1 + 1e-9)
    )
    with pytest.raises(CheckError, match="largest error of a component"):
        installation_checks.attitude_round_trip()


def test_a_cache_folder_that_cannot_be_written_is_named_with_its_cure(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr(installation_checks, "compiler", lambda: "cc")
    monkeypatch.setenv("SPINFILTERS_CACHE", str(tmp_path / "file" / "cache"))
    code, text = page(CHECKS[-1:])
    assert code == 1
    assert str(tmp_path / "file" / "cache") in text
    assert "SPINFILTERS_CACHE=" in text


def test_a_compiler_that_fails_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    broken = tmp_path / "broken-cc"
    broken.write_text("#!/bin/sh\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("SPINFILTERS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(c_library, "compiler", lambda: str(broken))
    monkeypatch.setattr(installation_checks, "compiler", lambda: str(broken))
    code, text = page(CHECKS[-1:])
    assert code == 1
    assert f"{broken} fails" in text


def test_without_a_compiler_the_page_says_so_and_nothing_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SPINFILTERS_COMPILE", "off")
    c_library.compiler.cache_clear()
    try:
        comparison = compare_with_virtual_machine()
        code, text = page(())
    finally:
        c_library.compiler.cache_clear()
    assert (comparison.is_c, comparison.equal, code) == (False, True, 0)
    assert "works without, but slower" in text


def test_nothing_is_left_outside_the_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    here, cache = tmp_path / "here", tmp_path / "cache"
    here.mkdir()
    monkeypatch.chdir(here)
    monkeypatch.setenv("SPINFILTERS_CACHE", str(cache))
    monkeypatch.setenv("TMPDIR", str(here))
    assert page(CHECKS[-1:])[0] == 0
    assert list(here.iterdir()) == []
    assert all(path.suffix == ".so" for path in cache.rglob("*"))


@pytest.mark.parametrize(
    ("name", "value", "cure"),
    [
        ("SPINFILTERS_LANES", "7", "give 4 or 8, or unset it"),
        ("SPINFILTERS_COMPILE", "banana", "give on, off or here, or unset it"),
    ],
)
def test_an_unusable_setting_of_compiling_is_cured_in_the_environment(
    name: str, value: str, cure: str
) -> None:
    command = [sys.executable, "-m", "spinfilters", "doctor"]
    environment = {**os.environ, name: value}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stderr
    *_, failed, last = done.stdout.splitlines()
    assert failed.split()[0] == "FAILED"
    assert f"{name} is '{value}'" in failed
    assert last.split(maxsplit=1) == ["cure", cure]
