"""Table 1.1 and Figures 2-6 to 2-10: tumbling and spinning targets of two missions, polhodes, space and body cones.

The rates of the table come from Eqs 1.1 to 1.12; polhodes about the three axes are of section 2.5.1.
"""

import math
from functools import partial
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from spinfilters.core.conventions import RPM
from spinfilters.core.polhode import PolhodeKind, polhode_of_moments
from spinfilters.core.rolling_motion import RollingMotion, axis_stability, cones, rolling_motion
from spinfilters.core.spin_threshold import ORBITAL_EXPRESS, SPHERES, spin_threshold
from spinfilters.plots.free_rotation import cones_figure, polhode_figure, spin_threshold_figure
from spinfilters.reproduction.item import ComparedNumber, ItemResult, tweddle_item

PRINTED: Final = {
    "SPHERES": (SPHERES, (2.20, 2.17, 2.17), 0.005),
    "Orbital Express": (ORBITAL_EXPRESS, (0.3020, 0.1164, 0.1164), 0.00005),
}
"""By mission: rates by thrust, by propellant and of both, rpm, and half a unit of the last digit."""


def make_thresholds() -> ItemResult:
    """The table, and its rates over the distance of station keeping."""
    rows = []
    for name, (mission, printed, tolerance) in PRINTED.items():
        found = spin_threshold(mission)
        limits = {"thrust": found.force, "propellant": found.mass_fraction, "both": found.overall}
        rows += [
            ComparedNumber(
                f"{name}, limit by {limit}", value / RPM, printed=table, unit="rpm", tolerance=tolerance
            )
            for (limit, value), table in zip(limits.items(), printed, strict=True)
        ]
    missions = {name: mission for name, (mission, _, _) in PRINTED.items()}
    return ItemResult(
        rows,
        figures={"thresholds": spin_threshold_figure(missions)},
        note="The printed mass fraction 0.0056 of Orbital Express is rounded and would give 0.1169 rpm; the printed 0.1164 rpm "
        "belongs to 5 kg of 900 kg.",
    )


SPIN_THRESHOLDS: Final = tweddle_item(
    "Table 1.1",
    "section 1.2",
    "Rates between tumbling and spinning targets",
    make_thresholds,
)


PRINTED_MOMENTS: Final = np.array([3.0, 1.0, 1.0 / 3.0])
POSSIBLE_MOMENTS: Final = np.array([1.3, 1.0, 1.0 / 3.0])
"""The printed ones with the first lowered until a rigid body can have them."""
IMPOSSIBLE: Final[str] = (
    "The printed moments (3, 1, 1/3) are those of no rigid body: 3 exceeds 1 + 1/3. They are drawn as numbers, and beside "
    "them a body that can exist, (1.3, 1, 1/3), at the same rate."
)
DISTURBED: Final = np.array([0.0, 2.0, 2e-3])
"""The printed rate (0, 2, 0), which stays as it is, with a thousandth about z."""


def make_intermediate_axis() -> ItemResult:
    """Figure 2-6: the rate turns over, again and again."""
    printed, possible = (
        rolling_motion(moments, DISTURBED) for moments in (PRINTED_MOMENTS, POSSIBLE_MOMENTS)
    )
    growth = axis_stability(POSSIBLE_MOMENTS, 2.0)[1].growth_rate
    disturbed = np.abs(possible.body_rate[:, 2])
    small = (possible.time < 0.25 * possible.period) & (disturbed > 0.01) & (disturbed < 0.1)
    slope = np.polyfit(possible.time[small], np.log(disturbed[small]), 1)[0]
    rows = [
        ComparedNumber(
            "turns over in one period, printed moments",
            _turns_over(printed.body_rate[:, 1]),
            expected=(2.0, 2.0),
        ),
        ComparedNumber(
            "turns over in one period, a possible body",
            _turns_over(possible.body_rate[:, 1]),
            expected=(2.0, 2.0),
        ),
        ComparedNumber(
            "growth of a disturbance over that of Eq. 2.77", float(slope) / growth, expected=(0.95, 1.05)
        ),
    ]
    return ItemResult(rows, _both_figures(DISTURBED), note=IMPOSSIBLE)


