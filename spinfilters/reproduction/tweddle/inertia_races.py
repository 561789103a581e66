"""Figures 6-23 to 6-26: two inertias propagated from a state of the metrology, and compared with it (section 6.5.2).

The recordings are lost. A body of Eslinger's inertia is simulated: over 80 s it is the target of Figures 6-3 to 6-7, which loses
energy; over 12 s it spins fast without torques. Its metrology has the errors of section 6.2 and gives the first state.
"""

import math
from functools import cache, partial
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from spinfilters.core.attitude_conversions import inverse, multiply, quaternion_from_matrix, rotate
from spinfilters.core.conventions import RPM
from spinfilters.core.torque_free import torque_free_motion
from spinfilters.evaluation.prediction_errors import NamedInertia, PropagatedInertia, propagate_inertias
from spinfilters.plots.reference_figures import inertia_race_figure
from spinfilters.plots.style import BLACK, BLUE, RED, legend_below, tidy
from spinfilters.reproduction.item import ComparedNumber, Item, ItemResult, tweddle_item
from spinfilters.reproduction.tweddle.metrology_comparison import STEP
from spinfilters.reproduction.tweddle.metrology_courses import LOSS, SPUN, Metrology, measured_motion, target
from spinfilters.reproduction.tweddle.reference_inertia import (
    ESLINGER,
    RATE,
    estimated_inertia,
    principal_axes,
)

LONG, SHORT_RACE = 80.0, 12.0
"""Durations, s."""
RATES_RPM: Final = (10.0, 15.0, 20.0, 25.0, 30.0)
"""Of the fast spin, which is not printed."""
PRINTED_APART: Final = (16.0, 6.0)
"""By how much the errors of both differ in the fast spin, deg and deg/s."""
NOT_AN_ESTIMATE: Final = "no estimate: one state propagated"


@cache
def long_race() -> tuple[Float[np.ndarray, " n"], PropagatedInertia, list[PropagatedInertia]]:
    """Times since 75 s, the metrology, and the motions of both inertias from its row there."""
    return _race(target(SPUN + LONG), SPUN)


@cache
def fast_race(rate_rpm: float) -> tuple[Float[np.ndarray, " n"], PropagatedInertia, list[PropagatedInertia]]:
    """The same of a spin along the commanded direction without torques.

    Parameters
    ----------
    rate_rpm : float
        About y.
    """
    time = np.arange(0.0, SHORT_RACE + STEP / 2, STEP)
    moments, R = principal_axes(ESLINGER)
    q = quaternion_from_matrix(R)
    w = RATE * RPM * rate_rpm / RATE[1]
    motion = torque_free_motion(moments, R.T @ w, time, q)
    attitude = multiply(motion.attitude, np.tile(inverse(q), (len(time), 1)))
    rate = rotate(np.tile(q, (len(time), 1)), motion.rate)
    still = np.zeros((len(time), 3))
    return _race(measured_motion("target in a fast spin", time, attitude, still, rate, still, 63), 0.0)


def _race(
    motion: Metrology, begin: float
) -> tuple[Float[np.ndarray, " n"], PropagatedInertia, list[PropagatedInertia]]:
    measured = motion.measured
    assert measured.attitude is not None
    assert measured.rate is not None
    rows = measured.time > begin - STEP / 2
    time, attitude, rate = measured.time[rows], measured.attitude[rows], measured.rate[rows]
    inertias = []
    for name, J in (("Eslinger's inertia", ESLINGER), ("estimated inertia", estimated_inertia())):
        moments, R = principal_axes(J)
        inertias.append(NamedInertia(name, moments, R.T))
    found = propagate_inertias(inertias, attitude[0], rate[0], time - time[0])
    return time - time[0], PropagatedInertia("the metrology", attitude, rate), found


def make_long_race(with_rates: bool) -> ItemResult:
    """Figures 6-23 and 6-24: 80 s from 75 s on; the text says which of both is nearer to the metrology when.

    Parameters
    ----------
    with_rates : bool
        Whether the courses are drawn, as in the first figure, or only their errors.
    """
    time, measured, found = long_race()
    reference, estimated = (each.angle_from(measured.attitude) for each in found)
    apart = found[0].angle_from(found[1].attitude)
    early, late = time <= 50.0, time >= 40.0
    own = f"here the body has Eslinger's inertia and loses {100 * LOSS:g} % of its energy in 57.5 s; at the end its inertia is "
    own += f"{math.degrees(reference[-1]):.0f} deg off the metrology, the estimated one {math.degrees(estimated[-1]):.0f} deg"
    rows = [
        ComparedNumber(
            "both propagations apart over the larger of their errors, median: very close",
            float(np.median(apart / np.maximum(reference, estimated))),
            expected=(0.0, 1.0),
            bound=NOT_AN_ESTIMATE,
            why=own,
        ),
        ComparedNumber(
            "share of the first 50 s in which the reference inertia is nearer to the metrology",
            float(np.mean(reference[early] < estimated[early])),
            expected=(0.5, 1.0),
            bound=NOT_AN_ESTIMATE,
            why=own,
        ),
        ComparedNumber(
            "share of the last 40 s in which the estimated inertia is nearer to the metrology",
            float(np.mean(estimated[late] < reference[late])),
            expected=(0.5, 1.0),
            bound=NOT_AN_ESTIMATE,
            why=own,
        ),
    ]
    note = (
        "The metrology of the test is lost and is simulated with the errors of section 6.2. The figures print curves; the "
        "text says "
        "that both propagations are very close, and which is nearer to the metrology when."
    )
    return ItemResult(
        rows, _figures(time, measured, found, with_rates), {"errors": _table(time, measured, found)}, note
    )


