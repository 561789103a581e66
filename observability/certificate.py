"""Certificate of observability, with its sentences and its document.

An exact rank from below; from above the symmetries or, of a steady motion, the order of its linear equation.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction
from typing import Any

import numpy as np
from jaxtyping import Float, Num

from observability.body_model import InputSeries, body_rank, flow_of_system
from observability.codistribution import motion_coefficients
from observability.exact_numbers import PrimeField, Rationals
from observability.explanation import Explained, explained, tangent_symmetries
from observability.residue_matrices import FIELD
from observability.symmetry import INERTIAL_ATTITUDE
from observability.system import System, is_linear_in_body_axes

STEADY_ORDERS = 13
"""Orders 0 to 12 determine everything of a steady motion. In axes that turn with the body the linearised motion has constant
coefficients: blocks of degree 3 each for place, velocity, attitude and rate, and 1 for all constants. By Cayley and Hamilton the
13th and all later derivatives of an output that is linear in those axes are combinations of the first 13."""


class Proof(StrEnum):
    """Why a rank is known."""

    FULL = "the exact rank is full"
    SYMMETRIES = "the exact rank and the symmetries, which hold for finite moves, add up to all unknowns"
    STEADY = "the motion is steady, so that no higher order can add to the exact rank"
    OPEN = "open: the exact rank is a lower bound, and no proof from above was found"


@dataclass(frozen=True)
class Certificate:
    """Proved rank and null space of a system's outputs at a point.

    Attributes
    ----------
    dimension : int
        Unknowns.
    names : tuple[str, ...]
        Of all unknowns.
    ranks : tuple[int, ...]
        Exact, with orders 0, 0 to 1, and so on.
    order : int
        The first with the last rank.
    regular : bool
        Whether the rank is that of points in general position nearby.
    null_space : ndarray of shape (n, d)
        Residues, a basis in its columns.
    explanations : tuple[Explained, ...]
        Of the null space, independent of one another.
    vectors : ndarray of shape (n, e)
        (n, explanations) of each explanation the direction as floats.
    unnamed : int
        Null directions that no explanation covers.
    proof : Proof
        Of the last rank.
    """

    dimension: int
    names: tuple[str, ...]
    ranks: tuple[int, ...]
    regular: bool
    null_space: Num[np.ndarray, "n d"]
    explanations: tuple[Explained, ...]
    vectors: Float[np.ndarray, "n e"]
    proof: Proof

    @property
    def rank(self) -> int:
        """Rank of all orders."""
        return self.ranks[-1]

    @property
    def order(self) -> int:
        """Order at which the rank is reached."""
        return self.ranks.index(self.rank)

    @property
    def null_dimension(self) -> int:
        """Directions that the outputs do not show."""
        return self.dimension - self.rank

    @property
    def unnamed(self) -> int:
        """Null directions without a name."""
        return self.null_dimension - len(self.explanations)

    @property
    def certified(self) -> bool:
        """Whether the rank is proved from both sides."""
        return self.proof is not Proof.OPEN


def certify(system: System, point: Rationals, inputs: Sequence[InputSeries] = ()) -> Certificate:
    """Rank, null space, names and proof at a point.

    Parameters
    ----------
    inputs : Sequence[InputSeries]
        Experiments with the system's known inputs; their rows are taken together.
    """
    experiments = list(inputs) or [()]
    exact = body_rank(system, point, STEADY_ORDERS, experiments)
    tangents = tangent_symmetries(system, point, exact)
    explanations = _list_explanations(system, point, tangents.symmetries, experiments)
    return Certificate(
        dimension=system.dimension,
        names=system.names,
        ranks=exact.ranks + (exact.rank,) * (STEADY_ORDERS - len(exact.ranks)),
        regular=_generic_rank(system, point, experiments) == exact.rank,
        null_space=exact.null_space,
        explanations=tuple(explanations),
        vectors=tangents.of([each.symmetry for each in explanations]),
        proof=_proof(system, point, exact.rank, explanations),
    )


def _list_explanations(
    system: System, point: Rationals, symmetries: list, experiments: Sequence[InputSeries]
) -> list[Explained]:
    """Explanations that hold in every experiment."""
    if not symmetries:
        return []
    found = explained(system, point, symmetries, experiments[0])
    for given in experiments[1:]:
        again = {each.symmetry.name: each for each in explained(system, point, symmetries, given)}
        found = [
            Explained(
                each.symmetry,
                max(each.change, again[each.symmetry.name].change),
                each.finite and again[each.symmetry.name].finite,
            )
            for each in found
            if each.symmetry.name in again
        ]
    return found


def _proof(system: System, point: Rationals, rank: int, explanations: Sequence[Explained]) -> Proof:
    if rank == system.dimension:
        return Proof.FULL
    if rank + sum(each.finite for each in explanations) == system.dimension:
        return Proof.SYMMETRIES
    linear = all(is_linear_in_body_axes(sensor.model) for sensor in system.sensors)
    if linear and not system.inputs and _has_steady_rate(system, point):
        return Proof.STEADY
    return Proof.OPEN


def _has_steady_rate(system: System, point: Rationals) -> bool:
    """Whether the rate's own rate is exactly 0."""
    flow = flow_of_system(system, point, FIELD)
    *_, (slope, _) = motion_coefficients(flow, 2)
    start = 0
    for block in system.chart.blocks:
        if block.name == "w":
            return not slope[start : start + block.size, 0, 0].any()
        start += block.size
    return False


