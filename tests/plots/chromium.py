"""Pages in a headless Chromium, where there is one."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")


def document_after_scripts(page: Path) -> str:
    """The document that a browser has made of a page; skips where there is no browser."""
    program = next((found for name in NAMES if (found := shutil.which(name))), None)
    if program is None:
        pytest.skip(f"none of {', '.join(NAMES)} is installed")
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=2000", "--dump-dom"]
    profile = f"--user-data-dir={page.parent / 'profile'}"
    done = subprocess.run(
        [program, *options, profile, page.as_uri()], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def pixels_drawn(document: str) -> int:
    """Of the model, as its script tells."""
    found = re.search(r'data-drawn="(\d+)"', document)
    assert found is not None, "the script of the page has not run"
    return int(found[1])
