"""A certificate in sentences, and as a document."""

from collections import Counter
from typing import Any

from observability.certificate import Certificate, Proof


def sentences(certificate: Certificate) -> list[str]:
    """What is determined, what is not and why, and how that is known."""
    rank, dimension = certificate.rank, certificate.dimension
    orders = "values alone" if certificate.order == 0 else f"derivatives up to order {certificate.order}"
    verb = "are" if certificate.proof is not Proof.OPEN else "at least are"
    lines = [f"{rank} of {dimension} unknowns {verb} determined, reached with {orders}."]
    lines.append(_null_space(certificate))
    lines.append(f"Proof: {certificate.proof.value}.")
    if not certificate.regular:
        lines.append("This motion is special: points in general position nearby determine more.")
    return lines


def _null_space(certificate: Certificate) -> str:
    if certificate.null_dimension == 0:
        return "Nothing is left undetermined."
    finite = Counter(each.symmetry.group for each in certificate.explanations if each.finite)
    infinitesimal = Counter(each.symmetry.group for each in certificate.explanations if not each.finite)
    parts = [_counted(group, count) for group, count in finite.items()]
    parts += [f"{_counted(group, count)}, to first order only" for group, count in infinitesimal.items()]
    if certificate.unnamed:
        parts.append(f"{certificate.unnamed} without a name")
    return f"Not determined, {certificate.null_dimension}: {'; '.join(parts)}."


def _counted(group: str, count: int) -> str:
    return group if count == 1 else f"{group} ({count})"


def document(certificate: Certificate) -> dict[str, Any]:
    """For JSON."""
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
            }
            for each in certificate.explanations
        ],
        "unnamed": certificate.unnamed,
        "text": sentences(certificate),
    }
