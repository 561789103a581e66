"""What is wrong with the poses of a simulated inspector: told late, drifting, of another point, too few, or not at all."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.geometry.camera_displacements import MINUTE, displaced, drifting, levered, turning
from spinfilters.geometry.camera_trajectory import CameraTrajectory
from spinfilters.simulation.inspector import InspectorPath

AXIS: Final = np.array([0.6, -0.48, 0.64])
"""Of errors with a direction, axes i: unit length, and none of the frames' axes."""
MOST_LATE: Final = 10.0
"""s."""
FARTHEST: Final = 1e6
"""Of a drift of places and of a lever arm, m."""
SPARSEST: Final = 1e4
"""s: a path is followed to the pose behind the last epoch."""


@dataclass(frozen=True)
class ToldPoses:
    """What is told of an inspector.

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
        Told poses with the error, from right ones and its size; None where nothing is told.
    smallest, largest : float
        Of its size; a largest of zero of an error without a size.
    """

    words: str
    apply: Callable[[ToldPoses, float], ToldPoses | None]
    largest: float
    smallest: float = 1e-6


def _late(told: ToldPoses, size: float) -> ToldPoses:
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
    """Poses every ``size`` s, the last at or behind the last epoch."""
    first, last = float(told.time[0]), float(told.time[-1])
    steps = int(np.ceil((last - first) / size))
    steps += first + size * steps < last  # by rounding
    return replace(told, time=first + size * np.arange(steps + 1))


def _missing(told: ToldPoses, size: float) -> None:
    return None


INSPECTOR_ERRORS: Final[Mapping[str, InspectorError]] = MappingProxyType(
    {
        "late": InspectorError("poses are stamped so many s late", _late, largest=MOST_LATE),
        "turning": InspectorError(
            "attitudes drift by so many rad over the recording", _turning, largest=np.pi
        ),
        "drifting": InspectorError(
            "places drift by so many m over the recording", _drifting, largest=FARTHEST
        ),
        "lever": InspectorError(
            "poses are of a point of the inspector that is so many m from its camera",
            _levered,
            largest=FARTHEST,
        ),
        "sparse": InspectorError("a pose every so many s only", _sparse, smallest=1e-3, largest=SPARSEST),
        "missing": InspectorError("no poses at all, as of a forgotten inspector.tum", _missing, largest=0.0),
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
    """The trajectory that is told of an inspector, with all its errors; None where none is."""
    told: ToldPoses | None = ToldPoses(path, time)
    for name, size in errors.items():
        if told is not None:
            told = INSPECTOR_ERRORS[name].apply(told, size)
    return None if told is None else told.trajectory
