"""Commands of pages that run a study, ``python -m experiments...``: their programs read all of them, and small ones run once."""

import argparse
import importlib
import os
import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from tests.docs.pasted_commands import PAGES

COMMAND = re.compile(r"python -m (experiments\.[\w.]*\w)([^`\n#]*)")
PLACEHOLDERS = {"N": "2", "STEP": "1", "SHAPE": "box"}
"""What stands for a number, or for one of several names."""
WITHOUT_PARSER = {
    "experiments.benchmarks.known_map",
    "experiments.benchmarks.observability_speed",
    "experiments.loop_closure",
}
"""Programs without options, which begin at once and take longer than a test may."""
SMALL = {
    "bound_monte_carlo": "--runs 2 --frames 10 --landmarks 20",
    "density_posterior": "--seeds 1",
    "inspector_runs": "--seeds 1",
    "named_causes": "--seeds 1 --sensors gyro --causes clock-jitter",
    "prediction_consistency": "--seeds 1 --measured 20 --ahead 2",
    "what_holds": "--runs 1 --first 2 -o rows",
}
"""Arguments of one small run by module, behind those of a page, whose values they replace. Others read recordings or runs that are
not in the repository, measure times, or take longer than a test may."""


class BegunError(Exception):
    """A program has read its arguments, and would begin."""


def documented() -> list[tuple[str, str]]:
    """Module and arguments of every command, each once."""
    found = [
        (module, " ".join(arguments.split()))
        for page in PAGES
        for module, arguments in COMMAND.findall(page.read_text(encoding="utf-8"))
    ]
    return sorted(set(found))


def run(module: str, arguments: str, patch: pytest.MonkeyPatch) -> None:
    """The program of a module, in this process."""
    patch.setattr("sys.argv", [module, *(PLACEHOLDERS.get(word, word) for word in shlex.split(arguments))])
    patch.setattr(os, "execv", lambda *_: pytest.fail("began anew"))
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        patch.setenv(name, "1")
    importlib.import_module(module).main()


def only_read(parser: argparse.ArgumentParser, *given: Any, **more: Any) -> None:
    """Read the arguments, and go no further."""
    _, unknown = parser.parse_known_args(*given, **more)
    assert not unknown
    raise BegunError


@pytest.mark.parametrize(
    ("module", "arguments"), [each for each in documented() if each[0] not in WITHOUT_PARSER]
)
def test_the_program_reads_the_arguments_of_a_page(
    module: str, arguments: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", only_read)
    with pytest.raises(BegunError):
        run(module, arguments, monkeypatch)


@pytest.mark.parametrize("name", SMALL)
def test_a_small_study_of_a_page_runs(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    module = f"experiments.{name}"
    arguments = next(own for each, own in documented() if each == module)
    monkeypatch.chdir(tmp_path)
    run(module, f"{arguments} {SMALL[name]}", monkeypatch)
    assert capsys.readouterr().out.strip()
