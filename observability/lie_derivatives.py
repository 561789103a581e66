"""Lie derivatives of a model's outputs and the observability matrix, as formulas."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from observability.invariant_manifold import at_values
from observability.model import Model
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
