"""Isolated other solutions by monodromy: other values of the unknowns with the same outputs, of systems of products and quotients.

At a random point as many independent Taylor coefficients of the outputs as there are unknowns make a square system G(z) = c, which
the point solves. Along closed ways of c through the complex numbers a solution is continued by Newton's method and ends at a
solution of the same system, with random ways at a random one of them all, since the graph of G is irreducible. Those that have all
other coefficients too, of orders beyond those that reach the rank, are other solutions. If ways that lead far end anywhere alike,
one more than the D solutions found is missed by n of them with a chance of (1 - 1/(D + 1))^n.
"""

from dataclasses import dataclass
from time import monotonic

import numpy as np
from jaxtyping import Bool, Complex, Float, Num

from observability.codistribution import ExactRank
from observability.exact_numbers import NotRegularError, Reals
from observability.function_values import BranchDecisions
from observability.model_rank import ReachedModel
from observability.null_fields import is_rational
from observability.power_series import Series
from spinfilters.core.errors import InputError

WAYS = 64
"""Continued at once."""
SHORTEST_REACH, LONGEST_REACH = 0.05, 3.0
"""Of a way's corners, to first order, by the size of the unknowns."""
FAR = 0.3
"""Reach from which a way counts for the chance of missing a solution."""
SIDES = 3
"""Of a way."""
FIRST_STEP = 1e-3
SHORTEST_STEP = 1e-6
"""Of a side, at which a way is given up."""
MOST_STEPS = 300
CONTRACTION = 0.1
"""Of the residual by a step of Newton's method that is near a solution."""
LEAST_BATCHES = 2
POLISHING = 6
"""Newton's, at the end of a way."""
CHECKED_BEYOND = 3
"""Orders compared beyond those that reach the rank."""
SAME = 1e-7
"""Relative difference below which coefficients are equal."""
APART = 1e-5
"""Relative difference of unknowns above which solutions are."""
INDEPENDENT = 1e-8
"""Share of a row that rows before must leave."""
LARGEST_CHANCE = 0.1
"""Up to which the search says anything of further solutions."""
LEAST_CHANCE = 1e-3
"""That is said: ways end at random only nearly."""
ENOUGH = 1e-3
"""Chance of missing a solution at which the search ends."""
MOST_UNKNOWNS = 14
LARGEST_WORK = 60_000
"""Registers times tangents times orders of a model that is searched."""
SECONDS = 20.0


@dataclass(frozen=True)
class OtherSolutions:
    """Other values with the same outputs, at a random point.

    Attributes
    ----------
    point : dict[str, float]
        The unknowns that were taken for the truth; none where the model was not searched.
    found : tuple[dict[str, complex], ...]
        Unknowns that differ in another solution, real ones first.
    chance_missed : float
        Of one more solution.
    """

    point: dict[str, float]
    found: tuple[dict[str, complex], ...]
    chance_missed: float

    @property
    def ambiguous(self) -> tuple[str, ...]:
        """Unknowns that have other values in some solution, also in a complex one."""
        return tuple(name for name in self.point if any(name in each for each in self.found))

    @property
    def real(self) -> tuple[dict[str, float], ...]:
        """The real ones."""
        return tuple(
            {name: value.real for name, value in each.items()}
            for each in self.found
            if not any(value.imag for value in each.values())
        )

    @property
    def sentences(self) -> list[str]:
        """What was found, and how surely that is all."""
        if not self.point:
            return ["Local only: other isolated solutions were not searched for."]
        lines = []
        for each in self.real:
            here = ", ".join(f"{name} = {self.point[name]:.3g}" for name in each)
            there = ", ".join(f"{name} = {value:.3g}" for name, value in each.items())
            lines.append(f"Another solution: where {here}, the outputs are those of {there}.")
        count = len(self.found) - len(self.real)
        if count:
            lines.append(f"{count} further solution{'s are' if count > 1 else ' is'} complex.")
        more = "further" if self.found else "other"
        if self.chance_missed > LARGEST_CHANCE:
            return [
                *lines,
                f"Local only: whether there are {more} isolated solutions the search cannot decide.",
            ]
        chance = max(self.chance_missed, LEAST_CHANCE)
        return [
            *lines,
            f"No {more} isolated solution was found at a random point; one is missed with a chance of about {chance:.0e}.",
        ]

    def document(self) -> dict[str, object]:
        """The solutions for JSON."""
        return {
            "point": self.point,
            "real": list(self.real),
            "complex": len(self.found) - len(self.real),
            "ambiguous": list(self.ambiguous),
            "chance_missed": self.chance_missed,
        }


