"""Scope of an analysis in words: question, exclusions and assumptions."""

from dataclasses import dataclass
from itertools import combinations

from observability.bounds.cramer_rao import LANDMARK_STD, PRIOR_STD
from observability.canonical_motions import CanonicalMotion, equal_moments
from observability.cases import WIDE_POSE_STD, Case
from observability.sensors import analysed
from spinfilters.models.process import THESIS_NOISE

NEARLY_EQUAL = 0.01
"""Relative difference below which two moments are called nearly equal: their axes are then hardly told apart."""
INERTIA_WORDS = {
    ("principal", False): "the two ratios of the principal moments",
    ("principal", True): "the three principal moments, scale included",
    ("tensor", True): "the inertia tensor, scale included",
    ("filter", False): "the mass distribution (inertia up to its scale, and its axes)",
}
CAMERA_AXES = "the camera's axes at the first frame (x right, y down, z forward)"
PRINCIPAL_AXES = "the body's principal axes x, y, z"


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
    known |= {words: True for each in case.sensors if (words := analysed(each).assumption)}
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
    process = THESIS_NOISE
    lines = [
        f"noise: {'; '.join(analysed(each).noise for each in case.sensors)}",
        f"process noise: {process.torque_psd:g} (rad/s^2)^2/Hz"
        + (f", {process.force_psd:g} (m/s^2)^2/Hz" if case.has_place else ""),
        f"priors: {_priors(case)}",
    ]
    lines += [
        f"{each.axis.value}: {each.size:g} {'N m' if each.axis.is_torque else 'm/s^2'} cos(2 pi t / {each.period:.3g} s)"
        for each in case.acting
    ]
    return lines


def _priors(case: Case) -> str:
    prior = PRIOR_STD
    words = [f"mass distribution {prior['s']:g}", f"body rate {prior['w']:g} rad/s"]
    if case.has_torque:
        words.append(f"logarithm of the inertia's scale {prior['n']:g}")
    if case.has_place:
        words += [f"velocity {prior['v']:g} m/s", f"centre of mass {prior['c']:g} m"]
    if case.maps:
        words.append(f"landmarks {LANDMARK_STD:g} m")
    known, free = [], case.free_rotations
    if case.has_place and case.place_is_defined:
        known.append("first position of g")
    elif case.has_place:
        words.append(f"first position of g {WIDE_POSE_STD['t']:g} m")
    if len(free) == 3:
        known.append("first attitude of g")
    else:
        words.append(f"first attitude of g {WIDE_POSE_STD['a']:g} rad")
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
