"""The Cramer-Rao bound beside the errors of a run."""

import json
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from swapped_ids import swapped

from experiments.bound_monte_carlo import bound_at_truth, recorded
from observability.cramer_rao import cramer_rao_bound as recursive_bound
from observability.reference_trajectory import ReferenceTrajectory, SensorSchedule
from spinfilters.evaluation import recording_bound
from spinfilters.evaluation.comparison_table import BOUND_CAPTION, comparison_table
from spinfilters.evaluation.consistency import true_states
from spinfilters.evaluation.recording_bound import cramer_rao_bound, with_bounds
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.truth import Truth
from spinfilters.models.process import ProcessNoise
from spinfilters.run.estimation import Comparison, compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.run.run_folder import write_run
from spinfilters.settings.run_settings import FILTER, Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_noise
from spinfilters.smoother import mass_posterior

SETTINGS = Settings(estimators=("mekf", "smoother"), verdict=FILTER)
TRACKS = Scenario.simplified(rate_rpm=RICH_RPM, epochs=40, landmarks=100)


@pytest.fixture(autouse=True, scope="module")
def few_samples() -> Iterator[None]:
    """Of mass distributions, which a bound does not look at."""
    with pytest.MonkeyPatch.context() as patch:
        for name, number in (("SAMPLES", 40), ("TRIED", 40), ("MOST_NODES", 1)):
            patch.setattr(mass_posterior, name, number)
        yield


def silent(*_: object) -> None:
    """Report no progress."""


def compared(dataset: Dataset) -> Comparison:
    """Both estimators on it."""
    return compare_estimators(prepare(dataset, SETTINGS), SETTINGS, silent)


@cache
def without_map() -> Comparison:
    """Tracks of landmarks that nobody knows."""
    return compared(replace(simulate(TRACKS), known_map=None))


@cache
def of_kind(kind: str) -> Comparison:
    """A known map, poses or a gyro."""
    return compared(simulate(replace(TRACKS, kind=kind)))


def truth_of(comparison: Comparison) -> Truth:
    """Of its data set."""
    truth = comparison.setup.dataset.truth
    assert truth is not None
    return truth


def limits_of(comparison: Comparison) -> EstimateHistory:
    """The bound of every epoch."""
    found = cramer_rao_bound(comparison.setup, truth_of(comparison), comparison.evaluations[0])
    assert found is not None
    return found


def bounds_with(comparison: Comparison, truth: Truth | None) -> list[bool]:
    """Which evaluations have a bound with another truth."""
    dataset = replace(comparison.setup.dataset, truth=truth)
    bare = [replace(each, bound=None) for each in comparison.evaluations]
    return [each.bound is not None for each in with_bounds(bare, replace(comparison.setup, dataset=dataset))]


def test_of_unknown_landmarks_it_is_that_of_their_true_points() -> None:
    limits, layout = limits_of(without_map()), without_map().setup.process.layout
    exact = bound_at_truth(recorded(simulate(TRACKS), TRACKS))
    for block in "avwcs":  # the origin of the estimate's g, of which t tells, is elsewhere
        found, expected = (std[1:, layout.slice(block)] for std in (limits.std, exact))
        lengths = np.linalg.norm(found, axis=1) / np.linalg.norm(expected, axis=1)
        assert lengths == pytest.approx(1.0, abs=0.03), block


def test_a_map_that_is_a_little_off_is_settled_at_the_true_poses() -> None:
    whole, right = without_map(), limits_of(without_map()).std[1:]
    start = whole.setup.initial
    assert start.has_landmarks
    off = start.points + 3e-3 * np.random.default_rng(0).standard_normal(start.points.shape)
    moved = replace(whole.setup, initial=replace(start, points=off))
    found = cramer_rao_bound(moved, truth_of(whole), whole.evaluations[0])
    assert found is not None
    assert found.std[1:] == pytest.approx(right, rel=0.02)


