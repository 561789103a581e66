"""Figures 6-33 to 6-43: how the smoother's estimates settle, and what a solve costs (sections 6.7 and 6.8).

The images are lost. The thesis' body, motion, rig and noise are simulated with as many epochs, landmarks and observations
(`Scenario`), and the smoother takes in epoch after epoch as in section 6.7: every solve estimates all epochs so far again.
"""

from functools import cache
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.plots.settling import (
    SettlingConstant,
    SettlingQuantity,
    constants_figure,
    costs_figure,
    course_figure,
    surfaces_figure,
)
from spinfilters.reproduction.item import ComparedNumber, Item, ItemResult, tweddle_item
from spinfilters.run.preparation import prepare
from spinfilters.run.smoother_convergence import Settling, recorded_convergence, settling_of
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate, without_map

SETTLED: Final = 3.0
"""Deviations of the last solve within which an estimate stays once it has settled."""
SOLVES: Final = (8, 16, 30, 50, 80, 115)
"""Panels of Figures 6-40 and 6-41."""
SIMULATED: Final = "The images are lost: body, motion, rig, noise and numbers of the thesis are simulated."
BY_EYE: Final = (
    "printed numbers are read off surfaces; here a quantity has settled at the first solve from which its rms distance from the "
    "last solve stays below three final deviations"
)


@cache
def recorded() -> tuple[Settling, Float[np.ndarray, " f"], int | None]:
    """What every solve said, times of the epochs, and the solve that closed the first loop."""
    settings = Settings(estimators=("smoother",))
    setup = prepare(without_map(simulate(Scenario())), settings)
    found = recorded_convergence(setup, settings)
    settling = settling_of(found, setup.process.layout, setup.dataset.truth)
    return settling, found.time, found.closure


def make_surfaces(name: str, printed: tuple[float, float, float]) -> ItemResult:
    """Surfaces of a quantity of the motion, and the solve at which each axis has settled.

    Parameters
    ----------
    name : str
        Of the quantity.
    printed : tuple of float
        Iterations by axis after which section 6.7 sees it converged.
    """
    settling, time, closure = recorded()
    quantity = settling.quantities[name]
    rows = [
        _settled_row(f"{quantity.label} {axis}", _settling_solve(quantity, k), number)
        for k, (axis, number) in enumerate(zip(quantity.names, printed, strict=True))
    ]
    last = quantity.std[-1]
    table = [
        {
            "time": float(t),
            **{f"std_{axis}": float(std) for axis, std in zip(quantity.names, row, strict=True)},
        }
        for t, row in zip(time, last, strict=True)
    ]
    surface = surfaces_figure(time, quantity, closure)
    return ItemResult(rows, {"surfaces": surface}, {"last_deviations": table}, _closed(closure))


def make_constant(number: int, printed: float) -> ItemResult:
    """Values and deviations of constants of the body over the solves.

    Parameters
    ----------
    number : int
        Among those of `Settling`.
    printed : float
        Iterations after which section 6.7 sees them converged.
    """
    settling, _, closure = recorded()
    constant = settling.constants[number]
    rows = [
        _settled_row(f"{constant.label.split(',')[0]}: {name}", _constant_settled(constant, k), printed)
        for k, name in enumerate(constant.names)
    ]
    if constant.truth is not None:
        off = np.abs(constant.values[-1] - constant.truth) / constant.std[-1]
        rows.append(
            ComparedNumber(
                "largest error of the last solve, in its stated deviations",
                float(off.max()),
                expected=(0.0, 4.0),
                why="more than four deviations from the truth: the stated deviations are too small",
            )
        )
    return ItemResult(rows, {"constants": constants_figure([constant], closure)}, note=_closed(closure))


