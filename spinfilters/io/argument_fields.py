"""Arguments: the fields of a record that users give, on a command line or from Python.

A record is a frozen dataclass. A field that users give is annotated with an `Argument`, and its numbers with a `NumberRange`::

    frames: Annotated[int, NumberRange(1, 100_000, whole=True), Argument("number of epochs")] = 115

Parser, help with defaults, checks of Python arguments and the page of all commands are made from these annotations, so that a
parameter stands once. Nothing heavy is imported here: help is quick.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, fields
from functools import cache
from inspect import get_annotations
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Literal, TypeVar, Union, get_args, get_origin

from spinfilters.core.errors import InputError
from spinfilters.io.input_file import value_text
from spinfilters.io.stated_values import Argument, FieldNote, NumberRange

R = TypeVar("R")


@dataclass(frozen=True)
class GivenField:
    """A field that users give, as its annotation describes it.

    Attributes
    ----------
    path : tuple[str, ...]
        Field names from the outermost record to it.
    kind : Any
        Type of its values, without None and without annotations.
    is_optional : bool
        Whether it may be None.
    default : Any
        `dataclasses.MISSING` where it has to be given.
    allowed : NumberRange or None
        Range of its numbers.
    group : str
        Title of the group that lists it.
    """

    path: tuple[str, ...]
    argument: Argument
    kind: Any
    is_optional: bool
    default: Any
    allowed: NumberRange | None
    group: str = ""

    @property
    def name(self) -> str:
        """Name by which Python and the parsed arguments know it."""
        return self.argument.name or self.path[-1]

    @property
    def flag(self) -> str:
        """Flag on the command line; of one given by its place, its metavar."""
        if self.argument.positional:
            return str(self.argument.metavar)
        return self.argument.flag or f"--{self.name.replace('_', '-')}"

    @property
    def usage(self) -> str:
        """How it is given on the command line, such as ``-o OUT or --output OUT``."""
        if self.argument.positional:
            return self.flag
        metavar = self.argument.metavar
        names = metavar if isinstance(metavar, str) else " ".join(metavar)
        flags = (self.argument.short, self.flag) if self.argument.short else (self.flag,)
        return " or ".join(f"{flag} {names}".strip() for flag in flags)

    @property
    def choices(self) -> tuple[Any, ...] | None:
        """Values of which one has to be given; None where there is no list of them."""
        kinds = (self.kind, *get_args(self.kind))
        return next((get_args(each) for each in kinds if get_origin(each) is Literal), None)

    @property
    def count(self) -> int | None:
        """How many values one use of it takes: None for a single one, 0 for one or more."""
        if get_origin(self.kind) is not tuple:
            return None
        parts = get_args(self._element if self.is_repeated else self.kind)
        return 0 if Ellipsis in parts else len(parts)

    @property
    def is_repeated(self) -> bool:
        """Whether it may be given several times, with several values each."""
        return get_origin(self.kind) is tuple and get_origin(self._element) is tuple

    @property
    def is_named(self) -> bool:
        """Whether it is given as names with a number each."""
        return get_args(self.kind)[:1] == (tuple[str, float],)

    @property
    def help(self) -> str:
        """Help of the argument with its default."""
        text = default_text(self.default)
        told = not text or "(default" in self.argument.help
        return self.argument.help if told else f"{self.argument.help} (default {text})"

    @property
    def _element(self) -> Any:
        return _plain(get_args(self.kind)[0])


NO_DEFAULT: Final = (None, False, "", (), MISSING)
"""Defaults that the help does not mention."""


def default_text(value: Any) -> str:
    """A default as it would be given on a command line; empty where nothing would be given."""
    if any(value is each or (type(value) is type(each) and value == each) for each in NO_DEFAULT):
        return ""
    if isinstance(value, tuple):
        return " ".join(default_text(each) for each in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


@cache
def given_fields(record: type) -> tuple[GivenField, ...]:
    """Fields of a record that users give, those of groups in their place.

    Parameters
    ----------
    record : type
        A dataclass whose annotations are evaluated; a field without an `Argument` is not given by users.
    """
    return tuple(_given_fields(record, (), "", ()))


def _given_fields(
    record: type, path: tuple[str, ...], title: str, only: tuple[str, ...]
) -> Iterator[GivenField]:
    for each in fields(record):
        hint = _annotation(record, each.name)
        if get_origin(hint) is not Annotated or (only and each.name not in only):
            continue
        kind, *notes = get_args(hint)
        inside = (*path, each.name)
        for note in notes:
            if note.group is not None:
                yield from _given_fields(kind, inside, note.group.title or title, note.group.only)
            elif note.argument is not None:
                yield _given_field(each, inside, kind, note.argument, notes, title)


def _given_field(
    each: Field[Any], path: tuple[str, ...], kind: Any, argument: Argument, notes: Sequence[Any], title: str
) -> GivenField:
    parts = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    rest = [part for part in parts if part is not NoneType]
    default = each.default if each.default_factory is MISSING else each.default_factory()
    ranges = [note.range for note in (*notes, *_inner_notes(kind)) if note.range is not None]
    allowed = ranges[0] if ranges else None
    return GivenField(path, argument, _plain(rest[0]), len(rest) < len(parts), default, allowed, title)


def _annotation(record: type, name: str) -> Any:
    """Annotation of a field in the class that defines it."""
    for owner in record.__mro__:
        if name in (found := get_annotations(owner)):
            return found[name]
    raise AssertionError(f"{record.__name__} has no field {name}")


def _plain(kind: Any) -> Any:
    return get_args(kind)[0] if get_origin(kind) is Annotated else kind


def _inner_notes(kind: Any) -> Iterator[FieldNote]:
    """Notes in the annotations within a type, such as those of a tuple's elements."""
    for part in get_args(kind):
        if get_origin(part) is Annotated:
            yield from get_args(part)[1:]
        yield from _inner_notes(part)


