"""Figures 6-33 to 6-43: how the smoother's estimates settle, and what a solve costs (sections 6.7 and 6.8).

The images are lost. The thesis' body, motion, rig and noise are simulated with as many epochs, landmarks and observations
(`Scenario`), and the smoother takes in epoch after epoch as in section 6.7: every solve estimates all epochs so far again.
"""

from collections.abc import Sequence
from functools import cache, partial
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from spinfilters.evaluation.estimated_motion import estimated_rates
from spinfilters.plots.settling import (
    SettlingConstant,
    SettlingQuantity,
    constants_figure,
    costs_by_epoch_figure,
    costs_by_size_figure,
    course_figure,
    surfaces_figure,
)
from spinfilters.plots.style import BLUE, ORANGE, tidy
from spinfilters.reproduction.item import ComparedNumber, Item, ItemResult, tweddle_item
from spinfilters.reproduction.tweddle.replaced_recordings import FULL, NO_BOUND, SHORT, simulated_recording
from spinfilters.run.preparation import prepare
from spinfilters.run.smoother_convergence import Settling, recorded_convergence, settling_of
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate, without_map

SETTLED: Final = 3.0
"""Deviations of the last solve within which an estimate stays once it has settled."""
SOLVES: Final = (8, 16, 30, 50, 80, 115)
"""Panels of Figures 6-40 and 6-41."""
SIMULATED: Final = "The images are lost: body, motion, rig, noise and numbers of the thesis are simulated."
LOOSE: Final = 10.0
"""The same, looser by the factor by which a reader's eye may be."""
BY_EYE: Final = (
    "Printed numbers are read off surfaces; here a quantity has settled at the first solve from which its rms distance from the "
    "last solve stays below three final deviations."
)


@cache
def recorded(scenario: Scenario = FULL) -> tuple[Settling, Float[np.ndarray, " f"], int | None]:
    """What every solve said, times of the epochs, and the solve that closed the first loop."""
    settings = Settings(estimators=("smoother",))
    setup = prepare(without_map(simulate(scenario)), settings)
    found = recorded_convergence(setup, settings)
    settling = settling_of(found, setup.process.layout, setup.dataset.truth)
    return settling, found.time, found.closure


def make_surfaces(name: str, printed: tuple[float, float, float], scenario: Scenario = FULL) -> ItemResult:
    """Surfaces of a quantity of the motion, and the solve at which each axis has settled.

    Parameters
    ----------
    name : str
        Of the quantity.
    printed : tuple of float
        Iterations by axis after which section 6.7 sees it converged.
    scenario : Scenario
        Of the recording.
    """
    settling, time, closure = recorded(scenario)
    quantity = settling.quantities[name]
    rows = [
        _settled_row(f"{quantity.label} {axis}", _settling_solve(quantity, k), number)
        for k, (axis, number) in enumerate(zip(quantity.names, printed, strict=True))
    ]
    last = quantity.std[-1]
    limits = _bounded_deviations(name, scenario)
    rows += [
        ComparedNumber(
            f"{quantity.label} {axis}: deviation that the last solve states, rms over the epochs",
            float(np.sqrt(np.nanmean(np.square(last[1:, k])))),
            expected=(0.0, np.inf) if limits is None else (0.9 * limits[k], 1.5 * limits[k]),
            unit=quantity.std_unit,
            bound=NO_BOUND if limits is None else limits[k],
            why=f"a noise that the smoother finds from {len(time)} epochs may be off by some tenths: 0.9 to 1.5 is allowed",
        )
        for k, axis in enumerate(quantity.names)
    ]
    table = [
        {
            "time": float(t),
            **{f"std_{axis}": float(std) for axis, std in zip(quantity.names, row, strict=True)},
        }
        for t, row in zip(time, last, strict=True)
    ]
    surface = surfaces_figure(time, quantity, closure)
    return ItemResult(rows, {"surfaces": surface}, {"last_deviations": table}, _closed(closure))


