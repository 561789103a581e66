"""Validated reading of TOML and YAML files, and of numbers in them."""

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float

from spinfilters.data.input_file import path_text, read_settings_text, reason, value_text
from spinfilters.errors import InputError

_MOST_DOTS = 64  # on a TOML line: tomllib takes memory as the square of the parts of a dotted key
_MOST_NESTED = 20  # of brackets and blocks in YAML, whose reader works from nested calls
_MOST_NODES = 20_000  # of a YAML file: a calibration has a hundred


def read_toml(path: Path) -> dict[str, Any]:
    """Document of a TOML file of at most 1 MiB.

    InputError: unreadable file, or text that is not TOML.
    """
    text = read_settings_text(path)
    for number, line in enumerate(text.split("\n"), start=1):
        if line.count(".") > _MOST_DOTS:
            raise InputError(
                f"{path_text(path)}: line {number}: has more than {_MOST_DOTS} dots; shorten that line"
            )
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path_text(path)}: is not TOML ({reason(error)}); correct that line") from None


def read_yaml(path: Path) -> dict[str, Any]:
    """Mapping of a YAML file of at most 1 MiB.

    Plain values only: no object tags, no aliases, no merge keys.
    A few aliases in one another name more values than memory holds, so they are refused before any is looked up.

    Raises
    ------
    InputError: unreadable file, text that is not YAML, tags such as !!python, aliases, too many or too deeply nested values, or
    no mapping at the top.
    """
    text = read_settings_text(path)
    try:
        _refuse_growth(path, text)
        document = yaml.safe_load(text)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        problem = reason(ValueError(error.problem))
        raise InputError(
            f"{path_text(path)}: line {line}: is not plain YAML ({problem}); correct that line"
        ) from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError(f"{path_text(path)}: is not YAML ({reason(error)}); correct it") from None
    if not isinstance(document, dict):
        raise InputError(
            f"{path_text(path)}: holds {value_text(document)}, expected 'key: value' lines; copy it again"
        )
    return document


def _refuse_growth(path: Path, text: str) -> None:
    """Refuse YAML that would become larger or deeper than it looks."""
    depth = nodes = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        line = f"{path_text(path)}: line {event.start_mark.line + 1}: "
        if isinstance(event, yaml.AliasEvent):
            raise InputError(
                f"{line}refers to another value (*{value_text(event.anchor)[1:-1]}); write the value itself"
            )
        if isinstance(event, yaml.ScalarEvent) and event.value == "<<":
            raise InputError(f"{line}has a merge key (<<); write the keys themselves")
        nodes += isinstance(event, yaml.NodeEvent)
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _MOST_NESTED or nodes > _MOST_NODES:
            raise InputError(
                f"{line}nests values more than {_MOST_NESTED} deep or holds more than {_MOST_NODES}; copy the file again"
            )


def numbers(path: Path, key: str, value: object, shape: tuple[int, ...]) -> Float[np.ndarray, "..."]:
    """Finite numbers of a key as an array of this shape.

    Text such as '1e-3', no number in YAML, counts.

    Raises
    ------
    InputError: another shape, a cell that is no finite number; the text names the file, the key and the
    value.
    """
    items = value if isinstance(value, list) else [value]
    if len(shape) == 2:
        if len(items) != shape[0]:
            raise _wrong_shape(path, key, value, shape)
        rows = [numbers(path, key, row, shape[1:]) for row in items]
        return np.array(rows)
    if (len(items),) != (shape or (1,)) or (isinstance(value, list) != bool(shape)):
        raise _wrong_shape(path, key, value, shape)
    return np.array([_number(path, key, item) for item in items]).reshape(shape)


def _number(path: Path, key: str, item: object) -> float:
    number = math.nan
    if isinstance(item, int | float | str) and not isinstance(item, bool):
        try:
            number = float(item)
        except (ValueError, OverflowError):
            number = math.nan
    if not math.isfinite(number):
        raise InputError(
            f"{path_text(path)}: {key} holds {value_text(item)}, not a finite number; correct it"
        )
    return number


def _wrong_shape(path: Path, key: str, value: object, shape: tuple[int, ...]) -> InputError:
    expected = "x".join(map(str, shape)) + " numbers" if shape else "a number"
    return InputError(f"{path_text(path)}: {key} is {value_text(value)}, expected {expected}; correct it")
