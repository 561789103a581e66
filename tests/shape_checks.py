"""Every shape that an annotation of the package states, checked whenever the tests call it.

A call that returns must have had the shapes it states, in its arguments and in its result; one that is
refused is left alone, because refusing is the function's own business and has its own tests. So one suite
covers right and wrong shapes. (jaxtyping's own import hook checks arguments before the call: there its error
hides our `ShapeError`, and it trips over NumPy scalars and CasADi's types.)
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, is_dataclass
from functools import cache, cached_property, wraps
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from inspect import Parameter, signature
from types import CodeType, FunctionType, ModuleType
from typing import Any, get_args, get_origin

import numpy as np
from jaxtyping import AbstractArray, jaxtyped


class WrongShapeError(AssertionError):
    """A function went on with, or returned, an array that is not of the shape its annotation states."""


def check_shapes_of(package: str) -> None:
    """Check every function, method and dataclass of the package; to be called before its first import."""
    loaded = sorted(name for name in sys.modules if name == package or name.startswith(f"{package}."))
    if loaded:
        raise ImportError(f"{', '.join(loaded)} imported before its shapes could be checked")
    sys.meta_path.insert(0, _Finder(package))


class _Finder(MetaPathFinder):
    def __init__(self, package: str) -> None:
        self._package = package

    def find_spec(self, fullname: str, path: Any, target: ModuleType | None = None) -> ModuleSpec | None:
        if fullname.partition(".")[0] != self._package:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _CheckingLoader(spec.loader.name, spec.loader.path)
        return spec


class _CheckingLoader(SourceFileLoader):
    def exec_module(self, module: ModuleType) -> None:
        super().exec_module(module)
        for name, value in list(vars(module).items()):
            if getattr(value, "__module__", None) != module.__name__:
                continue
            if isinstance(value, FunctionType):
                setattr(module, name, checked(value))
            elif isinstance(value, type):
                check_class(value)


def check_class(cls: type) -> None:
    """Check the methods of a class, and the fields of a dataclass or named tuple when one is made."""
    for name, value in list(vars(cls).items()):
        if isinstance(value, FunctionType):
            setattr(cls, name, checked(value))
        elif isinstance(value, classmethod | staticmethod):
            setattr(cls, name, type(value)(checked(value.__func__)))
        elif isinstance(value, property) and isinstance(value.fget, FunctionType):
            setattr(cls, name, value.getter(checked(value.fget)))
        elif isinstance(value, cached_property) and isinstance(value.func, FunctionType):
            value.func = checked(value.func)
    maker = "__init__" if is_dataclass(cls) else "__new__" if hasattr(cls, "_fields") else None
    if maker is not None:
        made = getattr(cls, maker)
        made.__annotations__ = {**made.__annotations__, **cls.__annotations__}
        setattr(cls, maker, checked(made))


@dataclass
class _WithFactory:
    made: list[int] = field(default_factory=list)


def checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, with the shapes of its arguments and of its result checked after it has returned."""
    hints = {name: hint for name, hint in function.__annotations__.items() if _states_a_shape(hint)}
    if not hints:
        return function
    parameters = signature(function).parameters
    correct: set[Any] = set()

    def check_unseen(form: Any, *values: Any) -> None:
        _check(function, hints, dict(zip(looked_at, values, strict=True)))
        correct.add(form)

    looked_at = (*(name for name in parameters if name in hints), *["return"][: "return" in hints])
    names: dict[str, Any] = {"_function": function, "_correct": correct, "_check_unseen": check_unseen}
    names |= {"_form_of": _form, "_array": np.ndarray}
    names |= {f"_default_{each.name}": each.default for each in parameters.values()}
    kinds = tuple((each.name, each.kind, each.default is not each.empty) for each in parameters.values())
    exec(_wrapper_code(kinds, looked_at), names)
    return wraps(function)(names["wrapper"])


