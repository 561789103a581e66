"""Every parametrisation of an attitude: to every other, and its rate from the body rate and back.

    a = convert(q, "quaternion", "mrp4")
    rate = parameter_rate(a, body_rate, "mrp4")
    w = body_rate(a, rate, "mrp4")

The attitude is q_ib, body to inertial (`spinfilters.core.conventions`), and the rate w is that of the body in body axes, rad/s.
Tweddle (2013), section 2.2, prints most of these for the inverse rotation; the signs here are those of q_ib.

| name | numbers | formula of the rate |
|---|---|---|
| quaternion | [x, y, z, w] | q' = q (x) [w, 0] / 2 (Eq. 2.39) |
| matrix | R_ib, 3 x 3 | R' = R [w x] |
| mrp | s = tan(angle / 4) n | s' = ((1 - s's) I + 2 [s x] + 2 s s') w / 4 (Eq. 2.47) |
| mrp4 | a = 4 s | a' = 4 s' |
| rotation-vector | r = angle n | r' = w + r x w / 2 + c r x (r x w), c = (1 - (angle / 2) cot(angle / 2)) / angle^2 |
| axis-angle | [n, angle] | angle' = n.w, n' = (n x w + cot(angle / 2) (w - n n.w)) / 2 |
| euler321 | yaw, pitch, roll [y, p, r] | w = [r' - y' sin p, p' cos r + y' cos p sin r, y' cos p cos r - p' sin r] |

All functions take arrays with any leading axes. Where a parametrisation has no finite rate (Euler angles at a pitch of
+-90 degrees, an axis at angle 0), `InputError` says so.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core import attitude_conversions as conversions
from spinfilters.core.attitude_conversions import axial_vector, cross_matrix, finite_array
from spinfilters.core.errors import InputError, ShapeError

Array = np.ndarray

SMALL_ANGLE: Final[float] = 1e-3
"""Below this angle, rad, trigonometric coefficients are replaced by their series, whose next term is below rounding there."""
SINGULAR: Final[float] = 1e-8
"""Cosine of the pitch, or angle in rad, below which a parametrisation has no rate that double precision can resolve."""


@dataclass(frozen=True)
class Parametrisation:
    """One way to write an attitude in numbers.

    Parameters
    ----------
    name : str
        Its name in `convert`, `parameter_rate` and `body_rate`.
    shape : tuple of int
        Shape of the numbers of one attitude.
    to_quaternion, from_quaternion : callable
        To and from the unit quaternion q_ib, over leading axes.
    rate : callable
        Rate of the numbers from the numbers and the body rate (rad/s).
    body_rate : callable
        Body rate from the numbers and their rate.
    """

    name: str
    shape: tuple[int, ...]
    to_quaternion: Callable[[Array], Array]
    from_quaternion: Callable[[Array], Array]
    rate: Callable[[Array, Array], Array]
    body_rate: Callable[[Array, Array], Array]


def convert(attitude: Array, source: str, target: str) -> Array:
    """The same attitude in another parametrisation.

    Parameters
    ----------
    attitude : np.ndarray
        Numbers of the source, over any leading axes (see the table of the module).
    source, target : str
        ``quaternion``, ``matrix``, ``mrp``, ``mrp4``, ``rotation-vector``, ``axis-angle`` or ``euler321``.

    Returns
    -------
    np.ndarray
        Numbers of the target: the short way round, and a quaternion with a non-negative scalar part unless it was given as one.

    Raises
    ------
    InputError
        An unknown name, numbers that are not finite, not of unit norm or no rotation.
    ShapeError
        Numbers of another shape.
    """
    given, asked = parametrisation(source), parametrisation(target)
    return asked.from_quaternion(given.to_quaternion(_shaped(attitude, given, "attitude")))


def parameter_rate(attitude: Array, body_rate: Float[Array, "*batch 3"], name: str) -> Array:
    """Time derivative of an attitude's numbers at a body rate.

    Parameters
    ----------
    attitude : np.ndarray
        Numbers of the parametrisation, over any leading axes.
    body_rate : Float[np.ndarray, "*batch 3"]
        Body rate in body axes, rad/s.
    name : str
        Name of the parametrisation.

    Returns
    -------
    np.ndarray
        Rate of the numbers, 1/s or rad/s.

    Raises
    ------
    InputError
        An unknown name, or an attitude at which this parametrisation has no finite rate.
    """
    chosen = parametrisation(name)
    return chosen.rate(_shaped(attitude, chosen, "attitude"), finite_array("body_rate", body_rate, 3))


def body_rate(attitude: Array, rate: Array, name: str) -> Float[Array, "*batch 3"]:
    """Body rate (rad/s, body axes) of an attitude whose numbers change at a given rate.

    Parameters
    ----------
    attitude : np.ndarray
        Numbers of the parametrisation, over any leading axes.
    rate : np.ndarray
        Their time derivative; what would leave the set of attitudes (the change of a quaternion's norm, say) is left out.
    name : str
        Name of the parametrisation.

    Raises
    ------
    InputError
        An unknown name, or numbers that are not finite.
    """
    chosen = parametrisation(name)
    return chosen.body_rate(_shaped(attitude, chosen, "attitude"), finite_array("rate", rate, *chosen.shape))


def parametrisation(name: str) -> Parametrisation:
    """The parametrisation of a name, or `InputError` with all names."""
    found = _BY_NAME.get(name)
    if found is None:
        raise InputError(f"parametrisation {name!r} is unknown; use {', '.join(_BY_NAME)}")
    return found


def rate_from_attitudes(
    time: Float[Array, " n"], attitude: Float[Array, "n 4"]
) -> tuple[Float[Array, " m"], Float[Array, "m 3"]]:
    """Body rate between the attitudes of a recording, from differences of continuous quaternions (Tweddle 2013, Eq. 6.13).

    The thesis divides the difference of two quaternions by the interval and maps it with 2 q^-1; here the rotation vector from one
    attitude to the next is divided by the interval, which is exact for a constant rate and of second order at its middle otherwise.

    Parameters
    ----------
    time : Float[np.ndarray, " n"]
        Times, s, increasing; at least two.
    attitude : Float[np.ndarray, "n 4"]
        q_ib, Hamilton, scalar last; signs need not be continuous.

    Returns
    -------
    time : Float[np.ndarray, " m"]
        Middles of the intervals, s; m = n - 1.
    rate : Float[np.ndarray, "m 3"]
        Body rate, rad/s, in body axes. Turns by more than 180 degrees between two attitudes cannot be seen.

    Raises
    ------
    InputError
        Times that do not increase, or numbers that are not finite or not of unit norm.
    ShapeError
        Fewer than two attitudes, or not one time for each.
    """
    time, q = finite_array("time", time), finite_array("attitude", attitude, 4)
    if time.ndim != 1 or len(time) < 2 or q.shape != (len(time), 4):
        raise ShapeError(f"time must be (n,) with n > 1 and attitude (n, 4), got {time.shape} and {q.shape}")
    intervals = np.diff(time)
    if not np.all(intervals > 0):
        k = int(np.argmin(intervals > 0))
        raise InputError(
            f"time[{k + 1}] = {time[k + 1]:g} s does not exceed the one before; sort the attitudes"
        )
    turns = conversions.multiply(conversions.inverse(q[:-1]), q[1:])
    rates = conversions.rotation_vector_from_quaternion(turns) / intervals[:, np.newaxis]
    return (time[:-1] + time[1:]) / 2, rates


def inertial_acceleration(
    position: Float[Array, "*batch 3"],
    velocity: Float[Array, "*batch 3"],
    acceleration: Float[Array, "*batch 3"],
    body_rate: Float[Array, "*batch 3"],
    body_acceleration: Float[Array, "*batch 3"],
) -> tuple[Float[Array, "*batch 3"], dict[str, Float[Array, "*batch 3"]]]:
    """Acceleration in an inertial frame of a point that is described in turning body axes (Tweddle 2013, section 2.2).

    a = a_rel + w' x r + 2 w x v_rel + w x (w x r), all in body axes.

    Parameters
    ----------
    position, velocity, acceleration : Float[np.ndarray, "*batch 3"]
        r, v_rel, a_rel of the point as seen in body axes; m, m/s, m/s^2.
    body_rate, body_acceleration : Float[np.ndarray, "*batch 3"]
        w and w' in body axes; rad/s, rad/s^2.

    Returns
    -------
    total : Float[np.ndarray, "*batch 3"]
        Inertial acceleration in body axes, m/s^2.
    terms : dict
        Its terms ``relative``, ``euler``, ``coriolis`` and ``centripetal``, m/s^2.
    """
    r, v, a, w, dw = (
        finite_array(name, value, 3)
        for value, name in (
            (position, "position"),
            (velocity, "velocity"),
            (acceleration, "acceleration"),
            (body_rate, "body_rate"),
            (body_acceleration, "body_acceleration"),
        )
    )
    terms = {
        "relative": a,
        "euler": np.cross(dw, r),
        "coriolis": 2.0 * np.cross(w, v),
        "centripetal": np.cross(w, np.cross(w, r)),
    }
    return np.asarray(sum(terms.values())), terms


# One block a parametrisation: rate, then body rate.


def _quaternion_rate(q: Array, w: Array) -> Array:
    return 0.5 * conversions.quaternion_product(q, _append_scalar(w, np.zeros(w.shape[:-1])))


def _body_rate_of_quaternion(q: Array, rate: Array) -> Array:
    conjugate = q * np.array([-1.0, -1.0, -1.0, 1.0])
    return 2.0 * conversions.quaternion_product(conjugate, rate)[..., :3]


def _matrix_rate(R: Array, w: Array) -> Array:
    return R @ cross_matrix(w)


def _body_rate_of_matrix(R: Array, rate: Array) -> Array:
    return axial_vector(np.swapaxes(R, -1, -2) @ rate)


def _mrp_rate(s: Array, w: Array) -> Array:
    square = _dot(s, s)
    return ((1.0 - square) * w + 2.0 * np.cross(s, w) + 2.0 * s * _dot(s, w)) / 4.0


def _body_rate_of_mrp(s: Array, rate: Array) -> Array:
    square = _dot(s, s)
    turned = (1.0 - square) * rate - 2.0 * np.cross(s, rate) + 2.0 * s * _dot(s, rate)
    return 4.0 * turned / np.square(1.0 + square)


def _mrp4_rate(a: Array, w: Array) -> Array:
    return 4.0 * _mrp_rate(a / 4.0, w)


def _body_rate_of_mrp4(a: Array, rate: Array) -> Array:
    return _body_rate_of_mrp(a / 4.0, rate / 4.0)


def _rotation_vector_rate(r: Array, w: Array) -> Array:
    angle = np.linalg.norm(r, axis=-1, keepdims=True)
    if np.any(np.abs(np.sin(angle / 2.0)) < SINGULAR, where=angle > 1.0):
        raise InputError(
            "attitude: a rotation vector of a whole turn has no rate; use the short way round, below pi rad"
        )
    small = angle < SMALL_ANGLE
    safe = np.where(small, 1.0, angle)
    c = np.where(small, 1.0 / 12.0 + angle**2 / 720.0, (1.0 - safe / 2.0 / np.tan(safe / 2.0)) / safe**2)
    across = np.cross(r, w)
    return w + across / 2.0 + c * np.cross(r, across)


def _body_rate_of_rotation_vector(r: Array, rate: Array) -> Array:
    angle = np.linalg.norm(r, axis=-1, keepdims=True)
    small = angle < SMALL_ANGLE
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5 - angle**2 / 24.0, 2.0 * np.square(np.sin(safe / 2.0) / safe))
    second = np.where(small, 1.0 / 6.0 - angle**2 / 120.0, (safe - np.sin(safe)) / safe**3)
    across = np.cross(r, rate)
    return rate - first * across + second * np.cross(r, across)


def _axis_angle_rate(value: Array, w: Array) -> Array:
    axis, angle = value[..., :3], value[..., 3:]
    if np.any(np.abs(np.sin(angle / 2.0)) < SINGULAR):
        raise InputError(
            "attitude: an axis has no rate at an angle of 0; use a rotation vector or a quaternion there"
        )
    along = _dot(axis, w)
    axis_rate = (np.cross(axis, w) + (w - axis * along) / np.tan(angle / 2.0)) / 2.0
    return np.concatenate([axis_rate, along], axis=-1)


def _body_rate_of_axis_angle(value: Array, rate: Array) -> Array:
    axis, angle = value[..., :3], value[..., 3:]
    axis_rate, angle_rate = rate[..., :3] - axis * _dot(axis, rate[..., :3]), rate[..., 3:]
    return axis * angle_rate + np.sin(angle) * axis_rate - (1.0 - np.cos(angle)) * np.cross(axis, axis_rate)


def _euler321_rate(angles: Array, w: Array) -> Array:
    _, theta, phi = np.moveaxis(angles, -1, 0)
    if np.any(np.abs(np.cos(theta)) < SINGULAR):
        raise InputError(
            "attitude: Euler angles have no rate at a pitch of +-90 degrees; use a quaternion there"
        )
    p, q, r = np.moveaxis(np.broadcast_to(w, np.broadcast_shapes(w.shape, angles.shape)), -1, 0)
    yaw = (q * np.sin(phi) + r * np.cos(phi)) / np.cos(theta)
    pitch = q * np.cos(phi) - r * np.sin(phi)
    return np.stack([yaw, pitch, p + yaw * np.sin(theta)], axis=-1)


def _body_rate_of_euler321(angles: Array, rate: Array) -> Array:
    _, theta, phi = np.moveaxis(angles, -1, 0)
    yaw, pitch, roll = np.moveaxis(rate, -1, 0)
    x = roll - yaw * np.sin(theta)
    y = pitch * np.cos(phi) + yaw * np.cos(theta) * np.sin(phi)
    z = yaw * np.cos(theta) * np.cos(phi) - pitch * np.sin(phi)
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1)


def _dot(a: Array, b: Array) -> Array:
    return np.sum(a * b, axis=-1, keepdims=True)


def _append_scalar(vector: Array, scalar: Array) -> Array:
    return np.concatenate([vector, scalar[..., np.newaxis]], axis=-1)


def _shaped(attitude: Array, form: Parametrisation, name: str) -> Array:
    return finite_array(f"{name} ({form.name})", attitude, *form.shape)


PARAMETRISATIONS: Final[tuple[Parametrisation, ...]] = (
    Parametrisation(
        "quaternion", (4,), conversions.unit_quaternion, np.array, _quaternion_rate, _body_rate_of_quaternion
    ),
    Parametrisation(
        "matrix",
        (3, 3),
        conversions.quaternion_from_matrix,
        conversions.matrix_from_quaternion,
        _matrix_rate,
        _body_rate_of_matrix,
    ),
    Parametrisation(
        "mrp",
        (3,),
        lambda s: conversions.quaternion_from_mrp(4.0 * s),
        lambda q: conversions.mrp_from_quaternion(q) / 4.0,
        _mrp_rate,
        _body_rate_of_mrp,
    ),
    Parametrisation(
        "mrp4",
        (3,),
        conversions.quaternion_from_mrp,
        conversions.mrp_from_quaternion,
        _mrp4_rate,
        _body_rate_of_mrp4,
    ),
    Parametrisation(
        "rotation-vector",
        (3,),
        conversions.quaternion_from_rotation_vector,
        conversions.rotation_vector_from_quaternion,
        _rotation_vector_rate,
        _body_rate_of_rotation_vector,
    ),
    Parametrisation(
        "axis-angle",
        (4,),
        lambda value: conversions.quaternion_from_axis_angle(value[..., :3], value[..., 3]),
        lambda q: _append_scalar(*conversions.axis_angle_from_quaternion(q)),
        _axis_angle_rate,
        _body_rate_of_axis_angle,
    ),
    Parametrisation(
        "euler321",
        (3,),
        conversions.quaternion_from_euler321,
        conversions.euler321_from_quaternion,
        _euler321_rate,
        _body_rate_of_euler321,
    ),
)
_BY_NAME: Final[dict[str, Parametrisation]] = {each.name: each for each in PARAMETRISATIONS}
