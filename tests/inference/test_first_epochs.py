"""The first epochs at other noise: from the estimate that there is, with its map, its associations and its motion."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from spinfilters.filters.timeline import SensorNoise, build_timeline
from spinfilters.inference import first_epochs
from spinfilters.inference.first_epochs import LARGEST_SHARE, FirstEpochs, SampledEpochs
from spinfilters.inference.initial_estimate import InitialEstimate
from spinfilters.inference.setup import camera_view
from spinfilters.io.dataset import Dataset
from spinfilters.models.body import body_estimate
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.models.tracks import track_poses
from spinfilters.settings.run_settings import InitialisationOptions
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map

PROCESS = TorqueFreeProcess(StateLayout(FULL_BLOCKS), ProcessNoise(1e-6, 1e-6))
OPTIONS = InitialisationOptions(epochs=32, share=LARGEST_SHARE)
"""As many epochs as an initialisation of 40 may have: none is looked at beyond."""
TRUE, STATED = 1.2, 0.3
"""Pixel noise."""


@cache
def tracks() -> Dataset:
    """Few landmarks, seen with noise that is larger than stated."""
    scenario = replace(
        Scenario.common_workload(RICH_RPM, 2), landmarks=400, epochs=40, pixel_std=TRUE, range_m=0.5
    )
    return without_map(simulate(scenario))


def epochs_at(pixel_std: float) -> FirstEpochs:
    """The first epochs of the tracks at a noise."""
    noise, view = SensorNoise(pixel_std=pixel_std), camera_view(tracks())
    timeline = build_timeline(tracks().log, PROCESS.layout, noise, view)
    return FirstEpochs(tracks(), view, PROCESS, timeline, noise)


@cache
def smoothed(pixel_std: float) -> InitialEstimate:
    """From the measurements alone."""
    return epochs_at(pixel_std).smoothed(OPTIONS)


def test_other_noise_needs_no_second_look_at_the_measurements(monkeypatch: pytest.MonkeyPatch) -> None:
    before, anew = smoothed(STATED), smoothed(TRUE)
    monkeypatch.setattr(first_epochs, "initialise", None)
    again = epochs_at(TRUE).smoothed(OPTIONS, before)
    assert len(again.mean) == len(anew.mean)
    std = np.linalg.norm(again.factor[-1, again.layout.slice("v")], axis=1)
    one, other = (each.mean[-1, each.layout.mean_slice("v")] for each in (again, anew))
    assert (np.abs(one - other) < 0.2 * std).all()
    one, other = (body_estimate(each.belief) for each in (again, anew))  # which need no frame g
    assert (
        np.abs(one.principal_moments - other.principal_moments) < 0.2 * one.principal_moments_std + 1e-9
    ).all()
    assert abs(again.accepted / anew.accepted - 1) < 0.02
    assert np.isin(anew.ids, again.ids).mean() > 0.98
    assert again.noise_ratio == before.noise_ratio


def test_an_estimate_of_fewer_epochs_is_made_anew() -> None:
    before = smoothed(STATED)
    few = replace(before, mean=before.mean[:6], factor=before.factor[:6])
    again, anew = epochs_at(TRUE).smoothed(OPTIONS, few), smoothed(TRUE)
    np.testing.assert_array_equal(again.mean, anew.mean)


def test_a_longer_start_fits_poses_of_its_new_epochs_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = simulate(Scenario.simplified(rate_rpm=RICH_RPM, landmarks=60, epochs=40))
    counts: list[int] = []
    fit = track_poses.fit_poses
    monkeypatch.setattr(
        track_poses, "fit_poses", lambda epochs, *rest: counts.append(len(epochs)) or fit(epochs, *rest)
    )
    layout = StateLayout(FULL_BLOCKS)
    process, noise = TorqueFreeProcess(layout, ProcessNoise()), SensorNoise(pixel_std=1.0)
    view = camera_view(dataset)
    first = FirstEpochs(dataset, view, process, build_timeline(dataset.log, layout, noise, view), noise)
    sampled, found = SampledEpochs(), None
    for last in (9, 29):
        found = first._samples_until(first.timeline[last].time, sampled)
        assert len(found.time) == last + 1
    assert found is not None
    assert counts == [10, 20]
    whole = first._samples_until(first.timeline[29].time, SampledEpochs())
    for name in ("time", "attitude", "positions"):
        np.testing.assert_allclose(getattr(found, name), getattr(whole, name), atol=1e-9)
