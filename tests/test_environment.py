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
    case "$*" in *--constraint*) exec sh ./refuse.sh "${*##*--constraint }" ;; esac
    ;;
esac
"""
"""A Python that only notes what it is to install, and leaves it to a script whether constraints can be met."""
REFUSE = """for name in $MISSING; do
  if grep -q "^$name==" "$1"; then
    echo "ERROR: No matching distribution found for $name==1" >&2
    exit 1
  fi
done
cat "$1" >>taken.log
exit "$CONSTRAINED"
"""
"""A script that refuses constraints of the packages $MISSING, as pip does, and any with the code $CONSTRAINED."""
APT = """#!/bin/sh
case "$1" in install) cp "${0%/*}/new-python" "${0%/*}/python3" ;; esac
"""
TOOLS = ("sh", "cat", "cksum", "cmp", "cp", "dirname", "grep", "mkdir", "mv", "rm", "sed", "tr")


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A project with the script, and commands in ``bin`` that install nothing."""
    (tmp_path / ".ci").mkdir()
    for name in ("environment.sh", "constraints.txt", "minimum.txt"):
        shutil.copy(ROOT / ".ci" / name, tmp_path / ".ci" / name)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (tmp_path / "refuse.sh").write_text(REFUSE)
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


def made(
    project: Path,
    constraints: str | None = None,
    constrained: int = 0,
    missing: str = "",
    extras: str = "test",
) -> tuple[int, list[str]]:
    """Exit code of the script, and what pip was called with."""
    stated = {} if constraints is None else {"SPINFILTERS_CONSTRAINTS": constraints}
    environment = {"PATH": str(project / "bin"), "CONSTRAINED": str(constrained), "MISSING": missing}
    environment |= stated
    script = [str(project / "bin/sh"), ".ci/environment.sh", extras]
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
    assert "--constraint" in calls[0]
    assert (project / "taken.log").read_text() == (project / ".ci/constraints.txt").read_text()


def test_extras_installed_together_are_not_installed_again_alone(project: Path) -> None:
    assert made(project, extras="test,check")[0] == 0
    for extras in ("test", "check", "test,check"):
        code, calls = made(project, extras=extras)
        assert code == 0
        assert len(calls) == 1
    assert len(made(project, extras="test,docs")[1]) == 2


def test_a_pin_that_is_not_there_is_dropped_and_no_other(project: Path) -> None:
    pins = (project / ".ci/constraints.txt").read_text().split()
    first, last = (pin.partition("==")[0] for pin in (pins[0], pins[-1]))
    code, calls = made(project, ".ci/constraints.txt", missing=f"{first} {last}")
    assert code == 0
    assert len(calls) == 3
    assert (project / "taken.log").read_text().split() == pins[1:-1]


def test_where_pinned_versions_do_not_fit_together_the_newest_are_taken(project: Path) -> None:
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
