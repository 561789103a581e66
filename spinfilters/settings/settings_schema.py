"""JSON Schema of a settings file, and of any record that settings or studies are validated by."""

import re
from dataclasses import fields
from inspect import getdoc
from typing import Any, Final, get_type_hints

from pydantic import TypeAdapter

from spinfilters.io.consider_parameter import consider_parameters
from spinfilters.io.sensor_format import noise_options
from spinfilters.models.state_blocks import BLOCKS, StateBlock
from spinfilters.settings.run_settings import CalibrationSettings, SensorSettings, Settings

DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"
_ROW: Final = re.compile(r"^(\w+(?:, \w+)*) : .*\n((?:[ ]{4}.*\n?)+)", re.MULTILINE)
"""Names and indented text of a row of a docstring in numpydoc's form."""


def settings_schema() -> dict[str, Any]:
    """JSON Schema of a settings file as TOML or JSON holds it."""
    return {"$schema": DIALECT, "title": "Settings of spinfilters", **record_schema(Settings)}


def record_schema(record: type) -> dict[str, Any]:
    """JSON Schema of a dataclass with the ranges of its annotations and the words of its docstring; unknown keys are refused.

    Parameters
    ----------
    record : type
        A dataclass; its fields that are dataclasses become tables under ``$defs``.

    Returns
    -------
    dict[str, Any]
        The schema.
    """
    schema = TypeAdapter(record).json_schema()
    records = {each.__name__: each for each in (record, *_tables_of(record))}
    for name, table in (*schema.get("$defs", {}).items(), (record.__name__, schema)):
        if name not in records:
            continue
        table["additionalProperties"] = False
        table["description"] = str(getdoc(records[name])).partition("\n")[0]
        words = field_words(records[name])
        for key, held in table.get("properties", {}).items():
            held.pop("title", None)
            if key in words:
                held["description"] = words[key]
    return schema


def field_words(record: type) -> dict[str, str]:
    """What each field of a record is, by its name.

    Parameters
    ----------
    record : type
        A dataclass of settings or of a study.

    Returns
    -------
    dict[str, str]
        One line a field, of its docstring or of the sensor that has it.
    """
    if record is SensorSettings:
        return {
            name: f"Standard deviation of the noise: {each.words}. {each.remark}".rstrip()
            for name, each in noise_options().items()
        }
    if record is CalibrationSettings:
        return {
            name: f"Standard deviation of {each.words}. {each.remark}".rstrip()
            for name, each in consider_parameters().items()
        }
    found = {each.prior_option: _prior_text(each) for each in BLOCKS.values()}
    found = {name: text for name, text in found.items() if name in record.__annotations__}
    for owner in reversed(record.__mro__):
        for names, text in _ROW.findall(f"{getdoc(owner) or ''}\n"):
            found |= dict.fromkeys(names.split(", "), " ".join(text.split()))
    return found


def _prior_text(block: StateBlock) -> str:
    """Help of the prior of a constant, with its unit unless it is a pure number."""
    unit = "" if block.unit == "1" else f", {block.unit}"
    return f"Prior standard deviation of {block.phrase}{unit}."


def _tables_of(record: type) -> list[type]:
    """Dataclasses that the fields of a dataclass hold."""
    hints = get_type_hints(record)
    return [hints[each.name] for each in fields(record) if hasattr(hints[each.name], "__dataclass_fields__")]
