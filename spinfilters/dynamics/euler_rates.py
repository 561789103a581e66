"""Rates of a torque-free body as functions of time: Euler's equations solved by Jacobi's elliptic functions.

w_A = alpha cn(u), w_B = beta sn(u), w_C = gamma dn(u) with u = u0 + lambda t (Landau and Lifshitz, Mechanics,
Eq. 37.10), axes A, B, C and positive constants as in `spinfilters.dynamics.polhode`; the signs of w_A and w_C
are those at t = 0.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.dynamics.jacobi_elliptic import argument_of, jacobi_functions
from spinfilters.dynamics.polhode import PolhodeShape, polhode_shape


@dataclass(frozen=True)
class EulerRates:
    """Elliptic parameters of a rate that moves.

    Polhode, signs (+1 or -1) of w_A and w_C, u0, and lambda = du/dt in rad/s.
    """

    shape: PolhodeShape
    signs: tuple[float, float]
    phase: float
    frequency: float

    def argument(self, time: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
        """Argument u of the elliptic functions at times in s."""
        return self.phase + self.frequency * time

    def rate(self, time: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch 3"]:
        """Body rate in principal axes, rad/s, at times in s."""
        sn, cn, dn = jacobi_functions(self.argument(time), self.shape.modulus)
        alpha, beta, gamma = self.shape.amplitudes
        a, b, c = self.shape.axes
        rate = np.empty((*np.shape(time), 3))
        rate[..., a] = self.signs[0] * alpha * cn
        rate[..., b] = beta * sn
        rate[..., c] = self.signs[1] * gamma * dn
        return rate


def euler_rates(moments: Float[np.ndarray, "3"], rate0: Float[np.ndarray, "3"]) -> EulerRates:
    """The motion of a rate from `rate0` (rad/s) at t = 0.

    It is not fixed (`polhode.is_fixed_rate`).
    """
    shape = polhode_shape(moments, rate0)
    a, b, c = shape.axes
    ac, bc = moments[c] - moments[a], moments[c] - moments[b]
    sine = rate0[b] * math.sqrt(moments[b] * abs(bc))
    cosine = rate0[a] * math.sqrt(moments[a] * abs(ac))
    radius = math.hypot(sine, cosine)
    sign_a, sign_c = math.copysign(1.0, rate0[a]), math.copysign(1.0, rate0[c])
    # J_B w_B' = +-(J_C - J_A) w_C w_A, plus where (A, B, C) is an even permutation of (x, y, z): Eq. 2.70 of
    # Tweddle (2013).
    parity = 1.0 if (b - a) % 3 == 1 else -1.0
    frequency = shape.amplitudes[2] * math.sqrt((ac / moments[b]) * (bc / moments[a]))
    return EulerRates(
        shape=shape,
        signs=(sign_a, sign_c),
        phase=argument_of(sine / radius, abs(cosine) / radius, shape.modulus),
        frequency=parity * math.copysign(1.0, ac) * sign_a * sign_c * frequency,
    )
