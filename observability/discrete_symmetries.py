"""Other solutions: unknowns mirrored or exchanged so that all outputs stay as they are.

A map s of the unknowns that commutes with the motion, f(s z) = s f(z), and keeps the outputs, h(s z) = h(z), takes any solution to
another one. Changes of sign and exchanges of pairs are tried at random points of a prime field; a map that holds at all of
them is one but for a chance of some 1e-9 to the power of the points. Where it keeps all that the generators leave alone, it leads
to a solution of the same family, and is left out. Where it changes an observable unknown or what all generators leave alone, it is
isolated from the family. Other isolated solutions are not looked for.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, islice

import numpy as np
from jaxtyping import Bool, Num

from observability.exact_numbers import PrimeField
from observability.function_values import Residues, function_values
from observability.generators import Generator
from observability.invariants import InvariantSet
from observability.model_rank import ReachedModel
from observability.monomials import Values
from observability.null_fields import is_rational

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
    values = {name: random.integers(1, field.prime, POINTS, dtype=np.uint64) for name in part.model.symbols}
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
