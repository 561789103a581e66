"""The option that chooses the checks of a verdict."""

from pathlib import Path

import pytest

from spinfilters import Settings, compare, simulate
from spinfilters.cli.command import arguments_from
from spinfilters.cli.commands.compare import CompareArguments, settings_of
from spinfilters.cli.main import main, parser
from spinfilters.core.errors import InputError


@pytest.mark.parametrize(
    ("options", "configured", "verdict"),
    [([], "full", "full"), ([], "filter", "filter"), (["--verdict", "full"], "filter", "full")],
)
def test_an_option_goes_before_the_config_file(
    options: list[str], configured: str, verdict: str, tmp_path: Path
) -> None:
    config = tmp_path / "config.toml"
    config.write_text(f'verdict = "{configured}"\n')
    given = parser().parse_args(["compare", "recording", "--config", str(config), *options])
    assert settings_of(arguments_from(CompareArguments, given)).verdict == verdict


def test_another_word_is_refused_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "config.toml").write_text('verdict = "none"\n')
    arguments = ["compare", "--config", str(tmp_path / "config.toml"), "-o", str(tmp_path / "run")]
    assert main(arguments) == 2
    told = capsys.readouterr().err
    assert 'config.toml: verdict is \'none\'; give "full" or "filter"' in told
    assert not (tmp_path / "run").exists()


def test_python_takes_it_as_an_argument_or_from_the_settings() -> None:
    data = simulate(kind="gyro", frames=40)
    of_argument = compare(data, "mekf", verdict="filter")
    of_settings = compare(data, "mekf", Settings(verdict="filter"))
    assert of_argument["mekf"].checks == of_settings["mekf"].checks
    assert "smoothed-checks-left-out" in of_argument["mekf"].checks
    with pytest.raises(InputError, match="verdict"):
        compare(data, "mekf", verdict="")
