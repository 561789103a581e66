"""Tracks in raw pixels of distorted lenses tell the motion that rectified ones tell."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from plain_comparison import plain_comparison

from spinfilters.core.cameras import monocular_camera, stereo_pair
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.io.camera import StereoRig
from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.run.readers import read_dataset
from spinfilters.settings.run_settings import FILTER, Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map

LEFT, RIGHT = (-1.0, 0.5, 0.001, -0.001), (-0.9, 0.4, -0.001, 0.0005)
SCENARIO = Scenario.simplified(rate_rpm=RICH_RPM, epochs=24, landmarks=80, seed=1)


@cache
def rectified(kind: str) -> Dataset:
    """Without distortion, of one camera with its map."""
    dataset = simulate(replace(SCENARIO, kind=kind))
    return without_map(dataset) if kind == "stereo-tracks" else dataset


def raw(kind: str) -> Dataset:
    """The same observations where distorted lenses would have put them."""
    dataset = rectified(kind)
    (stream,), rig = dataset.log.streams, dataset.rig
    assert rig is not None
    own, left = rig.calibration, replace(rig.left, distortion=LEFT)
    if isinstance(rig, StereoRig):
        distorted = replace(rig, left=left, right_distortion=RIGHT)
        points = stereo_pair(own).points_of(stream.values, own)
        values = stereo_pair(distorted.calibration).pixels_of(points, distorted.calibration)
    else:
        distorted = left
        rays = monocular_camera(own).rays_of(stream.values, own)
        values = monocular_camera(distorted.calibration).pixels_of(rays, distorted.calibration)
    assert np.abs(values - stream.values).max() > 3.0
    return replace(dataset, rig=distorted, log=MeasurementLog((replace(stream, values=values),)))


def compared(dataset: Dataset) -> tuple[Evaluation, ...]:
    """A filter and the smoother, without tests of their models."""
    return plain_comparison(dataset, Settings(estimators=("mekf", "smoother"), verdict=FILTER)).evaluations


@cache
def with_rectified(kind: str) -> tuple[Evaluation, ...]:
    """Estimates from rectified pixels."""
    return compared(rectified(kind))


@pytest.mark.parametrize("kind", ["stereo-tracks", "mono-tracks"])
def test_raw_pixels_tell_what_rectified_ones_tell(kind: str) -> None:
    """Not quite the same: the lens shrinks the noise of simulated pixels with the image."""
    for one, other in zip(compared(raw(kind)), with_rectified(kind), strict=True):
        assert one.errors is not None
        assert other.errors is not None
        assert one.errors.rms.attitude == pytest.approx(other.errors.rms.attitude, rel=0.15)
        assert one.errors.rms.rate == pytest.approx(other.errors.rms.rate, rel=0.15)


def test_raw_pixels_without_their_distortion_mislead() -> None:
    dataset = rectified("mono-tracks")
    untold = replace(raw("mono-tracks"), rig=dataset.rig)
    wrong, right = compared(untold)[1], with_rectified("mono-tracks")[1]
    assert wrong.errors is not None
    assert right.errors is not None
    assert wrong.errors.rms.position is not None
    assert right.errors.rms.position is not None
    assert wrong.errors.rms.position > 3 * right.errors.rms.position


@pytest.mark.parametrize("kind", ["stereo-tracks", "mono-tracks"])
def test_distortion_is_read_back_bit_for_bit(kind: str, tmp_path: Path) -> None:
    dataset = raw(kind)
    write_dataset(dataset, tmp_path)
    assert read_dataset(tmp_path).rig == dataset.rig
