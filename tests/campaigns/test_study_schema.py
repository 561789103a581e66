"""JSON Schema of a study: every study of this repository validates, a misspelled one does not."""

import tomllib
from pathlib import Path

import pytest

from spinfilters.campaigns.filter_comparison import NAMES, study_file
from spinfilters.campaigns.study import study_schema

Draft202012Validator = pytest.importorskip(
    "jsonschema", reason="needs jsonschema of the extra test"
).Draft202012Validator

STUDIES = [
    *sorted((Path(__file__).parents[2] / "experiments" / "studies").glob("*.toml")),
    *map(study_file, NAMES),
]
SMALL = {"study": {"name": "small", "seeds": 2}, "factors": {"estimator": ["mekf"]}}


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_the_studies_of_this_repository_validate(path: Path) -> None:
    Draft202012Validator(study_schema()).validate(tomllib.loads(path.read_text()))


@pytest.mark.parametrize(
    "wrong",
    [
        {"study": {"name": "no seeds"}},
        {"study": {"name": "bad", "seeds": 0}},
        {"factors": {}},
        {"factors": {"estimator": ["mekf"], "sensors.pixel_std": [1.0]}},
        {"motion": {"base": {"epoch": 3}}},
        {"noise": {"base": {"pixel_std": {"uniform": [1.0, 2.0]}}}},
    ],
)
def test_a_wrong_study_does_not_validate(wrong: dict) -> None:
    validator = Draft202012Validator(study_schema())
    assert validator.is_valid(SMALL)
    assert not validator.is_valid(SMALL | wrong)
