"""Measurements in any order of arrival give what they give in the order of time, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.filters.baselines import FilterpyEkf
from spinfilters.filters.estimator import Measurement
from spinfilters.filters.filter import MultiplicativeFilter
from spinfilters.filters.late_measurements import Outcome, OutOfSequenceUpdates
from spinfilters.filters.timeline import Epoch, run
from spinfilters.models.status import Verdict
from spinfilters.run.estimation import build_estimator
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import InitialisationOptions, Settings
from spinfilters.simulation.scenario import Scenario, simulate
from tests.filters.out_of_sequence_samples import (
    FRAMES,
    OURS,
    PROCESS,
    Build,
    arrivals,
    assert_same_bits,
    belief,
    gyro_arrivals,
    late,
    one_by_one,
    online,
    received,
)


@pytest.mark.parametrize("build", [*OURS, FilterpyEkf])
@pytest.mark.parametrize("seed", range(3))
def test_any_order_of_arrival_inside_the_horizon_gives_the_same_bits(build: Build, seed: int) -> None:
    in_order, shuffled = online(build), online(build)
    assert set(received(in_order, arrivals())) <= {Outcome.TAKEN, Outcome.INSERTED}
    outcomes = received(shuffled, late(seed, 1.9))
    assert outcomes.count(Outcome.INSERTED) > 20
    assert shuffled.counts[Outcome.TOO_LATE] == 0
    assert shuffled.replayed_epochs > 100
    assert shuffled.time == in_order.time == arrivals()[-1][0]
    assert_same_bits(shuffled.belief, in_order.belief)
    assert shuffled.status.verdict is Verdict.OK


@pytest.mark.parametrize("build", OURS)
def test_in_order_it_is_the_plain_run_of_epochs_in_the_order_of_sensor_names(build: Build) -> None:
    updates, estimator = online(build), build(PROCESS)
    received(updates, arrivals())
    estimator.start(belief())
    stamps: dict[float, list[Measurement]] = {}
    for time, measurement in arrivals():
        stamps.setdefault(time, []).append(measurement)
    epochs = [Epoch(t, tuple(sorted(group, key=lambda m: m.model.name))) for t, group in stamps.items()]
    history = run(estimator, 0.0, tuple(epochs))
    assert_same_bits(updates.belief, history.belief(-1))


def test_two_packets_of_one_sensor_at_one_stamp_may_come_in_either_order() -> None:
    time, view = next(a for a in arrivals() if a[1].model.name == "stereo")
    half = len(view.values) // 2
    parts = [
        replace(view, values=view.values[s], parameters=view.parameters[s])
        for s in (np.s_[:half], np.s_[half:])
    ]
    one, other = online(), online()
    received(one, [(time, parts[0]), (time, parts[1])])
    received(other, [(time, parts[1]), (time, parts[0])])
    assert_same_bits(one.belief, other.belief)


def test_a_sensor_of_constant_latency_is_put_in_its_place() -> None:
    """Poses that are stamped in the past by the time they take, among a gyro that is at once."""
    latency, gyro = 0.35, gyro_arrivals()
    poses = [a for a in arrivals() if a[1].model.name == "pose"]
    order = sorted([(t, t, m) for t, m in gyro] + [(t + latency, t, m) for t, m in poses], key=lambda a: a[0])
    out_of_order, in_order = online(), online()
    outcomes = received(out_of_order, [(t, m) for _, t, m in order])
    received(in_order, sorted(gyro + poses, key=lambda a: a[0]))
    assert outcomes.count(Outcome.INSERTED) >= FRAMES - 1
    assert_same_bits(out_of_order.belief, in_order.belief)


def test_a_result_tells_the_update_s_report_and_what_was_done_again() -> None:
    updates, gyro = online(), gyro_arrivals()
    received(updates, [*gyro[:3], *gyro[4:8]])
    result = updates.receive(*gyro[3])
    assert (result.outcome, result.replayed, result.reason) == (Outcome.INSERTED, 4, "")
    assert result.report is not None
    assert (result.report.dof, result.report.accepted) == (3, 1)


def test_a_reused_buffer_does_not_reach_what_was_received() -> None:
    one, other = online(), online()
    for time, measurement in late(5, 1.0):
        buffer = measurement.values.copy()
        one.receive(time, replace(measurement, values=buffer))
        buffer[...] = np.nan
    received(other, late(5, 1.0))
    assert_same_bits(one.belief, other.belief)


@pytest.mark.parametrize("build", OURS)
def test_asking_for_the_future_changes_nothing(build: Build) -> None:
    asked, other = online(build), online(build)
    for time, measurement in late(6, 0.5):
        asked.receive(time, measurement)
        assert np.all(asked.belief_at(asked.time + 0.3).std >= 0.0)
        other.receive(time, measurement)
    assert_same_bits(asked.belief, other.belief)
    assert_same_bits(asked.belief_at(asked.time), asked.belief)
    estimator = build(PROCESS)
    estimator.start(asked.belief)
    estimator.predict(0.25)
    assert_same_bits(asked.belief_at(asked.time + 0.25), estimator.belief)
    with pytest.raises(InputError, match="latest epoch"):
        asked.belief_at(asked.time - 0.1)


@pytest.mark.parametrize("name", ["mekf", "ukf"])
def test_landmarks_of_the_state_come_and_go_in_the_order_of_time(name: str) -> None:
    """Observations of landmarks that nobody knew, from a start that smooths the first of them; all that is remembered is the
    same."""
    dataset = replace(simulate(Scenario.simplified(epochs=24, landmarks=40)), known_map=None)
    settings = Settings(initialisation=InitialisationOptions(epochs=8))
    setup = prepare(dataset, settings)
    rest = one_by_one(setup.timeline[len(setup.initial.mean) :])
    order = np.argsort(np.arange(len(rest)) + np.random.default_rng(8).uniform(0.0, 3.5, len(rest)))
    states, updates = [], []
    for arrival in (rest, [rest[k] for k in order]):
        estimator = build_estimator(name, setup, settings)
        assert isinstance(estimator, MultiplicativeFilter)
        estimator.start(setup.belief)
        updates.append(OutOfSequenceUpdates(estimator, setup.end_of_initialisation, horizon_s=5.0))
        received(updates[-1], arrival)
        states.append(estimator.snapshot())
    assert updates[0].counts[Outcome.INSERTED] == 0 < updates[1].counts[Outcome.INSERTED]
    assert updates[1].counts[Outcome.TOO_LATE] == 0
    assert states[0].keys() == states[1].keys()
    for key, array in states[0].items():
        np.testing.assert_array_equal(states[1][key], array, strict=True)
