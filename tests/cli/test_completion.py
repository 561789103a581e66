"""Completion in a shell: what bash itself offers behind the words of a command, and the scripts of the other shells."""

import shutil
import subprocess

import pytest

from spinfilters.cli.commands import COMMANDS
from spinfilters.cli.commands.completion import SHELLS, bash_script, completed_commands, flags_of
from spinfilters.cli.main import main


def offered(*words: str) -> set[str]:
    """Words that bash offers for the last of some words."""
    line = " ".join(f"'{word}'" for word in words)
    asked = f"COMP_WORDS=(spinfilters {line}); COMP_CWORD={len(words)}; _spinfilters"
    program = f"{bash_script()}\n{asked}; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    done = subprocess.run(["bash", "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert not done.stderr
    return set(done.stdout.split())


def test_bash_offers_commands_options_and_choices() -> None:
    assert offered("") == {listed.name for listed in COMMANDS}
    assert offered("comp") == {"compare", "completion"}
    assert "--estimators" in offered("compare", "--est")
    assert offered("compare", "--verdict", "") == {"full", "filter"}
    assert offered("campaign", "re") == {"report", "repeat"}
    assert offered("schema", "s") == {"settings", "study", "summary"}
    assert offered("compare", "data", "") == set()  # file names


def test_every_option_of_every_command_is_offered() -> None:
    for each in completed_commands():
        name = each.words.split()[0]
        wanted = {flag for option in each.options for flag in flags_of(option)}
        assert wanted <= offered(name, "-"), name


@pytest.mark.parametrize("shell", SHELLS)
def test_the_script_of_a_shell_names_every_command(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert all(listed.name in script for listed in COMMANDS)
    if shutil.which(shell):
        done = subprocess.run(
            [shell, "-n"], input=script, capture_output=True, text=True, timeout=60, check=False
        )
        assert done.returncode == 0, done.stderr
