"""Lie derivatives of a model's outputs and the observability matrix, as formulas, and unknown inputs solved for by them.

The first derivative of an output that an unknown input w acts on is v = a + b w. Where b is not 0, w = (v - a) / b, and v is known
and as generic as w is. With all unknown inputs replaced that act on some output, the model has known inputs only: derivatives of
outputs. The first order of derivatives that adds nothing is then the last (Hirschorn 1979, IEEE Trans. Automatic Control 24, for
the inversion).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import casadi as ca

from observability.invariant_manifold import at_values, vanishes
from observability.model import Model
from observability.model_rank import exact_rank, reached
from observability.written_formulas import written


@dataclass(frozen=True)
class LieDerivative:
    """One derivative of one output along the motion, with its gradient by the unknowns.

    Attributes
    ----------
    output : str
        Name of the output.
    order : int
        0 for the output itself.
    formula : str
        The derivative.
    gradient : dict[str, str]
        Its partial derivatives that are not 0, by unknown: a row of the observability matrix.
    """

    output: str
    order: int
    formula: str
    gradient: dict[str, str]

    def __str__(self) -> str:
        name = f"L{self.order} {self.output}"
        rows = [f"  d/d{unknown}: {text}" for unknown, text in self.gradient.items()]
        return "\n".join([f"{name} = {self.formula}", *rows])


@dataclass(frozen=True)
class ObservabilityMatrix:
    """Derivatives of all outputs up to an order, with their gradients.

    Attributes
    ----------
    unknowns : tuple[str, ...]
        Columns: the model's unknowns, then derivatives of unknown inputs.
    rows : tuple[LieDerivative, ...]
        Order by order.
    """

    unknowns: tuple[str, ...]
    rows: tuple[LieDerivative, ...]

    @cached_property
    def entries(self) -> list[list[str]]:
        """The matrix."""
        return [[row.gradient.get(name, "0") for name in self.unknowns] for row in self.rows]

    def __str__(self) -> str:
        return "\n".join(str(row) for row in self.rows)

    def document(self) -> dict[str, object]:
        """The matrix for JSON."""
        rows = [
            {"output": row.output, "order": row.order, "formula": row.formula, "gradient": row.gradient}
            for row in self.rows
        ]
        return {"unknowns": list(self.unknowns), "rows": rows}


def observability_matrix(model: Model, orders: int) -> ObservabilityMatrix:
    """Lie derivatives 0 to ``orders`` - 1 of all outputs and their gradients by all unknowns.

    Derivatives of an input u are the symbols d1_u, d2_u and so on. Values of the model's point are put in after differentiation.

    Raises
    ------
    InputError
        Where a formula becomes too long.
    """
    inputs = _InputDerivatives(model)
    current, rows = dict(model.outputs), []
    for order in range(orders):
        unknowns = {name: model.symbols[name] for name in model.unknowns} | inputs.unknown
        for name, expression in current.items():
            rows.append(_row(model, name, order, expression, unknowns))
        if order + 1 < orders:
            current = {name: derivative_along(each, inputs.rates(each)) for name, each in current.items()}
    return ObservabilityMatrix((*model.unknowns, *inputs.unknown), tuple(rows))


def derivative_along(expression: ca.SX, rates: Mapping[str, ca.SX]) -> ca.SX:
    """The derivative of an expression along the motion, with rates of the symbols that vary."""
    total = ca.SX(0)
    for symbol in ca.symvar(expression):
        if symbol.name() in rates:
            total += ca.jacobian(expression, symbol) * rates[symbol.name()]
    return total


class _InputDerivatives:
    """Rates of states, and derivatives of inputs as symbols of their own."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._known: dict[str, ca.SX] = dict(model.rates)
        self._orders = {name: (name, 0) for name in (*model.inputs, *model.unknown_inputs)}
        self.unknown: dict[str, ca.SX] = {}

    def rates(self, expression: ca.SX) -> Mapping[str, ca.SX]:
        """Of all symbols in an expression that vary."""
        for symbol in ca.symvar(expression):
            name = symbol.name()
            if name in self._orders and name not in self._known:
                source, order = self._orders[name]
                derivative = f"d{order + 1}_{source}"
                while derivative in self._model.symbols:
                    derivative += "_"
                self._known[name] = ca.SX.sym(derivative)
                self._orders[derivative] = (source, order + 1)
                if source in self._model.unknown_inputs:
                    self.unknown[derivative] = self._known[name]
        return self._known


def _row(
    model: Model, output: str, order: int, expression: ca.SX, unknowns: Mapping[str, ca.SX]
) -> LieDerivative:
    """A derivative at time 0 and at the model's point, with its gradient."""
    known = model.known_initial_values
    if known:
        states = ca.vertcat(*[model.symbols[name] for name in known])
        expression = ca.substitute(ca.SX(expression), states, ca.vertcat(*known.values()))
    gradient = {}
    for name, symbol in unknowns.items():
        text = written(at_values(ca.jacobian(expression, symbol), model, model.point))
        if text != "0":
            gradient[name] = text
    return LieDerivative(output, order, written(at_values(expression, model, model.point)), gradient)


