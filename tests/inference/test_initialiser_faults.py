"""Gross errors in the first epochs: the initialisation leaves them out, whatever the sensor."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.special import chdtri

from spinfilters.core.attitude_conversions import multiply
from spinfilters.evaluation.consistency import true_states
from spinfilters.inference.initial_estimate import InitialEstimate, SmoothingOptions, smooth_first_epochs
from spinfilters.inference.setup import Setup
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.models.process import ProcessNoise
from spinfilters.models.sensor import MotionSamples
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.measurement_faults import WrongAssociations, with_faults
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map
from spinfilters.smoother.batch_smoother import NO_LANDMARKS, NO_POINTS
from spinfilters.smoother.closed_form import consistent_samples
from spinfilters.smoother.problem import InitialGuess

TUMBLING = (3.0, 10.0, 4.0)
TURN = np.array([np.sin(0.8), 0.0, 0.0, np.cos(0.8)])
"""By 92 deg."""
CASES = {
    "pose": Scenario.simplified(kind="pose", rate_rpm=TUMBLING),
    "attitude": Scenario.simplified(kind="attitude", rate_rpm=TUMBLING),
    "gyro": Scenario.simplified(kind="gyro", rate_rpm=TUMBLING, interval=0.1, epochs=120),
}


def _spoilt(dataset: Dataset, epoch: int) -> Dataset:
    """With one measurement that has nothing to do with the body."""
    (stream,) = dataset.log.streams
    values = stream.values.copy()
    if dataset.kind == "gyro":
        values[epoch] += [1.0, -2.0, 0.5]
    else:
        values[epoch, -4:] = multiply(values[epoch, -4:], TURN)
    return replace(dataset, log=MeasurementLog((replace(stream, values=values),)))


@cache
def _recorded(kind: str) -> Dataset:
    return simulate(CASES[kind])


@cache
def _begun_with_error(kind: str, epoch: int) -> tuple[Dataset, Setup]:
    """A recording with one gross error, and what is made of its first epochs."""
    dataset = _spoilt(_recorded(kind), epoch)
    return dataset, prepare(dataset, Settings())


def _nees(found: InitialEstimate, dataset: Dataset) -> tuple[float, int]:
    """Of everything that the data tell in the truth's frames, and its degrees of freedom."""
    assert dataset.truth is not None
    layout, epochs = found.layout, len(found.mean)
    error = layout.local(found.mean[-1], true_states(dataset.truth, layout)[epochs - 1])
    told = np.setdiff1d(np.arange(layout.error_dim), np.arange(*layout.slice("a").indices(100)))
    factor = found.factor[-1][told]
    covariance = factor @ factor.T
    return float(error[told] @ np.linalg.solve(covariance, error[told])), len(told)


@pytest.mark.parametrize("epoch", [0, 3, 20])
@pytest.mark.parametrize("kind", list(CASES))
def test_one_gross_error_in_the_first_epochs_is_left_out(kind: str, epoch: int) -> None:
    dataset, setup = _begun_with_error(kind, epoch)
    found = setup.initial
    assert found.converged
    assert 1 <= found.rejected <= 3
    assert found.fit == pytest.approx(1.0, abs=0.15)
    nees, dof = _nees(found, dataset)
    assert nees < chdtri(dof, 1e-3)


@pytest.mark.parametrize("kind", ["stereo-tracks", "mono-tracks"])
@pytest.mark.parametrize("share", [0.05, 0.3])
def test_wrong_ids_under_a_known_map_are_left_out(kind: str, share: float) -> None:
    clean = simulate(Scenario.simplified(kind=kind, rate_rpm=TUMBLING, epochs=75))
    found = prepare(with_faults(clean, (WrongAssociations(share),), 0), Settings()).initial
    assert found.converged
    assert found.fit == pytest.approx(1.0, abs=0.05)
    assert found.rejected > 0.5 * share * found.dof / 3
    nees, dof = _nees(found, clean)
    assert nees < chdtri(dof, 1e-3)


def test_noise_that_is_three_times_the_stated_opens_the_gate_and_shows() -> None:
    scenario = Scenario.simplified(kind="pose", rate_rpm=TUMBLING, position_std=0.03, rotation_std=0.03)
    dataset = simulate(scenario)
    (stream,) = dataset.log.streams
    stated = replace(stream, covariance=np.tile(1e-4 * np.eye(6), (len(stream), 1, 1)))
    found = prepare(replace(dataset, log=MeasurementLog((stated,))), Settings()).initial
    assert found.converged
    assert found.fit == pytest.approx(3.0, abs=0.3)
    assert found.rejected <= 0.05 * len(found.mean)


def test_a_short_burst_of_motion_is_no_gross_error() -> None:
    time = 0.1 * np.arange(60)
    rates = np.stack([np.exp(-(((time - 3.0) / 0.15) ** 2)), np.ones(60), 0.1 * np.sin(time)], axis=1)
    assert len(consistent_samples(MotionSamples(time, rates=rates)).time) == 60
    rates[40] += 1.0
    kept = consistent_samples(MotionSamples(time, rates=rates)).time
    np.testing.assert_allclose(np.setdiff1d(time, kept), time[[40]])


def test_an_attitude_of_the_other_sign_is_no_gross_error() -> None:
    turns = 0.1 * np.arange(30)
    attitude = np.stack([np.sin(turns), 0 * turns, 0 * turns, np.cos(turns)], axis=1)
    attitude[::3] *= -1
    assert len(consistent_samples(MotionSamples(turns, attitude)).time) == 30


@pytest.mark.parametrize("pixel_std", [0.1, 5.0])
def test_tracks_without_a_map_are_initialised_at_any_pixel_noise(pixel_std: float) -> None:
    scenario = replace(Scenario.common_workload(RICH_RPM, 0), pixel_std=pixel_std, epochs=60)
    found = prepare(without_map(simulate(scenario)), Settings()).initial
    assert found.converged
    assert found.fit == pytest.approx(1.0, abs=0.02)
    assert found.noise_ratio == pytest.approx(1.0, abs=0.03)
    rates = found.mean[:, found.layout.mean_slice("w")]
    assert np.linalg.norm(rates, axis=1) == pytest.approx(np.linalg.norm(RICH_RPM) * np.pi / 30, abs=0.1)


@pytest.mark.parametrize("kind", list(CASES))
def test_a_strict_smoothing_knows_whether_annealing_would_have_changed_it(kind: str) -> None:
    right, (_, wrong) = prepare(_recorded(kind), Settings()), _begun_with_error(kind, 20)
    strict, annealed = (_smoothed(right, SmoothingOptions(annealed=annealed)) for annealed in (0, 40))
    assert strict.is_annealed_too
    assert np.array_equal(strict.mean, annealed.mean)
    assert np.array_equal(strict.factor, annealed.factor)
    assert not annealed.is_annealed_too
    assert not _smoothed(wrong, SmoothingOptions(annealed=0)).is_annealed_too


def _smoothed(setup: Setup, options: SmoothingOptions) -> InitialEstimate:
    """From a body a little off, as disturbances allow it that are large enough."""
    start, process = setup.initial, setup.process.with_noise(ProcessNoise(1e-3, 1e-3))
    trajectory = start.mean.copy()
    trajectory[:, start.layout.mean_slice("s")] += 0.1
    guess = InitialGuess(trajectory, NO_LANDMARKS, NO_POINTS)
    return smooth_first_epochs(process, setup.timeline[: len(trajectory)], guess, start.prior, options)
