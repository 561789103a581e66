"""What goes wrong around filters with landmarks in their state does them no harm."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.filters.shared_modes import LandmarkOptions, anchored_at_pose
from spinfilters.models.gauge import GAUGE_STD, state_in_g
from spinfilters.simulation.measurement_faults import (
    Dropout,
    FrozenEpochs,
    PointsAtInfinity,
    WrongAssociations,
    with_faults,
)
from tests.filters.landmark_samples import (
    FILTERS,
    LAYOUT,
    nees,
    recording,
    run_through,
    started,
    timeline_of,
)

BOTH = pytest.mark.parametrize("name", FILTERS)


@pytest.mark.parametrize("share", [0.3, 0.45])
@BOTH
def test_wrong_associations_are_refused_and_do_no_harm(name, share):
    recorded = recording()
    faulty = timeline_of(with_faults(recorded.dataset, (WrongAssociations(share),), 1))
    estimator, true = started(name), [epoch.measurements[0].ids for epoch in recorded.timeline]
    reports = []
    for k, epoch in enumerate(faulty):
        if k:
            estimator.predict(0.5)
        reports.append((estimator.update(epoch.measurements[0]).map_change, epoch.measurements[0].ids))
    errors = nees([estimator.belief], recorded.states[-1:])
    wrong = [
        np.isin(change.used, ids[ids != right]).mean()
        for (change, ids), right in zip(reports[1:], true[1:], strict=True)
    ]
    assert np.mean(wrong) < 0.01
    assert errors < chi_square_band(20, 1, 0.999)[1]


def test_a_landmark_at_infinity_never_enters_the_map():
    recorded = recording()
    faulty = with_faults(recorded.dataset, (PointsAtInfinity(3),), 1)
    estimator = started()
    run_through(estimator, timeline_of(faulty))
    before, after = (set(ids_of(dataset)) for dataset in (recorded.dataset, faulty))
    far = after - before
    assert len(far) == 3
    assert not far & set(estimator.held.tolist())


def ids_of(dataset):
    ids = dataset.log.stream("stereo").ids
    assert ids is not None
    return ids.tolist()


def test_a_frozen_camera_is_no_news():
    recorded = recording()
    frozen = timeline_of(with_faults(recorded.dataset, (FrozenEpochs(12, 3),), 1))
    estimator = started()
    run_through(estimator, frozen[:13])
    for k in (13, 14, 15):
        estimator.predict(frozen[k].time - frozen[k - 1].time)
        before = estimator.belief
        report = estimator.update(frozen[k].measurements[0])
        assert report.accepted == 0
        assert (estimator.belief.mean == before.mean).all()
    errors = nees(run_through(estimator, frozen, 16), recorded.states[16:])
    assert np.median(errors) < chi_square_band(20, 1)[1]


@BOTH
def test_a_filter_that_loses_every_landmark_knows_how_little_it_knows(name):
    """New landmarks tell nothing of the attitude in frame g: what is said of it does not shrink to what they tell of each other."""
    recorded, estimator = recording(), started(name)
    run_through(estimator, recorded.timeline[:15])
    estimator.predict(8.0)
    lost, spreads, epochs = estimator.belief, [], recorded.timeline[15:22]
    for before, epoch in zip([None, *epochs], epochs, strict=False):
        seen = epoch.measurements[0]
        if before is not None:
            estimator.predict(epoch.time - before.time)
        assert seen.ids is not None
        estimator.update(replace(seen, ids=seen.ids + 10_000))
        spreads.append(np.linalg.norm(estimator.belief.std[LAYOUT.slice("a")]))
    assert min(spreads) > 0.9 * np.linalg.norm(lost.std[LAYOUT.slice("a")])


def test_a_belief_anchored_at_the_pose_is_the_same_belief():
    estimator, n = started(), LAYOUT.error_dim
    run_through(estimator, recording().timeline[:15])
    estimator.predict(8.0)
    belief = estimator.landmark_belief
    anchored = anchored_at_pose(belief, LandmarkOptions())
    pose = np.r_[LAYOUT.slice("t"), LAYOUT.slice("a")]
    np.testing.assert_allclose(np.linalg.norm(anchored.factor[pose], axis=1), GAUGE_STD, rtol=1e-9)
    mean, rows = state_in_g(LAYOUT, anchored.mean, anchored.factor, anchored.move)
    np.testing.assert_allclose(mean, belief.mean, atol=1e-12)
    expected = belief.factor[:n] @ belief.factor[:n].T
    expected[pose, pose] += GAUGE_STD**2
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        rows @ rows.T / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-8
    )


def test_a_dropout_of_ten_seconds_is_survived():
    recorded = recording(epochs=60)
    faulty = timeline_of(with_faults(recorded.dataset, (Dropout(10.2, 20.2),), 1))
    estimator = started(epochs=60)
    run_through(estimator, faulty)
    last = recorded.states[-1]
    error = LAYOUT.local(estimator.belief.mean, last)
    whitened = np.linalg.solve(estimator.belief.factor, error)
    assert len(faulty) < 45
    assert whitened @ whitened < chi_square_band(20, 1, 0.999)[1]


def test_the_same_epoch_twice_counts_once():
    recorded, estimator = recording(), started()
    run_through(estimator, recorded.timeline[:5])
    before = estimator.belief
    report = estimator.update(recorded.timeline[4].measurements[0])
    assert report.accepted == 0
    assert (estimator.belief.factor == before.factor).all()
