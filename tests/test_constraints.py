"""Versions that CI installs: those declared as the smallest, and those of the last run that passed."""

import re
import runpy
import tomllib
from pathlib import Path

from spinfilters.io.document import read_yaml

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


def test_tests_docs_wheel_and_source_distribution_are_checked_on_every_python_that_is_declared() -> None:
    jobs = read_yaml(ROOT / ".github" / "workflows" / "ci.yml")["jobs"]
    declared = [
        line.rsplit(" ", 1)[1] for line in PROJECT["project"]["classifiers"] if "Python :: 3." in line
    ]
    for name in ("test", "install", "docs"):
        assert jobs[name]["strategy"]["matrix"]["python"] == declared
    assert jobs["install"]["strategy"]["matrix"]["form"] == ["wheel", "sdist"]


def test_the_citation_has_the_version_its_date_and_both_sources() -> None:
    cited = read_yaml(ROOT / "CITATION.cff")
    assert cited["version"] == PROJECT["project"]["version"]
    history = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## {cited['version']} ({cited['date-released']})" in history
    assert [each["authors"][0]["family-names"] for each in cited["references"]] == ["Tweddle", "Decoust"]


def test_actions_are_pinned_by_commit() -> None:
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    used = re.findall(r"uses: \S+@(\S+)", workflow)
    assert used
    assert all(re.fullmatch(r"[0-9a-f]{40}", commit) for commit in used)
