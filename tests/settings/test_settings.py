"""Settings and their TOML."""

import pickle
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.core.robust_losses import LOSS_NAMES, build_loss
from spinfilters.io.consider_parameter import consider_parameters
from spinfilters.io.output_files import write_toml
from spinfilters.io.stated_values import NumberRange
from spinfilters.models.process import ProcessNoise
from spinfilters.settings.run_settings import (
    InitialisationOptions,
    ProcessSettings,
    SensorSettings,
    Settings,
    SmootherSettings,
    TruthValue,
    read_settings,
    settings_from,
    with_keys,
)
from spinfilters.settings.settings_page import page
from spinfilters.smoother.solver import Dogleg

TABLES = [name for name, value in Settings().document.items() if isinstance(value, dict)]


def test_defaults_survive_their_file(tmp_path: Path) -> None:
    write_toml(tmp_path / "config.toml", Settings().document)
    assert read_settings(tmp_path / "config.toml") == Settings()


def test_an_empty_document_is_the_defaults() -> None:
    assert settings_from({}, "test") == Settings()


OTHER_NAMES = {
    "mode": "window",
    "gauge": "standard",
    "precision": "float32",
    "loss": "huber",
    "step": "dogleg",
    "gate_probability": 0.99,
    "shape": 1.0,
    "tolerance": 1e-3,
    "gravity": False,
    "coordinates": "mrp",
    **dict.fromkeys(consider_parameters(), 0.05),
}
"""Of settings that cannot take one more than their default."""


OF_BELIEFS = ("mean", "std", "covariance")
"""Settings that hold numbers by block (`spinfilters.settings.stated_belief`), with tests of their own."""


def single_settings(table: str) -> dict[str, bool | float | str]:
    """Settings of a table that are one number, word or choice, with their defaults."""
    return {key: value for key, value in Settings().document[table].items() if key not in OF_BELIEFS}


def another(key: str, default: bool | float | str) -> bool | float | str:
    if key in OTHER_NAMES:
        return OTHER_NAMES[key]
    if isinstance(default, bool):
        return not default
    return 0.5 if isinstance(default, str) else default + 1


@pytest.mark.parametrize("table", TABLES)
def test_every_setting_is_taken_from_its_table(table: str) -> None:
    for key, default in single_settings(table).items():
        changed = another(key, default)
        assert settings_from({table: {key: changed}}, "test").document[table][key] == changed


@pytest.mark.parametrize("table", TABLES)
def test_every_number_may_be_of_numpy(table: str, tmp_path: Path) -> None:
    for key, default in single_settings(table).items():
        changed = another(key, default)
        if isinstance(changed, str):
            continue
        for given in (np.array(changed), np.array(changed)[()]):
            found = settings_from({table: {key: given}}, "test")
            assert found == settings_from({table: {key: changed}}, "test")
            write_toml(tmp_path / "config.toml", found.document)
            assert type(found.document[table][key]) in (bool, int, float)
    single = settings_from({"process": {"tolerance": np.float32(1e-3)}}, "test")
    assert single.process.tolerance == float(np.float32(1e-3))


