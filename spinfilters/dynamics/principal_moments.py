"""Principal moments of inertia of a rigid body, and the two quantities that torque-free motion conserves."""

from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError, ShapeError

AXIS_NAMES: Final[tuple[str, str, str]] = ("Jxx", "Jyy", "Jzz")

TRIANGLE_TOLERANCE: Final[float] = 1e-12
"""Relative slack of the triangle inequality: a thin plate has equality, which rounding may miss."""


def validate_principal_moments(principal_moments: Float[np.ndarray, " n"]) -> Float[np.ndarray, " 3"]:
    """Principal moments of a body that can exist, as a float64 array in the order given.

    Every moment must be finite and positive, and none may exceed the sum of the other two (equality is a thin
    plate).
    Units: kg m^2, or any common multiple of it where only ratios matter.
    Raises: `ShapeError` unless the shape is (3,); `InputError` for anything that is not a rigid body, such as
    J = (3, 1, 1/3) of Figures 2-6, 2-7 and 2-9 of Tweddle (2013).
    """
    moments = finite_vector(principal_moments, 3, "principal_moments", "kg m^2")
    for name, moment in zip(AXIS_NAMES, moments, strict=True):
        if moment <= 0.0:
            raise InputError(
                f"principal_moments: {name} = {moment:.6g} kg m^2 is not positive; give three that are"
            )
    largest = int(np.argmax(moments))
    others = float(np.delete(moments, largest).sum())
    if moments[largest] > others * (1.0 + TRIANGLE_TOLERANCE):
        raise InputError(
            f"principal_moments: {AXIS_NAMES[largest]} = {moments[largest]:.6g} kg m^2 exceeds the sum "
            f"{others:.6g} of the other two, which no rigid body has (triangle inequality); "
            f"lower it to {others:.6g} or raise the others"
        )
    return moments


def finite_vector(
    values: Float[np.ndarray, " n"], length: int, name: str, unit: str
) -> Float[np.ndarray, " n"]:
    """The vector as float64. Raises `ShapeError` on another length, `InputError` on NaN or infinity."""
    vector = np.array(values, dtype=np.float64)
    if vector.shape != (length,):
        raise ShapeError(f"{name} has shape {vector.shape}, expected ({length},) in {unit}")
    if not np.all(np.isfinite(vector)):
        raise InputError(
            f"{name} = {vector.tolist()} {unit} is not finite; replace NaN and infinity by numbers"
        )
    return vector


def angular_momentum(
    principal_moments: Float[np.ndarray, " 3"], rate: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch 3"]:
    """Angular momentum h = J w in body principal axes, kg m^2/s.

    `rate` in rad/s (Tweddle 2013, Eq. 2.78).
    """
    return principal_moments * rate


def rotational_energy(
    principal_moments: Float[np.ndarray, " 3"], rate: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch"]:
    """Rotational kinetic energy w'Jw / 2, J.

    `rate` in principal axes, rad/s (Tweddle 2013, Eq. 2.80).
    """
    return np.asarray(0.5 * np.sum(principal_moments * np.square(rate), axis=-1))
