"""Rank of a model's outputs at real points in floats, with which a rank in residues must agree.

Residues know that exp(a) exp(b) = exp(a + b), but not that log(a) + log(b) = log(a b) or that sin(4 atan(1)) = 0: such a
difference is then a number other than 0, and the rank too high. On the reals it is rounding. Each operation is computed several
times with errors drawn at random (Vignes 1993, the CESTAC method), so that a number that is all rounding differs from one time to
the next.
"""

import math
from collections.abc import Sequence
from enum import StrEnum
from fractions import Fraction
from typing import Final

import numpy as np
from jaxtyping import Num

from observability.codistribution import Coefficients, ExactRank, Flow, motion_coefficients
from observability.exact_numbers import SIMPLE, Arithmetic
from observability.function_values import BranchDecisions
from observability.model_rank import ReachedModel, draw_point, later_inputs, with_tangents
from observability.power_series import Series
from observability.tape import PIECEWISE, TRANSCENDENTAL, Choices, float_choices
from spinfilters.core.errors import InputError

COMPLEX: Final = np.dtype(np.complex128)
ROUNDING: Final = float(np.finfo(float).eps)
TIMES: Final = 6
"""Each number is computed so often."""
COMPUTED: Final = 1e-15
"""Error of a constant that was computed from others in floats."""
LARGEST_LEFT_OVER: Final = 1e-14
"""Magnitude below which a constant may be what a difference of equal numbers leaves."""
SMALLEST_SHARE: Final = 1e-9
"""Relative difference within which it is a multiple of the cosine of pi/2 as a float."""
DIGITS: Final = 14
"""A constant with more of them is a computed one."""
SURE: Final = 100.0
"""A number is none of rounding if it is so many times its spread."""
TINY: Final = float(np.finfo(float).tiny)
RANGES: Final = ((0.5, 2.0), (0.1, 1.0), (1.0, 6.0), (-3.0, 3.0))
"""Values of unknowns are drawn from these in turn."""
POINTS: Final = 60
"""Drawn at most until some have all roots and logarithms real."""
ENOUGH: Final = 8
"""Real points compared."""
FEWEST: Final = 3
"""The same, where a point takes long."""
LONG: Final = 2_000_000
"""Products at a point, from which it takes long."""
FUNCTIONS: Final = TRANSCENDENTAL | {"sqrt"}


class RealRank(StrEnum):
    """What real points say of an exact rank, in words of a proof that stays open."""

    SAME = ""
    LOWER = (
        "the equations hold functions or constants, such as 4*atan(1), with a relation that the exact arithmetic does not know; "
        "at real points the rank is lower"
    )
    HIGHER = "the exact rank is that of one branch of a root or an inverse function; at other real points it is higher"
    OTHER_BRANCH = "no real point of this branch was found to compare the exact rank with"
    NEVER_REAL = "no point was found at which all roots and logarithms are real; check the equations"