@pytest.mark.parametrize("kind", ["pose", "gyro"])
def test_in_the_last_epoch_it_is_the_recursive_bound_of_the_analyser(kind: str) -> None:
    limits, setup = limits_of(of_kind(kind)), of_kind(kind).setup
    layout, prior = setup.process.layout, setup.initial.prior.std
    (measurement,) = setup.timeline[0].measurements
    states = true_states(truth_of(of_kind(kind)), layout)
    seen = np.ones((len(states), 1), dtype=bool)
    schedule = SensorSchedule(measurement.model, measurement.parameters, 0, seen)
    reference = ReferenceTrajectory(setup.process, limits.time, states)
    std = {block: float(prior[layout.slice(block)][0]) for block in layout.blocks}
    expected = recursive_bound(reference, [schedule], std).std[-1]
    assert limits.std[-1] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("comparison", [without_map, lambda: of_kind("stereo-tracks")], ids=["tracks", "map"])
def test_errors_are_of_its_size_and_summary_and_table_show_it(comparison, tmp_path: Path) -> None:
    found, stream = comparison(), StringIO()
    write_run(tmp_path / "run", found, SETTINGS)
    document = json.loads((tmp_path / "run" / "summary.json").read_text())
    for name in ("rms_position_m", "rms_second_half_velocity_m_s", "rms_second_half_rate_rad_s"):
        errors = document["estimators"]["smoother"]["errors"]
        assert 0.4 < errors[name] / errors["bound"][name] < 2.5, name
    assert errors["bound"].keys() <= errors.keys()
    Console(file=stream, width=170).print(comparison_table(found.evaluations))
    rows = {
        line.split("│")[1].strip(): line.split("│")[-2]
        for line in stream.getvalue().splitlines()
        if "│" in line
    }
    for name in ("position error [mm]", "velocity error [mm/s]", "rate error in i [deg/s]"):
        assert float(rows[name]) > 0, name
    assert " ".join(stream.getvalue().split()).endswith(BOUND_CAPTION)


def test_a_gyros_attitude_and_axes_have_a_bound_in_the_inertial_frame_of_the_first_sample() -> None:
    evaluation = of_kind("gyro").evaluations[0]
    found, errors, body = evaluation.bound, evaluation.errors, evaluation.body_errors
    assert found is not None
    assert errors is not None
    assert body is not None
    assert found.rms.position is None
    assert found.rms.attitude is not None
    assert errors.rms.attitude is not None
    assert 0.2 < errors.rms.attitude / found.rms.attitude < 4
    assert found.body.axes_angle is not None
    assert body.axes_angle is not None
    assert (body.axes_angle < 4 * found.body.axes_angle).all()
    assert found.body.principal_moments is not None
    assert 0 < found.rms.rate < 0.1


def test_more_noise_makes_it_larger_and_wrong_associations_hardly_do() -> None:
    right = limits_of(without_map()).std[1:]
    dataset = replace(simulate(TRACKS), known_map=None)
    tracks = swapped(dataset.log.stream("stereo"), 0.1, np.random.default_rng(0))
    changed = replace(dataset, log=MeasurementLog((tracks,)))
    ratio = limits_of(compared(changed)).std[1:] / right
    assert 1.0 < ratio.mean() < 1.2
    noisier = replace(SETTINGS, sensors=replace(SETTINGS.sensors, pixel_std=2.0))
    setup = prepare(dataset, noisier)
    doubled = cramer_rao_bound(setup, truth_of(without_map()), without_map().evaluations[0])
    assert doubled is not None
    assert (doubled.std[1:] / right).mean() > 1.3


def test_there_is_none_without_a_truth_of_every_epoch() -> None:
    truth = truth_of(without_map())
    short = {
        name: getattr(truth, name)[:-1] for name in ("time", "center_of_mass", "q_ig", "velocity", "rate_i")
    }
    assert bounds_with(without_map(), truth) == [True, True]
    assert bounds_with(without_map(), None) == [False, False]
    assert bounds_with(without_map(), replace(truth, **short)) == [False, False]
    assert bounds_with(without_map(), replace(truth, principal_moments=None)) == [False, False]
    assert bounds_with(without_map(), replace(truth, time=truth.time + 0.1)) == [False, False]