def make_fast_race(with_rates: bool) -> ItemResult:
    """Figures 6-25 and 6-26: 12 s of a fast spin, whose rate is not printed.

    Parameters
    ----------
    with_rates : bool
        As for `make_long_race`.
    """
    races = {rate: fast_race(rate) for rate in RATES_RPM}
    apart = {
        rate: [
            math.degrees(float(np.max(each[1] - each[0])))
            for each in (
                [motion.angle_from(measured.attitude) for motion in found],
                [motion.rate_from(measured.rate) for motion in found],
            )
        ]
        for rate, (_, measured, found) in races.items()
    }
    nearest = min(RATES_RPM, key=lambda rate: abs(apart[rate][0] - PRINTED_APART[0]))
    listed = "; ".join(f"{a:.1f} deg and {w:.1f} deg/s at {rate:g} rpm" for rate, (a, w) in apart.items())
    lost = f"the rate of this test is not printed. Along the commanded direction both part by {listed}: no rate gives both numbers"
    time, measured, found = races[nearest]
    rows = [
        ComparedNumber(
            f"error of the estimated inertia less that of the reference, {what}, largest in 12 s at {nearest:g} rpm",
            ours,
            printed=printed,
            unit=unit,
            tolerance=0.5,
            bound=NOT_AN_ESTIMATE,
            why=lost,
        )
        for what, unit, ours, printed in zip(
            ("attitude", "rate"), ("deg", "deg/s"), apart[nearest], PRINTED_APART, strict=True
        )
    ]
    note = (
        "The metrology of the test is lost and is simulated with the errors of section 6.2. Shown is the rate whose attitudes part "
        "most nearly as printed."
    )
    return ItemResult(
        rows, _figures(time, measured, found, with_rates), {"errors": _table(time, measured, found)}, note
    )


def _figures(
    time: Float[np.ndarray, " n"],
    measured: PropagatedInertia,
    found: list[PropagatedInertia],
    with_rates: bool,
) -> dict[str, Figure]:
    if with_rates:
        return {"rates": inertia_race_figure(time, found, measured)}
    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for each, colour in zip(found, (RED, BLUE), strict=True):
        upper.plot(time, np.rad2deg(each.angle_from(measured.attitude)), color=colour, label=each.name)
        lower.plot(time, np.rad2deg(each.rate_from(measured.rate)), color=colour)
    upper.plot(
        time,
        np.rad2deg(found[0].angle_from(found[1].attitude)),
        color=BLACK,
        linestyle=":",
        label="both apart",
    )
    upper.set_ylabel("attitude [deg]")
    lower.set_ylabel("rate [deg/s]")
    lower.set_xlabel("time from the common state [s]")
    for axes in (upper, lower):
        axes.set_ylim(bottom=0.0)
        tidy(axes)
    figure.suptitle("two inertias from one state of the metrology: how far off it")
    legend_below(figure, upper.get_legend_handles_labels()[0])
    return {"errors": figure}


def _table(
    time: Float[np.ndarray, " n"], measured: PropagatedInertia, found: list[PropagatedInertia]
) -> list[dict[str, float]]:
    angles = [np.rad2deg(each.angle_from(measured.attitude)) for each in found]
    rates = [np.rad2deg(each.rate_from(measured.rate)) for each in found]
    return [
        {
            "time_s": float(time[k]),
            "reference_deg": float(angles[0][k]),
            "estimated_deg": float(angles[1][k]),
            "reference_deg_s": float(rates[0][k]),
            "estimated_deg_s": float(rates[1][k]),
        }
        for k in range(0, len(time), 5)
    ]


INERTIA_RACES: Final[tuple[Item, ...]] = tuple(
    tweddle_item(f"Figure {number}", "section 6.5.2", title, partial(make, with_rates))
    for number, title, make, with_rates in (
        ("6-23", "Two inertias and the metrology over 80 s", make_long_race, True),
        ("6-24", "Errors of two inertias over 80 s", make_long_race, False),
        ("6-25", "Two inertias and the metrology over 12 s", make_fast_race, True),
        ("6-26", "Errors of two inertias over 12 s", make_fast_race, False),
    )
)
