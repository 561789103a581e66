"""Figures 4-6 to 4-8: condition number of a double integrator's noise over the time step and the unit of velocity (section 4.9)."""

import math
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from observability.conditioning import (
    best_time_step,
    best_velocity_unit,
    condition_number,
    double_integrator_covariance,
)
from spinfilters.plots.observability_figures import TIME_STEPS
from spinfilters.plots.style import BLACK, BLUE, ORANGE, RED, SKY, tidy
from spinfilters.reproduction.item import ComparedNumber, ItemResult, tweddle_item

ALPHAS: Final = (0.1, 1.0, 10.0)
SLIP: Final[str] = (
    "The text writes dt = alpha sqrt(3) for the best time step; with Eq. 4.118 it is dt = sqrt(3) / alpha, so that both examples "
    "are inverted."
)
DAY, HOUR = 86_400.0, 3_600.0


def make_condition_numbers() -> ItemResult:
    """Figure 4-6: the condition number has its minimum at sqrt(3) s."""
    steps = np.geomspace(0.1, 30.0, 20_001)
    numbers = np.array([condition_number(double_integrator_covariance(float(dt))) for dt in steps])
    best = float(steps[np.argmin(numbers)])
    rows = [
        ComparedNumber("best time step", best, printed=math.sqrt(3.0), unit="s", tolerance=2e-3),
        ComparedNumber("condition number there", float(numbers.min()), printed=13.9, tolerance=0.05),
        ComparedNumber(
            "condition number at 0.1 s over that",
            float(numbers[0] / numbers.min()),
            expected=(10.0, math.inf),
        ),
        ComparedNumber(
            "condition number at 30 s over that",
            float(numbers[-1] / numbers.min()),
            expected=(10.0, math.inf),
        ),
    ]
    figure, axes = _panel("time step [s]", "condition number [-]", "condition number of the discrete noise")
    axes.loglog(steps, numbers, color=BLUE)
    axes.plot(best, numbers.min(), "o", color=RED, label=f"least: {numbers.min():.1f} at {best:.3f} s")
    axes.legend(frameon=False)
    table = [
        {"time_step_s": float(dt), "condition_number": float(n)}
        for dt, n in zip(steps[::50], numbers[::50], strict=True)
    ]
    return ItemResult(rows, {"conditioning": figure}, {"condition_numbers": table})


def make_uncertainty_ellipses() -> ItemResult:
    """Figure 4-7: the ellipse is upright at small steps and lies down at large ones; 45 degrees at the best one with alpha = 1."""
    rows = [
        ComparedNumber(
            "angle of the long axis from position, 0.1 s", _long_axis(0.1), expected=(80.0, 90.0), unit="deg"
        ),
        ComparedNumber(
            "angle of the long axis at sqrt(3) s",
            _long_axis(math.sqrt(3.0)),
            printed=45.0,
            unit="deg",
            tolerance=1e-6,
        ),
        ComparedNumber("angle of the long axis, 10 s", _long_axis(10.0), expected=(0.0, 15.0), unit="deg"),
    ]
    table = [{"time_step_s": float(dt), "long_axis_deg": _long_axis(float(dt))} for dt in TIME_STEPS]
    figure, axes = _panel(
        "position [-]", "velocity [-]", "ellipses of one deviation, over the largest of each"
    )
    angle = np.linspace(0.0, 2.0 * math.pi, 200)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    for dt, colour in zip(
        (0.1, 0.5, math.sqrt(3.0), 4.0, 10.0), (SKY, BLUE, BLACK, ORANGE, RED), strict=True
    ):
        values, vectors = np.linalg.eigh(double_integrator_covariance(dt))
        ellipse = vectors @ (np.sqrt(values)[:, np.newaxis] * circle) / math.sqrt(values[-1])
        axes.plot(*ellipse, color=colour, label=f"{dt:.3g} s: {_long_axis(dt):.0f} deg")
    axes.set(aspect="equal", xlim=(-1.1, 1.1), ylim=(-1.1, 1.1))
    axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return ItemResult(
        rows, {"conditioning": figure}, {"ellipses": table}, "The 45 degrees hold for alpha = 1 alone."
    )


