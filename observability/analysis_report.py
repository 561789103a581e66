"""Report of an analysis in sentences and as a document."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from observability.bounds.cramer_rao import Bound
from observability.bounds.prior_dependence import QuantityBound, quantity_bounds
from observability.bounds.quantities import (
    BLOCK_NAMES,
    EACH_MOMENT,
    MOMENTS,
    PLACE,
    Quantity,
    bounded_quantities,
    weak_direction_in_words,
)
from observability.bounds.reference_trajectory import ReferenceTrajectory
from observability.cases import Case
from observability.certificate import Certificate
from observability.input_gain import InputGain, input_gain
from observability.rational import as_floats
from observability.report_text import document, null_space_sentence, null_vector_sentences, sentences
from observability.scope import (
    CAMERA_AXES,
    PRINCIPAL_AXES,
    assumptions,
    axes_in_words,
    close_moments,
    scope,
    scope_sentences,
    title,
)
from spinfilters.symbolic.working_time import building

WORTH_SAYING = 0.05
"""Share of the information that is the priors' from which it is told beside a result."""
ALONG_SPIN = 1e-2
"""Sine of the angle within which a direction is called that of the spin axis."""

ATTITUDE = BLOCK_NAMES["a"]
MOVING = (ATTITUDE, BLOCK_NAMES["v"], BLOCK_NAMES["w"], PLACE)
"""Quantities that are no constants: their directions hold at an epoch."""
AXES_GIVEN = "That the ratios count as determined rests on the axes being taken as known."


@dataclass(frozen=True)
class Report:
    """A case with its certificate and, after a flight, its bound.

    Attributes
    ----------
    quantities: standard deviations over time.   verdicts: of every quantity after the last frame.
    gain: of the known inputs, None without any.
    """

    case: Case
    certificate: Certificate
    reference: ReferenceTrajectory
    bound: Bound
    quantities: dict[Quantity, Float[np.ndarray, " frames"]]
    verdicts: dict[Quantity, QuantityBound]
    gain: InputGain | None = None

    @cached_property
    def rank_sentences(self) -> list[str]:
        """Sentences on the rank, the unknowns and the proof."""
        lines = [*sentences(self.certificate), *null_vector_sentences(self.certificate)]
        lines += [*_gauge_sentences(self.certificate), *_spin_axis_sentences(self.case, self.certificate)]
        return [*lines, *singularity_sentences(self.case)]

    @cached_property
    def sentences(self) -> list[str]:
        """The whole text."""
        interval = float(self.reference.time[-1]) / max(1, len(self.reference.time) - 1)
        frames = len(self.reference.time)
        when = f"{frames} frame{'s' if frames > 1 else ''}" + (f" at {interval:g} s" if frames > 1 else "")
        lines = [title(self.case), *self.rank_sentences, *scope_sentences(self.case)]
        lines.append(f"Axes: {axes_in_words(self.case)}.")
        lines += _summary_of(self.verdicts)
        lines.append(f"Cramer-Rao bound after {when}, standard deviation of each component:")
        lines += [f"  {name:<28} {verdict_in_words(self, (name, unit))}" for name, unit in self.verdicts]
        lines.append(f"Least known: {weak_direction_in_words(self.bound)}.")
        if self.gain is not None:
            lines.append(str(self.gain))
        return [*lines, "Assumed:", *[f"  {words}" for words in assumptions(self.case)]]

    @property
    def final(self) -> dict[Quantity, float]:
        """Standard deviations after the last frame."""
        return {name: float(values[-1]) for name, values in self.quantities.items()}

    def document(self) -> dict[str, Any]:
        """For JSON."""
        asked = scope(self.case)
        return {
            "case": title(self.case),
            **document(self.certificate),
            "text": self.rank_sentences,
            "asked": list(asked.asked),
            "not_asked": list(asked.not_asked),
            "taken_as_known": list(asked.taken_as_known),
            "axes": axes_in_words(self.case),
            "assumed": assumptions(self.case),
            "bound": {_key(name): value for name, value in self.final.items()},
            "gain_of_inputs": None if self.gain is None else self.gain.document(),
            "bound_verdicts": {_key(name): self._verdict(name) for name in self.verdicts},
        }

    def _verdict(self, name: Quantity) -> dict[str, Any]:
        each = self.verdicts[name]
        longer = each.times_longer
        return {
            "text": verdict_in_words(self, name),
            "std": each.std,
            "prior_only_directions": each.prior_directions.tolist(),
            "axes_of_directions": _axes(name),
            "std_along_them": each.std_along if len(each.prior_directions) else None,
            "std_across_them": each.std_across if len(each.prior_directions) < each.dimension else None,
            "share_of_prior_that_remains_across": each.remains,
            "directions_not_determined": each.undetermined,
            "determined_in_principle_only": each.in_principle_only,
            "times_longer": longer if longer is not None and np.isfinite(longer) else None,
            "times_longer_tried": each.searched,
        }


@building()
def analyse(case: Case, frames: int, interval: float) -> Report:
    """Rank, bound and verdicts of a case after so many frames at such an interval, s."""
    certificate = case.certificate()
    reference = case.reference(frames, interval)
    bound = case.bound(reference)
    quantities = bounded_quantities(bound, reference)
    final = {name: float(values[-1]) for name, values in quantities.items()}
    return Report(
        case,
        certificate,
        reference,
        bound,
        quantities,
        quantity_bounds(case, reference, bound),
        input_gain(case, certificate, final, frames, interval),
    )