def make_course(name: str) -> ItemResult:
    """Course along or about y as chosen solves saw it: panels of the thesis' animation.

    Parameters
    ----------
    name : str
        Of the quantity.
    """
    settling, time, _ = recorded()
    quantity = settling.quantities[name]
    assert quantity.truth is not None
    error = np.abs(quantity.values[..., 1] - quantity.truth[:, 1])
    last, stated = error[-1], quantity.std[-1, :, 1]
    begin = int(np.searchsorted(time, 10.0))
    early = [float(np.nanmax(error[k, : k + 1])) for k in range(begin, len(time))]
    span = float(np.ptp(quantity.truth[:, 1]))
    rows = [
        ComparedNumber(
            f"largest error of any solve from 10 s on, share of the {quantity.label}'s range",
            max(early) / span,
            expected=(0.0, 0.2),
            why="the print sees the course follow the metrology closely behind 5 to 10 s",
        ),
        ComparedNumber(
            "root mean square error of the last solve, in stated deviations",
            float(np.sqrt(np.mean(np.square(last / stated)))),
            expected=(0.3, 1.7),
            why="errors of one recording are alike along time: one draw of few numbers",
        ),
    ]
    note = f"{SIMULATED} `spinfilters compare --convergence` writes the animation itself."
    return ItemResult(rows, {"course": course_figure(time, quantity, 1, SOLVES)}, note=note)


def make_costs() -> ItemResult:
    """Figure 6-42: time, landmarks and factors."""
    settling, _, _ = recorded()
    costs = settling.costs
    total, to_80 = float(costs.seconds.sum()), float(costs.seconds[:80].sum())
    rows = [
        ComparedNumber(
            "all solves of 115 stereo pairs", total, printed=35 * 60.0, unit="s", smaller_is_better=True
        ),
        ComparedNumber("the first 80 of them", to_80, printed=15 * 60.0, unit="s", smaller_is_better=True),
        ComparedNumber(
            "landmarks",
            float(costs.landmarks[-1]),
            printed=2447,
            tolerance=25,
            why="landmarks are drawn; the scenario has the thesis' number on average",
        ),
        ComparedNumber(
            "factors",
            float(costs.factors[-1]),
            printed=24723,
            tolerance=400,
            why="observations are drawn; those of the motion and the prior are counted here too",
        ),
        ComparedNumber(
            "shortest time of a solve", 1e3 * float(costs.seconds.min()), expected=(1e-3, np.inf), unit="ms"
        ),
    ]
    table = [
        {"epoch": k + 1, "seconds": float(s), "landmarks": int(n), "factors": int(f)}
        for k, (s, n, f) in enumerate(zip(costs.seconds, costs.landmarks, costs.factors, strict=True))
    ]
    note = f"{SIMULATED} Every solve is linearised again and gives the covariances of all its epochs, as in section 6.8."
    return ItemResult(rows, {"costs": costs_figure(costs)}, {"costs": table}, note)


def make_costs_by_factors() -> ItemResult:
    """Figure 6-43: the time of a solve is linear in its factors."""
    settling, _, _ = recorded()
    costs = settling.costs
    count = np.arange(len(costs.seconds)) + 1.0
    rows = [
        ComparedNumber(
            f"correlation of the time of a solve with its {word}",
            float(np.corrcoef(numbers, costs.seconds)[0, 1]),
            expected=(0.9, 1.0),
            why="solves that iterate more often than others, and the other users of the machine, scatter the times",
        )
        for word, numbers in (("factors", costs.factors), ("poses", count))
    ]
    return ItemResult(rows, {"costs": costs_figure(costs)}, note=SIMULATED)


def make_iterations() -> ItemResult:
    """Text of section 6.7: after how many epochs everything has settled, and when the first loop closes."""
    settling, _, closure = recorded()
    rows = [
        ComparedNumber(
            "first loop closes at epoch; a revolution at 10 rpm takes 12 epochs of 0.5 s",
            float("nan") if closure is None else float(closure),
            printed=12.0,
            tolerance=2.0,
            why="a landmark returns after most of a revolution, and the smoother waits until enough of them did",
        )
    ]
    for name, printed in (("position", 30.0), ("velocity", 30.0), ("attitude", 100.0), ("body_rate", 100.0)):
        quantity = settling.quantities[name]
        slowest = max(_settling_solve(quantity, k) for k in range(len(quantity.names)))
        rows.append(_settled_row(f"{quantity.label}, slowest axis", slowest, printed))
    for constant, printed in zip(settling.constants, (50.0, 40.0, 100.0), strict=True):
        slowest = max(_constant_settled(constant, k) for k in range(len(constant.names)))
        rows.append(_settled_row(f"{constant.label.split(',')[0]}, slowest", slowest, printed))
    return ItemResult(rows, note=_closed(closure))


