"""A filter put on a hand-over: state and landmarks are the smoother's."""

import numpy as np
import pytest

from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import LandmarkBelief
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.live.filter_track import HandOver, distance
from spinfilters.live.smoother_process import MAP, hand_over_of
from spinfilters.models.gauge import GAUGE_DIM
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, Gaussian, StateLayout

LAYOUT = StateLayout(FULL_BLOCKS)
PROCESS = TorqueFreeProcess(LAYOUT, ProcessNoise(1e-6, 1e-6))


MODES = LandmarkOptions().modes


def smoothed(modes: int = 2, landmarks: int = 5) -> LandmarkBelief:
    rng, n = np.random.default_rng(1), LAYOUT.error_dim
    size = n + modes + GAUGE_DIM
    return LandmarkBelief(
        LAYOUT,
        LAYOUT.retract(LAYOUT.origin(), 0.1 * rng.normal(size=n)),
        np.arange(10, 10 + landmarks),
        rng.normal(size=(landmarks, 3)),
        1e-3 * rng.normal(size=(landmarks, 3, modes)),
        np.tile(1e-3 * np.eye(3), (landmarks, 1, 1)),
        np.tril(1e-2 * rng.normal(size=(size, size))) + 0.1 * np.eye(size),
        np.zeros(GAUGE_DIM),
    )


def test_further_modes_change_no_covariance() -> None:
    given = smoothed()
    more = given.with_modes(7)
    assert more.modes.shape == (5, 3, 7)
    expected, found = given.joint_factor(), more.joint_factor()
    np.testing.assert_allclose(found @ found.T, expected @ expected.T, rtol=1e-9, atol=1e-15)


def test_a_filter_on_a_hand_over_believes_what_the_smoother_does() -> None:
    filter_, given = MultiplicativeEkf(PROCESS), smoothed()
    filter_.start(smoothed(MODES, landmarks=9))
    filter_.rebase(HandOver(1.0, given).belief)
    assert filter_.mode_count == MODES
    assert filter_.held.tolist() == given.ids.tolist()
    np.testing.assert_allclose(filter_.belief.mean, given.state.mean, atol=1e-12)
    np.testing.assert_allclose(filter_.belief.covariance, given.state.covariance, rtol=1e-9, atol=1e-15)
    own, wanted = filter_.landmark_belief.joint_factor(), given.joint_factor()
    np.testing.assert_allclose(own @ own.T, wanted @ wanted.T, rtol=1e-9, atol=1e-15)


def test_a_hand_over_comes_through_as_arrays() -> None:
    given = smoothed()
    message = {name: np.asarray(getattr(given, name)) for name in (*MAP, "mean", "factor")}
    back = hand_over_of(message | {"time": np.array(2.0), "verdict": np.array("ok")}, LAYOUT)
    assert isinstance(back.belief, LandmarkBelief)
    np.testing.assert_array_equal(back.belief.factor, given.factor)
    assert back.is_finite


@pytest.mark.parametrize("name", ["points", "modes", "roots", "factor"])
def test_a_map_that_is_not_finite_is_no_hand_over(name: str) -> None:
    given = smoothed()
    getattr(given, name)[0] = np.nan
    assert not HandOver(1.0, given).is_finite


def test_a_hand_over_without_landmarks_is_a_state_alone() -> None:
    filter_, given = MultiplicativeEkf(PROCESS), smoothed(MODES)
    filter_.start(given)
    filter_.rebase(HandOver(1.0, Gaussian(LAYOUT, given.mean, given.state.factor)).belief)
    assert not len(filter_.held)


def test_an_error_in_a_direction_that_is_hardly_known_is_no_distance_whatever_the_others_are() -> None:
    rng, part, n = np.random.default_rng(3), LAYOUT.slice("s"), LAYOUT.error_dim
    factor, axes = 1e-4 * np.eye(n), np.linalg.qr(rng.normal(size=(5, 5)))[0]
    factor[part, part] = axes * [0.2, 1e-4, 1e-4, 1e-4, 1e-4]
    vague = Gaussian(LAYOUT, smoothed().mean, factor)
    there = LAYOUT.retract(vague.mean, 2 * factor[:, part.start])
    assert distance(Gaussian(LAYOUT, there, 1e-6 * np.eye(n)), vague) == pytest.approx(4 / n, rel=1e-3)
