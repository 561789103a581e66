"""A certificate in sentences, and as a document."""

from collections import Counter
from typing import Any

import numpy as np
from jaxtyping import Float

from observability.certificate import Certificate, Proof
from observability.explanation import Explained

DIRECTED = ("gauge translation", "gauge rotation", "centre of mass", "roll of the principal axes")
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
    parts = _named([each for each in certificate.explanations if each.finite])
    later = _named([each for each in certificate.explanations if not each.finite])
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


def _named(explanations: list[Explained]) -> list[str]:
    """Kinds of directions: all three of a kind by their number, fewer by their own names."""
    counts = Counter(each.symmetry.group for each in explanations)
    parts = []
    for group, count in counts.items():
        names = [each.symmetry.name for each in explanations if each.symmetry.group == group]
        if group not in DIRECTED or count >= ALL_DIRECTIONS:
            parts.append(group if count == 1 else f"{group} ({count})")
        else:
            parts.append(
                " and ".join(names) if not group.startswith("gauge") else f"{group}: {' and '.join(names)}"
            )
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
