"""Provenance of a run: versions, commit and machine."""

import platform
import subprocess
from functools import cache
from importlib.metadata import version
from pathlib import Path

from spinfilters.version import __version__

PACKAGES = ("numpy", "scipy", "casadi", "filterpy", "matplotlib")


def provenance() -> dict[str, str]:
    """Versions of what decides the numbers, and the commit when the package runs from a checkout."""
    return dict(_provenance())


@cache
def _provenance() -> dict[str, str]:
    """Provenance, cached: what the process has loaded does not change."""
    return {
        "spinfilters": __version__,
        "git_commit": git_commit() or "not a checkout",
        "python": platform.python_version(),
        "platform": platform.platform(),
        **{name: version(name) for name in PACKAGES},
    }


def git_commit() -> str | None:
    """Commit of the package's checkout, ``-dirty`` with changes; None elsewhere."""
    folder = Path(__file__).resolve().parents[2]
    if not (folder / ".git").exists():
        return None
    try:
        done = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=12"],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=10,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() or None
