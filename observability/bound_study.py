"""Bound as a function of motion, duration, frame rate and number of landmarks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from observability.canonical_motions import CanonicalMotion, motion
from observability.cases import Case
from observability.cramer_rao import MOMENTS, Quantity, bounded_quantities
from observability.exact_numbers import as_floats
from spinfilters.core.conventions import RPM

DURATIONS: Final = (5.0, 10.0, 20.0, 40.0, 80.0)
INTERVALS: Final = (0.125, 0.25, 0.5, 1.0, 2.0)
COUNTS: Final = (1, 2, 4, 8, 16, 32)
ANGLES: Final = (0.0, 3.0, 10.0, 22.5, 45.0, 67.5, 80.0, 87.0, 90.0)
"""Of the rate, in degrees: from the axis of the least moment towards the others, and around it."""


@dataclass(frozen=True)
class Curve:
    """A bound against one choice.

    Attributes
    ----------
    label : str
        Of the choice with its unit.
    choices : ndarray of shape (k,)
    std : dict[Quantity, ndarray of shape (k,)]
        Of every quantity after the last frame, (k,).
    """

    label: str
    choices: Float[np.ndarray, " k"]
    std: dict[Quantity, Float[np.ndarray, " k"]]


@dataclass(frozen=True)
class BoundStudy:
    """Bounds of one case.

    Attributes
    ----------
    curves : tuple[Curve, ...]
        Against duration, interval and landmarks.
    tilts : ndarray of shape (k,)
        Angle of the rate from the minor axis, degrees.
    turns : ndarray of shape (l,)
        Angle of the rate from the intermediate (0) to the major axis (90), degrees.
    moments : ndarray of shape (k, l)
        Bound of the inertia ratios for each pair of these angles.
    """

    curves: tuple[Curve, ...]
    tilts: Float[np.ndarray, " k"]
    turns: Float[np.ndarray, " l"]
    moments: Float[np.ndarray, "k l"]

    def document(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "curves": [
                {
                    "against": c.label,
                    "choices": c.choices.tolist(),
                    "std": {f"{n} [{u}]": v.tolist() for (n, u), v in c.std.items()},
                }
                for c in self.curves
            ],
            "inertia_ratios_by_motion": {
                "tilt_from_minor_axis_deg": self.tilts.tolist(),
                "turn_from_intermediate_to_major_axis_deg": self.turns.tolist(),
                "std": self.moments.tolist(),
            },
        }


def study(case: Case, frames: int, interval: float, report: Callable[[int, int], None]) -> BoundStudy:
    """All bounds of a case over `frames` epochs, `interval` s apart; `report` gets the steps done and their total."""
    counts = COUNTS if case.sees_points else ()
    steps = _Steps(len(DURATIONS) + len(INTERVALS) + len(counts) + len(ANGLES) ** 2, report)
    duration = (frames - 1) * interval
    curves = [
        _curve(
            "duration [s]",
            DURATIONS,
            [steps.final(case, round(d / interval) + 1, interval) for d in DURATIONS],
        ),
        _curve(
            "seconds between frames",
            INTERVALS,
            [steps.final(case, round(duration / dt) + 1, dt) for dt in INTERVALS],
        ),
    ]
    if counts:
        found = [steps.final(replace(case, landmarks=count), frames, interval) for count in counts]
        curves.append(_curve("landmarks", counts, found))
    angles = np.array(ANGLES)
    directions = [
        [replace(case, motion=_tilted(case.motion, tilt, turn)) for turn in ANGLES] for tilt in ANGLES
    ]
    moments = [[steps.final(each, frames, interval)[MOMENTS] for each in row] for row in directions]
    return BoundStudy(tuple(curves), angles, angles, np.array(moments))


class _Steps:
    """Bounds one after the other, counted."""

    def __init__(self, total: int, report: Callable[[int, int], None]) -> None:
        self._done, self._total, self._report = 0, total, report

    def final(self, case: Case, frames: int, interval: float) -> dict[Quantity, float]:
        """Bound of every quantity after the last frame."""
        reference = case.reference(frames, interval)
        found = bounded_quantities(case.bound(reference), reference)
        self._done += 1
        self._report(self._done, self._total)
        return {name: float(values[-1]) for name, values in found.items()}


def _curve(label: str, choices: Sequence[float], found: list[dict[Quantity, float]]) -> Curve:
    std = {name: np.array([each[name] for each in found]) for name in found[0]}
    return Curve(label, np.array(choices, dtype=float), std)


def _tilted(given: CanonicalMotion, tilt: float, turn: float) -> CanonicalMotion:
    """The same body turning as fast, or slowly if it did not turn, about another axis."""
    speed = max(float(np.linalg.norm(as_floats(given.rate))), RPM)
    polar, around = np.deg2rad(tilt), np.deg2rad(turn)
    ascending = np.array([np.cos(polar), np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around)])
    rate = np.zeros(3)
    rate[np.argsort([float(moment) for moment in given.moments])] = np.round(speed * ascending, 9)
    return motion(f"{tilt:g} and {turn:g} degrees", rate.tolist(), given.moments)
