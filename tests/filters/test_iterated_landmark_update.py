"""Iterated updates of state and landmarks together."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.filters.estimator import LandmarkBelief, Measurement
from spinfilters.filters.iterated_update import IterationOptions
from spinfilters.models.state_layout import Gaussian
from tests.filters.landmark_samples import LAYOUT, START_STD, recording, run_through, started


def test_iterating_changes_nothing_where_the_linear_model_was_right():
    recorded = recording(pixel_std=1.0)
    beliefs = []
    for iterations in (1, 4):
        estimator = started(iteration=IterationOptions(iterations))
        estimator.start(Gaussian(LAYOUT, recorded.states[0], np.diag(1e-4 * START_STD)))
        beliefs.append(run_through(estimator, recorded.timeline[:1])[-1])
    assert (beliefs[0].mean == beliefs[1].mean).all()
    assert (beliefs[0].factor == beliefs[1].factor).all()


def test_iterating_finds_the_point_that_one_linearisation_misses():
    """An attitude that is off by half a radian, and a map that is known: the residuals tell how far each got."""
    recorded = recording()
    epoch = recorded.timeline[0]
    sums = []
    for iterations in (1, 6):
        estimator = started(iteration=IterationOptions(iterations))
        estimator.start(Gaussian(LAYOUT, recorded.states[0], np.diag(1e-7 * np.ones(20))))
        estimator.update(epoch.measurements[0])
        known = estimator.landmark_belief
        off = LAYOUT.retract(known.mean, np.r_[0, 0, 0, 0.3, -0.3, 0.3, np.zeros(14)])
        std = np.r_[np.full(3, 1e-3), np.full(3, 0.5), np.full(14, 1e-4), np.ones(len(known.factor) - 20)]
        roots = np.tile(1e-4 * np.eye(3), (len(known.ids), 1, 1))
        estimator.start(replace(known, mean=off, factor=np.diag(std), modes=0 * known.modes, roots=roots))
        estimator.update(epoch.measurements[0])
        sums.append(np.abs(LAYOUT.local(estimator.belief.mean, recorded.states[0])[3:6]).max())
    assert sums[1] < 0.2 * sums[0]


def _joint_objective(before: LandmarkBelief, after: LandmarkBelief, measurement: Measurement) -> float:
    """Squared deviations from a belief and from an epoch's observations of its landmarks, at a later mean."""
    assert measurement.ids is not None
    sensor = measurement.model.landmark_sensor
    assert sensor is not None
    place = {int(key): k for k, key in enumerate(after.ids)}
    moved = after.points[[place[int(key)] for key in before.ids]] - before.points
    error = np.concatenate([LAYOUT.local(before.mean, after.mean), moved.ravel()])
    away = np.linalg.solve(before.joint_factor(), error)
    known = np.isin(measurement.ids, before.ids)
    parameters = measurement.parameters[known].copy()
    parameters[:, :3] = after.points[[place[int(key)] for key in measurement.ids[known]]]
    residual = sensor.linearise_landmarks(after.mean, parameters, measurement.values[known]).innovation
    return float(away @ away + np.sum(residual * residual))


@pytest.mark.parametrize("name", ["mekf", "ukf"])
def test_state_and_young_landmarks_are_the_most_probable_together(name: str):
    """Landmarks that one observation has placed: the update accounts for the errors of their lever arms."""
    recorded = recording(seed=3, epochs=6, landmarks=60, pixel_std=2.0)
    std = np.repeat([1e-6, 1e-6, 0.005, 0.005, 0.02, 0.05], [3, 3, 3, 3, 3, 5])
    found = []
    for estimator in (started(iteration=IterationOptions(1)), started(name)):
        estimator.start(Gaussian(LAYOUT, recorded.states[0], np.diag(std)))
        run_through(estimator, recorded.timeline[:1])
        estimator.predict(recorded.timeline[1].time - recorded.timeline[0].time)
        before = estimator.landmark_belief
        (second,) = recorded.timeline[1].measurements
        estimator.update(second)
        found.append(_joint_objective(before, estimator.landmark_belief, second))
    assert found[1] < found[0] - 0.1
