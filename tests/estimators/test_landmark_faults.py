"""What goes wrong around filters with landmarks in their state does them no harm."""

import numpy as np
import pytest
from landmark_samples import (
    FILTERS,
    LAYOUT,
    nees,
    recording,
    run_through,
    started,
    timeline_of,
)

from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.simulation.faults import (
    Dropout,
    FrozenFrames,
    PointsAtInfinity,
    WrongAssociations,
    with_faults,
)

BOTH = pytest.mark.parametrize("name", FILTERS)


@pytest.mark.parametrize("share", [0.3, 0.45])
@BOTH
def test_wrong_associations_are_refused_and_do_no_harm(name, share):
    recorded = recording()
    faulty = timeline_of(with_faults(recorded.dataset, (WrongAssociations(share),), 1))
    estimator, true = started(name), [frame.measurements[0].ids for frame in recorded.timeline]
    reports = []
    for k, frame in enumerate(faulty):
        if k:
            estimator.predict(0.5)
        reports.append((estimator.update(frame.measurements[0]).map_change, frame.measurements[0].ids))
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
    frozen = timeline_of(with_faults(recorded.dataset, (FrozenFrames(12, 3),), 1))
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


def test_a_dropout_of_ten_seconds_is_survived():
    recorded = recording(frames=60)
    faulty = timeline_of(with_faults(recorded.dataset, (Dropout(10.2, 20.2),), 1))
    estimator = started(frames=60)
    run_through(estimator, faulty)
    last = recorded.states[-1]
    error = LAYOUT.local(estimator.belief.mean, last)
    whitened = np.linalg.solve(estimator.belief.factor, error)
    assert len(faulty) < 45
    assert whitened @ whitened < chi_square_band(20, 1, 0.999)[1]


def test_the_same_frame_twice_counts_once():
    recorded, estimator = recording(), started()
    run_through(estimator, recorded.timeline[:5])
    before = estimator.belief
    report = estimator.update(recorded.timeline[4].measurements[0])
    assert report.accepted == 0
    assert (estimator.belief.factor == before.factor).all()
