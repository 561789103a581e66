"""The examples of the analyser's README print what they are shown to print."""

import re
from pathlib import Path

import pytest

from spinfilters.cli.main import main

README = Path(__file__).parents[2] / "observability" / "README.md"
EXAMPLES = re.findall(
    r"```\n\$ spinfilters ((?:observe|condition)[^\n]*)\n(.*?)```", README.read_text(), re.DOTALL
)


def test_there_are_examples_of_every_kind() -> None:
    commands = " ".join(command for command, _ in EXAMPLES)
    for word in (
        "gyro",
        "mono-tracks",
        "attitude",
        "pose",
        "lidar",
        "condition",
        "--torque",
        "--manoeuvre",
        "--landmarks",
    ):
        assert word in commands


@pytest.mark.parametrize(("command", "shown"), EXAMPLES, ids=[command for command, _ in EXAMPLES])
@pytest.mark.usefixtures("unrendered")
def test_an_example_prints_what_is_shown(
    command: str, shown: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    assert main([*command.split(), "-o", str(tmp_path / "run")]) == 0
    printed = capsys.readouterr().out
    missing = [line for line in shown.splitlines() if line not in printed]
    assert missing == []


def test_the_program_of_the_readme_runs(capsys: pytest.CaptureFixture) -> None:
    (program,) = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    exec(compile(program, str(README), "exec"), {})
    expected = re.findall(r"# (\d+ \d+ [A-Z]+)$", program, re.MULTILINE)
    assert capsys.readouterr().out.splitlines()[0] == expected[0]
