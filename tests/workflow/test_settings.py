"""Settings and their TOML."""

from pathlib import Path

import pytest

from spinfilters.errors import InputError
from spinfilters.logs.atomic_write import write_toml
from spinfilters.workflow.settings import Settings, read_settings, settings_from

TABLES = [name for name in Settings().document if name != "estimators"]


def test_defaults_survive_their_file(tmp_path: Path) -> None:
    write_toml(tmp_path / "config.toml", Settings().document)
    assert read_settings(tmp_path / "config.toml") == Settings()


def test_an_empty_document_is_the_defaults() -> None:
    assert settings_from({}, "test") == Settings()


OTHER_NAMES = {
    "mode": "window",
    "gauge": "standard",
    "precision": "float32",
    "kernel": "huber",
    "gate_probability": 0.99,
    "shape": 1.0,
    "tolerance": 1e-3,
}
"""Of settings that cannot take one more than their default."""


def another(key: str, default: bool | float | str) -> bool | float | str:
    if key in OTHER_NAMES:
        return OTHER_NAMES[key]
    if isinstance(default, bool):
        return not default
    return 0.5 if isinstance(default, str) else default + 1


@pytest.mark.parametrize("table", TABLES)
def test_every_setting_is_taken_from_its_table(table: str) -> None:
    for key, default in Settings().document[table].items():
        changed = another(key, default)
        assert settings_from({table: {key: changed}}, "test").document[table][key] == changed


@pytest.mark.parametrize(
    ("table", "key", "value"),
    [
        ("smoother", "width", -2.0),
        ("smoother", "mode", "sliding"),
        ("robust", "kernel", "soft"),
        ("landmarks", "gauge", 3),
        ("landmarks", "modes", 2.5),
    ],
)
def test_a_setting_that_cannot_be_is_named(table: str, key: str, value: object) -> None:
    with pytest.raises(InputError, match=rf"test: .*{key}"):
        settings_from({table: {key: value}}, "test")


@pytest.mark.parametrize("table", TABLES)
def test_an_unknown_key_is_named_with_those_that_exist(table: str) -> None:
    with pytest.raises(
        InputError,
        match=rf"test: unknown key {table}\.speed; known are {next(iter(Settings().document[table]))}",
    ):
        settings_from({table: {"speed": 1.0}}, "test")


def test_a_whole_number_is_good_for_a_real_one() -> None:
    assert settings_from({"process": {"force_psd": 1}}, "test").process.force_psd == 1.0


def test_provenance_of_another_run_is_not_a_setting() -> None:
    assert settings_from({"provenance": {"python": "2.7"}}, "test") == Settings()
