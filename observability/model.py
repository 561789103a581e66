"""A dynamic system of a user: x' = f(x, p, u, w), y = h(x, p, u, w), with what is unknown of it."""

import inspect
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, Final

import casadi as ca
import numpy as np

from observability.model_text import FUNCTIONS, NAME, exact_number, formula
from spinfilters.core.errors import InputError
from spinfilters.io.argument_checks import refuse

LISTS: Final = ("states", "parameters", "inputs", "unknown_inputs", "known_constants")
VECTORS: Final = "unit_vectors"
"""Groups of states of norm 1."""
TABLES: Final = ("equations", "outputs", "known_initial_values", "point", "courses", "every", "experiments")
OF_EXPERIMENTS: Final = ("known_initial_values", "point", "courses", "every", "bound")
"""What an experiment may have of its own."""
WORDS: Final = ("name", "source", "notes", "kinds", "answer", "time", "bound")
"""Of a model's file: what others read."""
CLOCK: Final = "t"
"""Time in the course of an input."""
FROM_FILE: Final = re.compile(r"\s*from\s+(.+?)\s*")
"""A course that a table holds."""
MOST_NAMES: Final = 400
NORM_POINTS: Final = 8
"""Random points at which the norm of a unit vector is tried."""
NORM_ROUNDING: Final = 1e-9