def make_constant(number: int, printed: float, scenario: Scenario = FULL) -> ItemResult:
    """Values and deviations of constants of the body over the solves.

    Parameters
    ----------
    number : int
        Among those of `Settling`.
    printed : float
        Iterations after which section 6.7 sees them converged.
    scenario : Scenario
        Of the recording.
    """
    settling, _, closure = recorded(scenario)
    constant = settling.constants[number]
    words = constant.label.split(",")[0]
    rows = [
        _settled_row(f"{words}: {name}", _constant_settled(constant, k), printed)
        for k, name in enumerate(constant.names)
    ]
    if constant.truth is not None:
        off, stated = np.abs(constant.values[-1] - constant.truth), constant.std[-1]
        limits = _bounded_constants(number, scenario)
        rows += [
            ComparedNumber(
                f"{words}: {name}, error of the last solve; up to four stated deviations",
                float(off[k]),
                expected=(0.0, 4.0 * float(stated[k])),
                unit=constant.unit,
                bound=limits[k],
                why=f"{off[k] / stated[k]:.2g} stated deviations from the truth: the stated deviations are too small",
            )
            for k, name in enumerate(constant.names)
        ]
    return ItemResult(rows, {"constants": constants_figure([constant], closure)}, note=_closed(closure))


def make_course(name: str, scenario: Scenario = FULL) -> ItemResult:
    """Course along or about y as chosen solves saw it: panels of the thesis' animation.

    Parameters
    ----------
    name : str
        Of the quantity.
    scenario : Scenario
        Of the recording.
    """
    settling, time, _ = recorded(scenario)
    quantity = settling.quantities[name]
    assert quantity.truth is not None
    error = np.abs(quantity.values[..., 1] - quantity.truth[:, 1])
    last, stated = error[-1], quantity.std[-1, :, 1]
    begin = int(np.searchsorted(time, 10.0))
    early = [float(np.nanmax(error[k, : k + 1])) for k in range(begin, len(time))]
    span = float(np.ptp(quantity.truth[:, 1]))
    limits = _bounded_deviations(name, scenario)
    rms, claimed = (float(np.sqrt(np.mean(np.square(each)))) for each in (last, stated))
    rows = [
        ComparedNumber(
            f"largest error of any solve from 10 s on, share of the {quantity.label}'s range",
            max(early) / span,
            expected=(0.0, 0.2),
            why="the print sees the course follow the metrology closely behind 5 to 10 s",
        ),
        ComparedNumber(
            "root mean square error of the last solve; 0.3 to 1.7 of the stated deviation",
            rms,
            expected=(0.3 * claimed, 1.7 * claimed),
            unit=quantity.unit,
            bound=NO_BOUND if limits is None else limits[1],
            why=f"errors of one recording are alike along time, so that {len(time)} epochs are one draw of few numbers; it is "
            f"{rms / claimed:.2g} stated deviations",
        ),
    ]
    note = f"{SIMULATED} `spinfilters compare --convergence` writes the animation itself."
    return ItemResult(
        rows,
        {"course": course_figure(time, quantity, 1, [solve for solve in SOLVES if solve <= len(time)])},
        note=note,
    )


