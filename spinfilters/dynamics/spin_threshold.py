"""The rate that divides tumbling from spinning targets (Tweddle 2013, section 1.2, Eqs 1.1-1.12).

An inspector that keeps station at a fixed point of the target flies a circle. The target tumbles while the
centripetal force stays below the thrust and the propellant below a given part of the inspector's mass;
otherwise it spins, and its rate must be estimated.
"""

import math
from dataclasses import dataclass, fields
from enum import Enum
from typing import Final

from spinfilters.errors import InputError

STANDARD_GRAVITY: Final[float] = 9.81
"""g0 in m/s^2 as printed with Eq. 1.5; 9.80665 would lower the propellant limit by 0.02 %."""


class SpinRegime(Enum):
    """Whether an inspector may ignore the rate of the target."""

    TUMBLING = "tumbling"
    SPINNING = "spinning"


@dataclass(frozen=True)
class InspectionMission:
    """What decides the threshold, in SI; raises `InputError` for values that no mission has.

    `station_keeping_radius` m, `inspector_mass` kg (at the start), `max_force` N, `specific_impulse` s,
    `max_mass_fraction` propellant for station keeping over inspector mass, in (0, 1), `duration` s.
    """

    station_keeping_radius: float
    inspector_mass: float
    max_force: float
    specific_impulse: float
    max_mass_fraction: float
    duration: float

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{field.name} = {value} must be positive and finite; give it in SI units")
        if self.max_mass_fraction >= 1.0:
            raise InputError(f"max_mass_fraction = {self.max_mass_fraction} must be below 1; 2.9 % is 0.029")


@dataclass(frozen=True)
class SpinThreshold:
    """Limits of the target's rate in rad/s: by thrust (Eq. 1.2) and by propellant (Eq. 1.10)."""

    force: float
    mass_fraction: float

    @property
    def overall(self) -> float:
        """The lower of both limits, rad/s (Eq. 1.11)."""
        return min(self.force, self.mass_fraction)

    def regime(self, rate: float) -> SpinRegime:
        """Tumbling below the overall limit, spinning from it on; `rate` is |w| in rad/s."""
        return SpinRegime.TUMBLING if abs(rate) < self.overall else SpinRegime.SPINNING


def spin_threshold(mission: InspectionMission) -> SpinThreshold:
    """Spin thresholds of force and of fuel, rad/s.

    sqrt(F / (m r)) and sqrt(-g0 Isp ln(1 - Mf) / (r dt)) (Tweddle 2013, Eqs 1.2 and 1.10).
    """
    radius = mission.station_keeping_radius
    exhaust_speed = STANDARD_GRAVITY * mission.specific_impulse
    velocity_change = -exhaust_speed * math.log1p(-mission.max_mass_fraction)
    return SpinThreshold(
        force=math.sqrt(mission.max_force / (mission.inspector_mass * radius)),
        mass_fraction=math.sqrt(velocity_change / (radius * mission.duration)),
    )


SPHERES: Final[InspectionMission] = InspectionMission(
    station_keeping_radius=0.7,
    inspector_mass=5.91,
    max_force=0.22,
    specific_impulse=37.7,
    max_mass_fraction=0.17 / 5.91,
    duration=5 * 60.0,
)
"""SPHERES (Tweddle 2013, Table 1.1): one tank of 0.17 kg in 5 min, printed as Mf = 0.029."""

ORBITAL_EXPRESS: Final[InspectionMission] = InspectionMission(
    station_keeping_radius=12.0,
    inspector_mass=900.0,
    max_force=10.8,
    specific_impulse=235.0,
    max_mass_fraction=5.0 / 900.0,
    duration=120 * 60.0,
)
"""Orbital Express, exercise 1 (Tweddle 2013, Table 1.1): 5 kg in 120 min.

The printed Mf = 0.0056 is rounded and would give
0.1169 rpm; the printed 0.1164 rpm belongs to 5/900."""