@dataclass(frozen=True)
class Model:
    """Equations with the roles of their symbols.

    Attributes
    ----------
    states, parameters, inputs, unknown_inputs, known_constants : tuple[str, ...]
        Names. Unknown are the parameters, the states at time 0, and the unknown inputs at time 0.
    symbols : Mapping[str, casadi.SX]
        Of every name.
    rates : Mapping[str, casadi.SX]
        x' of every state.
    outputs : Mapping[str, casadi.SX]
        What is measured.
    known_initial_values : Mapping[str, casadi.SX]
        States known at time 0, as expressions of parameters and constants: they are no unknowns.
    point : Mapping[str, Fraction]
        States and parameters that have exactly these values, and are unknown all the same; all others are generic.
    name : str
        For titles.
    discrete : bool
        Whether equations give the next value, x[k+1] = f, in place of the rate.
    every : Mapping[str, int]
        An output measured at every so many steps or times only.
    unit_vectors : tuple[tuple[str, ...], ...]
        States whose squares add up to 1, such as the four of a quaternion, group by group: one unknown less in each.
    """

    states: tuple[str, ...]
    parameters: tuple[str, ...]
    inputs: tuple[str, ...]
    unknown_inputs: tuple[str, ...]
    known_constants: tuple[str, ...]
    symbols: Mapping[str, ca.SX]
    rates: Mapping[str, ca.SX]
    outputs: Mapping[str, ca.SX]
    known_initial_values: Mapping[str, ca.SX] = field(default_factory=dict)
    point: Mapping[str, Fraction] = field(default_factory=dict)
    name: str = "the system"
    discrete: bool = False
    every: Mapping[str, int] = field(default_factory=dict)
    unit_vectors: tuple[tuple[str, ...], ...] = ()

    def __post_init__(self) -> None:
        if not self.outputs:
            raise InputError(f"{self.name}: nothing is measured; give at least one output")
        for state in self.known_initial_values:
            if state not in self.states:
                raise InputError(
                    f"{self.name}: the known initial value of {state!r} is of no state; states are {', '.join(self.states)}"
                )
        for each, count in self.every.items():
            if each not in self.outputs:
                raise InputError(
                    f"{self.name}: every names {each!r}, which is no output; use {', '.join(self.outputs)}"
                )
            if count < 1:
                raise InputError(f"{self.name}: every of {each} is {count}; give a whole number from 1")
        allowed = (*self.states, *self.parameters, *self.known_constants)
        for each in self.point:
            if each not in allowed:
                raise InputError(
                    f"{self.name}: the point names {each!r}, which is no state, parameter or constant; "
                    f"use {', '.join(allowed) or 'none'}"
                )
            if each in self.known_initial_values:
                raise InputError(
                    f"{self.name}: {each!r} has a known initial value and a value of the point; give one of them"
                )
        _check_unit_vectors(self)

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Parameters, states without a known initial value, unknown inputs."""
        states = [each for each in self.states if each not in self.known_initial_values]
        return (*self.parameters, *states, *self.unknown_inputs)

    @property
    def is_generic(self) -> bool:
        """Whether every value is a generic one and every input known."""
        return not (self.point or self.known_initial_values or self.unknown_inputs or self.unit_vectors)

    @property
    def period(self) -> int:
        """Steps after which outputs of several rates meet again."""
        return math.lcm(*[self.every.get(each, 1) for each in self.outputs])

    def measured_at(self, step: int) -> list[int]:
        """Indices of the outputs that are measured at a step."""
        return [k for k, each in enumerate(self.outputs) if step % self.every.get(each, 1) == 0]

    @cached_property
    def reached(self) -> frozenset[str]:
        """Names that some output depends on, directly or through states."""
        found, known = _names_in(*self.outputs.values()), set[str]()
        while states := [each for each in self.states if each in found - known]:
            known |= set(states)
            found |= _names_in(*[self.rates[each] for each in states])
        return frozenset(found)


def _check_unit_vectors(model: Model) -> None:
    """Refuse groups that are no states, overlap, or whose equations change their norm."""
    seen: set[str] = set()
    for group in model.unit_vectors:
        where = f"{model.name}: the unit vector {', '.join(group) or '()'}"
        foreign = [each for each in group if each not in model.states or each in model.known_initial_values]
        if foreign or len(group) < 2 or seen & set(group) or len(set(group)) < len(group):
            raise InputError(
                f"{where} is no group of states; give two or more states without known initial values, each in one group"
            )
        seen |= set(group)
        given = [model.point[each] for each in group if each in model.point]
        if given and (len(given) < len(group) or sum(each * each for each in given) != 1):
            raise InputError(
                f"{where} has a norm other than 1 at the point; give all its values there, as exact fractions, or none"
            )
        if not _keeps_norm(model, group):
            raise InputError(
                f"{where} changes its norm along the motion; check its equations, or take it out of {VECTORS}"
            )


def with_norms(model: Model) -> Model:
    """The model with the norms of its unit vectors among the outputs: they are known, and determine one direction each."""
    norms = {
        f"norm of {', '.join(group)}": ca.sumsqr(ca.vertcat(*[model.symbols[each] for each in group]))
        for group in model.unit_vectors
    }
    return replace(model, outputs={**model.outputs, **norms}) if norms else model


def _keeps_norm(model: Model, group: tuple[str, ...]) -> bool:
    """Whether x.f = 0 (or f.f = 1 in discrete time) where x.x = 1, at random points in floats."""
    x, f = (ca.vertcat(*[values[each] for each in group]) for values in (model.symbols, model.rates))
    symbols = ca.vertcat(*model.symbols.values())
    change = ca.dot(f, f) - 1 if model.discrete else ca.dot(x, f) / (1 + ca.norm_2(f))
    evaluate, random = ca.Function("norm", [symbols], [change]), np.random.default_rng(0)
    points = random.uniform(0.1, 1, (symbols.numel(), NORM_POINTS))
    where = [[*model.symbols].index(each) for each in group]
    points[where] /= np.linalg.norm(points[where], axis=0)
    found = np.asarray(evaluate(points))
    return bool(np.all(np.abs(found[np.isfinite(found)]) < NORM_ROUNDING))


def _names_in(*expressions: ca.SX) -> set[str]:
    return {symbol.name() for symbol in ca.symvar(ca.vertcat(*expressions))}


def model_of(f: Any, h: Any = None, x: Any = None, **roles: Any) -> Model:
    """A model of formulas, as one document or as equations and outputs, or of expressions."""
    if isinstance(f, Model):
        return f
    if isinstance(f, Mapping) and isinstance(h, Mapping):
        return _model_of_equations(f, h, x, roles)
    if not isinstance(f, Mapping):
        if h is None or x is None:
            raise InputError("expressions need f, h and x; give all three, or a dictionary of formulas")
        allowed = [*inspect.signature(model_of_expressions).parameters][3:]
        unknown = [key for key in roles if key not in allowed]
        if unknown:
            raise InputError(f"{unknown[0]!r} is no role of symbols; use {', '.join(allowed)}")
        return model_of_expressions(f, h, x, **roles)
    foreign = sorted(set(roles) - {"at", "name"})
    foreign += [key for key, each in (("h", h), ("x", x)) if each is not None]
    if foreign:
        raise InputError(
            f"a dictionary of formulas holds everything itself; leave out {foreign[0]!r}, "
            "or give equations and outputs as two dictionaries"
        )
    document = dict(f)
    if roles.get("at"):
        document["point"] = dict(document.get("point", {})) | dict(_values_by_name(roles["at"], "at"))
    return model_of_text(document, str(roles.get("name") or document.get("name", "the system")))


def _model_of_equations(f: Mapping[str, Any], h: Mapping[str, Any], x: Any, roles: dict[str, Any]) -> Model:
    """A model of formulas by state and by output; roles are lists of names and tables, as a document has them."""
    if "equations" in f or "outputs" in h:
        raise InputError("this dictionary is a whole model; give it alone, without 'h'")
    name = str(roles.pop("name", "the system"))
    allowed = [
        each for each in (*LISTS, *TABLES, VECTORS, "time", "at") if each not in ("equations", "outputs")
    ]
    unknown = [key for key in roles if key not in allowed]
    if unknown:
        raise InputError(f"{unknown[0]!r} is no role of names; use {', '.join(allowed)}")
    at = dict(_values_by_name(roles.pop("at", None) or {}, "at"))
    document = {"states": list(f) if x is None else x, **roles, "equations": f, "outputs": h}
    return model_of_text(document | {"point": {**roles.get("point", {}), **at}}, name)


def model_of_text(document: Mapping[str, Any], name: str = "the model") -> Model:
    """A model of formulas.

    Parameters
    ----------
    document : Mapping
        Lists ``states``, ``parameters``, ``inputs``, ``unknown_inputs``, ``known_constants`` of names, and tables ``equations``,
        ``outputs``, ``known_initial_values``, ``point``, ``courses`` of formulas by name, as a TOML file has them; ``time``,
        ``every`` and ``experiments``; ``unit_vectors``, a list of lists of states of norm 1.
    name : str
        For complaints and titles.

    Raises
    ------
    InputError
        One line with the name and the cure.
    """
    for key in document:
        if key not in (*LISTS, *TABLES, *WORDS, VECTORS):
            raise InputError(
                f"{name}: {key!r} is unknown; use {', '.join((*LISTS, *TABLES, VECTORS, 'time', 'bound'))}"
            )
    experiments = document.get("experiments")
    if experiments is not None:
        return joined(experiments_of(document, name), name)
    if document.get("time", "continuous") not in ("continuous", "discrete"):
        raise InputError(f'{name}: time is {document["time"]!r}; use "continuous" or "discrete"')
    lists = {key: _names(document.get(key, ()), f"{name}: {key}") for key in LISTS}
    tables = {key: _table(document.get(key, {}), f"{name}: {key}") for key in TABLES}
    symbols = _symbols(lists, name)
    missing = [each for each in lists["states"] if each not in tables["equations"]]
    if missing:
        raise InputError(f"{name}: the state {missing[0]!r} has no equation; add one to equations")
    for each in tables["equations"]:
        if each not in lists["states"]:
            raise InputError(f"{name}: the equation of {each!r} is of no state; add it to states")
    rates = {
        each: formula(tables["equations"][each], symbols, f"{name}: the equation of {each}")
        for each in lists["states"]
    }
    outputs = {
        each: formula(text, symbols, f"{name}: the output {each}") for each, text in tables["outputs"].items()
    }
    constant = {each: symbols[each] for each in (*lists["parameters"], *lists["known_constants"])}
    known = {
        each: formula(text, constant, f"{name}: the known initial value of {each}")
        for each, text in tables["known_initial_values"].items()
    }
    point = {
        each: exact_number(text, f"{name}: {each} at the point") for each, text in tables["point"].items()
    }
    model = Model(
        **lists,
        symbols=symbols,
        rates=rates,
        outputs=outputs,
        known_initial_values=known,
        point=point,
        name=name,
        discrete=document.get("time") == "discrete",
        every={each: _whole(count, f"{name}: every of {each}") for each, count in tables["every"].items()},
        unit_vectors=_groups(document.get(VECTORS, ()), f"{name}: {VECTORS}"),
    )
    return with_courses(model, tables["courses"])


def require_inputs(name: str, courses: Mapping[str, Any], inputs: Sequence[str]) -> None:
    """InputError where the courses of a model or section of this name give something that is no input."""
    foreign = [each for each in courses if each not in inputs]
    if foreign:
        raise InputError(
            f"{name}: courses names {foreign[0]!r}, which is no input; use {', '.join(inputs) or 'none'}"
        )


def with_courses(model: Model, courses: Mapping[str, Any]) -> Model:
    """The model with formulas of the time t, or numbers, for known inputs; those from a file stay generic inputs.

    The clock is a state that an output shows, so that its value is a generic one.
    """
    name = model.name
    require_inputs(name, courses, model.inputs)
    texts = {each: text for each, text in courses.items() if not FROM_FILE.fullmatch(str(text))}
    if not texts:
        return model
    if CLOCK in model.symbols:
        raise InputError(
            f"{name}: {CLOCK!r} is the time in courses; rename the symbol {CLOCK!r} of the model"
        )
    clock = ca.SX.sym(CLOCK)
    found = {
        each: formula(text, {CLOCK: clock}, f"{name}: the course of {each}") for each, text in texts.items()
    }
    old, new = (ca.vertcat(*each) for each in ([model.symbols[name] for name in found], found.values()))
    rates, outputs = (
        {each: ca.substitute(ca.SX(value), old, new) for each, value in group.items()}
        for group in (model.rates, model.outputs)
    )
    states, symbols = (
        model.states,
        {each: symbol for each, symbol in model.symbols.items() if each not in found},
    )
    if any(CLOCK in _names_in(each) for each in found.values()):
        states = (*states, CLOCK)
        symbols |= {CLOCK: clock}
        rates |= {CLOCK: clock + 1 if model.discrete else ca.SX(1)}
        outputs |= {CLOCK: clock}
    inputs = tuple(each for each in model.inputs if each not in found)
    return replace(model, states=states, inputs=inputs, symbols=symbols, rates=rates, outputs=outputs)


def experiments_of(document: Mapping[str, Any], name: str) -> dict[str, dict[str, Any]]:
    """A document for each experiment, with its own initial values, point, courses and bound over those of all."""
    experiments = document["experiments"]
    if not isinstance(experiments, Mapping) or not experiments:
        raise InputError(
            f"{name}: experiments is {experiments!r}; give a table by the name of each experiment"
        )
    found = {}
    for each, own in experiments.items():
        where = f"{name}: experiment {each!r}"
        if not NAME.fullmatch(str(each)):
            raise InputError(f"{where} is no name; use letters, digits and _")
        if not isinstance(own, Mapping):
            raise InputError(f"{where} is {own!r}; give a table")
        for key, value in own.items():
            if key not in OF_EXPERIMENTS:
                raise InputError(f"{where}: {key!r} is unknown; use {', '.join(OF_EXPERIMENTS)}")
            if not isinstance(value, Mapping):
                raise InputError(f"{where}: {key} is {value!r}; give a table")
        rest = {key: value for key, value in document.items() if key != "experiments"}
        found[each] = rest | {key: _merge_tables(rest.get(key, {}), value) for key, value in own.items()}
    return found


def _merge_tables(table: Any, over: Mapping[str, Any]) -> dict[str, Any]:
    """A table with what another says instead, in tables within it as well."""
    below = dict(table) if isinstance(table, Mapping) else {}
    return below | {
        key: _merge_tables(below.get(key, {}), value) if isinstance(value, Mapping) else value
        for key, value in over.items()
    }


def joined(documents: Mapping[str, Mapping[str, Any]], name: str) -> Model:
    """One model of several experiments: parameters and constants are the same, states and inputs are each experiment's own."""
    models = {each: model_of_text(document, f"{name}, {each}") for each, document in documents.items()}
    first = next(iter(models.values()))
    shared = {each: first.symbols[each] for each in (*first.parameters, *first.known_constants)}
    symbols = dict(shared)
    groups: dict[str, list[str]] = {"states": [], "inputs": [], "unknown_inputs": []}
    tables: dict[str, dict[str, Any]] = {
        key: {} for key in ("rates", "outputs", "known_initial_values", "point", "every")
    }
    vectors: list[tuple[str, ...]] = []
    for experiment, model in models.items():
        names = {key: f"{key}_{experiment}" for key in model.symbols if key not in shared}
        own = {key: ca.SX.sym(each) for key, each in names.items()}
        symbols |= {names[key]: symbol for key, symbol in own.items()}
        old = ca.vertcat(*model.symbols.values())
        every = {**shared, **own}
        new = ca.vertcat(*[every[key] for key in model.symbols])
        for key, group in groups.items():
            group += [names[each] for each in getattr(model, key)]
        for key in ("rates", "outputs", "known_initial_values"):
            tables[key] |= {
                f"{each}_{experiment}": ca.substitute(ca.SX(value), old, new)
                for each, value in getattr(model, key).items()
            }
        tables["point"] |= {names.get(each, each): value for each, value in model.point.items()}
        tables["every"] |= {f"{each}_{experiment}": count for each, count in model.every.items()}
        vectors += [tuple(names[each] for each in group) for group in model.unit_vectors]
    if len(symbols) > MOST_NAMES:
        raise InputError(
            f"{name}: {len(symbols)} names in {len(models)} experiments; give at most {MOST_NAMES}"
        )
    if len(symbols) != len(shared) + sum(len(model.symbols) - len(shared) for model in models.values()):
        raise InputError(f"{name}: names of experiments make two names alike; choose other names for them")
    return replace(
        first,
        **{key: tuple(group) for key, group in groups.items()},
        **tables,
        symbols=symbols,
        name=name,
        unit_vectors=tuple(vectors),
    )


