"""Other parametrisations of principal moments up to scale: Aghili's, Lichter's, the thesis' logarithms of ratios, a box.

    Aghili (2012)     p_x = (I_y - I_z) / I_x and cyclic: three numbers, p_x + p_y + p_z + p_x p_y p_z = 0
    Lichter (2005)    I_xx = |z_2| + |z_3| and cyclic, z = R(q) (0, 0, 1): four numbers
    Tweddle (2013)    k_1 = ln(J_xx / J_yy), k_2 = ln(J_yy / J_zz): two numbers, impossible bodies among them
    a uniform box     J_x is proportional to b^2 + c^2 and cyclic: three edges, the longest 1

Every function takes moments about x, y, z in this order (Tweddle 2013, Eqs 4.89 to 4.99). The package itself estimates a mass
distribution whose every value is a body (`spinfilters.core.mass_distribution`).
"""

import numpy as np
from jaxtyping import Bool, Float

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.errors import InputError


def aghili_parameters(moments: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """p_x, p_y, p_z of principal moments (Eqs 4.89 to 4.91).

    Parameters
    ----------
    moments : ndarray of float, shape (..., 3)
        Positive, of any scale.

    Returns
    -------
    ndarray of float, shape (..., 3)
        Between -1 and 1 for a body.

    Raises
    ------
    InputError
        A moment that is not positive.
    """
    x, y, z = _positive(moments)
    return np.stack([(y - z) / x, (z - x) / y, (x - y) / z], axis=-1)


def aghili_constraint(parameters: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
    """p_x + p_y + p_z + p_x p_y p_z, which is zero for numbers that belong to moments (Eq. 4.92)."""
    return np.asarray(parameters.sum(axis=-1) + parameters.prod(axis=-1))


def moments_from_aghili(parameters: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Principal moments, the first of them 1, of p_y and p_z; p_x follows from these (Eq. 4.92).

    Parameters
    ----------
    parameters : ndarray of float, shape (..., 3)
        p_x, p_y, p_z.

    Returns
    -------
    ndarray of float, shape (..., 3)
        Not positive where the parameters are of no body.
    """
    p_y, p_z = parameters[..., 1], parameters[..., 2]
    # I_z - I_x = p_y I_y and I_x - I_y = p_z I_z, with I_x = 1
    y = (1.0 - p_z) / (1.0 + p_y * p_z)
    return np.stack([np.ones_like(y), y, 1.0 + p_y * y], axis=-1)


def moments_from_lichter(q: Float[np.ndarray, "*batch 4"]) -> Float[np.ndarray, "*batch 3"]:
    """Principal moments of Lichter's quaternion, scalar last (Eqs 4.93 to 4.96 with the third column of a rotation).

    Parameters
    ----------
    q : ndarray of float, shape (..., 4)
        Of any length but zero.

    Returns
    -------
    ndarray of float, shape (..., 3)
        I_xx, I_yy, I_zz; one is zero where two components of z are.
    """
    z = np.abs(matrix_from_quaternion(q / np.linalg.norm(q, axis=-1, keepdims=True))[..., 2])
    return np.stack([z[..., 1] + z[..., 2], z[..., 0] + z[..., 2], z[..., 0] + z[..., 1]], axis=-1)


def lichter_direction(moments: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """The unit vector z, all components positive, of principal moments: the second moments up to scale.

    Parameters
    ----------
    moments : ndarray of float, shape (..., 3)
        Positive, of any scale.

    Raises
    ------
    InputError
        A moment that is not positive.
    """
    x, y, z = _positive(moments)
    second = np.stack([y + z - x, x + z - y, x + y - z], axis=-1)
    return second / np.linalg.norm(second, axis=-1, keepdims=True)


def log_ratios_of(moments: Float[np.ndarray, "3"] | tuple[float, float, float]) -> Float[np.ndarray, "2"]:
    """k_1 and k_2 of principal moments in any order, the largest about x (Eq. 4.99)."""
    low, middle, high = np.sort(moments)
    return np.log([high / middle, middle / low])


def moments_from_log_ratios(log_ratios: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 3"]:
    """Principal moments, the second of them 1, of k_1 and k_2 (Eq. 4.99)."""
    k_1, k_2 = log_ratios[..., 0], log_ratios[..., 1]
    return np.stack([np.exp(k_1), np.ones_like(k_1), np.exp(-k_2)], axis=-1)


def box_of_equal_inertia(moments: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Edges of the uniform box with these ratios of moments, along the same axes.

    Parameters
    ----------
    moments : ndarray of float, shape (..., 3)
        Principal moments of a body, of any scale.

    Returns
    -------
    ndarray of float, shape (..., 3)
        Edges a, b, c, the longest 1: a^2 is proportional to J_y + J_z - J_x.
        The edge that a plate or rod lacks is about a thousandth.
    """
    total = moments.sum(axis=-1, keepdims=True)
    squares = np.clip(total - 2 * moments, 1e-6 * total, None)
    return np.sqrt(squares / squares.max(axis=-1, keepdims=True))


def is_body(moments: Float[np.ndarray, "*batch 3"]) -> Bool[np.ndarray, "*batch"]:
    """Whether moments are positive and keep the triangle inequality."""
    total = moments.sum(axis=-1, keepdims=True)
    return np.asarray(((moments > 0) & (2 * moments <= total)).all(axis=-1))


def _positive(moments: Float[np.ndarray, "*batch 3"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    moments = np.asarray(moments, dtype=float)
    if not (np.isfinite(moments).all() and (moments > 0).all()):
        raise InputError("principal moments must be positive and finite; correct them")
    return moments[..., 0], moments[..., 1], moments[..., 2]
