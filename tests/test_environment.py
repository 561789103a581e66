"""The script that makes .venv: with versions that are there and not, and on a machine without Python."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PYTHON = """#!/bin/sh
case "$*" in
  "-c "*) echo 3.11 ;;
  "-m venv "*) mkdir -p "$3/bin" && cp "$0" "$3/bin/python" ;;
  "-m pip install "*)
    echo "$*" >>pip.log
    case "$*" in *--constraint*) exit "$CONSTRAINED" ;; esac
    ;;
esac
"""
"""A Python that only notes what it is to install, and refuses constraints with the code $CONSTRAINED."""
APT = """#!/bin/sh
case "$1" in install) cp "${0%/*}/new-python" "${0%/*}/python3" ;; esac
"""
TOOLS = ("sh", "cat", "cksum", "cp", "dirname", "mkdir", "rm")


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A project with the script, and commands in ``bin`` that install nothing."""
    (tmp_path / ".ci").mkdir()
    for name in ("environment.sh", "constraints.txt", "minimum.txt"):
        shutil.copy(ROOT / ".ci" / name, tmp_path / ".ci" / name)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    place = tmp_path / "bin"
    place.mkdir()
    for name in TOOLS:
        found = shutil.which(name)
        assert found
        (place / name).symlink_to(found)
    for name, text in {"python3": PYTHON, "apt-get": APT, "id": "#!/bin/sh\necho 0\n"}.items():
        (place / name).write_text(text)
        (place / name).chmod(0o755)
    return tmp_path


def made(project: Path, constraints: str | None = None, constrained: int = 0) -> tuple[int, list[str]]:
    """Exit code of the script, and what pip was called with."""
    stated = {} if constraints is None else {"SPINFILTERS_CONSTRAINTS": constraints}
    environment = {"PATH": str(project / "bin"), "CONSTRAINED": str(constrained), **stated}
    script = [str(project / "bin/sh"), ".ci/environment.sh", "test"]
    code = subprocess.run(script, cwd=project, env=environment, capture_output=True, check=False).returncode
    log = project / "pip.log"
    return code, log.read_text().splitlines() if log.exists() else []


def test_a_user_gets_versions_without_constraints(project: Path) -> None:
    code, calls = made(project)
    assert code == 0
    assert len(calls) == 1
    assert "--constraint" not in calls[0]


def test_pinned_versions_are_installed_once(project: Path) -> None:
    assert made(project, ".ci/constraints.txt")[0] == 0
    code, calls = made(project, ".ci/constraints.txt")
    assert code == 0
    assert len(calls) == 1
    assert "--constraint .ci/constraints.txt" in calls[0]


def test_where_a_pinned_version_is_not_there_the_newest_are_taken(project: Path) -> None:
    code, calls = made(project, ".ci/constraints.txt", constrained=1)
    assert code == 0
    assert ["--constraint" in call for call in calls] == [True, False]


def test_smallest_versions_that_are_not_there_are_a_failure(project: Path) -> None:
    code, calls = made(project, ".ci/minimum.txt", constrained=1)
    assert code == 1
    assert len(calls) == 1
    assert made(project, ".ci/minimum.txt")[0] == 0


def test_a_machine_without_python_gets_one(project: Path) -> None:
    os.rename(project / "bin/python3", project / "bin/new-python")
    code, calls = made(project)
    assert code == 0
    assert len(calls) == 1


def test_a_machine_with_an_old_python_is_not_changed(project: Path) -> None:
    os.rename(project / "bin/python3", project / "bin/new-python")
    old = project / "bin/python3"
    old.write_text('#!/bin/sh\ncase "$*" in *sys.exit*) exit 1 ;; esac\necho 3.9.2\n')
    old.chmod(0o755)
    assert made(project) == (1, [])
