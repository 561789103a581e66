"""Versions that CI installs: those declared as the smallest, and those of the last run that passed."""

import re
import runpy
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_the_smallest_versions_that_are_tested_are_the_declared_ones() -> None:
    wanted = runpy.run_path(str(ROOT / ".ci" / "minimum.py"))["minimum_constraints"](PROJECT)
    assert (ROOT / ".ci" / "minimum.txt").read_text(encoding="utf-8").split() == wanted


def test_every_package_that_ci_needs_has_one_version_in_the_constraints() -> None:
    pinned = {
        line.partition("==")[0].lower().replace("_", "-")
        for line in (ROOT / ".ci" / "constraints.txt").read_text(encoding="utf-8").split()
    }
    extras = PROJECT["project"]["optional-dependencies"]
    needed = [*PROJECT["project"]["dependencies"], *extras["test"], *extras["check"]]
    names = {re.split(r"[\[>=]", line)[0].lower().replace("_", "-") for line in needed}
    assert names <= pinned


def test_actions_are_pinned_by_commit() -> None:
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    used = re.findall(r"uses: \S+@(\S+)", workflow)
    assert used
    assert all(re.fullmatch(r"[0-9a-f]{40}", commit) for commit in used)
