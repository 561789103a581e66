"""Which law of drag a comparison takes from its options and its config file."""

from pathlib import Path

import pytest

from spinfilters.cli.command import arguments_from
from spinfilters.cli.commands.compare import CompareArguments, settings_of
from spinfilters.cli.main import parser


@pytest.mark.parametrize(
    ("options", "configured", "law"),
    [
        ([], "false", False),
        (["--drag"], "false", True),
        (["--drag-law", "linear"], "false", "linear"),
        ([], '"auto"', "auto"),
        (["--drag"], '"linear"', "linear"),
        (["--drag", "--drag-law", "quadratic"], '"linear"', "quadratic"),
    ],
)
def test_an_option_names_the_law_and_drag_alone_keeps_that_of_the_config_file(
    options: list[str], configured: str, law: str | bool, tmp_path: Path
) -> None:
    config = tmp_path / "config.toml"
    config.write_text(f"[process]\ndrag = {configured}\n")
    given = parser().parse_args(["compare", "recording", "--config", str(config), *options])
    assert settings_of(arguments_from(CompareArguments, given)).process.drag == law
