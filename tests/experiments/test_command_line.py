"""Studies end in a line where their caller can mend what is wrong, and show every other error whole."""

import ast
from collections.abc import Callable
from pathlib import Path

import pytest

from experiments import command_line
from experiments.command_line import run_study
from spinfilters.core.errors import InputError

STUDIES = Path(command_line.__file__).parent
RUN_ALONE = {"first_solve.py"}
"""Run by another in a process of its own, with a file that it has just written."""


def test_what_a_caller_can_mend_is_one_line_and_exit_code_2(capsys: pytest.CaptureFixture[str]) -> None:
    lines = [
        complaint(capsys, InputError("runs/a: is no\ncampaign's folder; give one")),
        complaint(capsys, FileNotFoundError(2, "No such file or directory", "runs/b")),
        complaint(capsys, KeyboardInterrupt()),
    ]
    assert [line.count("\n") for line in lines] == [1, 1, 1]
    assert lines[0] == "experiments: runs/a: is no campaign's folder; give one\n"
    assert lines[1].startswith("experiments: runs/b: No such file or directory; ")
    assert lines[2].startswith("experiments: interrupted; ")


@pytest.mark.parametrize("error", [ValueError("shapes"), OSError("of no file")])
def test_a_defect_shows_its_trace(error: Exception) -> None:
    with pytest.raises(type(error), match=str(error)):
        run_study(raising(error))


def test_a_study_that_ends_well_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    run_study(lambda: None)
    assert capsys.readouterr() == ("", "")


def test_every_study_with_a_main_function_is_run_so() -> None:
    mains = [path for path in sorted(STUDIES.rglob("*.py")) if path.name not in RUN_ALONE and called(path)]
    assert len(mains) >= 39
    assert [path.name for path in mains if called(path) != "run_study"] == []


def complaint(capsys: pytest.CaptureFixture[str], error: BaseException) -> str:
    """Standard error of a study that ends in the error with exit code 2."""
    with pytest.raises(SystemExit) as left:
        run_study(raising(error))
    assert left.value.code == 2
    return capsys.readouterr().err


def raising(error: BaseException) -> Callable[[], None]:
    """A main function that raises."""

    def main() -> None:
        raise error

    return main


def called(path: Path) -> str | None:
    """Name of the function that a module calls where it is run as a program."""
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.If) and "__name__" in ast.unparse(node.test):
            call = ast.parse(ast.unparse(node.body[-1]), mode="eval").body
            assert isinstance(call, ast.Call)
            return ast.unparse(call.func)
    return None
