"""Truncated power series with tangents: Lie derivatives and their gradients without symbols.

The k-th Taylor coefficient of an output along the motion is its k-th Lie derivative divided by k!, and the coefficient's tangents
are that derivative's gradient. Each operation costs one convolution per order, so the whole grows as the square of the order,
where repeated symbolic differentiation grows exponentially.
"""

from fractions import Fraction

import numpy as np
from jaxtyping import Num

from observability.exact_numbers import Arithmetic, NotRegularError
from observability.function_values import BranchDecisions
from observability.tape import Group, Tape
from spinfilters.core.errors import InputError


class Series:
    """Registers of a tape as series: (orders, registers, batch, 1 + tangents), value first.

    Parameters
    ----------
    tape, branch_decisions : Tape and BranchDecisions
        The program, and its decisions at the points.
    arithmetic : Arithmetic
        Floats or residues.
    shape : tuple[int, int, int]
        Orders, batch, 1 + tangents.
    """

    def __init__(
        self,
        tape: Tape,
        branch_decisions: BranchDecisions,
        arithmetic: Arithmetic,
        shape: tuple[int, int, int],
    ) -> None:
        orders, batch, width = shape
        self._tape, self._branch_decisions, self._arithmetic = tape, branch_decisions, arithmetic
        self._registers = np.zeros((orders, tape.size, batch, width), dtype=arithmetic.dtype)
        self._shares: dict[int, np.ndarray] = {}
        for register, value in tape.constants:
            self._registers[0, register, :, 0] = arithmetic.copies(value, batch)

    def put(self, index: int, order: int, values: Num[np.ndarray, "n b m"]) -> None:
        """Coefficients of an input."""
        self._registers[order, self._tape.inputs[index]] = values

    def advance(self, order: int) -> Num[np.ndarray, "o b m"]:
        """The output's coefficients of this order, from inputs whose coefficients up to it are put.

        Raises
        ------
        InputError
            At a point where the expression has no power series.
        """
        try:
            for index, group in enumerate(self._tape.groups):
                self._registers[order, group.out] = self._coefficient(index, group, order)
        except NotRegularError as error:
            raise InputError(
                f"{self._tape.name} has no power series at this point: {error}; move the point"
            ) from None
        return self._registers[order, self._tape.output]

    def _coefficient(self, index: int, group: Group, order: int) -> Num[np.ndarray, "g b m"]:
        now, reduced = self._registers[order], self._arithmetic.reduced
        match group.operation:
            case "add":
                return reduced(now[group.left] + now[group.right])
            case "sub":
                return self._arithmetic.difference(now[group.left], now[group.right])
            case "neg":
                return self._arithmetic.negative(now[group.left])
            case "twice":
                return reduced(now[group.left] + now[group.left])
            case "assign":
                return now[group.left]
            case "mul" | "sq":
                return self._convolved(group.left, group.right, range(order + 1), order)
            case "div" | "inv":
                return self._quotient(group, order)
            case "sqrt":
                return self._root(group, order)
            case "times_i":
                return self._arithmetic.times_i(now[group.left])
            case "exp" | "cis":
                return self._exponential(index, group, order)
            case "log" | "arg":
                return self._logarithm(index, group, order)
            case _:
                return self._chosen(index, group, order)

    def _chosen(self, index: int, group: Group, order: int) -> Num[np.ndarray, "g b m"]:
        now, choice = self._registers[order], self._branch_decisions.choices[index][..., np.newaxis]
        zero = np.zeros((), dtype=self._arithmetic.dtype)
        match group.operation:
            case "fmax" | "fmin":
                return np.where(choice, now[group.left], now[group.right])
            case "fabs":
                return np.where(choice, now[group.left], self._arithmetic.negative(now[group.left]))
            case "if_else_zero":
                return np.where(choice, now[group.right], zero)
            case _:  # a condition: a constant, 0 or 1
                result = np.zeros_like(now[group.left])
                result[..., 0] = self._branch_decisions.choices[index] if order == 0 else zero
                return result

    def _quotient(self, group: Group, order: int) -> Num[np.ndarray, "g b m"]:
        """c = a / b: c_k = (a_k - sum_{j<k} c_j b_{k-j}) / b_0."""
        inverse = group.operation == "inv"
        divisor = group.left if inverse else group.right
        if inverse:
            above = np.zeros_like(self._registers[order, group.left])
            above[..., 0] = order == 0
        else:
            above = self._registers[order, group.left]
        rest = self._convolved(group.out, divisor, range(order), order)
        return self._divide_series(self._arithmetic.difference(above, rest), self._registers[0, divisor])

    def _root(self, group: Group, order: int) -> Num[np.ndarray, "g b m"]:
        """c = sqrt(a): c_k = (a_k - sum_{0<j<k} c_j c_{k-j}) / (2 c_0)."""
        now = self._registers[order, group.left]
        if order == 0:
            root = self._arithmetic.root(now[..., 0])
            return self._with_value(root, self._half_over(now, root))
        rest = self._arithmetic.difference(now, self._convolved(group.out, group.out, range(1, order), order))
        first = self._registers[0, group.out]
        return self._divide_series(rest, self._arithmetic.reduced(first + first))

    def _half_over(
        self, a: Num[np.ndarray, "g b m"], root: Num[np.ndarray, "g b"]
    ) -> Num[np.ndarray, "g b m"]:
        inverse = self._arithmetic.inverse(self._arithmetic.reduced(root + root))
        return self._arithmetic.product(a, inverse[..., np.newaxis])

    def _exponential(self, index: int, group: Group, order: int) -> Num[np.ndarray, "g b m"]:
        """c = exp(a): c_k = sum_{0<j<=k} (j/k) a_j c_{k-j}, times i for c = exp(i a)."""
        now, turns = self._registers[order, group.left], group.operation == "cis"
        if order == 0:
            power = self._branch_decisions.values.get(index)
            if power is None:
                power = self._arithmetic.exponential(self._rotate_series(now, turns)[..., 0])
            tangents = self._arithmetic.product(self._rotate_series(now, turns), power[..., np.newaxis])
            return self._with_value(power, tangents)
        rest = self._convolved(group.left, group.out, range(1, order + 1), order, weighted=True)
        return self._rotate_series(rest, turns)

    def _logarithm(self, index: int, group: Group, order: int) -> Num[np.ndarray, "g b m"]:
        """c = log(a): c_k = (a_k - sum_{0<j<k} (j/k) c_j a_{k-j}) / a_0, with -i a_k for c = log(a) / i."""
        above, turns = self._registers[order, group.left], group.operation == "arg"
        if turns:
            above = self._arithmetic.negative(self._arithmetic.times_i(above))
        first = self._registers[0, group.left]
        if order == 0:
            inverse = self._arithmetic.inverse(first[..., 0])[..., np.newaxis]
            value = self._branch_decisions.values.get(index)
            if value is None:
                value = self._arithmetic.logarithm(first[..., 0])
                value = self._arithmetic.negative(self._arithmetic.times_i(value)) if turns else value
            return self._with_value(value, self._arithmetic.product(above, inverse))
        rest = self._convolved(group.out, group.left, range(1, order), order, weighted=True)
        return self._divide_series(self._arithmetic.difference(above, rest), first)

    def _rotate_series(self, a: Num[np.ndarray, "g b m"], turns: bool) -> Num[np.ndarray, "g b m"]:
        return self._arithmetic.times_i(a) if turns else a

    def _convolved(
        self, left: np.ndarray, right: np.ndarray, terms: range, order: int, weighted: bool = False
    ) -> Num[np.ndarray, "g b m"]:
        """sum of a_j b_{order-j}, each term with its tangents; weighted by j / order where asked."""
        product, reduced = self._arithmetic.product, self._arithmetic.reduced
        if not len(terms):
            return np.zeros_like(self._registers[0, left])
        a = self._registers[terms.start : terms.stop, left]
        b = self._registers[order + 1 - terms.stop : order + 1 - terms.start, right][::-1]
        if weighted:
            weights = self._weights(order)[terms.start : terms.stop]
            a = product(a, weights[:, np.newaxis, np.newaxis, np.newaxis])
        first = product(a[..., :1], b).sum(axis=0)
        if a.shape[-1] == 1:
            return reduced(first)
        # The value a b stands in both sums, at index 0: each tangent has da b of one and a db of the other.
        result = reduced(first + product(a, b[..., :1]).sum(axis=0))
        result[..., 0] = reduced(first[..., 0])
        return result

    def _weights(self, order: int) -> Num[np.ndarray, " k"]:
        """j / order for all j up to it."""
        if order not in self._shares:
            self._shares[order] = self._arithmetic.numbers([Fraction(j, order) for j in range(order + 1)])
        return self._shares[order]

    def _divide_series(
        self, a: Num[np.ndarray, "g b m"], b: Num[np.ndarray, "g b m"]
    ) -> Num[np.ndarray, "g b m"]:
        """a / b with tangents: (da - (a/b) db) / b."""
        product = self._arithmetic.product
        inverse = self._arithmetic.inverse(b[..., 0])[..., np.newaxis]
        value = product(a[..., :1], inverse)
        return self._with_value(
            value[..., 0], product(self._arithmetic.difference(a, product(value, b)), inverse)
        )

    @staticmethod
    def _with_value(
        value: Num[np.ndarray, "g b"], tangents: Num[np.ndarray, "g b m"]
    ) -> Num[np.ndarray, "g b m"]:
        tangents[..., 0] = value
        return tangents