def model_of_expressions(
    f: ca.SX | ca.Function | Sequence[ca.SX],
    h: ca.SX | ca.Function | Sequence[ca.SX],
    x: ca.SX | Sequence[ca.SX],
    parameters: ca.SX | Sequence[ca.SX] = (),
    inputs: ca.SX | Sequence[ca.SX] = (),
    unknown_inputs: ca.SX | Sequence[ca.SX] = (),
    known_constants: ca.SX | Sequence[ca.SX] = (),
    known_initial_values: Mapping[str, Any] | None = None,
    at: Mapping[str, Any] | None = None,
    name: str = "the system",
    time: str = "continuous",
    unit_vectors: Sequence[Any] = (),
) -> Model:
    """A model of CasADi expressions of scalar or vector symbols, or of functions of (x, parameters, inputs, unknown inputs).

    Raises
    ------
    InputError
        One line with the name and the cure.
    """
    if time not in ("continuous", "discrete"):
        raise InputError(f'{name}: time is {time!r}; use "continuous" or "discrete"')
    given = dict(zip(LISTS, (x, parameters, inputs, unknown_inputs, known_constants), strict=True))
    groups = {key: _scalars(value, "x" if key == "states" else key) for key, value in given.items()}
    lists = {key: tuple(each.name() for each in group) for key, group in groups.items()}
    symbols = _symbols(lists, name, [each for group in groups.values() for each in group])
    arguments = [ca.vertcat(*group) for group in list(groups.values())[:4]]
    rates, outputs = (_scalars_of(each, arguments, key) for each, key in ((f, "f"), (h, "h")))
    if len(rates) != len(lists["states"]):
        raise InputError(
            f"{name}: f has {len(rates)} rows for {len(lists['states'])} states; give the rate of every state in the order of x"
        )
    roles = {each.element_hash() for each in symbols.values()}
    foreign = {
        symbol.name()
        for each in (*rates, *outputs)
        for symbol in ca.symvar(each)
        if symbol.element_hash() not in roles
    }
    if foreign:
        first = min(foreign)
        cure = (
            "is in f or h as a second symbol of this name; make each symbol once, and use it everywhere"
            if first in symbols
            else "is in f or h but has no role; give it as a parameter, input or known constant"
        )
        raise InputError(f"{name}: {first!r} {cure}")
    known = {
        each: formula(value, symbols, f"{name}: the known initial value of {each}")
        if not isinstance(value, ca.SX)
        else value
        for each, value in _values_by_name(known_initial_values or {}, "known_initial_values").items()
    }
    point = {
        each: exact_number(value, f"{name}: {each} at the point")
        for each, value in _values_by_name(at or {}, "at").items()
    }
    states, constants, known_inputs, free_inputs, fixed = lists.values()
    return Model(
        states,
        constants,
        known_inputs,
        free_inputs,
        fixed,
        symbols=symbols,
        rates=dict(zip(lists["states"], rates, strict=True)),
        outputs={f"y{k + 1}": each for k, each in enumerate(outputs)},
        known_initial_values=known,
        point=point,
        name=name,
        discrete=time == "discrete",
        unit_vectors=tuple(tuple(each.name() for each in _scalars(group, VECTORS)) for group in unit_vectors),
    )