def record_from(record: type[R], values: Mapping[str, Any]) -> R:
    """Record of values by the names of its arguments; what is missing there keeps its default.

    Raises
    ------
    InputError
        The record refuses a value.
    """
    return _record_from(record, values, given_fields(record), 0)


def _record_from(record: type[R], values: Mapping[str, Any], given: Sequence[GivenField], depth: int) -> R:
    found: dict[str, Any] = {}
    for each in fields(record):  # pyright: ignore[reportArgumentType]
        inside = [field for field in given if field.path[depth] == each.name]
        if inside and len(inside[0].path) > depth + 1:  # a group: a record of its own
            kind = _plain(_annotation(record, each.name))
            found[each.name] = _record_from(kind, values, inside, depth + 1)
        elif inside and inside[0].name in values:
            found[each.name] = values[inside[0].name]
    return record(**found)


def numbers_by_name(field: GivenField, given: Sequence[Sequence[str]]) -> tuple[tuple[str, float], ...]:
    """Numbers by name of an option that was given several times, each with a name and a number.

    Raises
    ------
    InputError
        Text that is no number, several numbers, a name that is given twice.
    """
    found: dict[str, float] = {}
    for name, *rest in given:
        if name in found:
            raise InputError(f"{field.flag} {name} is given twice; give it once")
        if len(rest) > 1:
            raise InputError(f"{field.flag} {name} {' '.join(rest)}: give one number; repeat the option")
        if not rest and field.argument.bare is None:
            raise InputError(f"{field.flag} {name}: give {field.argument.cure}")
        try:
            found[name] = float(rest[0]) if rest else field.argument.bare or 0.0
        except ValueError:
            raise InputError(
                f"{field.flag} {name} {value_text(rest[0])}: give {field.argument.cure}"
            ) from None
    return tuple(found.items())
