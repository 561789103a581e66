"""The compiled steps of an epoch compute what their NumPy reference computes."""

import numpy as np
import pytest

from spinfilters.estimators.landmarks.landmark_map import LandmarkMap
from spinfilters.estimators.landmarks.native import LARGEST_STATE, NativeSteps, steps_of
from spinfilters.estimators.landmarks.reference import NumpySteps
from spinfilters.estimators.landmarks.steps import NewModes

RANK, COUNT, POSE = 5, 23, 6
SIZE = 20 + RANK + 6
PRECISIONS = pytest.mark.parametrize("precision", ["float64", "float32"])


def sample(precision: str) -> tuple[np.random.Generator, LandmarkMap]:
    generator = np.random.default_rng(4)
    landmarks = LandmarkMap(RANK, precision)
    roots = np.tril(generator.standard_normal((60, 3, 3)))
    modes = generator.standard_normal((60, 3, RANK))
    landmarks.append(np.arange(60), generator.standard_normal((60, 3)), modes, roots)
    return generator, landmarks


def both(precision: str) -> tuple[NumpySteps, NativeSteps]:
    steps = steps_of(RANK, precision)
    if not isinstance(steps, NativeSteps):
        pytest.skip("no compiler")
    return NumpySteps(), steps


def assert_alike(found: np.ndarray, expected: np.ndarray, rtol: float = 1e-9) -> None:
    np.testing.assert_allclose(found, expected, rtol=rtol, atol=rtol * np.abs(expected).max(initial=1e-300))


@PRECISIONS
def test_following_landmarks(precision):
    tolerance = 1e-9 if precision == "float64" else 1e-5
    made = []
    for steps in both(precision):
        generator, landmarks = sample(precision)
        landmarks.steps = steps
        for _ in range(30):
            landmarks.advance(
                np.eye(RANK) + 0.1 * generator.standard_normal((RANK, RANK)),
                0.1 * generator.standard_normal((RANK, POSE)),
                generator.standard_normal(RANK),
            )
        landmarks.refresh(np.arange(60))
        made.append(landmarks.snapshot())
    for key, array in made[0].items():
        found = made[1][key]
        if key == "map.roots":
            array, found = (x.astype(float) @ np.swapaxes(x.astype(float), 1, 2) for x in (array, found))
        assert_alike(found, array, tolerance)


@PRECISIONS
def test_an_epoch_of_observations(precision):
    tolerance = 1e-9 if precision == "float64" else 1e-5
    made = [epoch(steps, precision) for steps in both(precision)]
    for expected, found in zip(*made, strict=True):
        assert_alike(found, expected, tolerance)


def epoch(steps: NumpySteps | NativeSteps, precision: str) -> list[np.ndarray]:
    """Everything that does not depend on the signs of modes and of the factor's columns."""
    generator, landmarks = sample(precision)
    at = generator.permutation(60)[:COUNT]
    linear, weights = generator.standard_normal((COUNT, 3, POSE + 4)), generator.uniform(0.1, 2.0, COUNT)
    factor = np.tril(generator.standard_normal((SIZE, SIZE)))
    columns = np.r_[0:POSE, 20 : 20 + RANK]
    white = steps.whitened(landmarks, at, linear, weights)
    squares = (
        np.einsum("kdi,kdj->kij", white.rows, white.rows),
        np.einsum("kdi,kdj->kij", white.spread, white.rows),
    )
    correction = steps.corrected(white.rows, factor, columns)
    new_rows, own = generator.standard_normal((4, 3, POSE)), np.tril(generator.standard_normal((4, 3, 3)))
    modes = steps.compress(white, new_rows, correction.factor[columns], np.ones(RANK))
    steps.observe(landmarks, at, white, correction.error[columns], modes)
    dependence, roots = steps.settled(new_rows, own, modes)
    shared = modes.rows @ correction.factor.T
    A, L = landmarks.modes[:60].astype(float), landmarks.roots[:60].astype(float)
    return [
        *squares,
        white.log_noise,
        correction.error,
        correction.factor @ correction.factor.T,
        np.array([correction.nis, correction.log_likelihood, correction.length(correction.coordinates)]),
        correction.coordinates,
        modes.explained,
        modes.rows @ modes.rows.T,
        shared.T @ shared,
        modes.kept @ shared,
        modes.dropped @ modes.dropped.T,
        landmarks.points[:60],
        A[at] @ shared,
        (L @ np.swapaxes(L, 1, 2)),
        dependence.astype(float) @ shared,
        roots.astype(float) @ np.swapaxes(roots.astype(float), 1, 2),
    ]


def test_an_epoch_without_any_observation():
    for steps in both("float64"):
        _, landmarks = sample("float64")
        none = np.zeros(0, dtype=np.int64)
        white = steps.whitened(landmarks, none, np.zeros((0, 3, POSE + 4)), np.zeros(0))
        correction = steps.corrected(white.rows, np.eye(SIZE), np.r_[0:POSE, 20 : 20 + RANK])
        np.testing.assert_array_equal(correction.error, 0.0)
        assert_alike(correction.factor @ correction.factor.T, np.eye(SIZE))
        rows = correction.factor[np.r_[0:POSE, 20 : 20 + RANK]]
        modes = steps.compress(white, np.zeros((0, 3, POSE)), rows, np.ones(RANK))
        assert isinstance(modes, NewModes)
        assert_alike(modes.rows @ modes.rows.T, np.eye(RANK))


def test_a_sensor_of_another_shape_goes_through_numpy():
    reference, native = both("float64")
    generator, landmarks = sample("float64")
    at, linear = np.arange(7), generator.standard_normal((7, 2, POSE + 4))
    factor = np.tril(generator.standard_normal((SIZE, SIZE)))
    columns = np.r_[0:POSE, 20 : 20 + RANK]
    found = []
    for steps in (reference, native):
        white = steps.whitened(landmarks, at, linear, np.ones(7))
        found.append(steps.corrected(white.rows, factor, columns))
    np.testing.assert_array_equal(found[0].error, found[1].error)
    assert SIZE <= RANK + LARGEST_STATE
