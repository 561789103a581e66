"""Linear stability of a spin about each principal axis (Tweddle 2013, section 2.5, Eqs 2.69-2.77).

A spin W about axis z with small rates about x and y obeys w_x' = W (Jyy - Jzz)/Jxx w_y, w_y' = W (Jzz -
Jxx)/Jyy w_x, so the roots are +-W sqrt((Jyy - Jzz)(Jzz - Jxx) / (Jxx Jyy)); the other two axes follow by
cyclic permutation.
"""

import cmath
from dataclasses import dataclass
from enum import Enum

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.core.polhode import validate_principal_moments


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