def _scalars(value: Any, key: str) -> list[ca.SX]:
    """Scalar symbols of a vector or of a list."""
    cure = "casadi.SX symbols, as one vector or as a list"
    if isinstance(value, ca.MX | str) or not isinstance(value, ca.SX | Iterable):
        refuse(key, value, cure)
    parts = [value] if isinstance(value, ca.SX) else list(value)
    for part in parts:
        if not isinstance(part, ca.SX):
            refuse(key, part, cure)
    found = [each[k] for each in parts for k in range(each.numel())]
    for each in found:
        if not each.is_symbolic():
            raise InputError(f"{key}: {each} is no symbol; give casadi.SX symbols")
    return found


def _scalars_of(value: Any, arguments: list[ca.SX], key: str) -> list[ca.SX]:
    cure = "a casadi.SX expression, a list of them, or a casadi.Function of (x, parameters, inputs, unknown_inputs)"
    try:
        if isinstance(value, ca.Function):
            value = value.expand()(*arguments[: value.n_in()])
        whole = value if isinstance(value, ca.SX) else ca.vertcat(*[ca.SX(each) for each in value])
    except (RuntimeError, NotImplementedError, TypeError):
        refuse(key, value, cure)
    whole = ca.densify(whole)
    return [whole[k] for k in range(whole.numel())]


