"""What ``--help`` says of estimators: it is written apart from them, so that help is quick."""

import pytest

from spinfilters.cli.compare import RECORDING_ESTIMATORS
from spinfilters.cli.main import main
from spinfilters.workflow.settings import ESTIMATORS


@pytest.mark.parametrize("command", ["compare", "estimate"])
def test_help_names_every_estimator(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([command, "--help"])
    said = "".join(capsys.readouterr().out.split())
    assert [name for name in ESTIMATORS if name not in said] == []
    assert command == "estimate" or f"recordings:{','.join(RECORDING_ESTIMATORS)}" in said