NOT_SEARCHED = OtherSolutions({}, (), 1.0)


def other_solutions(part: ReachedModel, exact: ExactRank, seed: int = 0) -> OtherSolutions:
    """Other solutions of a model of full rank with known inputs; `NOT_SEARCHED` where it is too large or not rational."""
    names, orders = part.unknowns, exact.order + 1 + CHECKED_BEYOND
    if not names or exact.rank < len(names) or not is_rational(part) or "sqrt" in part.tape.operations:
        return NOT_SEARCHED
    if len(names) > MOST_UNKNOWNS or part.tape.size * (1 + len(names)) * orders > LARGEST_WORK:
        return NOT_SEARCHED
    try:
        with np.errstate(all="ignore"):
            return _Monodromy(part, exact, orders, seed).result()
    except (InputError, NotRegularError, np.linalg.LinAlgError):
        return NOT_SEARCHED


class _Monodromy:
    """Ways from the known solution to others."""

    def __init__(self, part: ReachedModel, exact: ExactRank, orders: int, seed: int) -> None:
        self._part, self._orders, self._seed = part, orders, seed
        self._random, self._until = np.random.default_rng(seed), monotonic() + SECONDS
        names = part.unknowns
        self._values = {
            name: float(self._random.uniform(0.5, 2.0)) for group in part.groups for name in group
        }
        self._truth = np.array([self._values[name] for name in names], dtype=complex)
        values, slopes = self._coefficients(self._truth[np.newaxis], orders)
        self._data = values[:, 0]
        self._scale = 1 / (np.abs(self._data) + 1e-3 * np.abs(self._data).max())
        self._rows = _independent_rows(slopes[:, 0] * self._scale[:, np.newaxis])
        self._squared = 1 + max(self._rows) // len(part.model.outputs)

    def result(self) -> OtherSolutions:
        if len(self._rows) < len(self._truth):
            return NOT_SEARCHED
        ended, batches = 0, 0
        every = [self._truth]
        while monotonic() < self._until:
            ends, far = self._ends(np.array(every))
            ended += far
            for end in ends:
                if all(_differing(end, other).any() for other in every):
                    every.append(end)
            batches += 1
            if batches >= LEAST_BATCHES and (1 - 1 / (len(every) + 1)) ** ended < ENOUGH:
                break
        whole, _ = self._coefficients(np.array(every), self._orders)
        same = (np.abs(whole.T - self._data) * self._scale < 1e2 * SAME).all(axis=1)
        names = self._part.unknowns
        others = [end for end, good in zip(every[1:], same[1:], strict=True) if good]
        others.sort(key=lambda end: bool((np.abs(np.imag(end)) > APART).any()))
        found = tuple(
            {
                names[k]: _drop_imaginary_rounding(end[k])
                for k in np.flatnonzero(_differing(end, self._truth)).tolist()
            }
            for end in others
        )
        point = {name: self._values[name] for name in names}
        return OtherSolutions(point, found, float((1 - 1 / (len(every) + 1)) ** ended))

    def _ends(self, starts: Complex[np.ndarray, "s n"]) -> tuple[list[Complex[np.ndarray, " n"]], int]:
        """Where random ways from random solutions end, and how many far ones do."""
        at = starts[self._random.integers(0, len(starts), WAYS)]
        reach = np.exp(self._random.uniform(np.log(SHORTEST_REACH), np.log(LONGEST_REACH), WAYS))
        home = np.tile(self._data[self._rows], (WAYS, 1))
        corners = np.array([home, *[home + self._random_direction(reach) for _ in range(2)], home])
        items, place, step = np.arange(WAYS), np.zeros(WAYS), np.full(WAYS, FIRST_STEP)
        for _ in range(MOST_STEPS):
            if monotonic() > self._until:
                break
            side = np.minimum(place, SIDES - 1e-9).astype(int)
            ahead = np.minimum(place + step, side + 1.0)
            share = (ahead - side)[:, np.newaxis]
            target = (1 - share) * corners[side, items] + share * corners[side + 1, items]
            once, before = self._newton(at, target)
            twice, after = self._newton(once, target)
            # Within reach of the solution Newton's method contracts; else the step was too long.
            good = (after < CONTRACTION * before) | (after < SAME)
            at[good], place[good] = twice[good], ahead[good]
            step = np.where(good, np.minimum(step * 1.7, 0.5), step / 3)
            if ((place >= SIDES) | (step < SHORTEST_STEP)).all():
                break
        arrived = place >= SIDES
        at, size = at[arrived], np.zeros(0)
        for _ in range(POLISHING if len(at) else 0):
            at, size = self._newton(at, home[: len(at)])
        good = size < SAME
        return list(at[good]), int((reach[arrived][good] > FAR).sum())

    def _random_direction(self, reach: Float[np.ndarray, " b"]) -> Complex[np.ndarray, "b r"]:
        """Random changes of the coefficients that move the known solution so far by its own size, to first order."""
        _, slopes = self._coefficients(self._truth[np.newaxis], self._squared)
        slope = slopes[self._rows][:, 0]
        parts = self._random.normal(0, 1, (2, WAYS, len(self._truth))) * reach[:, np.newaxis]
        return ((parts[0] + 1j * parts[1]) * self._truth) @ slope.T

    def _newton(
        self, at: Complex[np.ndarray, "b n"], target: Complex[np.ndarray, "b r"]
    ) -> tuple[Complex[np.ndarray, "b n"], Num[np.ndarray, " b"]]:
        """One step, and the size of what was left before it."""
        values, slopes = self._coefficients(at, self._squared)
        rows, count = self._rows, len(self._truth)
        scale = self._scale[rows]
        residual = (values[rows].T - target) * scale
        slope = slopes[rows].transpose(1, 0, 2) * scale[:, np.newaxis]
        bad = ~(np.isfinite(residual).all(axis=1) & np.isfinite(slope).all(axis=(1, 2)))
        residual[bad], slope[bad] = 1, np.eye(count)
        slope[:, np.arange(count), np.arange(count)] += 1e-14
        moved = at.copy()
        moved -= np.linalg.solve(slope, residual[..., np.newaxis])[..., 0]
        return moved, np.abs(residual).max(axis=1)

    def _coefficients(
        self, at: Complex[np.ndarray, "b n"], orders: int
    ) -> tuple[Complex[np.ndarray, "m b"], Complex[np.ndarray, "m b n"]]:
        """Taylor coefficients of the outputs at points, and their slopes."""
        part, count, width = self._part, len(at), 1 + len(self._part.unknowns)
        given = []
        for names in part.groups:
            rows = np.zeros((len(names), count, width), dtype=complex)
            for k, name in enumerate(names):
                if name in part.unknowns:
                    column = part.unknowns.index(name)
                    rows[k, :, 0], rows[k, :, 1 + column] = at[:, column], 1
                else:
                    rows[k, :, 0] = self._values[name]
            given.append(rows)
        inputs = np.random.default_rng(self._seed)
        series = Series(part.tape, BranchDecisions({}, {}), ComplexNumbers(), (orders, count, width))
        state, found = given[0], []
        for order in range(orders):
            series.put(0, order, state)
            series.put(1, order, given[1] if order == 0 else np.zeros_like(given[1]))
            course = np.zeros_like(given[2])
            course[..., 0] = inputs.uniform(-1, 1, (len(course), 1)) if order else given[2][..., 0]
            series.put(2, order, course)
            rows = series.advance(order)
            found.append(rows[len(part.states) :])
            state = rows[: len(part.states)] / (order + 1)
        whole = np.concatenate(found)
        return whole[..., 0], whole[..., 1:]


class ComplexNumbers(Reals):
    """complex128, without complaints: what has no value is no number, and its way is given up."""

    dtype = np.dtype(np.complex128)

    def inverse(self, a: np.ndarray) -> np.ndarray:
        """1 / a."""
        return 1 / a


def _independent_rows(rows: Complex[np.ndarray, "m n"]) -> list[int]:
    """The first rows that are independent of those before."""
    basis, found = np.zeros((0, rows.shape[1]), dtype=complex), []
    for k, row in enumerate(rows):
        left = row - basis.T @ (basis.conj() @ row)
        left -= basis.T @ (basis.conj() @ left)
        size = np.linalg.norm(left)
        if size > INDEPENDENT * np.linalg.norm(row):
            basis = np.concatenate([basis, left[np.newaxis] / size])
            found.append(k)
        if len(found) == rows.shape[1]:
            break
    return found


def _differing(a: Complex[np.ndarray, " n"], b: Complex[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Unknowns in which two solutions differ."""
    return np.abs(a - b) > APART * (np.abs(a) + np.abs(b))


def _drop_imaginary_rounding(value: complex) -> complex:
    """Without an imaginary part that is rounding."""
    return complex(value.real, value.imag if abs(value.imag) > APART * abs(value) else 0.0)
