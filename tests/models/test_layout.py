"""Points and errors of a state: retract and local undo one another, and a reset moves errors by its Jacobian."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spinfilters.core.attitude_conversions import angle_between, quaternion_from_mrp
from spinfilters.core.errors import InputError, ShapeError
from spinfilters.core.mass_distribution import from_inertia, inertia_matrix
from spinfilters.models.state_blocks import BLOCKS
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout

ROTATION, FULL = StateLayout(ROTATION_BLOCKS), StateLayout(FULL_BLOCKS)
WITH_DRAG = StateLayout((*FULL_BLOCKS, "d"))
MASS = StateLayout(("s",))
VECTORS = StateLayout(("v", "w", "c"))
EVERY_BLOCK = StateLayout(tuple(BLOCKS))
LAYOUTS = (ROTATION, FULL, WITH_DRAG, MASS, VECTORS, EVERY_BLOCK)


def _point(layout: StateLayout, generator: np.random.Generator) -> np.ndarray:
    return layout.retract(layout.origin(), 0.7 * generator.standard_normal(layout.error_dim))


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: "".join(layout.blocks))
@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-6, 1e-2, 0.3, 1.0])
def test_local_undoes_retract(layout: StateLayout, size: float) -> None:
    generator = np.random.default_rng(1)
    for _ in range(20):
        x, d = _point(layout, generator), size * generator.uniform(-1, 1, layout.error_dim)
        np.testing.assert_allclose(layout.local(x, layout.retract(x, d)), d, atol=2e-13 * max(1, size / 1e-2))


@pytest.mark.parametrize("layout", [ROTATION, FULL, EVERY_BLOCK], ids=lambda layout: "".join(layout.blocks))
def test_errors_side_by_side_have_the_bits_of_each_by_itself(layout: StateLayout) -> None:
    generator = np.random.default_rng(5)
    x, d = _point(layout, generator), generator.standard_normal((41, layout.error_dim))
    y = layout.retract_each(x, d)
    np.testing.assert_array_equal(y, [layout.retract(x, each) for each in d])
    np.testing.assert_array_equal(layout.local_each(x, y), [layout.local(x, each) for each in y])


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: "".join(layout.blocks))
def test_retract_undoes_local(layout: StateLayout) -> None:
    generator = np.random.default_rng(2)
    for _ in range(20):
        x, y = _point(layout, generator), _point(layout, generator)
        back = layout.retract(x, layout.local(x, y))
        np.testing.assert_allclose(layout.local(y, back), 0.0, atol=1e-10)


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: "".join(layout.blocks))
@pytest.mark.parametrize("size", [0.0, 1e-9, 0.1, 0.5])
def test_the_reset_jacobian_is_the_derivative_of_the_error_about_the_new_point(
    layout: StateLayout, size: float
) -> None:
    generator = np.random.default_rng(3)
    x, d, h = _point(layout, generator), size * generator.standard_normal(layout.error_dim), 1e-5
    y, steps = layout.retract(x, d), h * np.eye(layout.error_dim)
    ahead, behind = (layout.local(y, layout.retract(x, d + sign * steps)) for sign in (1, -1))
    np.testing.assert_allclose(layout.reset_jacobian(d), (ahead - behind).T / (2 * h), atol=1e-8)


def test_without_an_error_the_reset_changes_nothing() -> None:
    np.testing.assert_allclose(FULL.reset_jacobian(np.zeros(20)), np.eye(20), atol=1e-15)


def test_an_attitude_error_is_four_mrps_on_the_body_side() -> None:
    layout = StateLayout(("a",))
    turned = layout.retract(layout.origin(), np.array([4 * np.tan(0.8 / 4), 0.0, 0.0]))
    np.testing.assert_allclose(turned, [np.sin(0.4), 0.0, 0.0, np.cos(0.4)], atol=1e-15)


def test_an_attitude_error_goes_the_short_way_round_for_either_sign_of_the_quaternion() -> None:
    layout, generator = StateLayout(("a",)), np.random.default_rng(4)
    for _ in range(20):
        x, y = (q / np.linalg.norm(q) for q in generator.standard_normal((2, 4)))
        a = layout.local(x, y)
        assert np.linalg.norm(a) <= 4 * (1 + 1e-12)
        np.testing.assert_allclose(layout.local(x, -y), a, atol=1e-12)
        assert angle_between(quaternion_from_mrp(a), layout.retract(layout.origin(), a)) < 1e-12


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 5.0))
def test_every_error_of_the_mass_distribution_leads_to_a_physical_body(seed: int, size: float) -> None:
    generator = np.random.default_rng(seed)
    s = MASS.retract(MASS.origin(), generator.uniform(-1, 1, 5))
    d = generator.uniform(-size, size, 5)
    J = inertia_matrix(MASS.retract(s, d))
    moments = np.linalg.eigvalsh(J)
    assert np.isfinite(J).all()
    assert moments[0] > 0
    assert moments[0] + moments[1] >= moments[2] * (1 - 1e-12)


def test_the_origin_of_the_mass_distribution_is_the_sphere() -> None:
    J = inertia_matrix(np.zeros(5))
    np.testing.assert_allclose(J, J[0, 0] * np.eye(3), atol=1e-15)
    np.testing.assert_allclose(from_inertia(7.0 * np.eye(3)), 0.0, atol=1e-15)


def test_an_inertia_comes_back_from_its_numbers_up_to_scale() -> None:
    generator = np.random.default_rng(5)
    for _ in range(20):
        J = inertia_matrix(generator.uniform(-1, 1, 5))
        again = inertia_matrix(from_inertia(3.0 * J))
        np.testing.assert_allclose(again, J, rtol=1e-12, atol=1e-12 * np.abs(J).max())


def test_an_error_of_the_mass_distribution_multiplies_second_moments_in_any_frame() -> None:
    """S -> L exp(D) L' with D = 2 x I along one axis stretches that axis by e for every body it is applied to."""
    D = np.array([2 / 3 * 0.3, -0.3 / 3, 0.0, 0.0, 0.0])
    for s in (np.zeros(5), np.array([0.2, -0.4, 0.0, 0.0, 0.0])):
        moments = (_second_moments(point) for point in (MASS.retract(s, D), s))
        after, before = (np.diag(matrix) for matrix in moments)
        np.testing.assert_allclose(np.log(after / before), [0.2, -0.1, -0.1], atol=1e-12)


