"""Isolated other solutions: values of the unknowns with the same outputs, by mirroring or exchange, and by monodromy.

Discrete symmetries: a map s of the unknowns that commutes with the motion, f(s z) = s f(z), and keeps the outputs, h(s z) = h(z),
takes any solution to another one. Changes of sign and exchanges of pairs are tried at random points of a prime field; a map that
holds at all of them is one but for a chance of some 1e-9 to the power of the points. Where it keeps all that the generators leave
alone, it leads to a solution of the same family, and is left out. Where it changes an observable unknown or what all generators
leave alone, it is isolated from the family.

Monodromy, for systems of products and quotients: at a random point as many independent Taylor coefficients of the outputs as there
are unknowns make a square system G(z) = c, which the point solves. Along closed ways of c through the complex numbers a solution is
continued by Newton's method and ends at a solution of the same system, with random ways at a random one of them all, since the
graph of G is irreducible. Those that have all other coefficients too, of orders beyond those that reach the rank, are other
solutions. If ways that lead far end anywhere alike, one more than the D solutions found is missed by n of them with a chance of
(1 - 1/(D + 1))^n.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, islice
from time import monotonic

import numpy as np
from jaxtyping import Bool, Complex, Float, Num

from observability.codistribution import ExactRank
from observability.exact_numbers import NotRegularError, PrimeField, Reals
from observability.function_values import BranchDecisions, Residues, function_values
from observability.generators import Generator
from observability.invariants import InvariantSet
from observability.model_rank import ReachedModel
from observability.monomials import Values
from observability.null_fields import is_rational
from observability.power_series import Series
from spinfilters.core.errors import InputError

MOST_MAPS = 6_000
"""Maps tried."""
MOST_PAIRS = 3
"""Pairs exchanged at once."""
POINTS = 3
BATCH = 8192


@dataclass(frozen=True)
class DiscreteSymmetry:
    """An exchange of unknowns with changes of sign.

    Attributes
    ----------
    images : dict[str, tuple[int, str]]
        Sign and unknown that take the place of every unknown that changes.
    isolated : bool
        Whether no continuous change that the outputs do not notice leads there as well.
    """

    images: dict[str, tuple[int, str]]
    isolated: bool = True

    def __str__(self) -> str:
        return ", ".join(
            f"{name} -> {'-' if sign < 0 else ''}{other}" for name, (sign, other) in self.images.items()
        )

    @property
    def sentence(self) -> str:
        """The solution in words, called isolated where it is known to be."""
        return f"Another solution{', isolated' if self.isolated else ''}: {self}."


@dataclass(frozen=True)
class SignedPermutation:
    """Places and signs: the k-th unknown becomes signs[k] times the one at places[k]."""

    places: tuple[int, ...]
    signs: tuple[int, ...]

    def after(self, other: "SignedPermutation") -> "SignedPermutation":
        """The product of both."""
        places = tuple(self.places[k] for k in other.places)
        signs = tuple(sign * self.signs[k] for k, sign in zip(other.places, other.signs, strict=True))
        return SignedPermutation(places, signs)


def _signed_permutation(places: np.ndarray, signs: np.ndarray) -> SignedPermutation:
    return SignedPermutation(tuple(places.tolist()), tuple(signs.tolist()))


@dataclass(frozen=True)
class DiscreteSearch:
    """What was found, and whether all mirrored and exchanged unknowns were tried.

    Attributes
    ----------
    found : tuple[DiscreteSymmetry, ...]
        Those that are no products of others of them.
    complete : bool
        Whether all maps of the kind were tried.
    """

    found: tuple[DiscreteSymmetry, ...]
    complete: bool


@dataclass(frozen=True)
class SolutionFamily:
    """Solutions that a continuous change of the unknowns leads to.

    Attributes
    ----------
    generators : Sequence[Generator]
        Fields that move along the family.
    invariants : InvariantSet
        Of these.
    unobservable : frozenset[str]
        Unknowns that differ within the family.
    whole : bool
        Whether the generators reach all of the family.
    """

    generators: Sequence[Generator]
    invariants: InvariantSet
    unobservable: frozenset[str]
    whole: bool

    def leaves(self, symmetry: DiscreteSymmetry, values: Values, field: PrimeField) -> bool:
        """Whether a map surely leads out of the family."""
        if not self.unobservable.issuperset(symmetry.images):
            return True
        return self.whole and self._changes(symmetry, values, field)

    def holds(self, symmetry: DiscreteSymmetry, values: Values, field: PrimeField) -> bool:
        """Whether a map surely stays in the family."""
        moved = {name for each in self.generators for name in each.components}
        return (
            self.invariants.complete
            and moved.issuperset(symmetry.images)
            and not self._changes(symmetry, values, field)
        )

    def _changes(self, symmetry: DiscreteSymmetry, values: Values, field: PrimeField) -> bool:
        """Whether some invariant has another value after a map."""
        image = dict(values)
        for name, (sign, other) in symmetry.images.items():
            image[name] = field.negative(values[other]) if sign < 0 else values[other]
        found = self.invariants.found
        return any((each.value(values, field) != each.value(image, field)).any() for each in found)


def discrete_symmetries(part: ReachedModel, family: SolutionFamily) -> DiscreteSearch:
    """Mirrored and exchanged unknowns that no output notices, apart from those within the family of solutions.

    Functions other than roots of 1 cannot be tried at points where they have no value: there nothing is tried.
    """
    names = [*part.states, *[name for name in part.constants if name in part.unknowns]]
    if not names or not is_rational(part):
        return DiscreteSearch((), complete=False)
    field, random = PrimeField(), np.random.default_rng(12)
    values = field.draw(part.model.symbols, POINTS, random)
    identity = np.arange(len(names))
    # A scaling by -1 stays in the family, whether its invariants are known or not.
    within = [_signed_permutation(identity, each) for each in _signs_of_scalings(family.generators, names)]
    others: list[tuple[SignedPermutation, DiscreteSymmetry]] = []
    maps, complete = _maps(names, part)
    for permutations, signs in maps:
        for index in np.flatnonzero(_check_maps(part, names, permutations, signs)).tolist():
            permutation, sign = permutations[index], signs[index]
            images = {
                name: (int(sign[k]), names[permutation[k]])
                for k, name in enumerate(names)
                if permutation[k] != k or sign[k] < 0
            }
            symmetry, own = DiscreteSymmetry(images), _signed_permutation(permutation, sign)
            if family.holds(symmetry, values, field):
                within.append(own)
            elif images:
                isolated = family.leaves(symmetry, values, field)
                others.append((own, DiscreteSymmetry(images, isolated)))
    group = {_signed_permutation(identity, np.ones(len(names), dtype=int))}
    found = []
    for own, symmetry in others:
        # Followed by what stays in the family it is no other solution.
        if any(each.after(own) in group for each in within):
            continue
        group = _generated(group, own)
        found.append(symmetry)
    return DiscreteSearch(tuple(found), complete)


def _maps(names: Sequence[str], part: ReachedModel) -> tuple[Iterator[tuple[np.ndarray, np.ndarray]], bool]:
    """Batches of permutations and signs, and whether they are all of the kind."""
    count = len(names)
    room = MOST_MAPS >> count
    if not room:
        return iter(()), False
    exchanges = list(islice(_exchanges(count, len(part.states)), room + 1))
    every = len(exchanges) <= room
    if not every:
        exchanges = exchanges[:1]
    bits = 1 - 2 * ((np.arange(1 << count)[:, np.newaxis] >> np.arange(count)) & 1)
    order = np.argsort((bits < 0).sum(axis=1), kind="stable")

    def batches() -> Iterator[tuple[np.ndarray, np.ndarray]]:
        for permutation in exchanges:
            for first in range(0, len(bits), BATCH):
                signs = bits[order[first : first + BATCH]]
                yield np.tile(permutation, (len(signs), 1)), signs

    return batches(), every


def _exchanges(count: int, states: int) -> Iterator[np.ndarray]:
    """The identity, then products of disjoint exchanges of two states or two constants."""
    pairs = [*combinations(range(states), 2), *combinations(range(states, count), 2)]
    for number in range(MOST_PAIRS + 1):
        for chosen in combinations(pairs, number):
            touched = [index for pair in chosen for index in pair]
            if len(set(touched)) == len(touched):
                permutation = np.arange(count)
                for a, b in chosen:
                    permutation[[a, b]] = permutation[[b, a]]
                yield permutation


def _check_maps(
    part: ReachedModel,
    names: Sequence[str],
    permutations: Num[np.ndarray, "m n"],
    signs: Num[np.ndarray, "m n"],
) -> Bool[np.ndarray, " m"]:
    """Whether maps hold at random points."""
    field, random = PrimeField(), np.random.default_rng(11)
    good = np.ones(len(signs), dtype=bool)
    states = len(part.states)
    for _ in range(POINTS):
        values = {name: int(random.integers(1, field.prime)) for group in part.groups for name in group}
        at = np.array([values[name] for name in names], dtype=np.uint64)
        active = np.flatnonzero(good)
        moved = _signed(at[permutations[active]], signs[active], field)
        here = _evaluate_outputs(part, values, names, at[np.newaxis], field)
        there = _evaluate_outputs(part, values, names, moved, field)
        rates = _signed(
            here[:, :states][:, permutations[active][:, :states]][0], signs[active][:, :states], field
        )
        wanted = np.concatenate([rates, np.repeat(here[:, states:], len(active), axis=0)], axis=1)
        good[active] = (there == wanted).all(axis=1)
    return good


def _evaluate_outputs(
    part: ReachedModel,
    values: dict[str, int],
    names: Sequence[str],
    at: Num[np.ndarray, "m n"],
    field: PrimeField,
) -> Num[np.ndarray, "m o"]:
    """Rates and outputs with these values of the unknowns."""
    columns = {name: at[:, k] for k, name in enumerate(names)}
    groups = []
    for group in part.groups:
        rows = [columns.get(name, np.full(len(at), values[name], dtype=np.uint64)) for name in group]
        stacked = np.array(rows, dtype=np.uint64).reshape(len(group), len(at))
        groups.append(Residues(stacked, np.ones_like(stacked)))
    return function_values(part.tape, field, groups, {}).output.p.T


def _signed(a: np.ndarray, signs: np.ndarray, field: PrimeField) -> np.ndarray:
    return np.where(signs < 0, field.negative(a), a)


def _generated(group: set[SignedPermutation], new: SignedPermutation) -> set[SignedPermutation]:
    """The group with one more element, closed under products."""
    found, waiting = set(group), [new]
    while waiting:
        next_one = waiting.pop()
        if next_one in found:
            continue
        found.add(next_one)
        for other in list(found):
            waiting += [each for each in (next_one.after(other), other.after(next_one)) if each not in found]
    return found


def _signs_of_scalings(generators: Sequence[Generator], names: Sequence[str]) -> list[np.ndarray]:
    """Signs that scalings with integer weights reach by a factor of -1."""
    found = [np.ones(len(names), dtype=int)]
    for each in generators:
        if each.kind != "scaling":
            continue
        weights = {term.moved: value for term, value in each.terms.items()}
        if any(value.denominator != 1 for value in weights.values()):
            continue
        flips = np.array([-1 if weights.get(name, 0) % 2 else 1 for name in names])
        found += [flips * other for other in found]
    return found


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
