"""Gain of known inputs: rank and bounds with and without them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from observability.bounds.quantities import Quantity, bounded_quantities
from observability.cases import Case
from observability.certificate import Certificate

GAIN_WORTH_SAYING = 0.9
"""Part of a bound that inputs must bring it below, to be told."""
PERCENT = round(100 * (1 - GAIN_WORTH_SAYING))


@dataclass(frozen=True)
class InputGain:
    """Each pair without and with the inputs.

    Attributes
    ----------
    rank, dimension: of the certificates.   falls: standard deviations after the last frame that fall by enough to be told.
    """

    rank: tuple[int, int]
    dimension: tuple[int, int]
    falls: dict[Quantity, tuple[float, float]]

    def __str__(self) -> str:
        (before, after), (few, many) = self.rank, self.dimension
        parts = [
            f"{name} {std:.3g} -> {less:.3g}" + ("" if unit == "1" else f" {unit}")
            for (name, unit), (std, less) in self.falls.items()
        ]
        told = f"bounds that fall by more than {PERCENT} %: {', '.join(parts)}"
        if not parts:
            told = f"no bound falls by more than {PERCENT} %"
        return f"Gain of the known inputs: rank {before} of {few} -> {after} of {many}; {told}."

    def document(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "rank": list(self.rank),
            "dimension": list(self.dimension),
            "bounds_that_fall": {f"{name} [{unit}]": list(pair) for (name, unit), pair in self.falls.items()},
        }


def input_gain(
    case: Case, certificate: Certificate, final: Mapping[Quantity, float], frames: int, interval: float
) -> InputGain | None:
    """Gain of known inputs against the case without them.

    Over as many frames, s apart; None where there are none.

    Parameters
    ----------
    certificate, final: of the case: what is proved, and the standard deviations after the last frame.
    """
    if not case.inputs:
        return None
    without = replace(case, inputs=())
    proved, reference = without.certificate(), without.reference(frames, interval)
    quantities = bounded_quantities(without.bound(reference), reference)
    pairs = {name: (float(values[-1]), final[name]) for name, values in quantities.items()}
    return InputGain(
        rank=(proved.rank, certificate.rank),
        dimension=(proved.dimension, certificate.dimension),
        falls={name: pair for name, pair in pairs.items() if pair[1] < GAIN_WORTH_SAYING * pair[0]},
    )
