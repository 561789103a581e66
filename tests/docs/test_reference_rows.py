"""No row of the reference is empty: public functions document every parameter and result, records every field."""

import importlib
import inspect
import re
from collections.abc import Collection, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import spinfilters

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "index.md"
HEADING = re.compile(r"^([A-Z][A-Za-z ]+)\n-+$", re.MULTILINE)
NAMES = re.compile(r"^(\*{0,2}\w+(?:, \*{0,2}\w+)*)(?: :.*)?$", re.MULTILINE)


def documented() -> dict[str, Any]:
    """Objects that the page shows, by name: the package's public names, and each that it lists."""
    found: dict[str, Any] = {name: getattr(spinfilters, name) for name in spinfilters.__all__}
    for path in re.findall(r"^::: (\S+)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE):
        module, _, name = path.rpartition(".")
        if module:
            found[path] = getattr(importlib.import_module(module), name)
    return found


def sections(text: str) -> dict[str, list[str]]:
    """Names in each section of a docstring in numpydoc's form."""
    parts = HEADING.split(text)
    found = {}
    for heading, body in zip(parts[1::2], parts[2::2], strict=True):
        found[heading] = [name.lstrip("*") for line in NAMES.findall(body) for name in line.split(", ")]
    return found


def callables(name: str, thing: Any, every: Collection[Any]) -> Iterator[tuple[str, Any]]:
    """The function, or the public methods that a class has of its own; those of a base are told there."""
    if inspect.isfunction(thing):
        yield name, thing
    elif inspect.isclass(thing):
        told = {key for base in thing.__mro__[1:] if base in every for key in vars(base)}
        for key, member in vars(thing).items():
            function = getattr(member, "__func__", member)
            if not key.startswith("_") and key not in told and inspect.isfunction(function):
                yield f"{name}.{key}", function


def empty_rows() -> Iterator[str]:
    """What the reference would show without words."""
    every = documented()
    for name, thing in every.items():
        for path, function in callables(name, thing, every.values()):
            told = sections(inspect.getdoc(function) or "")
            signature = inspect.signature(function)
            asked = [each for each in signature.parameters if each not in ("self", "cls")]
            asked = [each for each in asked if each not in told.get("Parameters", [])]
            if asked:
                yield f"{path}: Parameters lacks {', '.join(asked)}"
            if signature.return_annotation not in (None, "None") and not {"Returns", "Yields"} & set(told):
                yield f"{path}: Returns is missing"
        if inspect.isclass(thing):
            told = sections(inspect.getdoc(thing) or "")
            names = (
                [each.name for each in fields(thing) if not each.name.startswith("_")]
                if is_dataclass(thing)
                else []
            )
            listed = (*told.get("Attributes", []), *told.get("Parameters", []))
            lacking = [each for each in names if each not in listed]
            if lacking:
                yield f"{name}: Attributes lacks {', '.join(lacking)}"


def test_no_row_of_the_reference_is_empty() -> None:
    assert not list(empty_rows())


def test_the_page_shows_every_public_name_of_the_package() -> None:
    page = PAGE.read_text(encoding="utf-8")
    (listed,) = re.findall(r"^::: spinfilters\n    options:\n      members: \[([^]]*)\]", page, re.MULTILINE)
    assert set(re.findall(r"\w+", listed)) == set(spinfilters.__all__)