def _settling_solve(quantity: SettlingQuantity, axis: int) -> float:
    """Number of the solve from which on the rms distance from the last solve stays small."""
    distance = quantity.values[..., axis] - quantity.values[-1, :, axis]
    with np.errstate(invalid="ignore"):
        rms = np.sqrt(np.nanmean(np.square(distance), axis=1))
    # values of an attitude are parts of a quaternion: half the angle
    scale = 1.0 if quantity.unit == quantity.std_unit else float(np.deg2rad(0.5))
    final = scale * float(np.sqrt(np.nanmean(np.square(quantity.std[-1, :, axis]))))
    return _first_for_good(rms <= SETTLED * final)


def _constant_settled(constant: SettlingConstant, axis: int) -> float:
    distance = np.abs(constant.values[:, axis] - constant.values[-1, axis])
    return _first_for_good(distance <= SETTLED * constant.std[-1, axis])


def _first_for_good(good: np.ndarray) -> float:
    """Number, from 1, of the solve from which on all are good."""
    bad = np.flatnonzero(~good)
    return float(bad[-1] + 2 if len(bad) else 1)


def _settled_row(what: str, ours: float, printed: float) -> ComparedNumber:
    return ComparedNumber(
        f"{what}: settled after epoch",
        ours,
        printed=printed,
        tolerance=10.0,
        smaller_is_better=True,
        why=BY_EYE,
    )


def _closed(closure: int | None) -> str:
    loop = "" if closure is None else f" The first loop closes at epoch {closure} (dotted line)."
    return f"{SIMULATED}{loop} {BY_EYE[0].upper()}{BY_EYE[1:]}."


CONVERGENCE: Final[tuple[Item, ...]] = (
    *(
        tweddle_item(
            number,
            "section 6.7",
            f"How the {what} settles: surfaces by axis",
            lambda name=name, printed=printed: make_surfaces(name, printed),
            seconds,
        )
        for number, what, name, printed, seconds in (
            ("Figure 6-33", "position", "position", (30.0, 30.0, 30.0), 10.0),
            ("Figure 6-34", "velocity", "velocity", (30.0, 30.0, 30.0), 3.0),
            ("Figure 6-35", "attitude", "attitude", (100.0, 40.0, 40.0), 3.0),
            ("Figure 6-36", "angular velocity", "body_rate", (100.0, 40.0, 40.0), 3.0),
        )
    ),
    *(
        tweddle_item(
            number,
            "section 6.7",
            f"How the {what}",
            lambda at=at, printed=printed: make_constant(at, printed),
            3.0,
        )
        for number, what, at, printed in (
            ("Figure 6-37", "centre of mass settles", 0, 50.0),
            ("Figure 6-38", "principal axes settle", 1, 40.0),
            ("Figure 6-39", "ratios of the moments settle", 2, 100.0),
        )
    ),
    *(
        tweddle_item(
            number,
            "section 6.7",
            f"{what} as epochs come, panels of the animation",
            lambda name=name: make_course(name),
            3.0,
        )
        for number, what, name in (
            ("Figure 6-40", "Velocity along y", "velocity"),
            ("Figure 6-41", "Rate about y", "body_rate"),
        )
    ),
    tweddle_item("Section 6.7", "text", "After how many epochs estimates settle", make_iterations, 3.0),
    tweddle_item("Figure 6-42", "section 6.8", "Run time, landmarks and factors by epoch", make_costs, 3.0),
    tweddle_item("Figure 6-43", "section 6.8", "Run time over factors and poses", make_costs_by_factors, 3.0),
)