class RandomRounding(Arithmetic):
    """Complex floats, each result with an error drawn at random."""

    dtype = COMPLEX

    def __init__(self, seed: int) -> None:
        self._generator = np.random.default_rng(seed)
        self.real = True

    def numbers(self, values: Sequence[Fraction]) -> Num[np.ndarray, " n"]:
        """Nearest floats."""
        return np.array(
            [float(value) for value in values],
            dtype=COMPLEX,
        )

    def copies(self, value: Fraction, count: int) -> Num[np.ndarray, " n"]:
        """A constant that differs from one to the next by the rounding of floats if it is a computed one."""
        numbers = np.repeat(self.numbers([value]), count)
        if not _is_computed(value):
            return numbers
        error = COMPUTED if not _is_left_over(float(value)) else 1.0
        return numbers * (1 + self._generator.uniform(-error, error, count))

    def reduced(self, a: np.ndarray) -> np.ndarray:
        """The same, rounded at random."""
        error = self._generator.uniform(-ROUNDING, ROUNDING, a.shape)
        return a + a * error

    def negative(self, a: np.ndarray) -> np.ndarray:
        """-a."""
        return -a

    def product(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """a b."""
        return self.reduced(a * b)

    def inverse(self, a: np.ndarray) -> np.ndarray:
        """1 / a."""
        return self.reduced(1 / a)

    def exponential(self, a: np.ndarray) -> np.ndarray:
        """exp(a)."""
        return self.reduced(np.exp(a))

    def root(self, a: np.ndarray) -> np.ndarray:
        """The principal root."""
        self._require_positive(a)
        return self.reduced(np.sqrt(a))

    def logarithm(self, a: np.ndarray) -> np.ndarray:
        """The principal logarithm."""
        if np.allclose(np.abs(a), 1):
            return self.reduced(np.log(a))
        self._require_positive(a)
        return self.reduced(np.log(a))

    def times_i(self, a: np.ndarray) -> np.ndarray:
        """The imaginary unit times a."""
        return 1j * a

    def _require_positive(self, a: np.ndarray) -> None:
        near = np.abs(np.imag(a)) < 1e-9 * np.abs(a)
        self.real &= bool(np.all(near & (np.real(a) > 0)))


def _is_computed(value: Fraction) -> bool:
    """Whether a constant has so many digits that it is a rounded number: sqrt(2) or pi, not 0.1."""
    number = float(value)
    return value.denominator > SIMPLE and float(f"{number:.{DIGITS}g}") != number


def _is_left_over(number: float) -> bool:
    """Whether a constant is what rounding leaves of 0: some units of the last binary place, or the sine of pi as a float."""
    if not 0 < abs(number) < LARGEST_LEFT_OVER:
        return False
    places = abs(number) / 2.0**-60
    quarters = abs(number) / math.cos(math.pi / 2)
    return places == round(places) or abs(quarters - round(quarters)) < SMALLEST_SHARE * quarters


def real_rank(part: ReachedModel, exact: ExactRank, seed: int = 0) -> RealRank:
    """What the ranks at random real points say of an exact rank.

    Where there are only sums, products and quotients of exact constants, nothing is computed: residues have all their relations.
    """
    tapes = (part.tape, part.start)
    rational = all(tape.operations.isdisjoint(FUNCTIONS) for tape in tapes)
    if rational and not any(_is_computed(value) for tape in tapes for _, value in tape.constants):
        return RealRank.SAME
    if not exact.names:
        return RealRank.SAME
    generator = np.random.default_rng(seed)
    work = part.tape.size * (exact.order + 2) ** 2 * len(exact.names)
    wanted = FEWEST if work > LONG else ENOUGH
    lower: dict[tuple[float, float], bool] = {}
    real = elsewhere = 0
    branch = (
        {}
        if PIECEWISE.isdisjoint(part.tape.operations)
        else draw_point(part, np.random.default_rng(seed)).decisions.choices
    )
    for attempt in range(POINTS):
        between = RANGES[attempt % len(RANGES)]
        values = _draw_groups(part, between, generator)
        arithmetic = RandomRounding(int(generator.integers(1 << 30)))
        try:
            rank = _rank_at(part, exact, values, arithmetic, generator, branch)
        except _OtherBranchError:
            elsewhere += 1
            continue
        except _NotRealError:
            continue
        real += 1
        if rank > exact.rank:
            return RealRank.HIGHER
        lower[between] = lower.get(between, True) and rank < exact.rank
        if real == wanted:
            break
    if not real:
        return RealRank.OTHER_BRANCH if elsewhere else RealRank.NEVER_REAL
    return RealRank.LOWER if any(lower.values()) else RealRank.SAME


class _OtherBranchError(Exception):
    """Of a point at which max, min, abs or a comparison decides otherwise than at that of the exact rank."""


class _NotRealError(Exception):
    """Of a point at which something is not real or not finite."""


def _draw_groups(
    part: ReachedModel, between: tuple[float, float], generator: np.random.Generator
) -> list[Num[np.ndarray, "n b"]]:
    """States, constants, inputs and unknown inputs, the same at all times."""
    groups = []
    for names in part.groups:
        values = generator.uniform(*between, len(names))
        for k, name in enumerate(names):
            if name in part.model.point:
                values[k] = float(part.model.point[name])
        for vector in part.model.unit_vectors:
            where = [k for k, name in enumerate(names) if name in vector]
            values[where] /= max(TINY, float(np.linalg.norm(values[where])))
        groups.append(np.repeat(values[:, np.newaxis], TIMES, axis=1))
    return groups


def _rank_at(
    part: ReachedModel,
    exact: ExactRank,
    values: list[Num[np.ndarray, "n b"]],
    arithmetic: RandomRounding,
    generator: np.random.Generator,
    branch: Choices,
) -> int:
    orders = exact.order + 2
    if part.model.discrete:
        periods = part.most_orders if part.unknown_inputs else exact.order + 1
        orders = part.model.period * periods
    elif part.unknown_inputs:
        orders = part.orders_with_unknown_inputs[exact.order]
    jets = len(part.unknown_inputs) * (orders - 1)
    width = 1 + len(part.unknowns) + jets
    with np.errstate(all="ignore"):
        if part.model.discrete:
            rows = _gradients_of_steps(part, values, arithmetic, (orders, width), generator)
        else:
            rows = _gradients(part, values, arithmetic, (orders, width), generator, branch)
    if not arithmetic.real or not np.isfinite(rows).all():
        raise _NotRealError
    unknown = len(part.unknowns)
    ordered = np.concatenate([rows[..., unknown:], rows[..., :unknown]], axis=-1).transpose(1, 0, 2)
    before, rest = _eliminate_columns(ordered, jets, arithmetic)
    return _eliminate_columns(rest[:, before:, jets:], unknown, arithmetic)[0]


def _gradients(
    part: ReachedModel,
    values: list[Num[np.ndarray, "n b"]],
    arithmetic: RandomRounding,
    shape: tuple[int, int],
    generator: np.random.Generator,
    branch: Choices,
) -> Num[np.ndarray, "r b n"]:
    """Gradients of the outputs' Taylor coefficients by the unknowns, then by jets of unknown inputs."""
    orders, width = shape
    firsts = _firsts(part, values, arithmetic, width)
    try:
        choices = float_choices(part.tape, [np.real(firsts[0][..., 0]), *values[1:]])
    except InputError:
        raise _NotRealError from None
    if any(np.any(choices[index] != each) for index, each in branch.items()):
        raise _OtherBranchError

    def others(order: int) -> Coefficients:
        if order == 0:
            return [(index, firsts[index]) for index in (1, 2, 3)]
        return [
            (index, _jets(part, index, order, width, generator)) for index in (2, 3) if part.groups[index]
        ]

    flow = Flow(arithmetic, part.tape, BranchDecisions(choices, {}), firsts[0], others)
    return np.concatenate([found[..., 1:] for _, found in motion_coefficients(flow, orders)])


def _gradients_of_steps(
    part: ReachedModel,
    values: list[Num[np.ndarray, "n b"]],
    arithmetic: RandomRounding,
    shape: tuple[int, int],
    generator: np.random.Generator,
) -> Num[np.ndarray, "r b n"]:
    """Gradients of the outputs measured at every step by the unknowns, then by later unknown inputs."""
    steps, width = shape
    states, given, found = len(part.states), _firsts(part, values, arithmetic, width), []
    for step in range(steps):
        if step:
            given[2:] = [_jets(part, index, step, width, generator) for index in (2, 3)]
        series = Series(part.tape, BranchDecisions({}, {}), arithmetic, (1, TIMES, width))
        for index, each in enumerate(given):
            series.put(index, 0, each)
        rows = series.advance(0)
        seen = [states + k for k in part.model.measured_at(step)]
        found.append(rows[seen, :, 1:])
        given[0] = rows[:states]
    return np.concatenate(found)


def _firsts(
    part: ReachedModel, values: list[Num[np.ndarray, "n b"]], arithmetic: RandomRounding, width: int
) -> list[Num[np.ndarray, "n b m"]]:
    """Values at time 0 of states, constants and inputs, with their tangents."""
    firsts = [
        with_tangents(part, names, each.astype(COMPLEX), width)
        for names, each in zip(part.groups, values, strict=True)
    ]
    if part.model.known_initial_values:
        start = Series(part.start, BranchDecisions({}, {}), arithmetic, (1, TIMES, width))
        for index, each in enumerate(firsts):
            start.put(index, 0, each)
        firsts[0] = start.advance(0)
    return firsts


def _jets(
    part: ReachedModel, index: int, order: int, width: int, generator: np.random.Generator
) -> Num[np.ndarray, "n b m"]:
    """Taylor coefficients of inputs, drawn; those of unknown inputs are unknowns."""
    drawn = generator.uniform(0.5, 1.5, len(part.groups[index])).astype(COMPLEX)
    return later_inputs(part, index, order, np.repeat(drawn[:, np.newaxis], TIMES, axis=1), width)


def _eliminate_columns(
    rows: Num[np.ndarray, "b r n"], columns: int, arithmetic: RandomRounding
) -> tuple[int, Num[np.ndarray, "b r n"]]:
    """Pivots in the first columns that are surely not 0, the surest first, and what elimination leaves, pivots' rows above."""
    rest = rows.copy()
    for done in range(min(columns, rest.shape[1])):
        below = rest[:, done:, :columns]
        mean = np.abs(below.mean(axis=0))
        spread = np.abs(below - below.mean(axis=0)).max(axis=0)
        sureness = mean / np.maximum(spread, np.maximum(ROUNDING * mean / 4, TINY))
        row, column = np.unravel_index(int(sureness.argmax()), sureness.shape)
        if sureness[row, column] < SURE:
            return done, rest
        row += done
        rest[:, [done, row]] = rest[:, [row, done]]
        pivot = rest[:, done]
        factor = rest[:, done + 1 :, column] / pivot[:, column, np.newaxis]
        change = arithmetic.product(factor[..., np.newaxis], pivot[:, np.newaxis])
        rest[:, done + 1 :] = arithmetic.reduced(rest[:, done + 1 :] - change)
        rest[:, done + 1 :, column] = 0
    return min(columns, rest.shape[1]), rest