@cache
def _wrapper_code(parameters: tuple[tuple[str, Any, bool], ...], looked_at: tuple[str, ...]) -> CodeType:
    """Code of a wrapper with the parameters of what it calls, by name, kind and whether they have a default.

    Calls of the package pass through it hundreds of thousands of times a minute: arguments that are packed and unpacked, or a loop
    over them, would take a quarter of a run's time.
    """
    taken, given, last = list[str](), list[str](), None
    for name, kind, has_default in parameters:
        if last is Parameter.POSITIONAL_ONLY and kind is not last:
            taken.append("/")
        if kind is Parameter.KEYWORD_ONLY and last not in (kind, Parameter.VAR_POSITIONAL):
            taken.append("*")
        stars = {Parameter.VAR_POSITIONAL: "*", Parameter.VAR_KEYWORD: "**"}.get(kind, "")
        taken.append(f"{stars}{name}" + (f"=_default_{name}" if has_default else ""))
        given.append(f"{name}={name}" if kind is Parameter.KEYWORD_ONLY else f"{stars}{name}")
        last = kind
    if last is Parameter.POSITIONAL_ONLY:
        taken.append("/")
    values = [name if name != "return" else "_result" for name in looked_at]
    forms = [
        f"({v}.dtype.num, {v}.shape) if type({v}) is _array else None if {v} is None else _form_of({v})"
        for v in values
    ]
    lines = "\n    ".join(
        [
            f"def wrapper({', '.join(taken)}):",
            f"_result = _function({', '.join(given)})",
            f"_form = ({', '.join(forms)},)",
            "if _form not in _correct:",
            f"    _check_unseen(_form, {', '.join(values)})",
            "return _result",
        ]
    )
    return compile(lines, "<checked call>", "exec")


def _form(value: Any) -> Any:
    """All that the check of a value depends on: two calls of one form are both right or both wrong."""
    if isinstance(value, np.ndarray):
        return value.dtype.num, value.shape
    if isinstance(value, list | tuple):
        return type(value), *map(_form, value)
    return type(value), getattr(value, "shape", None)


def _check(function: Callable[..., Any], hints: Mapping[str, Any], values: Mapping[str, Any]) -> None:
    with jaxtyped("context"):  # one meaning of every axis name within one call
        for name, hint in hints.items():
            if not _agrees(values[name], hint, is_result=name == "return"):
                arrays = {known: v.shape for known in hints if isinstance(v := values[known], np.ndarray)}
                where = f"{function.__module__}.{function.__qualname__}"
                raise WrongShapeError(f"{where}: {name} is not {hint}; arrays of the call: {arrays}")


_DEFAULT_FACTORY = type(signature(_WithFactory).parameters["made"].default)
"""What stands for a dataclass field's default until it is made."""


def _agrees(value: Any, hint: Any, is_result: bool) -> bool:
    if not _states_a_shape(hint) or value is None or isinstance(value, _DEFAULT_FACTORY):
        return True
    if isinstance(hint, type) and issubclass(hint, AbstractArray):
        return isinstance(_as_array(value, hint, is_result), hint if is_result else _broadcasting(hint))
    if get_origin(hint) is tuple and isinstance(value, tuple):
        members = get_args(hint)
        members = members[:1] * len(value) if members[1:] == (...,) else members
        return len(members) == len(value) and all(map(_agrees, value, members, [is_result] * len(value)))
    options = [option for option in get_args(hint) if _states_a_shape(option)]
    return not isinstance(value, np.ndarray) or any(_agrees(value, option, is_result) for option in options)


@cache
def _broadcasting(hint: Any) -> Any:
    """The hint with batch axes that broadcast over arguments, as everywhere in the package (`Compiled`)."""
    return hint.dtype[hint.array_type, hint.dim_str.replace("*batch", "*#batch")]


def _as_array(value: Any, hint: Any, is_result: bool) -> Any:
    """NumPy's scalars are arrays of no axes; arguments may be what NumPy converts: lists and integers."""
    if not is_result and not isinstance(value, np.ndarray | np.generic):
        value = np.asarray(value)
    if not is_result and value.dtype.kind in "iub" and "float64" in hint.dtypes:
        return np.asarray(value, dtype=float)
    return np.asarray(value) if isinstance(value, np.generic) else value


def _states_a_shape(hint: Any) -> bool:
    if isinstance(hint, type) and issubclass(hint, AbstractArray):
        return True
    return any(_states_a_shape(part) for part in get_args(hint))
