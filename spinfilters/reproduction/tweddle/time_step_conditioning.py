"""Figures 4-6 to 4-8: condition number of a double integrator's noise over the time step and the unit of velocity (section 4.9)."""

import math
from typing import Final

import numpy as np

from observability.conditioning import (
    best_time_step,
    best_velocity_unit,
    condition_number,
    double_integrator_covariance,
)
from spinfilters.plots.observability_figures import TIME_STEPS, conditioning_figure
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
    figure = conditioning_figure(np.array([0.0, 1.0, 0.0]), 0.5, best_velocity_unit(0.5))
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
    figure = conditioning_figure(np.array([0.0, 1.0, 0.0]), math.sqrt(3.0), 1.0)
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
            why=SLIP,
        ),
        ComparedNumber(
            "alpha of the printed formula for an hour, dt / sqrt(3)",
            HOUR / math.sqrt(3.0),
            printed=2078.0,
            tolerance=0.5,
        ),
    ]
    figure = conditioning_figure(np.array([0.0, 1.0, 0.0]), 0.5, ALPHAS[-1])
    return ItemResult(rows, {"conditioning": figure}, note=SLIP)


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