def _values_by_name(value: Any, key: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        refuse(key, value, 'a dictionary of values by name, such as {"x": 1}')
    return value


def _names(value: Any, where: str) -> tuple[str, ...]:
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise InputError(f"{where} is {value!r}; give a list of names")
    names = tuple(value)
    for each in names:
        if not isinstance(each, str) or not NAME.fullmatch(each) or each in FUNCTIONS:
            raise InputError(
                f"{where}: {each!r} is no name; use letters, digits and _, and no name of a function"
            )
    return names


def _groups(value: Any, where: str) -> tuple[tuple[str, ...], ...]:
    if isinstance(value, str | Mapping) or not isinstance(value, Iterable):
        raise InputError(
            f'{where} is {value!r}; give a list of lists of states, such as [["q1", "q2", "q3", "q4"]]'
        )
    return tuple(_names(each, where) for each in value)


def _whole(value: Any, where: str) -> int:
    number = exact_number(value, where)
    if number.denominator != 1:
        raise InputError(f"{where} is {value!r}; give a whole number")
    return int(number)


def _table(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"{where} is {value!r}; give a table of formulas by name")
    for each, text in value.items():
        if isinstance(text, bool) or not isinstance(text, str | int | float | Fraction):
            raise InputError(f"{where}: {each} is {text!r}; give a formula in quotes, or a number")
    return value


def _symbols(
    lists: Mapping[str, tuple[str, ...]], name: str, given: Sequence[ca.SX] | None = None
) -> dict[str, ca.SX]:
    names = [each for group in lists.values() for each in group]
    twice = [each for each in names if names.count(each) > 1] if len(names) <= MOST_NAMES else []
    if twice:
        raise InputError(f"{name}: {twice[0]!r} is declared twice; give every name one role")
    if len(names) > MOST_NAMES:
        raise InputError(f"{name}: {len(names)} names; give at most {MOST_NAMES}")
    return dict(zip(names, given or [ca.SX.sym(each) for each in names], strict=True))
