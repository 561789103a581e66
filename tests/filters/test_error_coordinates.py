"""Error coordinates: the same to first order, each with its own symmetry; the filter on them."""

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import multiply, quaternion_from_rotation_vector, rotate
from spinfilters.filters.ekf import InvariantEkf, MultiplicativeEkf
from spinfilters.filters.error_coordinates import CoordinateName, ErrorCoordinates, InvariantOptions
from spinfilters.filters.iterated_update import IterationOptions
from spinfilters.models.state_layout import ROTATION_BLOCKS, StateLayout
from tests.filters.filter_samples import FULL, PROCESS, START, embedded, nees, run_on

NAMES: tuple[CoordinateName, ...] = ("mrp", "rotation-vector", "inertial", "coupled", "coupled-inertial")
every_name = pytest.mark.parametrize("name", NAMES)


def _point() -> np.ndarray:
    return embedded(0).truth[5]


@every_name
@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-6, 0.3, 0.5, 0.51, 2.0])
def test_the_covariance_moves_with_the_derivative_of_the_fold(name: CoordinateName, size: float) -> None:
    coordinates = ErrorCoordinates(FULL, name)
    generator = np.random.default_rng(1)
    direction = generator.standard_normal(FULL.error_dim)
    direction[FULL.slice("a")] *= 1 / np.linalg.norm(direction[FULL.slice("a")])
    d, x, h = size * direction, _point(), 1e-5
    moved, factor = coordinates.fold(x, coordinates.by_error(x) @ d, coordinates.by_error(x))
    np.testing.assert_allclose(moved, coordinates.retract(x, d), atol=1e-12)
    for k in range(FULL.error_dim):
        e = h * np.eye(FULL.error_dim)[k]
        ends = [FULL.local(moved, coordinates.retract(x, d + sign * e)) for sign in (1, -1)]
        np.testing.assert_allclose(factor[:, k], (ends[0] - ends[1]) / (2 * h), atol=3e-8)


@every_name
def test_folds_agree_with_the_layout_to_first_order(name: CoordinateName) -> None:
    coordinates, x = ErrorCoordinates(FULL, name), _point()
    error = 1e-6 * np.random.default_rng(2).standard_normal(FULL.error_dim)
    moved, factor = coordinates.fold(x, error, np.eye(FULL.error_dim))
    np.testing.assert_allclose(FULL.local(x, moved), error, atol=1e-11)
    np.testing.assert_allclose(factor, np.eye(FULL.error_dim), atol=1e-5)


def test_the_invariant_error_does_not_change_with_the_inertial_frame() -> None:
    coordinates, x = ErrorCoordinates(FULL, "coupled"), _point()
    d = 0.4 * np.random.default_rng(3).standard_normal(FULL.error_dim)
    turn, shift = quaternion_from_rotation_vector(np.array([0.7, -1.1, 0.4])), np.array([1.0, 2.0, -3.0])

    def seen(point: np.ndarray) -> np.ndarray:
        """The same motion in another inertial frame."""
        t, q, v = (FULL.mean_slice(block) for block in ("t", "a", "v"))
        other = point.copy()
        other[t] = rotate(turn, point[t]) + shift
        other[q], other[v] = multiply(turn, point[q]), rotate(turn, point[v])
        return other

    there = FULL.local(seen(coordinates.retract(x, d)), coordinates.retract(seen(x), d))
    np.testing.assert_allclose(there, 0.0, atol=1e-12)


def test_the_rate_of_the_target_in_inertial_axes_moves_with_its_attitude() -> None:
    coordinates, x = ErrorCoordinates(FULL, "coupled-inertial"), _point()
    d = np.zeros(FULL.error_dim)
    d[FULL.slice("a")] = [0.3, -0.5, 1.2]
    q, w = FULL.mean_slice("a"), FULL.mean_slice("w")
    moved, turn = coordinates.retract(x, d), quaternion_from_rotation_vector(d[FULL.slice("a")])
    np.testing.assert_allclose(rotate(moved[q], moved[w]), rotate(turn, rotate(x[q], x[w])), atol=1e-12)


def test_a_gyros_state_has_coordinates_without_a_position() -> None:
    layout = StateLayout(ROTATION_BLOCKS)
    x, d = layout.origin(), 0.1 * np.ones(layout.error_dim)
    x[layout.mean_slice("w")] = [0.1, 0.2, 0.3]
    for name in NAMES:
        assert np.isfinite(ErrorCoordinates(layout, name).retract(x, d)).all()


@every_name
def test_the_filter_is_consistent_in_every_coordinates(name: CoordinateName) -> None:
    history = run_on(InvariantEkf(PROCESS, options=InvariantOptions(name)), 1)
    assert len(history.time) == len(embedded(1).timeline) - START.epochs
    assert nees(history, 1).mean() / FULL.error_dim < 2.0


def test_with_the_layouts_own_coordinates_it_is_the_mekf_without_iterated_updates() -> None:
    own = run_on(InvariantEkf(PROCESS, options=InvariantOptions("mrp")), 1)
    mekf = run_on(MultiplicativeEkf(PROCESS, iteration=IterationOptions(iterations=1)), 1)
    np.testing.assert_allclose(own.mean, mekf.mean, atol=1e-10)
    np.testing.assert_allclose(own.std, mekf.std, rtol=1e-8)
