"""Report of an analysis: question, exclusions and assumptions, rank, bounds, and the gain of known inputs."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from jaxtyping import Float

from observability.canonical_motions import CanonicalMotion, equal_moments
from observability.cases import WIDE_POSE_STD, Case
from observability.certificate import (
    Certificate,
    document,
    null_space_sentence,
    null_vector_sentences,
    sentences,
)
from observability.cramer_rao import (
    BLOCK_NAMES,
    EACH_MOMENT,
    MOMENTS,
    PLACE,
    Bound,
    Quantity,
    bounded_quantities,
    weak_direction_in_words,
)
from observability.exact_numbers import as_floats
from observability.prior_dependence import QuantityBound, quantity_bounds
from observability.reference_trajectory import ReferenceTrajectory
from observability.system import analysed, with_noise_options
from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.working_time import building
from spinfilters.io.sensor_format import noise_options

GAIN_WORTH_SAYING = 0.9
"""Part of a bound that inputs must bring it below, to be reported."""
PERCENT = round(100 * (1 - GAIN_WORTH_SAYING))


@dataclass(frozen=True)
class InputGain:
    """Each pair without and with the inputs.

    Attributes
    ----------
    rank, dimension : tuple[int, int]
        Of the certificates.
    falls : dict[Quantity, tuple[float, float]]
        Standard deviations after the last frame that fall by enough to be reported.
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
    certificate, final : Certificate and Mapping[Quantity, float]
        Of the case: what is proved, and the standard deviations after the last frame.
    """
    if not case.inputs:
        return None
    without = replace(case, inputs=(), recorded=())
    proved, reference = without.certificate(), without.reference(frames, interval)
    quantities = bounded_quantities(without.bound(reference), reference)
    pairs = {name: (float(values[-1]), final[name]) for name, values in quantities.items()}
    return InputGain(
        rank=(proved.rank, certificate.rank),
        dimension=(proved.dimension, certificate.dimension),
        falls={name: pair for name, pair in pairs.items() if pair[1] < GAIN_WORTH_SAYING * pair[0]},
    )


NEARLY_EQUAL = 0.01
"""Relative difference below which two moments are called nearly equal: their axes are then barely distinguished."""
INERTIA_WORDS = {
    ("principal", False): "the two ratios of the principal moments",
    ("principal", True): "the three principal moments, scale included",
    ("tensor", True): "the inertia tensor, scale included",
    ("filter", False): "the mass distribution (inertia up to its scale, and its axes)",
}
CAMERA_AXES = "the camera's axes at the first frame (x right, y down, z forward)"
PRINCIPAL_AXES = "the body's principal axes x, y, z"
ESTIMATE_I, ESTIMATE_G = "frame i of the estimate", "frame g of the estimate"
"""Frames of a bound about a recording."""


@dataclass(frozen=True)
class Scope:
    """Scope of one analysis in words."""

    asked: tuple[str, ...]
    not_asked: tuple[str, ...]
    taken_as_known: tuple[str, ...]


def scope(case: Case) -> Scope:
    """The scope of a case."""
    in_axes = case.chart == "principal"
    answers = {
        "position and velocity": case.has_place,
        "attitude": case.holds_attitude,
        "body rate": True,
        INERTIA_WORDS[case.chart, case.holds_scale]: True,
        "where the principal axes lie in the body": in_axes and case.has_attitude,
        "centre of mass": case.has_place,
        "the map of landmarks": case.maps,
        "the bias of the gyro": case.has_bias,
    }
    left_out = {
        "attitude": not case.holds_attitude,
        "position and velocity": not case.has_place,
        "centre of mass": not case.has_place,
        "overall scale of the inertia": not case.holds_scale,
        "a map of landmarks": not case.maps,
    }
    known = {
        "the gyro's axes are the principal axes (the bound below takes them as unknown)": in_axes
        and not case.has_attitude,
        "the map": case.known_map and case.sees_points,
    }
    told = [analysed(each) for each in case.sensors]
    known |= {each.assumption: True for each in told if each.assumption and not (each.bias and case.has_bias)}
    return Scope(
        *[tuple(words for words, holds in each.items() if holds) for each in (answers, left_out, known)]
    )


def scope_sentences(case: Case) -> list[str]:
    """Sentences on what was asked and what was not."""
    found = scope(case)
    lines = [f"Asked: {'; '.join(found.asked)}.", f"Not asked: {'; '.join(found.not_asked)}."]
    if not found.not_asked:
        lines.pop()
    if found.taken_as_known:
        lines.append(f"Taken as known: {'; '.join(found.taken_as_known)}.")
    return lines


def axes_in_words(case: Case) -> str:
    """The frames that options and results are in."""
    words = [f"rates and moments about {PRINCIPAL_AXES}, in the order of --moments; frame g along these axes"]
    if case.has_place:
        words.append(f"frame i along {CAMERA_AXES}")
    if case.has_torque:
        words.append("torques about these axes as well, fixed in the body and known in frame g")
    if not all(each.is_torque for each in case.inputs):
        words.append("manoeuvres along the axes of frame i")
    return "; ".join(words)


def assumptions(case: Case) -> list[str]:
    """Noise, priors and inputs that the bound is computed with."""
    process = case.levels.process
    lines = [
        f"noise: {'; '.join(_noise(case, each) for each in case.sensors)}",
        f"process noise: {process.torque_psd:g} (rad/s^2)^2/Hz"
        + (f", {process.force_psd:g} (m/s^2)^2/Hz" if case.has_place else ""),
        f"priors: {_priors(case)}",
    ]
    return [*lines, *[f"{each.axis.value}: {each.words}" for each in case.acting]]


def _noise(case: Case, sensor: str) -> str:
    """A sensor with its standard deviations and their units."""
    told, options = analysed(sensor), noise_options()
    parameters = with_noise_options(told, case.levels.noise)
    levels = {option: parameters[places[0]] for option, places in told.noise.items()}
    words = [
        f"{std:g}"
        if options[option].allowed.unit == "1"
        else f"{std:g} {options[option].allowed.unit or 'of the rate'}"
        for option, std in levels.items()
        if std
    ]
    return f"{sensor} {', '.join(words)}"


def _priors(case: Case) -> str:
    prior = case.prior_std
    words = [f"mass distribution {prior['s']:g}", f"body rate {prior['w']:g} rad/s"]
    if case.has_torque:
        words.append(f"logarithm of the inertia's scale {prior['n']:g}")
    if case.has_place:
        words += [f"velocity {prior['v']:g} m/s", f"centre of mass {prior['c']:g} m"]
    if case.maps:
        words.append(f"landmarks {case.levels.landmark_std:g} m")
    if case.has_bias:
        words.append(f"bias of the gyro {prior['b']:g} rad/s")
    known, free = [], case.free_rotations
    if case.has_place and case.place_is_defined:
        known.append("first position of g")
    elif case.has_place:
        words.append(f"first position of g {prior['t']:g} m")
    if len(free) == 3:
        known.append("first attitude of g")
    else:
        wide = {**WIDE_POSE_STD, **case.levels.prior_std}["a"]
        words.append(f"first attitude of g {wide:g} rad")
        known += [f"first rotation of g about {'xyz'[axis]}" for axis in free]
    return ", ".join(words) + (f"; by definition: {', '.join(known)}" if known else "")


def close_moments(motion: CanonicalMotion) -> list[tuple[str, float]]:
    """Pairs of axes of nearly equal moments ("x and y"), and their relative difference."""
    found = []
    for a, b in combinations(range(3), 2):
        gap = abs(motion.moments[a] - motion.moments[b]) / max(motion.moments[a], motion.moments[b])
        if gap < NEARLY_EQUAL:
            found.append((f"{'xyz'[a]} and {'xyz'[b]}", 0.0 if equal_moments(motion, a, b) else float(gap)))
    return found


def title(case: Case) -> str:
    """Title of the case in one line."""
    words = [_sensor_in_words(case, each) for each in case.sensors]
    acting = f", known {' and '.join(case.inputs)}" if case.inputs else ""
    moments = " ".join(f"{float(moment):g}" for moment in case.motion.moments)
    return f"{' with '.join(words)}, {case.motion.name}, moments {moments}{acting}, chart: {case.system.chart.name}"


def _sensor_in_words(case: Case, sensor: str) -> str:
    told = analysed(sensor)
    if not told.sees_points:
        return f"the sensor {sensor}"
    known = "known" if case.known_map else "unknown"
    return f"{told.words} and {case.landmarks} {known} landmark{'s' if case.landmarks > 1 else ''}"


WORTH_SAYING = 0.05
"""Share of the information that is the priors' from which it is reported with a result."""
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
    quantities : dict[Quantity, ndarray of shape (frames,)]
        Standard deviations over time.
    verdicts : dict[Quantity, QuantityBound]
        Of every quantity after the last frame.
    gain : InputGain or None
        Of the known inputs, None without any.
    recording : str
        What was recorded, in words, of a bound at the estimate of a recording; "" of one at a motion that is asked for.
    """

    case: Case
    certificate: Certificate
    reference: ReferenceTrajectory
    bound: Bound
    quantities: dict[Quantity, Float[np.ndarray, " frames"]]
    verdicts: dict[Quantity, QuantityBound]
    gain: InputGain | None = None
    recording: str = ""

    @property
    def last_rate(self) -> Float[np.ndarray, "3"]:
        """Body rate at the last epoch, rad/s, axes g."""
        return self.reference.states[-1][self.reference.process.layout.mean_slice("w")]

    @property
    def title(self) -> str:
        """The recording, where there is one, and the case."""
        return f"{self.recording}; {title(self.case)}" if self.recording else title(self.case)

    @property
    def axes(self) -> str:
        """The frames that options and results are in."""
        if self.recording:
            return f"moments and rates of the title about principal axes; other results in {ESTIMATE_I} and {ESTIMATE_G}"
        return axes_in_words(self.case)

    @cached_property
    def rank_sentences(self) -> list[str]:
        """Sentences on the rank, the unknowns and the proof."""
        lines = [*sentences(self.certificate), *null_vector_sentences(self.certificate)]
        lines += [*_gauge_sentences(self.certificate), *_spin_axis_sentences(self.case, self.certificate)]
        return [*lines, *singularity_sentences(self.case)]

    @cached_property
    def sentences(self) -> list[str]:
        """The whole text."""
        frames = len(self.reference.time)
        interval = float(self.reference.time[-1] - self.reference.time[0]) / max(1, frames - 1)
        when = f"{frames} frame{'s' if frames > 1 else ''}" + (f" at {interval:g} s" if frames > 1 else "")
        lines = [self.title, *self.rank_sentences, *scope_sentences(self.case)]
        lines.append(f"Axes: {self.axes}.")
        lines += _summary_of(self.verdicts)
        lines.append(f"Cramer-Rao bound after {when}, standard deviation of each component:")
        lines += [f"  {name:<28} {verdict_in_words(self, (name, unit))}" for name, unit in self.verdicts]
        lines.append(
            f"Least known: {weak_direction_in_words(self.bound, ESTIMATE_G if self.recording else '')}."
        )
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
            "case": self.title,
            **document(self.certificate),
            "text": self.rank_sentences,
            "asked": list(asked.asked),
            "not_asked": list(asked.not_asked),
            "taken_as_known": list(asked.taken_as_known),
            "axes": self.axes,
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
            "axes_of_directions": _axes(self, name),
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
    """Verdict on one quantity: what the data determine, what the prior does, and why."""
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
    frame = f" of {_axes(report, name)}" if name in (MOMENTS, EACH_MOMENT) else ""
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
    axes = _axes(report, name)
    told = ["frame i" if axes in (CAMERA_AXES, ESTIMATE_I) else "frame g"]
    if name in MOVING:
        told.append("at the last epoch")
    rate = report.last_rate if report.recording else as_floats(report.case.motion.rate)
    speed = float(np.linalg.norm(rate))
    if (
        axes in (PRINCIPAL_AXES, ESTIMATE_G)
        and speed
        and np.linalg.norm(np.cross(row, rate)) < ALONG_SPIN * speed
    ):
        told.append("the spin axis")
    if name == ATTITUDE:
        told += _axis_of_i(report, row)
    return f"{words} ({', '.join(told)})"


def _axis_of_i(report: Report, row: Float[np.ndarray, "3"]) -> list[str]:
    """The axis of frame i that a direction of g is at the last epoch, as the names of null directions call it; none or one."""
    attitude = report.reference.states[-1][report.reference.process.layout.mean_slice("a")]
    along = np.abs(matrix_from_quaternion(attitude) @ row)
    axis = int(along.argmax())
    return [f"{'xyz'[axis]} of frame i"] if np.delete(along, axis).max() < ALONG_SPIN else []


def _vector(values: Float[np.ndarray, " d"]) -> str:
    return "(" + ", ".join(f"{value + 0.0:.2g}" for value in np.round(values, 3)) + ")"


def _axes(report: Report, name: Quantity) -> str:
    if name == MOMENTS:
        return "(J_min/J_max, J_mid/J_max)"
    if name == EACH_MOMENT:
        return "(J_xx, J_yy, J_zz)"
    in_i = name in (PLACE, BLOCK_NAMES["v"])
    if report.recording:
        return ESTIMATE_I if in_i else ESTIMATE_G
    return CAMERA_AXES if in_i else PRINCIPAL_AXES


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
            f"Nearly singular: moments differ little ({', '.join(close)}). Ratios and principal axes are then distinguished "
            "slowly; the rank does not show that, the bound does."
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
        "This chart is singular there: its result for the ratios holds only for these axes. In the inertia tensor, "
        f"which stays regular, {tensor.rank} of {tensor.dimension} unknowns are determined. {null_space_sentence(tensor)}"
    )
