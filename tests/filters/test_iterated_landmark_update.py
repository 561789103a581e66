"""Iterated updates of state and landmarks together."""

from dataclasses import replace

import numpy as np

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