def make_costs(scenario: Scenario = FULL) -> ItemResult:
    """Figure 6-42: time, landmarks and factors."""
    settling, _, _ = recorded(scenario)
    costs = settling.costs
    total, to_80 = float(costs.seconds.sum()), float(costs.seconds[:80].sum())
    growth = float(
        np.polyfit(np.log(10.0 + np.arange(len(costs.seconds[9:]))), np.log(costs.seconds[9:]), 1)[0]
    )
    tenth = max(1, len(costs.seconds) // 10)
    rows = [
        ComparedNumber(
            f"all solves of {len(costs.seconds)} stereo pairs",
            total,
            printed=35 * 60.0,
            unit="s",
            smaller_is_better=True,
        ),
        ComparedNumber("the first 80 of them", to_80, printed=15 * 60.0, unit="s", smaller_is_better=True),
        ComparedNumber(
            "share of the time that the first 80 take",
            to_80 / total,
            printed=15 / 35,
            tolerance=0.03,
            why=f"the time of a solve grows with the power {growth:.2g} of the epochs; printed are 15 and just over 35 min",
        ),
        ComparedNumber(
            "time of the last tenth of the solves over that of the first tenth: steadily growing",
            float(costs.seconds[-tenth:].sum() / costs.seconds[:tenth].sum()),
            expected=(1.0, np.inf),
            why=f"the time of a solve grows with the power {growth:.2g} of the epochs",
        ),
        ComparedNumber(
            "landmarks",
            float(costs.landmarks[-1]),
            printed=2447,
            tolerance=25,
            why=f"the scenario asks for {scenario.landmarks}, and which of them are seen is drawn",
            given=True,
        ),
        ComparedNumber(
            "factors",
            float(costs.factors[-1]),
            printed=24723,
            tolerance=400,
            why=f"observations are drawn; {len(costs.seconds)} factors are of the motion and the prior, and "
            f"{_observations(scenario)} "
            "of the observations",
            given=True,
        ),
    ]
    table = [
        {"epoch": k + 1, "seconds": float(s), "landmarks": int(n), "factors": int(f)}
        for k, (s, n, f) in enumerate(zip(costs.seconds, costs.landmarks, costs.factors, strict=True))
    ]
    note = f"{SIMULATED} Every solve is linearised again and gives the covariances of all its epochs, as in section 6.8."
    return ItemResult(rows, {"costs": costs_by_epoch_figure(costs)}, {"costs": table}, note)


def _observations(scenario: Scenario) -> int:
    """Observations of landmarks in the recording."""
    return len(simulated_recording(scenario).dataset.log.stream("stereo"))


def make_costs_by_factors(scenario: Scenario = FULL) -> ItemResult:
    """Figure 6-43: the time of a solve is linear in its factors."""
    settling, _, _ = recorded(scenario)
    costs = settling.costs
    count = np.arange(len(costs.seconds)) + 1.0
    rows = []
    for word, numbers in (("factors", costs.factors), ("poses", count)):
        line = np.polyval(np.polyfit(numbers, costs.seconds, 1), numbers)
        rows.append(
            ComparedNumber(
                f"correlation of the time of a solve with its {word}",
                float(np.corrcoef(numbers, costs.seconds)[0, 1]),
                expected=(0.9, 1.0),
                why="times of solves scatter by "
                f"{1e3 * np.std(costs.seconds - line):.2g} ms about a straight line through {1e3 * np.ptp(line):.2g} ms, as "
                "some iterate "
                "more often and others use the machine",
            )
        )
    return ItemResult(rows, {"costs": costs_by_size_figure(costs)}, note=SIMULATED)


def _bounded_deviations(name: str, scenario: Scenario) -> Sequence[float] | None:
    """Bound of a quantity by axis, rms over the epochs after the first, in the unit of its deviations; None without."""
    recording = simulated_recording(scenario)
    motion, limit = recording.bounded_motion, recording.bound
    if motion is None or limit is None:
        return None
    rates = estimated_rates(limit).std
    assert rates is not None
    degrees = float(np.rad2deg(1.0))
    std = {
        "position": 1e3 * motion.std_position,
        "velocity": 1e3 * motion.std_velocity,
        "attitude": degrees * motion.std_attitude,
        "body_rate": degrees * rates,
    }[name]
    return np.sqrt(np.mean(np.square(std[1:]), axis=0)).tolist()


def _bounded_constants(number: int, scenario: Scenario) -> Sequence[float | str]:
    """Bound of centre of mass (mm), principal axes (mrad) or ratios after all epochs, by component."""
    body = simulated_recording(scenario).bounded_body
    if body is None:
        return [NO_BOUND] * 3
    assert body.center_of_mass_std is not None
    return (
        (1e3 * body.center_of_mass_std).tolist(),
        np.rad2deg(body.principal_axes_std).tolist(),
        [body.k1_std, body.k2_std],
    )[number]


def make_iterations(scenario: Scenario = FULL) -> ItemResult:
    """Text of section 6.7: after how many epochs everything has settled, and when the first loop closes."""
    settling, _, closure = recorded(scenario)
    rows = [
        ComparedNumber(
            "first loop closes at epoch; a revolution at 10 rpm takes 12 epochs of 0.5 s",
            float("nan") if closure is None else float(closure),
            printed=12.0,
            tolerance=2.0,
            why="a landmark is seen over about half of a revolution of 12 epochs, and the smoother waits until enough return",
        )
    ]
    for name, printed in (("position", 30.0), ("velocity", 30.0), ("attitude", 100.0), ("body_rate", 100.0)):
        quantity = settling.quantities[name]
        slowest = _slowest([_settling_solve(quantity, k) for k in range(3)])
        rows.append(_settled_row(f"{quantity.label}, slowest axis", slowest, printed))
    for constant, printed in zip(settling.constants, (50.0, 40.0, 100.0), strict=True):
        slowest = _slowest([_constant_settled(constant, k) for k in range(len(constant.names))])
        rows.append(_settled_row(f"{constant.label.split(',')[0]}, slowest", slowest, printed))
    return ItemResult(rows, {"settled": _settled_figure(rows)}, note=_closed(closure))


def _settled_figure(rows: list[ComparedNumber]) -> Figure:
    """Epochs after which everything has settled, printed and ours."""
    figure = Figure(figsize=(7.6, 4.4), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(rows))[::-1]
    axes.barh(places + 0.18, [row.printed or 0.0 for row in rows], 0.34, color=ORANGE, label="printed")
    axes.barh(places - 0.18, [row.ours for row in rows], 0.34, color=BLUE, label="ours")
    axes.set_yticks(places, [row.what.split(": ")[0].split(";")[0] for row in rows])
    axes.set_xlabel("epochs")
    axes.set_title("after how many epochs estimates settle", loc="left", fontsize="medium")
    axes.legend(frameon=False)
    tidy(axes)
    return figure


def _slowest(found: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """The larger numbers of several axes."""
    return max(each[0] for each in found), max(each[1] for each in found)


def _settling_solve(quantity: SettlingQuantity, axis: int) -> tuple[float, float]:
    """Number of the solve from which on the rms distance from the last solve stays small; the same for a looser eye."""
    distance = quantity.values[..., axis] - quantity.values[-1, :, axis]
    with np.errstate(invalid="ignore"):
        rms = np.sqrt(np.nanmean(np.square(distance), axis=1))
    # values of an attitude are parts of a quaternion: half the angle
    scale = 1.0 if quantity.unit == quantity.std_unit else float(np.deg2rad(0.5))
    final = scale * float(np.sqrt(np.nanmean(np.square(quantity.std[-1, :, axis]))))
    return _first_for_good(rms <= SETTLED * final), _first_for_good(rms <= LOOSE * final)


def _constant_settled(constant: SettlingConstant, axis: int) -> tuple[float, float]:
    distance = np.abs(constant.values[:, axis] - constant.values[-1, axis])
    std = constant.std[-1, axis]
    return _first_for_good(distance <= SETTLED * std), _first_for_good(distance <= LOOSE * std)


def _first_for_good(good: np.ndarray) -> float:
    """Number, from 1, of the solve from which on all are good."""
    bad = np.flatnonzero(~good)
    return float(bad[-1] + 2 if len(bad) else 1)


def _settled_row(what: str, found: tuple[float, float], printed: float) -> ComparedNumber:
    return ComparedNumber(
        f"{what}: settled after epoch",
        found[0],
        printed=printed,
        tolerance=10.0,
        smaller_is_better=True,
        bound="a count of epochs",
        why=f"to an eye that allows {LOOSE:g} final deviations instead of {SETTLED:g} it has settled after epoch {found[1]:g}",
    )


def _closed(closure: int | None) -> str:
    loop = "" if closure is None else f" The first loop closes at epoch {closure} (dotted line)."
    return f"{SIMULATED}{loop} {BY_EYE}"


CONVERGENCE: Final[tuple[Item, ...]] = (
    *(
        tweddle_item(
            number,
            "section 6.7",
            f"How the {what} settles: surfaces by axis",
            partial(make_surfaces, name, printed),
            seconds,
            partial(make_surfaces, name, printed, SHORT),
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
            partial(make_constant, at, printed),
            3.0,
            partial(make_constant, at, printed, SHORT),
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
            partial(make_course, name),
            3.0,
            partial(make_course, name, SHORT),
        )
        for number, what, name in (
            ("Figure 6-40", "Velocity along y", "velocity"),
            ("Figure 6-41", "Rate about y", "body_rate"),
        )
    ),
    *(
        tweddle_item(number, place, title, make, 3.0, partial(make, SHORT))
        for number, place, title, make in (
            ("Section 6.7", "text", "After how many epochs estimates settle", make_iterations),
            ("Figure 6-42", "section 6.8", "Run time, landmarks and factors by epoch", make_costs),
            ("Figure 6-43", "section 6.8", "Run time over factors and poses", make_costs_by_factors),
        )
    ),
)
