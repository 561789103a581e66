"""TOML and YAML of strangers as plain values, and numbers taken out of them."""

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.logs.input_file import named, read_settings_text, reason, shown

_MOST_DOTS = 64  # on a TOML line: tomllib takes memory as the square of the parts of a dotted key


def read_toml(path: Path) -> dict[str, Any]:
    """Document of a TOML file of at most 1 MiB. InputError: unreadable file, or text that is not TOML."""
    text = read_settings_text(path)
    for number, line in enumerate(text.split("\n"), start=1):
        if line.count(".") > _MOST_DOTS:
            raise InputError(
                f"{named(path)}: line {number}: has more than {_MOST_DOTS} dots; shorten that line"
            )
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{named(path)}: is not TOML ({reason(error)}); correct that line") from None


def read_yaml(path: Path) -> dict[str, Any]:
    """Mapping of a YAML file of at most 1 MiB, plain values only (no object tags).

    Raises
    ------
    InputError: unreadable file, text that is not YAML, tags such as !!python, or no mapping at the top.
    """
    text = read_settings_text(path)
    try:
        document = yaml.safe_load(text)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        problem = reason(ValueError(error.problem))
        raise InputError(
            f"{named(path)}: line {line}: is not plain YAML ({problem}); correct that line"
        ) from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError(f"{named(path)}: is not YAML ({reason(error)}); correct it") from None
    if not isinstance(document, dict):
        raise InputError(
            f"{named(path)}: holds {shown(document)}, expected 'key: value' lines; copy it again"
        )
    return document


def numbers(path: Path, key: str, value: object, shape: tuple[int, ...]) -> Float[np.ndarray, "..."]:
    """Finite numbers of a key as an array of the given shape; text such as '1e-3', no number in YAML, counts.

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
        raise InputError(f"{named(path)}: {key} holds {shown(item)}, not a finite number; correct it")
    return number


def _wrong_shape(path: Path, key: str, value: object, shape: tuple[int, ...]) -> InputError:
    expected = "x".join(map(str, shape)) + " numbers" if shape else "a number"
    return InputError(f"{named(path)}: {key} is {shown(value)}, expected {expected}; correct it")
