"""The list of checks: what each entry owes to those who read it, and the page that is made of it."""

import re
from pathlib import Path

import pytest

from spinfilters.models.status import ALL, OWN_STATUS, Finding
from spinfilters.verdict.checks import BY_NAME, CHECKS, Check, check_of, finding
from spinfilters.verdict.checks_page import main, page

ROOT = Path(__file__).parents[2]
BY_ITS_FINDING = {"unexplained-residuals", "model-error"}
"""Checks whose sentence brings its cure."""
CODE = sorted((ROOT / "spinfilters").rglob("*.py"))


def test_the_page_of_checks_is_up_to_date() -> None:
    """Made anew by ``python -m spinfilters.verdict.checks_page docs/reference/checks.md``."""
    assert (ROOT / "docs/reference/checks.md").read_text(encoding="utf-8") == page()


def test_the_page_is_written_to_a_file(tmp_path: Path) -> None:
    path = tmp_path / "checks.md"
    assert main([str(path)]) == 0
    assert path.read_text(encoding="utf-8") == page()


def test_names_of_checks_are_different() -> None:
    assert len(BY_NAME) == len(CHECKS)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.name)
def test_every_check_has_its_words(check: Check) -> None:
    assert check.asks
    assert check.false_alarm
    assert check.sentence
    assert check.cure or check.name in BY_ITS_FINDING
    assert check.about <= ALL
    assert check.name in page()


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.name)
def test_numbers_of_a_sentence_have_at_most_three_digits(check: Check) -> None:
    for form in re.findall(r"\{\w+:([^}]*)\}", check.sentence):
        assert form in {".1g", ".2g", ".3g", ".3f"}  # the last of a time of the recording


def test_every_name_that_the_code_gives_a_finding_is_in_the_list() -> None:
    given = r"(?:\bfinding\(\s*|\bFinding\(\s*|\.(?:degraded|failed)\((?:[^()]|\([^()]*\))*?,\s*)\"([a-z]+(?:-[a-z]+)*)\""
    names = {name for path in CODE for name in re.findall(given, path.read_text(encoding="utf-8"))}
    assert len(names) > 20
    assert names <= set(BY_NAME)


def test_a_finding_has_sentence_cure_and_numbers() -> None:
    found = finding("not-a-free-flight", {"percent": 63.66, "limit": 4.0})
    assert found.reason.startswith(
        "not a free flight: torque-free motion leaves 64 % of the rate unexplained"
    )
    assert found.reason.endswith(
        ". Cut the recording to the flight (--segment), or check axes, range and unit of the gyro"
    )
    assert Finding("gap", "nothing was measured", "cut it").reason == "nothing was measured: cut it"
    assert found.numbers["percent"] == 63.66


def test_a_number_that_misses_its_limit_does_not_read_like_it() -> None:
    sentence = finding("moments-undetermined", {"std": 0.10034, "limit": 0.1}).sentence
    assert sentence.endswith("deviation is 0.1003 of the largest moment (limit 0.1)")
    assert "deviation is 0.12 of" in finding("moments-undetermined", {"std": 0.1234, "limit": 0.1}).sentence
    numbers = {"epochs": 30, "evidence": 29.96, "limit": 30.0, "why": "a steady spin"}
    assert "(evidence 29.96, at least 30" in finding("motion-shows-no-moments", numbers).sentence


def test_a_finding_that_no_check_knows_is_an_estimators_own() -> None:
    assert check_of(Finding("of-a-plug-in", "its battery is low")).name == OWN_STATUS
    assert check_of(Finding("model-error:drag/torque", "drag")).name == "model-error"
