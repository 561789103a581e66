"""Validation of settings by pydantic, imported where a value differs from its default."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ConfigDict, ValidationError, create_model

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import unknown_key, value_text


def validated(record: type, values: Mapping[str, object]) -> dict[str, Any]:
    """Validated values of some fields of a dataclass.

    Their types decide; tables given as mappings are turned into their dataclasses.

    Parameters
    ----------
    record : type
        A dataclass with annotated fields.
    values : Mapping[str, object]
        Values of some of its fields, by name.

    Returns
    -------
    dict[str, Any]
        The values, converted to the types of the fields.

    Raises
    ------
    InputError
        An unknown key in a table, a value of another type or out of its range.
    """
    try:
        checked = _model(record).model_validate(dict(values))
    except ValidationError as error:
        raise InputError(_line(record, error)) from None
    return {name: getattr(checked, name) for name in values}


@cache
def _model(record: type) -> type[BaseModel]:
    """Model of a dataclass' fields; tables that are dataclasses already are validated again."""
    config = ConfigDict(extra="forbid", revalidate_instances="always")
    hints = get_type_hints(record, include_extras=True)
    types: dict[str, Any] = {name: (kind, None) for name, kind in hints.items()}
    return create_model(record.__name__, __config__=config, **types)


def _line(record: type, error: ValidationError) -> str:
    """The first fault: its key, its value, what to give."""
    fault = error.errors(include_url=False, include_context=False)[0]
    value = value_text(fault["input"])
    table, *inner = map(str, fault["loc"])
    kind = get_type_hints(record, include_extras=True)[table]
    if not is_dataclass(kind):
        return f"{table} {'holds' if inner else 'is'} {value}; give {wanted(kind)}"
    if not inner:
        return f"{table} is {value}; it must be a table [{table}]"
    hints = get_type_hints(kind, include_extras=True)
    key, keys = inner[0], {each.name: hints[each.name] for each in fields(kind)}
    if key not in keys:
        return unknown_key(f"{table}.{value_text(key)[1:-1]}", key, keys)
    return f"{table}.{key} is {value}; give {wanted(keys[key])}"


def wanted(kind: Any) -> str:
    """Values that a type admits, in words."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Literal:
        return " or ".join(f'"{part}"' for part in parts)
    if origin is tuple and parts[0] is not str:
        return (
            f"{len(parts)} times {wanted(parts[0])}"
            if Ellipsis not in parts
            else f"a list, each {wanted(parts[0])}"
        )
    if origin is tuple:
        return "a list of names"
    if origin is Annotated:
        return str(parts[1])
    if kind is dict or origin is dict:
        return "a table"
    return {str: "a name", float: "a number"}.get(kind, "") or " or ".join(map(wanted, parts))
