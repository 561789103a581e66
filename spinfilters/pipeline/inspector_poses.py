"""Poses of an inspector that are too sparse for the bends of its path, or that repeat while it moves."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.sensor_format import sensor_format
from spinfilters.geometry.camera_trajectory import CameraTrajectory
from spinfilters.pipeline.setup import Setup
from spinfilters.state.blocks.rigid_body import POSITION
from spinfilters.state.status import Finding
from spinfilters.verdict.checks import finding

FEWEST_REPEATS: Final = 3
"""Intervals of one pose, from which it has not come about by rounding."""
ROUNDING: Final = 1e-9
"""m and rad: smaller errors of an interpolation are rounding of numbers, not bends of a path."""
ABRUPT: Final = 0.5
"""Of the step beside a repeated pose in the one before it, from which the camera did not come to rest: evenly braked it is 1/3."""


def pose_findings(setup: Setup) -> list[Finding]:
    """Findings about the given poses of an inspector."""
    return [*sparse_poses(setup), *repeated_poses(setup)]


def repeated_poses(setup: Setup) -> list[Finding]:
    """Findings where poses of a moving inspector stop from one to the next, as of a tracker that is lost or a log that ends."""
    trajectory = CameraTrajectory.of(setup.dataset.inspector)
    if trajectory is None:
        return []
    return [
        finding("repeated-inspector-poses", {"begin": begin, "end": end})
        for begin, end in repeats(trajectory)
    ]


def repeats(trajectory: CameraTrajectory) -> Iterator[tuple[float, float]]:
    """First and last time of each pose that repeats exactly right behind, or before, poses that move on evenly."""
    steps = np.abs(np.diff(trajectory.poses, axis=0)).max(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], steps > 0, [True]]).astype(int)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        before, behind = steps[:first][::-1][:2], steps[last:][:2]
        is_abrupt = any(len(pair) == 2 and pair[0] > ABRUPT * pair[1] for pair in (before, behind))
        if last - first >= FEWEST_REPEATS and is_abrupt:
            yield float(trajectory.time[first]), float(trajectory.time[last])


def sparse_poses(setup: Setup) -> list[Finding]:
    """A finding where interpolated poses of the inspector are off by more than noise leaves of an epoch's pose.

    The errors of the interpolation follow from how its poses bend; in pixels they are common to an image, and compared with the
    pixel noise over the root of its observations.
    """
    dataset = setup.dataset
    trajectory, rig = CameraTrajectory.of(dataset.inspector), dataset.rig
    streams = [each for each in dataset.log.streams if sensor_format(each.sensor).calibration is not None]
    if trajectory is None or rig is None or not streams or setup.initial.has_failed:
        return []
    epochs = np.unique(np.concatenate([each.time for each in streams]))
    place, turn = trajectory.interpolation_errors(epochs)
    first = epochs[: len(setup.initial.mean)]
    body = setup.initial.mean[: len(first), setup.process.layout.mean_slice(POSITION.name)]
    distance = float(np.median(np.linalg.norm(body - trajectory.at(first)[:, :3], axis=1)))
    pixels = _root_mean_square(float(rig.calibration[0]) * (place / distance + turn))
    seen = sum(len(each) for each in streams) / len(epochs)
    if not pixels > setup.noise.pixel_std / np.sqrt(seen):
        return []
    apart = float(np.median(np.diff(trajectory.time)))
    off, turned = (
        size if size > ROUNDING else 0.0 for size in (_root_mean_square(place), _root_mean_square(turn))
    )
    numbers = {"interval": apart, "millimetres": 1e3 * off, "rotation": turned, "pixels": pixels}
    return [finding("sparse-inspector-poses", numbers)]


def _root_mean_square(values: Float[np.ndarray, " k"]) -> float:
    return float(np.sqrt(np.mean(values**2)))
