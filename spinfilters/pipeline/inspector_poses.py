"""Poses of an inspector that are too sparse for the bends of its path: straight lines between them are off by more than noise."""

import numpy as np
from jaxtyping import Float

from spinfilters.data.sensor_format import sensor_format
from spinfilters.geometry.camera_trajectory import CameraTrajectory
from spinfilters.pipeline.setup import Setup
from spinfilters.state.blocks.rigid_body import POSITION
from spinfilters.state.status import Finding
from spinfilters.verdict.checks import finding


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
    numbers = {
        "interval": apart,
        "millimetres": 1e3 * _root_mean_square(place),
        "rotation": _root_mean_square(turn),
        "pixels": pixels,
    }
    return [finding("sparse-inspector-poses", numbers)]


def _root_mean_square(values: Float[np.ndarray, " k"]) -> float:
    return float(np.sqrt(np.mean(values**2)))
