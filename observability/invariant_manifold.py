"""Invariant manifolds: states that stay at their values along the motion, and the model that is left on them."""

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction

import casadi as ca
import numpy as np

from observability.exact_numbers import PrimeField, rational
from observability.function_values import function_values, residues_of
from observability.model import Model
from observability.tape import PIECEWISE, tape_of

POINTS = 64
"""Random points; those at which a function has no residue are left out."""


def staying(model: Model, values: Mapping[str, Fraction]) -> dict[str, Fraction]:
    """The largest set of states at these values whose rates are 0 there, whatever all other symbols are."""
    found = {name: value for name, value in values.items() if name in model.states}
    while found:
        rates = [at_values(model.rates[name], model, found) for name in found]
        moves = [name for name, rate in zip(found, rates, strict=True) if not vanishes(rate)]
        if not moves:
            break
        found = {name: value for name, value in found.items() if name not in moves}
    return found


def restricted(model: Model, values: Mapping[str, Fraction]) -> Model:
    """The model with states that stay put in as numbers; they are no unknowns of it."""
    states = tuple(name for name in model.states if name not in values)
    return replace(
        model,
        states=states,
        rates={name: at_values(model.rates[name], model, values) for name in states},
        outputs={name: at_values(each, model, values) for name, each in model.outputs.items()},
        known_initial_values={
            name: each for name, each in model.known_initial_values.items() if name not in values
        },
        point={name: each for name, each in model.point.items() if name not in values},
        unit_vectors=tuple(each for each in model.unit_vectors if not set(each) & set(values)),
    )


def known_numbers(model: Model) -> dict[str, Fraction]:
    """Known initial values that are numbers."""
    return {
        name: rational(float(each)) for name, each in model.known_initial_values.items() if each.is_constant()
    }


def at_values(expression: ca.SX, model: Model, values: Mapping[str, Fraction]) -> ca.SX:
    """An expression with numbers for states."""
    names = list(values)
    symbols = ca.vertcat(*[model.symbols[name] for name in names])
    numbers = ca.DM([float(values[name]) for name in names])
    return ca.substitute(ca.SX(expression), symbols, numbers) if names else expression


def vanishes(expression: ca.SX) -> bool:
    """Whether an expression is 0 at random points of a prime field (branches and singular points: no)."""
    if expression.is_zero():
        return True
    symbols = ca.symvar(expression)
    tape = tape_of("a rate", [ca.vertcat(*symbols)], expression)
    if not PIECEWISE.isdisjoint(tape.operations):
        return False
    field, random = PrimeField(), np.random.default_rng(2)
    points = [
        tuple(
            Fraction(pow(int(number), 4, field.prime))
            for number in random.integers(2, field.prime, len(symbols))
        )
        for _ in range(POINTS)
    ]
    found = function_values(tape, field, [residues_of(points, field)], {})
    return bool(found.regular.any()) and not found.output.p[:, found.regular].any()
