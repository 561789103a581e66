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


@pytest.mark.parametrize("table", TABLES)
def test_every_setting_is_taken_from_its_table(table: str) -> None:
    for key, default in Settings().document[table].items():
        changed = not default if isinstance(default, bool) else 0.5 if default == "auto" else default + 1
        assert settings_from({table: {key: changed}}, "test").document[table][key] == changed


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
