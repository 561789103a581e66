"""Motion of the inspector: circling, limit cycles of its attitude control, and errors of its known poses."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import inverse, multiply, quaternion_from_rotation_vector, rotate
from spinfilters.core.camera_trajectory import MINUTE, CameraTrajectory, displaced, drifting, levered, turning
from spinfilters.core.errors import InputError

LEAD = 20.0
"""Simulated before time zero, s: further back the cycle is as it was then."""
SHORTEST = 1e-6
"""Of an arc, s: an edge that it begins at is not where it ends."""
SPREAD = 0.2
"""Of the velocity after a pulse, relative."""
MOST_ARCS = 4000
"""Drawn; after them the cycle repeats from the first arc that begins at the same edge. Of an inspector that is some hours."""


def limit_cycle(
    band: float, pulse: float, push: float, generator: np.random.Generator
) -> Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " n"]]:
    """Coordinate over time, s.

    Between pulses x'' is constant; at an edge of the band a pulse turns the velocity inwards.

    Parameters
    ----------
    band : float
        Either way, m or rad.
    pulse : float
        Mean velocity after a pulse, per s.
    push : float
        Largest constant acceleration, per s^2; drawn, of either sign.
    """
    acceleration = float(generator.uniform(-push, push))
    start, place = [-LEAD], [float(generator.uniform(-band, band))]
    velocity = [pulse * float(generator.choice([-1.0, 1.0]))]
    strength = np.random.default_rng(int(generator.integers(2**32)))

    def extended(until: float) -> None:
        """Arcs up to a time, or as many as are drawn and one at whose edge an earlier one begins."""
        while start[-1] < until and (len(start) <= MOST_ARCS or place[-1] not in place[1:-1]):
            duration, edge = _exit_from_band(place[-1], velocity[-1], acceleration, band)
            start.append(start[-1] + duration)
            place.append(edge)
            velocity.append(-np.sign(edge) * pulse * (1 + SPREAD * float(strength.uniform(-1, 1))))

    def repeated(time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Times, those after the last arc in the cycle that repeats."""
        if np.max(time) <= start[-1]:
            return time
        begin, end = start[place.index(place[-1], 1)], start[-1]
        return np.where(time > end, begin + (time - begin) % (end - begin), time)

    def at(time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Coordinates."""
        extended(float(np.max(time)))
        time = repeated(time)
        arc = np.clip(np.searchsorted(start, time, side="right") - 1, 0, None)
        since = time - np.array(start)[arc]
        return np.array(place)[arc] + np.array(velocity)[arc] * since + acceleration * since**2 / 2

    return at


def _exit_from_band(x: float, v: float, a: float, band: float) -> tuple[float, float]:
    """Time until a parabola leaves the band, and the edge where it does."""
    found = []
    for edge in (-band, band):
        roots = np.roots([a / 2, v, x - edge]) if a else np.array([(edge - x) / v])
        found += [(float(np.real(t)), edge) for t in roots if np.isreal(t) and np.real(t) > SHORTEST]
    return min(found)


InspectorPath = Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, "n 7"]]
"""Poses (t_ic m, q_ic) in frame i at times since the first epoch, s, before it and after the last, too; i is that of time zero."""

STATIC: Final = "static"
"""Of an inspector that does not move, so that frame i is its camera's."""
CIRCLE_PERIOD: Final = 60.0
"""Of a circle about the body, s."""
SWAY_PERIODS: Final = np.array([[23.0, 31.0, 37.0], [19.0, 29.0, 17.0]])
"""Of place and attitude about every axis, s: no two of them agree."""
SWAY: Final = np.array([[0.05], [0.05]])
"""Amplitudes of place, m, and attitude, rad."""
BAND: Final = np.array([[0.008], [0.015]])
"""Dead band of place, m, and attitude, rad, either way."""
PULSE: Final = np.array([[0.002], [0.004]])
"""Velocity after a pulse of the thrusters, m/s and rad/s."""
PUSH: Final = np.array([[1e-4], [2e-4]])
"""Largest constant acceleration between pulses, m/s^2 and rad/s^2."""


def circle(centre: Float[np.ndarray, " 3"], seed: int = 0) -> InspectorPath:
    """Circle in the xz plane about a point in view, m, frame i.

    It goes round -y, against the spin of the scenarios' bodies: an inspector that flies along with a body sees it rotate less, and
    learns less of it (a tenth less, once a minute for a body of 10 rpm).
    """

    def path(time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 7"]:
        """Poses that look at the centre."""
        angles = -2 * np.pi / CIRCLE_PERIOD * time
        q = quaternion_from_rotation_vector(angles[:, None] * np.array([0.0, 1.0, 0.0]))
        return np.concatenate([centre - rotate(q, np.tile(centre, (len(time), 1))), q], axis=1)

    return path


def sway(centre: Float[np.ndarray, " 3"], seed: int = 0) -> InspectorPath:
    """Place and attitude that swing about every axis, each with a period of its own."""

    def path(time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 7"]:
        """Poses, the identity at time zero."""
        swung = SWAY[:, :, None] * np.sin(2 * np.pi * time / SWAY_PERIODS[:, :, None])
        return _poses(swung)

    return path


def dead_band(centre: Float[np.ndarray, " 3"], seed: int = 0) -> InspectorPath:
    """Limit cycle of thrusters that fire where place or attitude leave a dead band: parabolas in between."""
    generator = np.random.default_rng([seed, 7])
    cycles = [
        [limit_cycle(float(band), float(pulse), float(push), generator) for _ in range(3)]
        for (band,), (pulse,), (push,) in zip(BAND, PULSE, PUSH, strict=True)
    ]

    def path(time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 7"]:
        """Poses in the frame of the one at time zero."""
        poses = _poses(np.array([[cycle(time) for cycle in three] for three in cycles]))
        begin = _poses(np.array([[cycle(np.zeros(1)) for cycle in three] for three in cycles]))[0]
        back = inverse(begin[3:])
        place = rotate(np.tile(back, (len(time), 1)), poses[:, :3] - begin[:3])
        return np.concatenate([place, multiply(np.tile(back, (len(time), 1)), poses[:, 3:])], axis=1)

    return path


def _poses(coordinates: Float[np.ndarray, "2 3 n"]) -> Float[np.ndarray, "n 7"]:
    """Poses of places and rotation vectors."""
    place, turned = coordinates.transpose(0, 2, 1)
    return np.concatenate([place, quaternion_from_rotation_vector(turned)], axis=1)


INSPECTORS: Final[Mapping[str, Callable[[Float[np.ndarray, " 3"], int], InspectorPath] | None]] = (
    MappingProxyType({STATIC: None, "circle": circle, "sway": sway, "dead-band": dead_band})
)
"""By name: from the body's place (3,) m in i and a seed to a path."""


AXIS: Final = np.array([0.6, -0.48, 0.64])
"""Of errors with a direction, axes i: unit length, and none of the frames' axes."""
MOST_LATE: Final = 10.0
"""s."""
FARTHEST: Final = 1e6
"""Of a drift of places and of a lever arm, m."""
SPARSEST: Final = 1e4
"""s: a path is followed to the pose after the last epoch."""


@dataclass(frozen=True)
class ToldPoses:
    """Poses of an inspector as they are stated.

    Attributes
    ----------
    path : InspectorPath
        Poses by time since the first epoch.
    time : (n,)
        Of the poses, s.
    """

    path: InspectorPath
    time: Float[np.ndarray, " n"]

    @property
    def trajectory(self) -> CameraTrajectory:
        """Poses at all times."""
        return CameraTrajectory(self.time, self.path(self.time - self.time[0]))


@dataclass(frozen=True)
class InspectorError:
    """One thing that can be wrong.

    Attributes
    ----------
    words : str
        What it does, with the unit of its size.
    apply : Callable
        Stated poses with the error, from right ones and its size; None where none are stated.
    smallest, largest : float
        Of its size; a largest of zero of an error without a size.
    """

    words: str
    apply: Callable[[ToldPoses, float], ToldPoses | None]
    largest: float
    smallest: float = 1e-6


def _delay_poses(told: ToldPoses, size: float) -> ToldPoses:
    return replace(told, path=lambda time: told.path(time - size))


def _turning(told: ToldPoses, size: float) -> ToldPoses:
    def path(time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 7"]:
        """Attitudes that drift by the size from the first pose to the last."""
        poses = told.path(time)
        return displaced(poses, turning(time, poses) @ (size * AXIS * _per_recording(told)))

    return replace(told, path=path)


def _drifting(told: ToldPoses, size: float) -> ToldPoses:
    def path(time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 7"]:
        """Places that drift by the size from the first pose to the last."""
        poses = told.path(time)
        return displaced(poses, drifting(time, poses) @ (size * AXIS * _per_recording(told)))

    return replace(told, path=path)


def _levered(told: ToldPoses, size: float) -> ToldPoses:
    def path(time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 7"]:
        """Places of a point of the inspector that is so far from its camera, in the camera's axes."""
        poses = told.path(time)
        return displaced(poses, levered(time, poses) @ (size * AXIS))

    return replace(told, path=path)


def _per_recording(told: ToldPoses) -> float:
    return MINUTE / float(told.time[-1] - told.time[0])


def _sparse(told: ToldPoses, size: float) -> ToldPoses:
    """Poses every ``size`` s, the last at or after the last epoch."""
    first, last = float(told.time[0]), float(told.time[-1])
    steps = int(np.ceil((last - first) / size))
    steps += first + size * steps < last  # by rounding
    return replace(told, time=first + size * np.arange(steps + 1))


INSPECTOR_ERRORS: Final[Mapping[str, InspectorError]] = MappingProxyType(
    {
        "late": InspectorError("poses are stamped so many s late", _delay_poses, largest=MOST_LATE),
        "turning": InspectorError(
            "attitudes drift by so many rad over the recording", _turning, largest=np.pi
        ),
        "drifting": InspectorError(
            "positions drift by so many m over the recording", _drifting, largest=FARTHEST
        ),
        "lever": InspectorError(
            "poses are of a point of the inspector that is so many m from its camera",
            _levered,
            largest=FARTHEST,
        ),
        "sparse": InspectorError("a pose every so many s only", _sparse, smallest=1e-3, largest=SPARSEST),
        "missing": InspectorError(
            "no poses at all, as if inspector.tum were forgotten", lambda told, size: None, largest=0.0
        ),
    }
)
"""By name."""


def require_inspector_errors(errors: Mapping[str, float]) -> None:
    """Require errors by name and size. InputError: an unknown one, or a size that it cannot have."""
    for name, size in errors.items():
        if name not in INSPECTOR_ERRORS:
            raise InputError(f"inspector error {name!r} is unknown; use one of {', '.join(INSPECTOR_ERRORS)}")
        error = INSPECTOR_ERRORS[name]
        if error.largest and not (np.isfinite(size) and error.smallest <= size <= error.largest):
            raise InputError(
                f"inspector error {name} of size {size}: {error.words}; give a size of {error.smallest:g} to {error.largest:.4g}"
            )


def told_trajectory(
    path: InspectorPath, time: Float[np.ndarray, " n"], errors: Mapping[str, float]
) -> CameraTrajectory | None:
    """The stated trajectory of an inspector, with all its errors; None where none is."""
    told: ToldPoses | None = ToldPoses(path, time)
    for name, size in errors.items():
        if told is not None:
            told = INSPECTOR_ERRORS[name].apply(told, size)
    return None if told is None else told.trajectory