def make_velocity_units() -> ItemResult:
    """Figure 4-8 and both examples: the minimum moves with the unit of velocity, its height does not."""
    rows = []
    for alpha in ALPHAS:
        dt = best_time_step(alpha)
        least = condition_number(double_integrator_covariance(dt, alpha))
        rows.append(
            ComparedNumber(
                f"condition number at sqrt(3) / alpha, alpha = {alpha:g} 1/s",
                least,
                printed=13.9,
                tolerance=0.05,
            )
        )
    rows += [
        ComparedNumber(
            "example of a car: millimetres a day as alpha",
            1e-3 / DAY,
            printed=1e-9,
            unit="m/s",
            tolerance=5e-10,
            why="a millimetre a day is 1.16e-8 m/s",
        ),
        ComparedNumber(
            "example of a car: its best time step",
            best_time_step(1e-9),
            printed=11e-9,
            unit="s",
            tolerance=5e-10,
            why=f"{SLIP} Neither form gives 11 ns from 1e-9.",
        ),
        ComparedNumber(
            "alpha for a time step of an hour",
            best_velocity_unit(HOUR),
            printed=2078.0,
            unit="m/s",
            tolerance=0.5,
            why=f"{SLIP} The printed form gives {HOUR / math.sqrt(3.0):.0f}, ours {math.sqrt(3.0) / HOUR:.2g}.",
        ),
        ComparedNumber(
            "alpha of the printed formula for an hour, dt / sqrt(3)",
            HOUR / math.sqrt(3.0),
            printed=2078.0,
            tolerance=0.5,
        ),
    ]
    figure, axes = _panel(
        "time step [s]", "alpha, unit of length of the velocity [-]", "logarithm of the condition number"
    )
    steps, units = np.geomspace(1e-2, 1e2, 121), np.geomspace(1e-2, 1e2, 121)
    height = [
        [math.log10(condition_number(double_integrator_covariance(float(dt), float(a)))) for dt in steps]
        for a in units
    ]
    filled = axes.contourf(steps, units, np.array(height), levels=20, cmap="viridis")
    figure.colorbar(filled, ax=axes)
    axes.loglog(steps, math.sqrt(3.0) / steps, color=RED, label="least: dt = sqrt(3) / alpha")
    axes.set(xlim=(1e-2, 1e2), ylim=(1e-2, 1e2))
    axes.legend(loc="lower left")
    return ItemResult(rows, {"conditioning": figure}, note=SLIP)


def _panel(across: str, up: str, title: str) -> tuple[Figure, Axes]:
    """A figure of one panel."""
    figure = Figure(figsize=(6.4, 4.6), layout="constrained")
    axes = figure.subplots()
    axes.set(xlabel=across, ylabel=up)
    axes.set_title(title, loc="left", fontsize="medium")
    tidy(axes)
    return figure, axes


def _long_axis(dt: float) -> float:
    """Angle from the position axis to the long axis of the covariance, deg in [0, 90]."""
    _, vectors = np.linalg.eigh(double_integrator_covariance(dt))
    return math.degrees(math.atan2(abs(vectors[1, 1]), abs(vectors[0, 1])))


CONDITIONING: Final = (
    tweddle_item(
        "Figure 4-6",
        "section 4.9",
        "Condition number over the time step",
        make_condition_numbers,
    ),
    tweddle_item(
        "Figure 4-7",
        "section 4.9",
        "Uncertainty ellipses over the time step",
        make_uncertainty_ellipses,
    ),
    tweddle_item(
        "Figure 4-8",
        "section 4.9",
        "Condition number over time step and unit",
        make_velocity_units,
    ),
)
