"""How a free rotation looks from outside (Tweddle 2013, section 2.5.1), and the stability of a spin about each principal axis.

The energy ellipsoid rolls on the invariable plane. The angular momentum h keeps its direction in space. The rate w touches the
plane w.h = 2 E, which lies at the distance 2 E / |h| from the centre of mass; its path there is the herpolhode, its path on the
body the polhode. Both paths seen from the centre of mass are cones: the body cone rolls on the space cone without slip. About an
axis of symmetry both are circular, with

    tan(angle of h to the axis) = (J_transverse / J_axis) tan(angle of w to the axis),

so that w lies between the axis and h where the axis has the smaller moment (prograde: the body cone rolls outside the space cone)
and beyond h where it has the larger (retrograde: the space cone lies inside the body cone).

Linear stability (section 2.5, Eqs 2.69-2.77): a spin W about axis z with small rates about x and y obeys
w_x' = W (Jyy - Jzz)/Jxx w_y, w_y' = W (Jzz - Jxx)/Jyy w_x, so the roots are +-W sqrt((Jyy - Jzz)(Jzz - Jxx) / (Jxx Jyy)); the other
two axes follow by cyclic permutation.
"""

import cmath
import math
from dataclasses import dataclass
from enum import Enum
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.errors import InputError
from spinfilters.core.polhode import (
    angular_momentum,
    finite_vector,
    positive_moments,
    rotational_energy,
    validate_principal_moments,
)
from spinfilters.core.torque_free import motion_of_moments, polhode_period

SYMMETRY_TOLERANCE: Final[float] = 1e-9
"""Two moments closer than this, relative to the larger, are those of an axis of symmetry."""
SAMPLES_PER_PERIOD: Final[int] = 720
MOST_TURNS: Final[float] = 400.0


@dataclass(frozen=True)
class RollingMotion:
    """A free rotation seen in space, with the momentum along z of the frame s.

    Parameters
    ----------
    time : Float[np.ndarray, " n"]
        Times, s.
    body_rate : Float[np.ndarray, "n 3"]
        The polhode: rate in body principal axes, rad/s.
    space_rate : Float[np.ndarray, "n 3"]
        The herpolhode: rate in the frame s, rad/s; its z is ``plane_distance``.
    axes : Float[np.ndarray, "n 3 3"]
        Body principal axes as columns in the frame s.
    plane_distance : float
        Distance of the invariable plane from the centre of mass, 2 E / |h|, rad/s.
    period : float
        Time after which the body rate returns, s; infinite where it does not or never changes.
    advance : float
        Angle about h by which the body is turned after one period, rad in (-pi, pi]; NaN without a period. The herpolhode closes
        where it is a rational part of a turn.
    """

    time: Float[np.ndarray, " n"]
    body_rate: Float[np.ndarray, "n 3"]
    space_rate: Float[np.ndarray, "n 3"]
    axes: Float[np.ndarray, "n 3 3"]
    plane_distance: float
    period: float
    advance: float

    @property
    def herpolhode_radii(self) -> tuple[float, float]:
        """Least and largest distance of the rate from h on the invariable plane, rad/s."""
        radii = np.linalg.norm(self.space_rate[:, :2], axis=-1)
        return float(radii.min()), float(radii.max())


@dataclass(frozen=True)
class Cones:
    """Cones of a body with an axis of symmetry; angles in rad, rates in rad/s.

    Parameters
    ----------
    axis : int
        Index of the axis of symmetry.
    body_half_angle : float
        Between the rate and the axis of symmetry.
    space_half_angle : float
        Between the rate and the momentum.
    nutation_angle : float
        Between the axis of symmetry and the momentum.
    precession_rate : float
        Of the axis of symmetry about the momentum, |h| / J_transverse.
    spin_rate : float
        Of the body about its axis relative to the precessing frame.
    sense : str
        ``prograde``, ``retrograde``, or ``none`` where the rate lies along the axis or across it.
    """

    axis: int
    body_half_angle: float
    space_half_angle: float
    nutation_angle: float
    precession_rate: float
    spin_rate: float
    sense: str


