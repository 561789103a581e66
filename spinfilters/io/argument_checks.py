"""Checks of the arguments of public functions, before anything is done with them.

Each check is what an argument may be: it takes its name and its value, and raises InputError with the name, the value and the
cure.
"""

import inspect
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from typing import Any, Final, NoReturn, ParamSpec, TypeVar

import numpy as np

from spinfilters.core.errors import InputError
from spinfilters.io.argument_fields import GivenField, given_fields
from spinfilters.io.input_file import value_text
from spinfilters.io.stated_values import NumberRange, plain_number

P = ParamSpec("P")
T = TypeVar("T")
Check = Callable[[str, Any], None]
"""Raises InputError for a value that the argument of this name cannot be."""


def checked_arguments(*records: type, **checks: Check) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Decorator: arguments are checked before the function is called, with numbers of Python for NumPy's.

    Parameters
    ----------
    *records : type
        Dataclasses whose given fields (`spinfilters.io.argument_fields`) say what the arguments of their names may be.
    **checks : Check
        Of further arguments, or in place of those of the records.

    Raises
    ------
    InputError
        At a call, for the first argument that its check refuses.
    """
    own = {field.name: check_of(field) for record in records for field in given_fields(record)}

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        """The function behind its checks."""
        signature = inspect.signature(function)
        assert checks.keys() <= signature.parameters.keys()
        every = own | checks

        @wraps(function)
        def checked(*args: P.args, **kwargs: P.kwargs) -> T:
            """The call, its arguments checked."""
            try:
                bound = signature.bind(*args, **kwargs)
            except TypeError as error:  # named and answered as by a function without checks
                taken = ", ".join(signature.parameters)
                raise TypeError(f"{function.__name__}(): {error}; its arguments are {taken}") from None
            for name, value in bound.arguments.items():
                if name in every:
                    bound.arguments[name] = plain_numbers(value)
                    every[name](name, bound.arguments[name])
            return function(*bound.args, **bound.kwargs)

        return checked

    return decorate


def check_of(field: GivenField) -> Check:
    """Check of an argument that a record describes: by its type, its range and the values to choose from."""
    if field.is_named:
        return optional(numbers_by_name(f"numbers by name: {field.argument.cure}"))
    if field.kind is bool:
        check: Check = truth
    elif field.allowed is not None:
        check = number(field.allowed) if field.count is None else three_numbers(field.allowed)
    elif field.count is not None:
        check = names(field.argument.cure)
    else:
        check = text(field.argument.cure)
    return optional(check) if field.is_optional else check


def plain_numbers(value: Any, depth: int = 6) -> Any:
    """A value with numbers of Python for NumPy's, in lists, tuples and dictionaries as well; rows of numbers become lists."""
    if depth == 0:
        return value
    if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "iuf":
        return value.tolist()
    if type(value) is dict:
        return {key: plain_numbers(each, depth - 1) for key, each in value.items()}
    if type(value) is list:
        return [plain_numbers(each, depth - 1) for each in value]
    if type(value) is tuple:
        return tuple(plain_numbers(each, depth - 1) for each in value)
    return plain_number(value)


def refuse(name: str, value: object, cure: str) -> NoReturn:
    """Raise InputError for an argument. ``cure``: what to give instead."""
    raise InputError(f"{name} is {value_text(value)}; give {cure}")


def optional(check: Check) -> Check:
    """None, or what the check allows."""

    def check_unless_none(name: str, value: Any) -> None:
        """The check, of a value that is there."""
        if value is not None:
            check(name, value)

    return check_unless_none


def path(what: str) -> Check:
    """The path of something, as text or os.PathLike."""

    def check(name: str, value: Any) -> None:
        """Whether the system can look for it."""
        if not is_path(value):
            refuse(name, value, f"the path of {what}, as text or pathlib.Path")

    return check


def one_of(*kinds: type, path_of: str = "", cure: str) -> Check:
    """An instance of some types, or a path where ``path_of`` says of what."""

    def check(name: str, value: Any) -> None:
        """Whether it is one."""
        if not isinstance(value, kinds) and not (path_of and is_path(value)):
            refuse(name, value, cure)

    return check


def text(cure: str) -> Check:
    """A text that is not empty."""

    def check(name: str, value: Any) -> None:
        """Whether it is one."""
        if not isinstance(value, str) or not value.strip():
            refuse(name, value, cure)

    return check


def names(cure: str) -> Check:
    """Names: one text that may list several with commas, or a list of texts."""

    def check(name: str, value: Any) -> None:
        """Whether there is one at least."""
        listed = value.split(",") if isinstance(value, str) else value
        plain = isinstance(listed, Iterable) and not isinstance(listed, Mapping | bytes | np.ndarray)
        if not plain or not isinstance(listed, Sequence | set | frozenset | tuple):
            refuse(name, value, cure)
        if not listed or not all(isinstance(each, str) and each.strip() for each in listed):
            refuse(name, value, cure)

    return check


def number(allowed: NumberRange) -> Check:
    """A number of a range."""
    return allowed.require


def three_numbers(allowed: NumberRange) -> Check:
    """Three numbers of a range, about the axes x, y, z: a list, a tuple or an array."""

    def check(name: str, value: Any) -> None:
        """Whether there are three."""
        listed = value.tolist() if isinstance(value, np.ndarray) else value
        if not isinstance(listed, Sequence) or isinstance(listed, str | bytes) or len(listed) != 3:
            refuse(name, value, "three numbers, about the axes x, y, z")
        for each in listed:
            allowed.require(name, each)

    return check


def numbers_by_name(cure: str) -> Check:
    """A mapping of names to finite numbers."""

    def check(name: str, value: Any) -> None:
        """Whether every value is a number."""
        if not isinstance(value, Mapping):
            refuse(name, value, cure)
        for key, each in value.items():
            is_number = isinstance(each, int | float) and not isinstance(each, bool)
            if not isinstance(key, str) or not is_number or not math.isfinite(each):
                refuse(name, value, cure)

    return check


def by_name(cure: str, each: Check | None = None) -> Check:
    """A mapping by name, of whatever, or of what a check allows."""

    def check(name: str, value: Any) -> None:
        """Whether it is one."""
        if not isinstance(value, Mapping):
            refuse(name, value, cure)
        if each is not None:
            for key, part in value.items():
                each(f"{name} of {key}", part)

    return check


def truth(name: str, value: Any) -> None:
    """True or False, and nothing that only counts as one."""
    if not isinstance(value, bool | np.bool_):
        refuse(name, value, "True or False")


def called(name: str, value: Any) -> None:
    """A function."""
    if not callable(value):
        refuse(name, value, "a function, which is called during the work")


def is_path(value: Any) -> bool:
    """Whether it is a text or os.PathLike of one, not empty, without what no system allows in a path."""
    if isinstance(value, os.PathLike):
        value = os.fspath(value)
    return isinstance(value, str) and bool(value) and "\0" not in value


KIND: Final = 'a kind of measurements, such as "gyro"'
ESTIMATORS: Final = 'names such as "mekf,smoother", or a list of at least one'