def test_an_impossible_inertia_is_refused() -> None:
    with pytest.raises(InputError, match="no rigid body"):
        from_inertia(np.diag([3.0, 1.0, 1 / 3]))


@pytest.mark.parametrize("blocks", [("w", "a"), ("a", "a"), ("a", "x"), ("s", "d", "c")])
def test_blocks_that_are_unknown_repeated_or_out_of_order_are_refused(blocks: tuple[str, ...]) -> None:
    with pytest.raises(InputError, match="state blocks"):
        StateLayout(blocks)


def test_points_and_errors_of_a_wrong_size_are_refused() -> None:
    with pytest.raises(ShapeError):
        FULL.retract(np.zeros(20), np.zeros(20))
    with pytest.raises(ShapeError):
        FULL.local(FULL.origin(), np.zeros(20))


def test_the_slices_of_a_layout_cover_it_without_gap() -> None:
    for layout in LAYOUTS:
        where = np.concatenate([np.arange(layout.error_dim)[layout.slice(b)] for b in layout.blocks])
        np.testing.assert_array_equal(where, np.arange(layout.error_dim))
        where = np.concatenate([np.arange(layout.mean_dim)[layout.mean_slice(b)] for b in layout.blocks])
        np.testing.assert_array_equal(where, np.arange(layout.mean_dim))


def _second_moments(s: np.ndarray) -> np.ndarray:
    J = inertia_matrix(s)
    return np.trace(J) / 2 * np.eye(3) - J
