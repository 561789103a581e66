"""Compilers side by side: which there are, what one that fails says, and how estimates are compared."""

from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from spinfilters.cli import compiler_comparison
from spinfilters.cli.commands.doctor import print_compilers
from spinfilters.cli.compiler_comparison import CompilerTimes, agree, installed_compilers


def _times(command: str, estimates: list[float], failure: str = "") -> CompilerTimes:
    return CompilerTimes(command, "version 1", 9.0, 0.5, np.array(estimates), failure)


def test_two_names_of_one_compiler_are_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("gcc", "clang"):
        (tmp_path / name).write_text("#!/bin/sh\n")
        (tmp_path / name).chmod(0o755)
    (tmp_path / "cc").symlink_to("gcc")
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("CC", str(tmp_path / "clang"))
    assert installed_compilers() == [str(tmp_path / "clang"), str(tmp_path / "cc")]


def test_estimates_agree_within_a_hundredth_of_their_deviations() -> None:
    one = _times("gcc", [0.0, 1.0])
    assert agree(one, _times("clang", [0.009, 1.0]))
    assert not agree(one, _times("clang", [0.011, 1.0]))
    assert not agree(one, _times("clang", [0.0]))
    assert not agree(one, _times("clang", [np.nan, 1.0]))


def test_the_page_tells_failures_and_differences(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [_times("/broken", [], "no crt1.o"), _times("/one", [0.0]), _times("/two", [1.0])]
    monkeypatch.setattr(compiler_comparison, "compare_compilers", lambda: iter(rows))
    console = Console(file=StringIO(), width=200)
    print_compilers(console)
    assert isinstance(console.file, StringIO)
    lines = [line for line in console.file.getvalue().splitlines() if line.startswith(("ok", "FAILED"))]
    assert [line.split()[:2] for line in lines] == [["FAILED", "/broken"], ["ok", "/one"], ["FAILED", "/two"]]
    assert "no crt1.o" in lines[0]
    assert "DIFFER" in lines[2]


def test_a_process_that_fails_is_told_by_its_last_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SPINFILTERS_LANES", "5")
    found = compiler_comparison.measure("", "off", "nothing compiled")
    assert "SPINFILTERS_LANES" in found.failure
    assert np.isnan(found.first)