def _generic_rank(system: System, point: Rationals, experiments: Sequence[InputSeries]) -> int:
    """Generic rank, at a random point of the chart.

    A quaternion is taken along a random turn, whose rank any unit quaternion has.
    Without inputs the rank of points in general position has grown to its end at the first order that adds nothing (Hermann and
    Krener 1977).
    """
    generator = np.random.default_rng(0)
    moved = tuple(
        value + Fraction(int(step), 10**4) if moves else value
        for value, step, moves in zip(
            point, generator.integers(1, 1000, len(point)), _additive(system), strict=True
        )
    )
    field = PrimeField(int(generator.integers(2, 1 << 30)))
    return body_rank(system, moved, STEADY_ORDERS, experiments, field, stops=not system.inputs).rank


def _additive(system: System) -> list[bool]:
    return [block.size == len(block.components) for block in system.chart.blocks for _ in range(block.size)]


NAMED_AFTER_KIND = ("gauge translation", "gauge rotation", INERTIAL_ATTITUDE)
"""Kinds whose directions are named after the kind: by themselves they do not say what moves."""
DIRECTED = (*NAMED_AFTER_KIND, "centre of mass", "roll of the principal axes")
"""Kinds that mean one direction of several, which is then named."""
ROUNDING = 1e-12
"""Of the largest entry of a direction."""
ALL_DIRECTIONS = 3
"""Directions of a kind that leave none to name."""


def sentences(certificate: Certificate) -> list[str]:
    """Sentences on what is determined, what is not, and the proof."""
    rank, dimension = certificate.rank, certificate.dimension
    orders = "values alone" if certificate.order == 0 else f"derivatives up to order {certificate.order}"
    verb = "are" if certificate.proof is not Proof.OPEN else "at least are"
    lines = [f"{rank} of {dimension} unknowns {verb} determined, reached with {orders}."]
    lines.append(null_space_sentence(certificate))
    lines.append(f"Proof: {certificate.proof.value}.")
    if not certificate.regular:
        lines.append("This motion is special: points in general position nearby determine more.")
    return lines


def null_space_sentence(certificate: Certificate) -> str:
    """Sentence on the directions left undetermined."""
    if certificate.null_dimension == 0:
        return "Nothing of what was asked is left undetermined."
    parts = _name_directions([each for each in certificate.explanations if each.finite])
    later = _name_directions([each for each in certificate.explanations if not each.finite])
    parts += [f"{words}, to first order only" for words in later]
    if certificate.unnamed:
        parts.append(f"{certificate.unnamed} without a name")
    return f"Not determined, {certificate.null_dimension}: {'; '.join(parts)}."


def null_vector_sentences(certificate: Certificate) -> list[str]:
    """Sentences on a null direction of a few unknowns, no gauge.

    It is in their own numbers: no more than a few change along it.
    """
    found = []
    for each, vector in zip(certificate.explanations, certificate.vectors.T, strict=True):
        if each.symmetry.group == "scale of the inertia":
            parts = named_entries(certificate.names, vector)
            words = ", ".join(f"{name} {value:+.4g}" for name, value in parts.items())
            found.append(f"Null vector of the {each.symmetry.name}, all other unknowns 0: {words}.")
    return found


def named_entries(names: tuple[str, ...], vector: Float[np.ndarray, " n"]) -> dict[str, float]:
    """Entries of a direction by the names of the unknowns.

    Those that are not 0, over that of J_z (or J_zz), or over the largest.
    """
    size = np.abs(vector)
    kept = np.flatnonzero(size > ROUNDING * size.max(initial=0.0))
    axial = [k for k in kept if names[k] in ("J_z", "J_zz")]
    unit = vector[axial[0]] if axial else vector[size.argmax()]
    return {names[k]: float(vector[k] / unit) for k in kept}


def _name_directions(explanations: list[Explained]) -> list[str]:
    """Kinds of directions: all three of a kind by their number, fewer by their own names."""
    counts = Counter(each.symmetry.group for each in explanations)
    parts = []
    for group, count in counts.items():
        names = [each.symmetry.name for each in explanations if each.symmetry.group == group]
        if group not in DIRECTED or count >= ALL_DIRECTIONS:
            parts.append(group if count == 1 else f"{group} ({count})")
        else:
            listed = " and ".join(names)
            parts.append(f"{group}: {listed}" if group in NAMED_AFTER_KIND else listed)
    return parts


def document(certificate: Certificate) -> dict[str, Any]:
    """The certificate for JSON."""
    return {
        "unknowns": list(certificate.names),
        "rank": certificate.rank,
        "dimension": certificate.dimension,
        "ranks_by_order": list(certificate.ranks),
        "regular": certificate.regular,
        "certified": certificate.certified,
        "proof": certificate.proof.value,
        "not_determined": [
            {
                "name": each.symmetry.name,
                "group": each.symmetry.group,
                "holds_for_finite_moves": each.finite,
                "change_of_outputs": each.change,
                "null_vector": named_entries(certificate.names, vector),
            }
            for each, vector in zip(certificate.explanations, certificate.vectors.T, strict=True)
        ],
        "unnamed": certificate.unnamed,
        "text": sentences(certificate),
    }
