"""The command ``schema``, and summary.json of a run against what it prints."""

import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

import spinfilters
from spinfilters.cli.main import main


def printed(of: str, capsys: pytest.CaptureFixture[str]) -> dict:
    assert main(["schema", of]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("of", ["settings", "study", "summary"])
def test_each_schema_is_one(of: str, capsys: pytest.CaptureFixture[str]) -> None:
    Draft202012Validator.check_schema(printed(of, capsys))


def test_the_summary_of_a_run_validates(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = spinfilters.simulate(kind="pose", frames=30, seed=1)
    run = spinfilters.compare(data, ("mekf",), settings={"verdict": "filter"})
    run.save(tmp_path / "run")
    document = json.loads((tmp_path / "run" / "summary.json").read_text())
    schema = printed("summary", capsys)
    Draft202012Validator(schema).validate(document)
    known = schema["$defs"]["estimator"]["properties"]["errors"]["properties"]
    assert set(known) & set(document["estimators"]["mekf"]["errors"])
    document["estimators"]["mekf"]["status"] = "fine"
    assert not Draft202012Validator(schema).is_valid(document)
