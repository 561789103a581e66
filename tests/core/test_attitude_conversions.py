"""Every representation against SciPy and against every other, where formulas break and everywhere else."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation

from spinfilters.core import attitude_conversions as attitude
from spinfilters.core.errors import InputError, ShapeError
from tests.core.attitude_samples import (
    TINY_ANGLES,
    quaternions,
    random_quaternions,
    special_quaternions,
    special_rotation_vectors,
    vectors,
)

ROUNDING: Final = 4e-15
"""rad: some ten roundings of a quaternion."""


@dataclass(frozen=True)
class Representation:
    """How spinfilters and SciPy go from a quaternion to this representation and back."""

    of: Callable[[np.ndarray], np.ndarray]
    to: Callable[[np.ndarray], np.ndarray]
    scipy_of: Callable[[Rotation], np.ndarray]
    scipy_to: Callable[[np.ndarray], Rotation]


REPRESENTATIONS: Final = {
    "matrix": Representation(
        attitude.matrix_from_quaternion,
        attitude.quaternion_from_matrix,
        lambda r: r.as_matrix(),
        Rotation.from_matrix,
    ),
    "4 x MRP": Representation(
        attitude.mrp_from_quaternion,
        attitude.quaternion_from_mrp,
        lambda r: 4 * r.as_mrp(),
        lambda a: Rotation.from_mrp(a / 4),
    ),
    "rotation vector": Representation(
        attitude.rotation_vector_from_quaternion,
        attitude.quaternion_from_rotation_vector,
        lambda r: r.as_rotvec(),
        Rotation.from_rotvec,
    ),
}
SAMPLES: Final = np.concatenate([special_quaternions(), random_quaternions(200)])


@pytest.fixture(params=REPRESENTATIONS)
def representation(request: pytest.FixtureRequest) -> Representation:
    return REPRESENTATIONS[request.param]


def test_scipy_reads_every_representation_as_the_same_attitude(representation: Representation) -> None:
    q = representation.scipy_to(representation.of(SAMPLES)).as_quat()
    assert np.max(attitude.angle_between(q, SAMPLES)) < ROUNDING


def test_every_representation_of_scipy_is_read_as_the_same_attitude(representation: Representation) -> None:
    regular = SAMPLES[np.abs(Rotation.from_quat(SAMPLES).as_matrix()[:, 2, 0]) < 1 - 1e-12]
    q = representation.to(representation.scipy_of(Rotation.from_quat(regular)))
    assert np.max(attitude.angle_between(q, regular)) < ROUNDING


@pytest.mark.parametrize(("first", "second"), list(product(REPRESENTATIONS, repeat=2)))
def test_every_pair_of_representations_makes_a_round_trip(first: str, second: str) -> None:
    one, other = REPRESENTATIONS[first], REPRESENTATIONS[second]
    q = one.to(one.of(other.to(other.of(SAMPLES))))
    assert np.max(attitude.angle_between(q, SAMPLES)) < 2 * ROUNDING


@given(quaternions())
def test_any_quaternion_survives_every_representation(q: np.ndarray) -> None:
    for representation in REPRESENTATIONS.values():
        assert attitude.angle_between(representation.to(representation.of(q)), q) < ROUNDING


@pytest.mark.parametrize("shape", [(), (0,), (4,), (2, 3)])
def test_a_batch_gives_what_its_items_give(representation: Representation, shape: tuple[int, ...]) -> None:
    q = random_quaternions(*shape)
    value = representation.of(q)
    back = representation.to(value)
    assert value.shape[: len(shape)] == shape
    assert back.shape == q.shape
    for index in np.ndindex(shape):
        np.testing.assert_array_equal(value[index], representation.of(q[index]))
        np.testing.assert_array_equal(back[index], representation.to(value[index]))


@given(vectors(3, 40.0))
def test_any_rotation_vector_gives_the_quaternion_of_scipy(r: np.ndarray) -> None:
    q = attitude.quaternion_from_rotation_vector(r)
    assert attitude.angle_between(q, Rotation.from_rotvec(r).as_quat()) < 2e-14


@given(vectors(3, 1e3))
def test_any_mrp_gives_the_quaternion_of_scipy(a: np.ndarray) -> None:
    q = attitude.quaternion_from_mrp(a)
    assert attitude.angle_between(q, Rotation.from_mrp(a / 4).as_quat()) < ROUNDING


@given(vectors(3, 7.0))
def test_euler_angles_multiply_as_yaw_then_pitch_then_roll(angles: np.ndarray) -> None:
    (cz, cy, cx), (sz, sy, sx) = np.cos(angles), np.sin(angles)
    yaw = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    pitch = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    roll = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    R = attitude.matrix_from_quaternion(attitude.quaternion_from_euler321(angles))
    np.testing.assert_allclose(R, yaw @ pitch @ roll, atol=ROUNDING)


def test_the_thesis_prints_the_transposed_euler_matrix() -> None:
    phi, theta, gamma = 0.3, -0.7, 1.9
    first = [[1, 0, 0], [0, np.cos(phi), np.sin(phi)], [0, -np.sin(phi), np.cos(phi)]]
    second = [[np.cos(theta), 0, -np.sin(theta)], [0, 1, 0], [np.sin(theta), 0, np.cos(theta)]]
    third = [[np.cos(gamma), np.sin(gamma), 0], [-np.sin(gamma), np.cos(gamma), 0], [0, 0, 1]]
    printed = np.array(first) @ np.array(second) @ np.array(third)
    q = attitude.quaternion_from_euler321(np.array([gamma, theta, phi]))
    np.testing.assert_allclose(attitude.matrix_from_quaternion(q), printed.T, atol=ROUNDING)


def test_the_short_way_round_is_at_most_half_a_turn() -> None:
    assert np.max(np.linalg.norm(attitude.mrp_from_quaternion(SAMPLES), axis=-1)) <= 4 + 1e-15
    assert np.max(np.linalg.norm(attitude.rotation_vector_from_quaternion(SAMPLES), axis=-1)) <= np.pi + 1e-15
    assert np.all(attitude.quaternion_from_matrix(attitude.matrix_from_quaternion(SAMPLES))[:, 3] >= 0)


def test_a_matrix_gives_back_its_quaternion_componentwise() -> None:
    short = SAMPLES * np.where(SAMPLES[:, 3:] < 0, -1, 1)
    found = attitude.quaternion_from_matrix(attitude.matrix_from_quaternion(short))
    clear = short[:, 3] > 1e-3  # at half a turn the sign is free
    np.testing.assert_allclose(found[clear], short[clear], rtol=0, atol=1e-15)


def test_small_rotations_keep_their_relative_accuracy() -> None:
    small = special_rotation_vectors()
    small = small[np.linalg.norm(small, axis=-1) < 0.1]
    q = attitude.quaternion_from_rotation_vector(small)
    np.testing.assert_allclose(attitude.rotation_vector_from_quaternion(q), small, rtol=1e-15, atol=1e-300)
    a = attitude.mrp_from_quaternion(q)
    length = np.linalg.norm(small, axis=-1, keepdims=True)
    expected = small * np.where(length > 1e-100, 4 * np.tan(length / 4) / np.maximum(length, 1e-100), 1)
    np.testing.assert_allclose(a, expected, rtol=1e-15, atol=1e-300)


@given(quaternions(), quaternions(), vectors(3, 10.0))
def test_products_of_quaternions_are_products_of_rotations(
    q: np.ndarray, p: np.ndarray, v: np.ndarray
) -> None:
    R_q, R_p = attitude.matrix_from_quaternion(q), attitude.matrix_from_quaternion(p)
    qp = attitude.multiply(q, p)
    np.testing.assert_allclose(attitude.matrix_from_quaternion(qp), R_q @ R_p, atol=ROUNDING)
    np.testing.assert_allclose(attitude.rotate(qp, v), R_q @ R_p @ v, atol=1e-13)
    np.testing.assert_allclose(attitude.rotate(attitude.inverse(q), v), R_q.T @ v, atol=1e-13)


def test_a_positive_rotation_about_z_turns_x_to_y() -> None:
    q = attitude.quaternion_from_rotation_vector(np.array([0.0, 0.0, np.pi / 2]))
    np.testing.assert_allclose(attitude.rotate(q, np.array([1.0, 0.0, 0.0])), [0, 1, 0], atol=1e-15)


def test_arguments_broadcast_over_their_batch_axes() -> None:
    q, v = random_quaternions(5, 1), np.random.default_rng(1).normal(size=(2, 3))
    together = attitude.rotate(q, v)
    assert together.shape == (5, 2, 3)
    np.testing.assert_array_equal(together[3, 1], attitude.rotate(q[3, 0], v[1]))


@pytest.mark.parametrize("angle", [*TINY_ANGLES, 0.5, 3.0, np.pi])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_angle_between_attitudes_is_their_rotation_angle(angle: float, sign: int) -> None:
    q = random_quaternions(50)
    turned = attitude.multiply(
        q, attitude.quaternion_from_rotation_vector(angle * np.array([0.6, 0.0, -0.8]))
    )
    np.testing.assert_allclose(attitude.angle_between(sign * q, turned), angle, rtol=0, atol=1.5e-15)


def test_the_angle_to_itself_is_exactly_zero() -> None:
    np.testing.assert_array_equal(attitude.angle_between(SAMPLES, -SAMPLES), 0.0)


def test_continuous_quaternions_never_jump() -> None:
    angle = np.linspace(0, 30, 400)
    smooth = attitude.quaternion_from_rotation_vector(angle[:, np.newaxis] * np.array([0.0, 0.6, 0.8]))
    signs = np.random.default_rng(3).choice([-1.0, 1.0], (400, 1))
    found = attitude.continuous_quaternions(smooth * signs)
    np.testing.assert_array_equal(found, smooth * signs[0])


def test_continuous_quaternions_treat_each_body_alone() -> None:
    q = np.stack([random_quaternions(20), -random_quaternions(20)], axis=1)
    found = attitude.continuous_quaternions(q)
    np.testing.assert_array_equal(found[:, 0], attitude.continuous_quaternions(q[:, 0]))
    np.testing.assert_array_equal(found[:, 1], attitude.continuous_quaternions(q[:, 1]))


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (
            lambda: attitude.rotate(np.ones((2, 4)), np.zeros(3)),
            r"q\[0\] = \[1. 1. 1. 1.\] is not of unit norm",
        ),
        (lambda: attitude.inverse(np.array([0, 0, 0, 1 + 2e-6])), "not of unit norm"),
        (lambda: attitude.quaternion_from_mrp(np.array([0, np.nan, 0])), r"a\[1\] = nan is not finite"),
        (lambda: attitude.inverse(np.array([0, 0, 0, np.inf])), "not finite"),
        (lambda: attitude.quaternion_from_matrix(np.eye(3) * 1.01), "R = (?s:.*) not orthonormal"),
        (lambda: attitude.quaternion_from_matrix(-np.eye(3)), "reflection"),
    ],
)
def test_values_that_are_no_rotation_are_named(call: Callable[[], object], text: str) -> None:
    with pytest.raises(InputError, match=text):
        call()


@pytest.mark.parametrize(
    "call",
    [
        lambda: attitude.inverse(np.zeros(3)),
        lambda: attitude.inverse(np.array(1.0)),
        lambda: attitude.quaternion_from_mrp(np.zeros((3, 2))),
        lambda: attitude.quaternion_from_matrix(np.zeros((3, 4))),
        lambda: attitude.rotate(random_quaternions(2), np.zeros((3, 3))),
        lambda: attitude.continuous_quaternions(random_quaternions()),
    ],
)
def test_wrong_shapes_are_refused(call: Callable[[], object]) -> None:
    with pytest.raises(ShapeError):
        call()


def test_a_nearly_unit_quaternion_is_normalised() -> None:
    q = random_quaternions(10)
    np.testing.assert_allclose(attitude.multiply(q * (1 + 5e-7), q), attitude.multiply(q, q), atol=1e-15)


def test_matrices_and_rotation_vectors_are_those_of_scipy() -> None:
    vectors_of, R = special_rotation_vectors(), Rotation.from_quat(SAMPLES).as_matrix()
    matrices = attitude.matrix_from_rotation_vector(vectors_of)
    assert np.abs(matrices - Rotation.from_rotvec(vectors_of).as_matrix()).max() < ROUNDING
    back = Rotation.from_rotvec(attitude.rotation_vector_from_matrix(R)).as_matrix()
    assert np.abs(back - R).max() < ROUNDING
    assert attitude.angle_from_matrix(R) == pytest.approx(Rotation.from_matrix(R).magnitude(), abs=1e-7)


def test_a_cross_matrix_multiplies_as_the_cross_product() -> None:
    a, b = np.random.default_rng(0).standard_normal((2, 5, 3))
    assert (attitude.cross_matrix(a) @ b[..., None])[..., 0] == pytest.approx(np.cross(a, b))