def test_there_is_none_of_a_plate_or_of_long_recordings(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = truth_of(without_map())
    plate = replace(truth, principal_moments=np.array([2.0, 1.0, 1.0]))
    assert bounds_with(without_map(), plate) == [False, False]
    monkeypatch.setattr(recording_bound, "MOST_WITH_LANDMARKS", 39)
    assert bounds_with(without_map(), truth) == [False, False]


def test_a_long_recording_without_landmarks_has_one() -> None:
    assert recording_bound.MOST_WITHOUT >= 20 * 4000
    assert bounds_with(of_kind("gyro"), truth_of(of_kind("gyro"))) == [True, True]


def reason_of(comparison: Comparison, truth: Truth) -> str | None:
    """Why there is no bound with another truth."""
    dataset = replace(comparison.setup.dataset, truth=truth)
    bare = [replace(each, bound=None) for each in comparison.evaluations]
    return with_bounds(bare, replace(comparison.setup, dataset=dataset))[0].bound_missing


def test_why_there_is_none_is_in_table_and_summary(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    whole, truth, stream = without_map(), truth_of(without_map()), StringIO()
    assert reason_of(whole, truth) is None
    assert "does not contain all" in str(reason_of(whole, replace(truth, principal_moments=None)))
    monkeypatch.setattr(recording_bound, "MOST_WITH_LANDMARKS", 39)
    bare = with_bounds([replace(each, bound=None) for each in whole.evaluations], whole.setup)
    assert bare[0].bound_missing == "with unknown landmarks it is computed of at most 39 epochs, these are 40"
    Console(file=stream, width=170).print(comparison_table(bare))
    assert "No BOUND: with unknown landmarks" in stream.getvalue()
    write_run(tmp_path / "run", replace(whole, evaluations=tuple(bare)), SETTINGS)
    document = json.loads((tmp_path / "run" / "summary.json").read_text())
    errors = document["estimators"]["mekf"]["errors"]
    assert errors["bound"] is None
    assert "at most 39 epochs" in errors["bound_missing"]


def test_measurements_much_better_than_they_state_leave_none() -> None:
    exact = without_noise(simulate(replace(TRACKS, kind="pose", position_std=1e-6, rotation_std=1e-6)))
    options = replace(exact.options, pose_position_std=0.005, pose_rotation_std=0.01)
    found = compared(replace(exact, options=options))
    assert "nearer to the truth than they state" in str(reason_of(found, truth_of(found)))


def test_of_disturbances_that_nobody_states_it_takes_those_of_the_truth() -> None:
    calm = ProcessNoise(force_psd=1e-12, torque_psd=1e-12)
    dataset = simulate(replace(TRACKS, kind="pose", noise=calm))
    silent_options = replace(dataset.options, force_psd=None, torque_psd=None)
    setup = prepare(replace(dataset, options=silent_options), SETTINGS)
    assert setup.process.noise.torque_psd > 1e-11  # what few noisy poses leave open
    assert dataset.truth is not None
    states = true_states(dataset.truth, setup.process.layout)
    found = recording_bound.true_disturbances(setup, states)
    assert found.torque_psd < max(2e-12, 1e-4 * setup.process.noise.torque_psd) * 1.01
    assert recording_bound.true_disturbances(prepare(dataset, SETTINGS), states) == calm


def test_there_is_none_where_the_noise_is_not_what_the_estimators_are_told() -> None:
    far = truth_of(without_map())
    assert bounds_with(without_map(), replace(far, center_of_mass=far.center_of_mass * 1.5)) == [False, False]


def test_an_estimate_that_ended_early_has_none() -> None:
    whole = without_map()
    history = whole.evaluations[0].history
    arrays = {name: value[:-1] for name, value in vars(history).items() if isinstance(value, np.ndarray)}
    ended = replace(whole.evaluations[0], history=replace(history, **arrays), bound=None)
    found = with_bounds([ended, whole.evaluations[1]], whole.setup)
    assert [each.bound is not None for each in found] == [False, True]