def verdict_in_words(report: Report, name: Quantity) -> str:
    """Verdict on one quantity: what the data tell, what the prior does, and why."""
    each, unit = report.verdicts[name], "" if name[1] == "1" else f" {name[1]}"
    count = len(each.prior_directions)
    if not count:
        share = each.remains**2
        rest = f"; priors give {100 * share:.2g} % of what is known" if share > WORTH_SAYING else ""
        if name == ATTITUDE and len(report.case.free_rotations) == 3:
            rest += ", since the first frame, whose attitude is a definition"
        return f"{each.std:.3g}{unit}{rest}"
    if count == each.dimension:
        return f"prior only ({each.std:.3g}{unit}): {_reason(each)}"
    directions = " and ".join(_direction(report, name, row) for row in each.prior_directions)
    frame = f" of {_axes(name)}" if name in (MOMENTS, EACH_MOMENT) else ""
    return (
        f"{each.std_across:.3g}{unit}, but prior only ({each.std_along:.3g}{unit}) along {directions}{frame}: "
        f"{_reason(each)}"
    )


def _reason(each: QuantityBound) -> str:
    count = len(each.prior_directions)
    if each.undetermined >= count:
        return "not determined"
    if each.times_longer is not None and np.isfinite(each.times_longer):
        longer = f"needs about {each.times_longer:g} times longer to halve the prior"
    elif each.searched > 1:
        longer = f"needs more than {each.searched:g} times longer to halve the prior"
    else:
        longer = "needs a longer flight"
    which = "" if not each.undetermined else f"{each.undetermined} of {count} not determined, the rest "
    return f"{which}determined in principle only, {longer}"


def _direction(report: Report, name: Quantity, row: Float[np.ndarray, " d"]) -> str:
    """A vector in axes of a frame, and whether the body spins about it.

    The quantity's own axes, when these are those of a frame.
    """
    words = _vector(row)
    if name in (MOMENTS, EACH_MOMENT):
        return words
    told = ["frame i" if _axes(name) == CAMERA_AXES else "frame g"]
    if name in MOVING:
        told.append("at the last epoch")
    rate = as_floats(report.case.motion.rate)
    speed = float(np.linalg.norm(rate))
    if _axes(name) == PRINCIPAL_AXES and speed and np.linalg.norm(np.cross(row, rate)) < ALONG_SPIN * speed:
        told.append("the spin axis")
    return f"{words} ({', '.join(told)})"


def _vector(values: Float[np.ndarray, " d"]) -> str:
    return "(" + ", ".join(f"{value + 0.0:.2g}" for value in np.round(values, 3)) + ")"


def _axes(name: Quantity) -> str:
    if name == MOMENTS:
        return "(J_min/J_max, J_mid/J_max)"
    if name == EACH_MOMENT:
        return "(J_xx, J_yy, J_zz)"
    return CAMERA_AXES if name in (PLACE, BLOCK_NAMES["v"]) else PRINCIPAL_AXES


def _key(name: Quantity) -> str:
    return f"{name[0]} [{name[1]}]"


def _summary_of(verdicts: dict[Quantity, QuantityBound]) -> list[str]:
    """Sentences where the bound does not bear out the rank."""
    weak = [name for (name, _), each in verdicts.items() if each.in_principle_only]
    if not weak:
        return []
    return [f"Determined in principle only, the bound being no better than the prior: {', '.join(weak)}."]


def _gauge_sentences(certificate: Certificate) -> list[str]:
    if any(each.symmetry.group.startswith("gauge") for each in certificate.explanations):
        return ["The gauge is where frame g lies in the body: a definition, and no lack of the sensors."]
    return []


def singularity_sentences(case: Case) -> list[str]:
    """Moments that are equal or nearly so, which leave principal axes no or hardly any meaning."""
    pairs = close_moments(case.motion)
    equal = [axes for axes, gap in pairs if not gap]
    close = [f"{axes} by {100 * gap:.2g} %" for axes, gap in pairs if gap]
    lines = []
    if equal:
        which = (
            "All three moments are equal" if len(equal) == 3 else f"The moments about {equal[0]} are equal"
        )
        lines.append(
            f"{which}: {'every axis' if len(equal) == 3 else 'every axis between these'} is principal."
        )
        if case.chart == "principal":
            lines.append(_regular_chart(case) if case.has_attitude else AXES_GIVEN)
    if close:
        lines.append(
            f"Nearly singular: moments differ little ({', '.join(close)}). Ratios and principal axes are then told apart slowly; "
            "the rank does not show that, the bound does."
        )
    return lines


def _spin_axis_sentences(case: Case, certificate: Certificate) -> list[str]:
    """The direction that the names of null directions mean by the spin axis."""
    if not any("the spin axis" in each.symmetry.name for each in certificate.explanations):
        return []
    rate = as_floats(case.motion.rate)
    return [f"The spin axis is {_vector(rate / np.linalg.norm(rate))} in {PRINCIPAL_AXES}."]


def _regular_chart(case: Case) -> str:
    """The verdict of the chart that equal moments leave regular."""
    tensor = replace(case, chart="tensor", unknowns="ratios").certificate()
    return (
        "This chart is singular there: what it says of the ratios holds for these axes and no others. In the inertia tensor, "
        f"which stays regular, {tensor.rank} of {tensor.dimension} unknowns are determined. {null_space_sentence(tensor)}"
    )
