"""Errors of a camera pair, of its holder, and of the unit of lengths."""

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.data.dataset import Dataset
from spinfilters.data.measurement_log import MeasurementLog
from spinfilters.simulation.model_faults.model_fault import POSE, TRACKS, FaultyView, ModelFault

ONLY: Final = (TRACKS,)
NAMES: Final = ("fx", "fy", "cx", "cy", "baseline")
RIGHT: Final = np.array([0.0, 0.0, 1.0])
Pixels = Float[np.ndarray, "n 3"]


def _projected(points: Pixels, calibration: Float[np.ndarray, " c"], k1: float = 0.0) -> Pixels:
    """(u_left, v, u_right) px, of a lens with x (1 + k1 r^2)."""
    fx, fy, cx, cy, baseline = calibration[:5]
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    right = (points[:, 0] - baseline) / points[:, 2]
    left_by, right_by = 1 + k1 * (x * x + y * y), 1 + k1 * (right * right + y * y)
    return np.stack([fx * x * left_by + cx, fy * y * left_by + cy, fx * right * right_by + cx], axis=1)


def _changed(view: FaultyView, k1: float = 0.0, **by: float) -> Pixels:
    """Difference that another calibration makes."""
    other = view.calibration.copy()
    for name, value in by.items():
        other[NAMES.index(name)] += value
    return _projected(view.points, other, k1) - _projected(view.points, view.calibration)


def _focal(view: FaultyView) -> Pixels:
    return _changed(view, fx=view.size * view.calibration[0], fy=view.size * view.calibration[1])


def _centre(view: FaultyView) -> Pixels:
    return _changed(view, cx=view.size, cy=-view.size)


def _distorted(view: FaultyView) -> Pixels:
    return _changed(view, k1=view.size)


def _baseline(view: FaultyView) -> Pixels:
    return _changed(view, baseline=view.size * view.calibration[4])


def _late(view: FaultyView) -> Pixels:
    ahead = _projected(view.points + view.size * view.per_second, view.calibration)
    return (ahead - _projected(view.points, view.calibration)) * RIGHT


def _turned(view: FaultyView) -> Pixels:
    x = (view.points[:, 0] - view.calibration[4]) / view.points[:, 2]
    y = view.points[:, 1] / view.points[:, 2]
    by = view.size * view.calibration[0] * (0.3 * (1 + x * x) + x * y + y)
    return by[:, None] * RIGHT


def _shake(view: FaultyView) -> Pixels:
    shift = view.generator.standard_normal((int(view.epoch.max()) + 1, 2))
    return view.size * shift[view.epoch][:, [0, 1, 0]]


def _unit(dataset: Dataset, size: float) -> Dataset:
    """Lengths ``size`` times too large: 1000 for mm that are read as m."""
    if dataset.rig is not None and dataset.rig.baseline_m:
        return replace(dataset, rig=replace(dataset.rig, baseline_m=size * dataset.rig.baseline_m))
    (stream,) = dataset.log.streams
    values = np.concatenate([size * stream.values[:, :3], stream.values[:, 3:]], axis=1)
    return replace(dataset, log=MeasurementLog((replace(stream, values=values),)))


FAULTS: Final = (
    ModelFault("camera-shake", 1.0, ONLY, pixels=_shake),
    ModelFault("right-camera-late", 5e-3, ONLY, pixels=_late),
    ModelFault("right-camera-turned", 5e-3, ONLY, pixels=_turned),
    ModelFault("focal-length", 0.03, ONLY, pixels=_focal),
    ModelFault("principal-point", 5.0, ONLY, pixels=_centre),
    ModelFault("distortion", 0.1, ONLY, pixels=_distorted),
    ModelFault("baseline", 0.03, ONLY, pixels=_baseline),
    ModelFault("length-unit", 1e3, (POSE, TRACKS), recording=_unit),
)