MOST_DERIVATIVES: Final = 6
"""Of one output, until an unknown input acts on it."""
LARGEST_EXPRESSION: Final = 20_000
"""Operations of a derivative."""


@dataclass(frozen=True)
class InvertedModel:
    """A model with its unknown inputs replaced.

    Attributes
    ----------
    model : Model
        Without unknown inputs that act on an output.
    rank : int
        Of states, parameters and unknown inputs: no rank of the original is larger.
    compensated : tuple[str, ...]
        Unknowns that the outputs do not depend on once the unknown inputs change along.
    """

    model: Model
    rank: int
    compensated: tuple[str, ...]


def invert(model: Model) -> InvertedModel | None:
    """The inverted model; None where an unknown input enters nonlinearly or derivatives grow too large."""
    inversion = _Inversion(model)
    while True:
        found = inversion.solved_model()
        left = [name for name in model.unknown_inputs if name in found.reached]
        if not left:
            break
        if not inversion.solve_one():
            return None
    part = reached(found)
    exact = exact_rank(part)
    if not exact.complete:
        return None
    before = set(reached(model).unknowns)
    own = [name for name in model.unknowns if name not in model.unknown_inputs]
    compensated = tuple(name for name in own if name in before and name not in part.unknowns)
    return InvertedModel(found, exact.rank + len(inversion.solutions), compensated)


class _Inversion:
    """Outputs differentiated until unknown inputs appear, and these solved for one by one."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._chains = [[each] for each in model.outputs.values()]
        self._ended = [False] * len(self._chains)
        self.solutions: dict[str, ca.SX] = {}
        self._derivatives: dict[str, ca.SX] = {}
        self._inputs = {name: model.symbols[name] for name in model.inputs}

    def solved_model(self) -> Model:
        """The model with what has been solved; outputs are all derivatives below the ones that are inputs now."""
        outputs = {
            f"y{i + 1}_{order}": self._substitute_inputs(each)
            for i, chain in enumerate(self._chains)
            for order, each in enumerate(chain)
        }
        model = self._model
        return replace(
            model,
            rates={name: self._substitute_inputs(each) for name, each in model.rates.items()},
            outputs=outputs,
            inputs=tuple(self._inputs),
            unknown_inputs=tuple(name for name in model.unknown_inputs if name not in self.solutions),
            symbols=dict(model.symbols) | self._inputs,
        )

    def solve_one(self) -> bool:
        """Differentiate outputs until an unknown input acts on one, and solve for it; whether that is possible."""
        for _ in range(MOST_DERIVATIVES):
            for index, chain in enumerate(self._chains):
                if self._ended[index]:
                    continue
                last = self._substitute_inputs(chain[-1])
                acting = self._acting_inputs(last)
                if acting:
                    return self._solve(index, last, acting[0])
                after = self._derivative(last)
                if ca.n_nodes(after) > LARGEST_EXPRESSION:
                    return False
                chain.append(after)
        return False

    def _solve(self, index: int, last: ca.SX, name: str) -> bool:
        symbol = self._model.symbols[name]
        slope = ca.jacobian(last, symbol)
        if symbol.name() in {each.name() for each in ca.symvar(slope)} and not vanishes(
            ca.jacobian(slope, symbol)
        ):
            return False
        zero = ca.SX(0)
        slope, rest = ca.substitute(slope, symbol, zero), ca.substitute(last, symbol, zero)
        known = self._new_input(f"d{len(self._chains[index]) - 1}_y{index + 1}")
        solution = (known - rest) / slope
        self.solutions = {
            key: ca.substitute(each, symbol, solution) for key, each in self.solutions.items()
        } | {name: solution}
        # The derivative is an input now, and no output; what is below stays one.
        self._chains[index].pop()
        self._ended[index] = True
        return True

    def _acting_inputs(self, expression: ca.SX) -> list[str]:
        """Unknown inputs that are not solved and act on an expression."""
        names = {each.name() for each in ca.symvar(expression)}
        return [
            name
            for name in self._model.unknown_inputs
            if name in names and not vanishes(ca.jacobian(expression, self._model.symbols[name]))
        ]

    def _substitute_inputs(self, expression: ca.SX) -> ca.SX:
        """An expression with the solutions in place of unknown inputs."""
        if not self.solutions:
            return expression
        symbols = ca.vertcat(*[self._model.symbols[name] for name in self.solutions])
        return ca.substitute(expression, symbols, ca.vertcat(*self.solutions.values()))

    def _derivative(self, expression: ca.SX) -> ca.SX:
        """D of an expression; derivatives of known inputs are further known inputs."""
        rates = {}
        for symbol in ca.symvar(expression):
            name = symbol.name()
            if name in self._model.states:
                rates[name] = self._substitute_inputs(self._model.rates[name])
            elif name in self._inputs:
                if name not in self._derivatives:
                    self._derivatives[name] = self._new_input(f"d_{name}")
                rates[name] = self._derivatives[name]
        return derivative_along(expression, rates)

    def _new_input(self, name: str) -> ca.SX:
        while name in self._model.symbols or name in self._inputs:
            name += "_"
        self._inputs[name] = ca.SX.sym(name)
        return self._inputs[name]
