"""What ``--help`` says of estimators: it is written apart from them, so that help is quick."""

import re

import pytest

from spinfilters.cli.main import main
from spinfilters.settings.run_settings import DEFAULT_ESTIMATORS, estimator_names


@pytest.mark.parametrize("command", ["compare", "estimate"])
def test_help_names_every_estimator(
    command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "1000")  # a line per argument
    with pytest.raises(SystemExit):
        main([command, "--help"])
    said = capsys.readouterr().out
    (named,) = re.findall(r"^ *--estimators? \S+ +(.*) \(default", said, re.MULTILINE)
    assert set(re.split(", | or ", named)) == set(estimator_names())
    assert (
        command == "estimate"
        or f"default: {','.join(DEFAULT_ESTIMATORS)}; filterpy's too with --known-map)" in said
    )
