"""Poses of an inspector that are too sparse for the bends of its path: straight lines between them are off by more than noise."""

from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.sensor_format import sensor_format
from spinfilters.geometry.camera_trajectory import CameraTrajectory
from spinfilters.pipeline.setup import Setup
from spinfilters.state.blocks.rigid_body import POSITION
from spinfilters.state.status import Finding
from spinfilters.verdict.checks import finding

ROUNDING: Final = 1e-9
"""m and rad: smaller errors of an interpolation are rounding of numbers, not bends of a path."""


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
    pixels = _rms(float(rig.calibration[0]) * (place / distance + turn))
    seen = sum(len(each) for each in streams) / len(epochs)
    if not pixels > setup.noise.pixel_std / np.sqrt(seen):
        return []
    apart = float(np.median(np.diff(trajectory.time)))
    off, turned = (size if size > ROUNDING else 0.0 for size in (_rms(place), _rms(turn)))
    numbers = {"interval": apart, "millimetres": 1e3 * off, "rotation": turned, "pixels": pixels}
    return [finding("sparse-inspector-poses", numbers)]


def _rms(values: Float[np.ndarray, " k"]) -> float:
    return float(np.sqrt(np.mean(values**2)))
