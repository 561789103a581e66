"""The textbook's EKF with all landmarks in its state."""

import numpy as np

from spinfilters.filters.joint_ekf import LARGEST_JOINT_MAP, JointEkf
from tests.filters.landmark_samples import LAYOUT, PROCESS, first_belief, nees, recording, run_through


def _through(seed: int) -> tuple[JointEkf, np.ndarray]:
    sample = recording(seed, epochs=15, landmarks=60)
    estimator = JointEkf(PROCESS)
    estimator.start(first_belief(sample.states, seed))
    beliefs = run_through(estimator, sample.timeline)
    return estimator, nees(beliefs, sample.states)[1:]


def test_state_and_map_of_an_unknown_body_come_out_within_their_covariance() -> None:
    estimator, every = _through(0)
    assert every.mean() / LAYOUT.error_dim < 2.0
    assert 20 < len(estimator.ids) <= LARGEST_JOINT_MAP
    error = (estimator.points - recording(0, epochs=15, landmarks=60).points[estimator.ids]).ravel()
    P = estimator.covariance[LAYOUT.error_dim :, LAYOUT.error_dim :]
    assert 0.2 < error @ np.linalg.solve(P, error) / len(error) < 2.0


def test_a_snapshot_holds_the_map() -> None:
    sample = recording(0, epochs=15, landmarks=60)
    estimator, _ = _through(0)
    kept, last = estimator.snapshot(), sample.timeline[-1].measurements[0]
    estimator.predict(0.5)
    estimator.update(last)
    first = estimator.belief
    estimator.restore(kept)
    estimator.predict(0.5)
    estimator.update(last)
    np.testing.assert_array_equal(estimator.belief.mean, first.mean)
    np.testing.assert_array_equal(estimator.belief.factor, first.factor)