@pytest.mark.parametrize(
    ("table", "key", "value"),
    [
        ("smoother", "width", -2.0),
        ("smoother", "mode", "sliding"),
        ("robust", "loss", "soft"),
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


def test_tables_may_be_mappings_of_their_keys() -> None:
    given = Settings(sensors={"pixel_std": 0.5}, smoother={"mode": "window"})  # pyright: ignore[reportArgumentType]
    assert given == settings_from({"sensors": {"pixel_std": 0.5}, "smoother": {"mode": "window"}}, "test")
    assert given.sensors == SensorSettings(pixel_std=0.5)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        (
            {"sensors": {"pixel_std": -1.0}},
            'sensors.pixel_std is -1.0; give "auto" or a number from 1e-12 to',
        ),
        ({"sensors": SensorSettings(pixel_std=-1.0)}, "sensors.pixel_std is -1.0; give"),
        (
            {"initialisation": InitialisationOptions(epochs=10**7)},
            "initialisation.epochs is 10000000; give a whole number from 1 to 100000",
        ),
        ({"process": {"drag": 1}}, "process.drag is 1; give true or false"),
        (
            {"process": {"drag": "cubic"}},
            'process.drag is \'cubic\'; give true or false or "linear" or "quadratic" or "auto"',
        ),
        ({"process": 3}, r"process is 3; it must be a table \[process\]"),
        ({"landmarks": {"precision": 3}}, "landmarks.precision is 3; give a name"),
        ({"estimators": ("mekf", 1)}, "estimators holds 1; give a list of names"),
        ({"estimators": "mekf"}, "estimators is 'mekf'; give a list of names"),
        ({"ukf": {"gamma": 1}}, "unknown key ukf.gamma; known are alpha, beta, kappa"),
    ],
)
def test_settings_made_in_python_are_validated_as_those_of_a_file(values: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=f"^{says}"):
        Settings(**values)


@pytest.mark.parametrize("key", ["self", "__dataclass_self__", "kind", "a\nb"])
def test_a_key_of_any_name_is_refused_in_one_line(key: str) -> None:
    with pytest.raises(InputError, match=r"test: unknown key 'a?[^\n]*'; known are estimators"):
        settings_from({key: 1}, "test")


def test_every_number_of_the_settings_has_a_range() -> None:
    for table, kind in get_type_hints(Settings, include_extras=True).items():
        for key, hint in get_type_hints(kind, include_extras=True).items() if table in TABLES else ():
            if key in OF_BELIEFS:
                continue
            members = (
                get_args(hint) if get_origin(hint) is UnionType or get_origin(hint) is Union else (hint,)
            )
            for member in members:
                told = any(isinstance(each, NumberRange | TruthValue) for each in get_args(member))
                assert told or member is str or get_origin(member) is Literal, f"{table}.{key}"


@pytest.mark.parametrize("default", [Settings(), Settings(process=ProcessSettings())])
def test_defaults_need_no_validation(default: Settings) -> None:
    assert default._validated() == {}


def test_a_keyword_that_is_no_table_is_a_mistake_of_the_program() -> None:
    with pytest.raises(TypeError, match="speed"):
        Settings(speed=1)  # pyright: ignore[reportCallIssue]


@pytest.mark.parametrize("name", LOSS_NAMES)
def test_filters_and_smoother_take_every_loss_of_the_table(name: str) -> None:
    settings = with_keys(Settings(), [f"robust.loss={name}", f"smoother.loss={name}"])
    assert settings.robust.loss == name
    assert settings.smoother.robust_loss == build_loss(name, settings.smoother.width, settings.smoother.shape)
    assert page().count(f'"{name}"') >= 2


def test_settings_of_the_thesis_have_a_name_unless_a_file_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    thesis = read_settings(Path("tweddle"))
    assert thesis.estimators == ("smoother",)
    assert (thesis.process.force_psd, thesis.sensors.pixel_std, thesis.smoother.iterations) == (1e-6, 1.0, 7)
    assert thesis.smoother.options(10).step_rule == Dogleg()
    with pytest.raises(InputError):
        read_settings(tmp_path / "tweddle")
    (tmp_path / "tweddle").write_text("[smoother]\niterations = 3\n")
    assert read_settings(Path("tweddle")).smoother.iterations == 3


def test_an_unknown_step_rule_is_named_with_those_there_are() -> None:
    with pytest.raises(
        InputError, match=r"smoother\.step 'newton' is unknown; choose from gauss-newton, dogleg"
    ):
        SmootherSettings(step="newton")


def test_settings_go_to_another_process_and_back() -> None:
    """Pools of processes hand objects over by pickle, which finds classes by module and name."""
    settings = Settings(estimators=("mekf",))
    assert pickle.loads(pickle.dumps(settings)) == settings
    assert pickle.loads(pickle.dumps(ProcessNoise())) == ProcessNoise()