def rolling_motion(
    moments: Float[np.ndarray, "3"], rate0: Float[np.ndarray, "3"], duration: float | None = None
) -> RollingMotion:
    """Polhode, herpolhode and axes of a free rotation over time.

    Parameters
    ----------
    moments : Float[np.ndarray, "3"]
        Principal moments, kg m^2, positive; those of no rigid body are taken as numbers.
    rate0 : Float[np.ndarray, "3"]
        Body rate at t = 0 in principal axes, rad/s; not zero.
    duration : float, optional
        Time, s. Without it: four periods of the polhode, or ten turns where it has none.

    Returns
    -------
    RollingMotion
        Sampled so that each turn and each period has at least 720 points.

    Raises
    ------
    InputError
        A body at rest, moments that are not positive, numbers that are not finite, or more than 400 turns.
    """
    moments, rate0 = positive_moments(moments), finite_vector(rate0, 3, "rate0", "rad/s")
    momentum, speed = angular_momentum(moments, rate0), float(np.linalg.norm(rate0))
    size = float(np.linalg.norm(momentum))
    if speed == 0.0:
        raise InputError("rate0 is zero: a body at rest has no polhode; give a rate")
    period, turn = polhode_period(moments, rate0), 2.0 * math.pi / speed
    if duration is None:
        duration = min(4.0 * period, 0.5 * MOST_TURNS * turn) if math.isfinite(period) else 10.0 * turn
    if not (math.isfinite(duration) and 0.0 < duration <= MOST_TURNS * turn):
        raise InputError(
            f"duration = {duration:g} s must be positive and at most {MOST_TURNS:g} turns of the body, {MOST_TURNS * turn:.4g} s"
        )
    count = 1 + math.ceil(SAMPLES_PER_PERIOD * duration / min(period, turn))
    time = np.linspace(0.0, duration, count)
    motion = motion_of_moments(moments, rate0, time)
    to_space = _frame_along(momentum / size)
    axes = to_space @ matrix_from_quaternion(motion.attitude)
    return RollingMotion(
        time=time,
        body_rate=motion.rate,
        space_rate=np.einsum("nij,nj->ni", axes, motion.rate),
        axes=axes,
        plane_distance=2.0 * float(rotational_energy(moments, rate0)) / size,
        period=period,
        advance=_advance(moments, rate0, period, to_space),
    )


def cones(moments: Float[np.ndarray, "3"], rate: Float[np.ndarray, "3"]) -> Cones | None:
    """Space and body cone of a body with an axis of symmetry; None of a body without one, and of a sphere.

    Parameters
    ----------
    moments : Float[np.ndarray, "3"]
        Principal moments, kg m^2, positive.
    rate : Float[np.ndarray, "3"]
        Body rate in principal axes, rad/s; not zero.

    Raises
    ------
    InputError
        A body at rest, or numbers that are not finite and positive.
    """
    moments, rate = positive_moments(moments), finite_vector(rate, 3, "rate", "rad/s")
    if not np.any(rate):
        raise InputError("rate is zero: a body at rest has no cones; give a rate")
    axis = _axis_of_symmetry(moments)
    if axis is None:
        return None
    transverse = float(np.mean(np.delete(moments, axis)))
    along, across = float(rate[axis]), float(np.linalg.norm(np.delete(rate, axis)))
    body = math.atan2(across, abs(along))
    nutation = math.atan2(transverse * across, float(moments[axis]) * abs(along))
    sense = "prograde" if moments[axis] < transverse else "retrograde"
    precession = math.hypot(transverse * across, float(moments[axis]) * along) / transverse
    return Cones(
        axis=axis,
        body_half_angle=body,
        space_half_angle=abs(nutation - body),
        nutation_angle=nutation,
        precession_rate=precession,
        spin_rate=along * (1.0 - float(moments[axis]) / transverse),
        sense="none" if across == 0.0 or along == 0.0 else sense,
    )


