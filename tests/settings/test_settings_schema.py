"""JSON Schema of settings, and their page: what the schema admits is what the settings admit."""

import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from spinfilters.core.errors import InputError
from spinfilters.settings.run_settings import Settings, settings_from
from spinfilters.settings.settings_page import main, page
from spinfilters.settings.settings_schema import settings_schema

DOCS = Path(__file__).parents[2] / "docs"


def test_all_defaults_validate() -> None:
    Draft202012Validator.check_schema(settings_schema())
    Draft202012Validator(settings_schema()).validate(json.loads(json.dumps(Settings().document)))


@pytest.mark.parametrize(
    ("document", "admitted"),
    [
        ({"sensors": {"pixel_std": 0.5}}, True),
        ({"sensors": {"pixel_std": "auto"}, "process": {"drag": "linear", "force_psd": 0}}, True),
        ({"verdict": "filter", "estimators": ["mekf"]}, True),
        ({"initialisation": {"mean": {"rate": [0.0, 1.0, 0.0]}, "std": {"rate": 0.1}}}, False),
        ({"sensors": {"pixel_std": -1.0}}, False),
        ({"sensors": {"pixels": 1.0}}, False),
        ({"process": {"drag": "cubic"}}, False),
        ({"initialisation": {"epochs": 1.5}}, False),
        ({"initialisation": {"epochs": 0}}, False),
        ({"sensor": {}}, False),
    ],
)
def test_the_schema_admits_what_settings_admit(document: dict, admitted: bool) -> None:
    if "mean" in document.get("initialisation", {}):  # what several keys say together no schema tells
        admitted = True
    else:
        try:
            settings_from(document, "test")
            assert admitted
        except InputError:
            assert not admitted
    assert Draft202012Validator(settings_schema()).is_valid(document) == admitted


def test_every_setting_is_described() -> None:
    schema = settings_schema()
    tables = {"": schema, **schema["$defs"]}
    silent = [
        f"{name}.{key}"
        for name, table in tables.items()
        for key, held in table.get("properties", {}).items()
        if not held.get("description")
    ]
    assert not silent


def test_the_page_of_settings_is_current(tmp_path: Path) -> None:
    """Made anew by ``python -m spinfilters.settings.settings_page docs/reference/settings.md``."""
    assert main([str(tmp_path / "settings.md")]) == 0
    assert (tmp_path / "settings.md").read_text() == page()
    assert (DOCS / "reference" / "settings.md").read_text() == page()
