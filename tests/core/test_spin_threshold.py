"""The tumbling threshold reproduces Table 1.1 of Tweddle (2013) and follows from its own definition."""

import math
from dataclasses import replace

import pytest

from spinfilters.core.conventions import RPM
from spinfilters.core.errors import InputError
from spinfilters.core.spin_threshold import (
    ORBITAL_EXPRESS,
    SPHERES,
    STANDARD_GRAVITY,
    InspectionMission,
    SpinRegime,
    spin_threshold,
)

# Tweddle (2013), Table 1.1: rpm by thrust, by propellant, overall, and half a unit of the last printed digit.
TABLE_1_1 = [
    pytest.param(SPHERES, (2.20, 2.17, 2.17), 0.005, id="SPHERES"),
    pytest.param(ORBITAL_EXPRESS, (0.3020, 0.1164, 0.1164), 0.00005, id="Orbital Express"),
]


@pytest.mark.parametrize(("mission", "printed", "rounding"), TABLE_1_1)
def test_table_1_1_is_reproduced_to_its_last_digit(
    mission: InspectionMission, printed: tuple[float, float, float], rounding: float
) -> None:
    threshold = spin_threshold(mission)
    computed = (threshold.force, threshold.mass_fraction, threshold.overall)
    for value, table in zip(computed, printed, strict=True):
        assert abs(value / RPM - table) <= rounding


def test_printed_mass_fraction_of_orbital_express_does_not_give_its_printed_threshold() -> None:
    rounded = spin_threshold(replace(ORBITAL_EXPRESS, max_mass_fraction=0.0056))
    assert rounded.mass_fraction / RPM == pytest.approx(0.1169, abs=5e-5)


@pytest.mark.parametrize("mission", [SPHERES, ORBITAL_EXPRESS])
def test_at_the_limits_thrust_and_propellant_are_just_used_up(mission: InspectionMission) -> None:
    threshold = spin_threshold(mission)
    radius = mission.station_keeping_radius
    assert mission.inspector_mass * radius * threshold.force**2 == pytest.approx(mission.max_force, rel=1e-14)
    velocity_change = mission.duration * radius * threshold.mass_fraction**2
    spent = -math.expm1(-velocity_change / (STANDARD_GRAVITY * mission.specific_impulse))
    assert spent == pytest.approx(mission.max_mass_fraction, rel=1e-13)


def test_weak_thruster_makes_the_thrust_the_overall_limit() -> None:
    threshold = spin_threshold(replace(SPHERES, max_force=0.01))
    assert threshold.overall == threshold.force < threshold.mass_fraction


def test_target_tumbles_below_the_threshold_and_spins_above_in_either_sense() -> None:
    threshold = spin_threshold(SPHERES)
    assert threshold.regime(2.1 * RPM) is SpinRegime.TUMBLING
    assert threshold.regime(-2.1 * RPM) is SpinRegime.TUMBLING
    assert threshold.regime(-2.2 * RPM) is SpinRegime.SPINNING
    assert threshold.regime(threshold.overall) is SpinRegime.SPINNING


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("station_keeping_radius", 0.0),
        ("inspector_mass", -1.0),
        ("duration", math.nan),
        ("max_mass_fraction", 2.9),
    ],
)
def test_missions_that_cannot_be_are_refused_by_the_name_of_the_value(field: str, value: float) -> None:
    with pytest.raises(InputError, match=field):
        replace(SPHERES, **{field: value})