def _axis_of_symmetry(moments: Float[np.ndarray, "3"]) -> int | None:
    """The axis whose other two moments are equal; None without one, and of a sphere."""
    pairs = ((1, 2), (2, 0), (0, 1))
    equal = [abs(moments[i] - moments[j]) <= SYMMETRY_TOLERANCE * moments.max() for i, j in pairs]
    return equal.index(True) if sum(equal) == 1 else None


def _frame_along(direction: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Rotation into a frame whose z is the unit vector."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(helper, direction)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(direction, x), direction])


def _advance(
    moments: Float[np.ndarray, "3"],
    rate0: Float[np.ndarray, "3"],
    period: float,
    to_space: Float[np.ndarray, "3 3"],
) -> float:
    """Angle about z of the frame s from the body's axes at t = 0 to those after one period."""
    if not math.isfinite(period):
        return math.nan
    turn = (
        to_space
        @ matrix_from_quaternion(motion_of_moments(moments, rate0, np.array(period)).attitude)
        @ to_space.T
    )
    return math.atan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])


class Stability(Enum):
    """What a small disturbance of the spin does."""

    STABLE = "nutates"
    UNSTABLE = "grows exponentially"
    NEUTRAL = "grows at most linearly"


@dataclass(frozen=True)
class AxisStability:
    """Stability of a spin about one principal axis.

    Imaginary roots are +-i times the nutation frequency in body axes, real ones +- the growth rate. ``NEUTRAL``
    has two zero roots: another moment equals this one (the rate then drifts towards that axis without end) or
    nothing spins.

    Parameters
    ----------
    axis : int
        0, 1, 2 for x, y, z.
    roots : tuple of complex
        Both roots of the characteristic equation, rad/s.
    stability : Stability
        What follows from them.
    """

    axis: int
    roots: tuple[complex, complex]
    stability: Stability

    @property
    def growth_rate(self) -> float:
        """Largest real part, 1/s; zero unless unstable."""
        return max(root.real for root in self.roots)

    @property
    def nutation_frequency(self) -> float:
        """Largest imaginary part, rad/s; zero unless stable."""
        return max(root.imag for root in self.roots)


def axis_stability(
    principal_moments: Float[np.ndarray, "3"], spin_rate: float
) -> tuple[AxisStability, AxisStability, AxisStability]:
    """Stability of a spin about the x, y and z principal axes (Tweddle 2013, Eqs 2.69-2.77).

    It is linear and knows no loss of energy, which also destabilises the axis of smallest inertia.

    Parameters
    ----------
    principal_moments : Float[np.ndarray, "3"]
        Principal moments of inertia, kg m^2, in any order.
    spin_rate : float
        Rate of the spin, rad/s, of either sign.

    Returns
    -------
    tuple of AxisStability
        For the axes x, y, z.

    Raises
    ------
    InputError
        Moments of no rigid body, or a rate that is not finite.
    """
    moments = validate_principal_moments(principal_moments)
    if not np.isfinite(spin_rate):
        raise InputError(f"spin_rate = {spin_rate} rad/s is not finite; give a number")
    return (
        _one_axis(moments, spin_rate, 0),
        _one_axis(moments, spin_rate, 1),
        _one_axis(moments, spin_rate, 2),
    )


def _one_axis(moments: Float[np.ndarray, "3"], spin_rate: float, axis: int) -> AxisStability:
    """Eq. 2.77 for the given axis in the place of z."""
    x, y, z = (float(moments[(axis + shift) % 3]) for shift in (1, 2, 0))
    product = ((y - z) / x) * ((z - x) / y)
    root = abs(spin_rate) * cmath.sqrt(product)
    if product == 0.0 or spin_rate == 0.0:
        return AxisStability(axis, (0j, 0j), Stability.NEUTRAL)
    verdict = Stability.STABLE if product < 0.0 else Stability.UNSTABLE
    return AxisStability(axis, (root, -root), verdict)