def make_stable_axis(rate: tuple[float, float, float], kind: PolhodeKind, axis: int) -> ItemResult:
    """Figures 2-7 and 2-9: the polhode is closed about the axis of largest or smallest inertia."""
    w = np.array(rate)
    rows = []
    for name, moments in (("printed moments", PRINTED_MOMENTS), ("a possible body", POSSIBLE_MOMENTS)):
        found, motion = polhode_of_moments(moments, w), rolling_motion(moments, w)
        one = motion.time <= motion.period
        winding = np.unwrap(np.arctan2(*np.delete(motion.body_rate[one], axis, axis=1).T))
        rows += [
            ComparedNumber(f"goes {kind.value}, {name}", float(found.kind is kind), expected=(1.0, 1.0)),
            ComparedNumber(
                f"turns about that axis in one period, {name}",
                float(abs(winding[-1] - winding[0])) / (2 * math.pi),
                expected=(0.98, 1.0),
            ),
        ]
    return ItemResult(rows, _both_figures(w), note=IMPOSSIBLE)


def make_cones(moments: tuple[float, float, float], sense: str) -> ItemResult:
    """Figures 2-8 and 2-10: the body cone rolls on the space cone."""
    J, w = np.array(moments), np.array([0.5, 0.0, 1.0])
    found, motion = cones(J, w), rolling_motion(J, w)
    assert found is not None
    low, high = motion.herpolhode_radii
    inside = sense == "retrograde"
    nutation = float(np.arccos(motion.axes[:, 2, 2]).mean())
    together = found.body_half_angle + (-1.0 if inside else 1.0) * found.space_half_angle
    rows = [
        ComparedNumber(f"nutation is {sense}", float(found.sense == sense), expected=(1.0, 1.0)),
        ComparedNumber(
            "herpolhode: largest over least distance from the momentum",
            high / low,
            expected=(1.0, 1.0 + 1e-9),
        ),
        ComparedNumber(
            f"half angle of the body cone {'less' if inside else 'and'} that of the space cone, over the nutation angle",
            together / nutation,
            expected=(1.0 - 1e-9, 1.0 + 1e-9),
        ),
        ComparedNumber(
            "rolls without slip: path of the rate on body over that in space",
            _rolled_share(motion),
            expected=(1 - 1e-5, 1 + 1e-5),
        ),
    ]
    return ItemResult(
        rows,
        {"cones": cones_figure(J, w)},
        note=f"The thesis prints no numbers for this drawing; here J = {moments}, rate (0.5, 0, 1) rad/s.",
    )


def _rolled_share(motion: RollingMotion) -> float:
    """Length of the polhode over that of the herpolhode."""
    body, space = (
        np.linalg.norm(np.diff(path, axis=0), axis=1).sum() for path in (motion.body_rate, motion.space_rate)
    )
    return float(body / space)


def _turns_over(course: np.ndarray) -> float:
    """Changes of sign over the four periods of a course, for each period; what lies near zero has none."""
    clear = course[np.abs(course) > 0.1 * np.abs(course).max()]
    return float(np.count_nonzero(np.diff(np.sign(clear))) / 4.0)


def _both_figures(rate: np.ndarray) -> dict[str, Figure]:
    return {
        "printed": polhode_figure(PRINTED_MOMENTS, rate),
        "possible": polhode_figure(POSSIBLE_MOMENTS, rate),
    }


POLHODES: Final = (
    tweddle_item(
        "Figure 2-6",
        "section 2.5.1",
        "Polhode of a spin about the intermediate axis",
        make_intermediate_axis,
    ),
    tweddle_item(
        "Figure 2-7",
        "section 2.5.1",
        "Polhode about the axis of largest inertia",
        partial(make_stable_axis, (2.0, 1.0, 1.0), PolhodeKind.ABOUT_MAJOR, 0),
    ),
    tweddle_item(
        "Figure 2-8",
        "section 2.5.1",
        "Space and body cone, retrograde",
        partial(make_cones, (1.0, 1.0, 1.8), "retrograde"),
    ),
    tweddle_item(
        "Figure 2-9",
        "section 2.5.1",
        "Polhode about the axis of smallest inertia",
        partial(make_stable_axis, (0.0, 0.5, 2.0), PolhodeKind.ABOUT_MINOR, 2),
    ),
    tweddle_item(
        "Figure 2-10",
        "section 2.5.1",
        "Space and body cone, prograde",
        partial(make_cones, (1.0, 1.0, 0.4), "prograde"),
    ),
)
