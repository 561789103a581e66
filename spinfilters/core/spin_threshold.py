"""The rate that divides tumbling from spinning targets (Tweddle 2013, section 1.2, Eqs 1.1-1.12).

An inspector that keeps station at a fixed point of the target flies a circle. The target tumbles while the
centripetal force stays below the thrust and the propellant below a given part of the inspector's mass;
otherwise it spins, and its rate must be estimated.
"""

import math
from dataclasses import dataclass, fields
from enum import Enum
from typing import Final

from spinfilters.core.errors import InputError

STANDARD_GRAVITY: Final[float] = 9.81
"""g0 in m/s^2 as printed with Eq. 1.5; 9.80665 would lower the propellant limit by 0.02 %."""


class SpinRegime(Enum):
    """Whether an inspector may ignore the rate of the target."""

    TUMBLING = "tumbling"
    SPINNING = "spinning"


@dataclass(frozen=True)
class InspectionMission:
    """What decides the threshold, in SI units.

    Parameters
    ----------
    station_keeping_radius : float
        Distance of the inspector from the target's centre of mass, m.
    inspector_mass : float
        Mass at the beginning of station keeping, propellant included, kg.
    max_force : float
        Largest force of the thrusters towards the target, N.
    specific_impulse : float
        Specific impulse of the thrusters, s.
    max_mass_fraction : float
        Propellant that may be spent on station keeping, as a part of ``inspector_mass``, in (0, 1).
    duration : float
        Time of station keeping, s.

    Raises
    ------
    InputError
        A value that is not positive and finite, or a mass fraction of one or more.
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
    """Largest rates at which an inspector may ignore that the target turns, rad/s.

    Parameters
    ----------
    force : float
        Limit by thrust (Eq. 1.2), rad/s.
    mass_fraction : float
        Limit by propellant (Eq. 1.10), rad/s.
    """

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
    """Rates from which thrust and propellant no longer suffice to keep station over a turning target.

    sqrt(F / (m r)) and sqrt(-g0 Isp ln(1 - Mf) / (r dt)) (Tweddle 2013, Eqs 1.2 and 1.10).

    Parameters
    ----------
    mission : InspectionMission
        Masses, lengths and times of the mission.

    Returns
    -------
    SpinThreshold
        Both limits and the lower of them, rad/s.
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
