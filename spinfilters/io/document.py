"""Documents of keys and values: plain YAML, the finite numbers of a key of YAML or TOML, and elements of XML without entities."""

import json
import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text, read_bytes, read_settings_text, reason, value_text

_MOST_NESTED = 20  # of brackets and blocks in YAML, whose reader works from nested calls
_MOST_NODES = 20_000  # of a YAML file: a calibration has a hundred
_MOST_NODES_OF_ROWS = 500_000  # of a list of rows, each of about ten: a minute of reading
LARGEST_ROWS = 16 << 20
"""Bytes of a list of rows."""


def read_yaml(path: Path) -> dict[str, Any]:
    """Mapping of a YAML file of at most 1 MiB.

    Plain values only: no object tags, no aliases, no merge keys.
    A few aliases in one another name more values than memory holds, so they are refused before any is looked up.

    Raises
    ------
    InputError
        Unreadable file, text that is not YAML, tags such as !!python, aliases, too many or too deeply nested
        values, or no mapping at the top.
    """
    document = _parsed(path, read_settings_text(path), _MOST_NODES)
    if not isinstance(document, dict):
        raise InputError(
            f"{path_text(path)}: holds {value_text(document)}, expected 'key: value' lines; copy it again"
        )
    return document


def read_yaml_rows(path: Path) -> Any:
    """The document of a YAML file of at most 16 MiB as JSON has it, or a list of several: dates and all keys are texts.

    Raises
    ------
    InputError
        As `read_yaml`.
    """
    try:
        text = read_bytes(path, LARGEST_ROWS).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path_text(path)}: is not UTF-8; save it as UTF-8 text") from None
    documents = _parsed_all(path, text, _MOST_NODES_OF_ROWS)
    document = documents[0] if len(documents) == 1 else documents
    try:
        return json.loads(json.dumps(document, default=str))
    except (TypeError, ValueError, RecursionError) as error:  # a key that is a list
        raise InputError(
            f"{path_text(path)}: has other keys than texts ({reason(error)}); correct it"
        ) from None


def _parsed(path: Path, text: str, most_nodes: int) -> Any:
    """The one document of a text in YAML of at most so many values. InputError: see `read_yaml`; several documents."""
    documents = _parsed_all(path, text, most_nodes)
    if len(documents) > 1:
        raise InputError(
            f"{path_text(path)}: holds {len(documents)} documents, expected one; leave out the others"
        )
    return documents[0] if documents else None


def _parsed_all(path: Path, text: str, most_nodes: int) -> list[Any]:
    """Documents of a text in YAML of at most so many values, without empty ones. InputError: see `read_yaml`."""
    import yaml  # here alone: few recordings have a camera's file

    try:
        _refuse_growth(path, text, most_nodes)
        return [each for each in yaml.safe_load_all(text) if each is not None]
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        problem = reason(ValueError(error.problem))
        raise InputError(
            f"{path_text(path)}: line {line}: is not plain YAML ({problem}); correct that line"
        ) from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError(f"{path_text(path)}: is not YAML ({reason(error)}); correct it") from None


def _refuse_growth(path: Path, text: str, most_nodes: int) -> None:
    """Refuse YAML that would become larger or deeper than it looks."""
    import yaml

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
        if depth > _MOST_NESTED or nodes > most_nodes:
            raise InputError(
                f"{line}nests values more than {_MOST_NESTED} deep or holds more than {most_nodes}; copy the file again"
            )


def numbers(path: Path, key: str, value: object, shape: tuple[int, ...]) -> Float[np.ndarray, "..."]:
    """Finite numbers of a key as an array of this shape; text such as '1e-3', which YAML reads as text, is accepted.

    Raises
    ------
    InputError
        Another shape, a cell that is no finite number; the text names the file, the key and the value.
    """
    items = value if isinstance(value, list) else [value]
    if len(shape) == 2:
        if len(items) != shape[0]:
            raise _wrong_shape(path, key, value, shape)
        rows = [numbers(path, key, row, shape[1:]) for row in items]
        return np.array(rows)
    if (len(items),) != (shape or (1,)) or (isinstance(value, list) != bool(shape)):
        raise _wrong_shape(path, key, value, shape)
    return np.array([_finite_number(path, key, item) for item in items]).reshape(shape)


def _finite_number(path: Path, key: str, item: object) -> float:
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


LARGEST_XML = 512 * 1024**2
"""Bytes; its elements take some ten times as much memory."""


def read_xml(path: Path) -> ElementTree.Element:
    """Root of an XML file, its names without name spaces.

    Raises
    ------
    InputError
        As `read_bytes`; no XML in UTF-8; a document type, whose entities could unpack to any size.
    """
    data = read_bytes(path, LARGEST_XML)
    if b"\0" in data or b"<!DOCTYPE" in data.upper():
        raise InputError(f"{path_text(path)}: is no UTF-8 XML without a document type; export it again")
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, RecursionError, LookupError, ValueError) as error:
        raise InputError(f"{path_text(path)}: is not XML ({reason(error)}); export it again") from None
    return without_name_spaces(root)


def without_name_spaces(root: ElementTree.Element) -> ElementTree.Element:
    """The element, its name and those of all within it without name spaces."""
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    return root
