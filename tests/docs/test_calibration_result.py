"""The published calibration is not much older than the code that it describes."""

import json
import subprocess
from datetime import date
from pathlib import Path

import pytest

from spinfilters.campaigns.calibration_report import DESCRIBED, is_outdated

ROOT = Path(__file__).parents[2]
RESULTS = sorted((ROOT / "docs").glob("calibration-*.json"))


def last_change() -> date | None:
    """Day of the last commit to the described packages; None outside a checkout with its history."""
    paths = [f"spinfilters/{name}" for name in DESCRIBED]
    command = ["git", "log", "-1", "--format=%cs", "--", *paths]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=30, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return date.fromisoformat(done.stdout.strip()) if done.stdout.strip() else None


@pytest.mark.parametrize("path", RESULTS, ids=lambda path: path.stem)
def test_a_published_calibration_is_not_outdated(path: Path) -> None:
    changed = last_change()
    if changed is None:
        pytest.skip("no history of the code")
    result = json.loads(path.read_text())
    assert result["commit"]
    again = f"run spinfilters calibration {result['study']['sensor']} again, and publish its result"
    assert not is_outdated(result, changed), again


def test_each_published_calibration_is_on_the_page() -> None:
    page = (ROOT / "docs" / "calibration.md").read_text()
    assert RESULTS
    assert all(f"({path.name})" in page and path.with_suffix(".png").is_file() for path in RESULTS)


@pytest.mark.parametrize(("code", "outdated"), [("2027-05-28", False), ("2027-05-29", True)])
def test_half_a_year_is_too_old(code: str, outdated: bool) -> None:
    assert is_outdated({"date": "2026-11-26"}, date.fromisoformat(code)) is outdated
