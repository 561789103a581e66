"""Landmarks and velocities eliminated in C, in NumPy, and by dense algebra are the same."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from spinfilters.smoother import elimination as chain_file
from spinfilters.smoother import elimination as elimination_file
from spinfilters.smoother import linear_system as reduced_file
from spinfilters.smoother import motion_factors as motion_file
from spinfilters.smoother.elimination import (
    Eliminated,
    VelocityElimination,
    eliminate,
    eliminate_in_numpy,
    eliminate_velocities,
)
from spinfilters.smoother.kernels import kernels
from spinfilters.smoother.landmark_factors import LandmarkObservations, LinearObservations, places_among
from spinfilters.smoother.linear_system import Marginals, SchurSystem
from tests.smoother.smoothing_samples import MIDDLE, perturbed, sample, solved

FRAMES, KEPT = 19, 6 * 19 + 8
"""More epochs than a kernel takes together, and the unknowns that remain."""
ALONE, UNSEEN, FLAT, UNBELIEVED, TWICE = range(5)
"""Landmarks with one observation, none, no depth, no weight, and several observations in one epoch."""
LANDMARKS = 30


@pytest.fixture
def no_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine without a compiler."""
    for file in (elimination_file, chain_file, motion_file, reduced_file):
        monkeypatch.setattr(file, "kernels", lambda: None)


def _needs_kernels() -> None:
    if kernels() is None:
        pytest.skip("no C compiler on this machine")


def _random(seed: int) -> tuple[LandmarkObservations, LinearObservations, np.ndarray]:
    """Observations of ordinary landmarks and of all that are not, with rows that are any numbers and weights of which a fifth
    is 0."""
    generator = np.random.default_rng(seed)
    pairs = [
        (landmark, epoch)
        for landmark in range(FLAT, LANDMARKS)
        for epoch in range(FRAMES)
        if generator.random() < 0.5
    ]
    pairs += [(ALONE, 3), (FLAT, 2), (FLAT, 4), (TWICE, 1), (TWICE, 1), (TWICE, 1), (TWICE, 5), (TWICE, 5)]
    landmark, epoch = np.array(sorted(pairs)).T.copy()
    rows = generator.standard_normal((len(epoch), 3, 10))
    rows[landmark == FLAT, :, 8] = 0.5 * rows[landmark == FLAT, :, 7]
    weight = np.where(generator.random(len(epoch)) < 0.2, 0.0, 0.1 + generator.random(len(epoch)))
    weight[landmark == UNBELIEVED] = 0.0
    weight[(landmark == TWICE) | (landmark == FLAT)] = 0.7
    counts = np.bincount(epoch, minlength=FRAMES)
    observations = LandmarkObservations(epoch, landmark, np.zeros_like(epoch), counts, LANDMARKS, ())
    return observations, LinearObservations(rows, np.square(rows[:, :, -1]).sum(axis=1)), weight


def _both(seed: int) -> tuple[Eliminated, Eliminated]:
    _needs_kernels()
    observations, linear, weight = _random(seed)
    return (
        eliminate(observations, linear, weight, KEPT, FRAMES),
        eliminate_in_numpy(observations, linear, weight, KEPT, FRAMES),
    )


@pytest.mark.parametrize("seed", range(4))
def test_landmarks_are_eliminated_in_c_as_in_numpy(seed: int) -> None:
    fast, plain = _both(seed)
    told = plain.is_constrained
    np.testing.assert_array_equal(fast.is_constrained, told)
    np.testing.assert_array_equal(fast.used, plain.used)
    np.testing.assert_allclose(
        fast.information_sqrt[told], plain.information_sqrt[told], rtol=1e-10, atol=1e-12
    )
    np.testing.assert_allclose(fast.gradient[told], plain.gradient[told], rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(fast.coupling, plain.coupling, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(fast.pose_gradient, plain.pose_gradient, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(np.tril(fast.information), plain.information, rtol=1e-9, atol=1e-9)


def test_landmarks_that_are_not_told_are_those_without_two_observations_or_without_depth() -> None:
    for found in _both(0):
        assert not found.is_constrained[[ALONE, UNSEEN, FLAT, UNBELIEVED]].any()
        assert found.is_constrained[TWICE]
        assert np.count_nonzero(found.is_constrained) > 20
        assert not found.used[np.isin(found.observations.landmark, [ALONE, FLAT, UNBELIEVED])].any()


def test_several_observations_in_one_epoch_count_in_the_coupling_of_the_first() -> None:
    for found in _both(0):
        rows = np.flatnonzero(found.observations.landmark == TWICE)
        epoch = found.observations.epoch[rows]
        for k in np.unique(epoch):
            first, *others = rows[epoch == k]
            assert np.abs(found.coupling[first]).max() > 0
            assert not found.coupling[others].any()


@pytest.mark.parametrize("seed", range(3))
def test_landmarks_follow_the_poses_in_c_as_in_numpy(seed: int) -> None:
    fast, plain = _both(seed)
    poses = np.random.default_rng(seed).standard_normal((FRAMES, 6))
    expected = plain._points_step(poses)
    np.testing.assert_allclose(fast.points_step(poses), expected, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(fast.points_step(np.asfortranarray(poses)), expected, rtol=1e-8, atol=1e-9)
    assert not fast.points_step(poses)[~fast.is_constrained].any()


def _stacked(seed: int, told: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All used rows over poses and told landmarks, and the right-hand side."""
    observations, linear, weight = _random(seed)
    number = np.cumsum(told) - 1
    J = np.zeros((int(used.sum()), 3, 6 * FRAMES + 3 * int(told.sum())))
    for row, k in enumerate(np.flatnonzero(used)):
        pose, point = 6 * observations.epoch[k], 6 * FRAMES + 3 * number[observations.landmark[k]]
        scaled = np.sqrt(weight[k]) * linear.rows[k]
        J[row, :, pose : pose + 6], J[row, :, point : point + 3] = scaled[:, :6], scaled[:, 6:9]
    y = np.sqrt(weight[used])[:, None] * linear.rows[used, :, 9]
    return J.reshape(-1, J.shape[2]), y.reshape(-1)


@pytest.mark.parametrize("which", [0, 1], ids=["C", "NumPy"])
def test_what_is_left_to_the_poses_is_the_dense_schur_complement(which: int) -> None:
    found, size = _both(1)[which], 6 * FRAMES
    J, y = _stacked(1, found.is_constrained, found.used)
    H, g = J.T @ J, J.T @ y
    gain = np.linalg.solve(H[size:, size:], H[size:, :size]).T
    np.testing.assert_allclose(
        np.tril(found.information[:size, :size]),
        np.tril(H[:size, :size] - gain @ H[size:, :size]),
        atol=1e-8,
    )
    np.testing.assert_allclose(found.pose_gradient[:size], g[:size] - gain @ g[size:], atol=1e-8)
    assert not found.information[size:].any()
    assert not found.pose_gradient[size:].any()


def _system(seed: int, pose: int, reach: int, epochs: int = 40) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A positive definite chain D, E, and its coupling G to poses (up to the next, the first up to ``reach``) and the rest."""
    generator, v, rest = np.random.default_rng(seed), 6, 9
    rows = generator.standard_normal((epochs - 1, 2 * v + 3, 2 * v))
    blocks = rows.swapaxes(1, 2) @ rows
    D, E = np.tile(np.eye(v), (epochs, 1, 1)), blocks[:, :v, v:].copy()
    D[:-1] += blocks[:, :v, :v]
    D[1:] += blocks[:, v:, v:]
    G = generator.standard_normal((epochs, v, epochs * pose + rest))
    for k in range(epochs):
        G[k, :, : max(k - 1, 0) * pose] = 0.0
        G[k, :, max(k + 2, reach if k == 0 else 0) * pose : epochs * pose] = 0.0
    return D, E, G


def _reduced(tridiagonal: VelocityElimination, size: int) -> np.ndarray:
    M = np.zeros((size + 1, size))
    tridiagonal.reduce(M)
    return np.tril(M)


@pytest.mark.parametrize(("pose", "reach"), [(0, 0), (6, 0), (6, 5), (6, 40)])
def test_a_chain_is_eliminated_in_c_as_in_numpy(
    pose: int, reach: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    _needs_kernels()
    fast = eliminate_velocities(*_system(3, pose, reach), pose, reach)
    kept = np.random.default_rng(4).standard_normal(fast.coupling.shape[2] - 1)
    errors, reduced = fast.back(kept), _reduced(fast, len(kept))
    monkeypatch.setattr(chain_file, "kernels", lambda: None)
    plain = eliminate_velocities(*_system(3, pose, reach), pose, reach)
    assert fast.failed == plain.failed == -1
    np.testing.assert_allclose(
        np.tril(fast.information_sqrts), np.tril(plain.information_sqrts), rtol=1e-10, atol=1e-12
    )
    np.testing.assert_allclose(fast.next, plain.next, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(fast.coupling, plain.coupling, rtol=1e-8, atol=1e-11)
    np.testing.assert_allclose(errors, plain.back(kept), rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(reduced, _reduced(plain, len(kept)), rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize(("pose", "reach"), [(0, 0), (6, 0), (6, 5)])
@pytest.mark.parametrize("library", ["C", "NumPy"])
def test_a_chain_leaves_the_dense_schur_complement(
    pose: int, reach: int, library: str, request: pytest.FixtureRequest
) -> None:
    if library == "NumPy":
        request.getfixturevalue("no_kernels")
    D, E, G = _system(5, pose, reach)
    epochs, v, width = G.shape
    H = np.zeros((epochs, v, epochs, v))
    H[np.arange(epochs), :, np.arange(epochs)] = D
    H[np.arange(epochs - 1), :, np.arange(1, epochs)] = E
    H[np.arange(1, epochs), :, np.arange(epochs - 1)] = E.swapaxes(1, 2)
    whole, coupling = H.reshape(epochs * v, -1), G.reshape(epochs * v, width).copy()
    expected = -coupling.T @ np.linalg.solve(whole, coupling[:, :-1])
    tridiagonal = eliminate_velocities(D, E, G, pose, reach)
    np.testing.assert_allclose(_reduced(tridiagonal, width - 1), np.tril(expected), atol=1e-8)
    kept = np.random.default_rng(6).standard_normal(width - 1)
    behind = np.linalg.solve(whole, coupling[:, -1] - coupling[:, :-1] @ kept)
    np.testing.assert_allclose(tridiagonal.back(kept).reshape(-1), behind, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("library", ["C", "NumPy"])
@pytest.mark.parametrize("wrong", [0, 4, 39])
@pytest.mark.parametrize("value", [-1e3, np.nan])
def test_the_first_block_that_is_not_positive_definite_is_reported(
    library: str, wrong: int, value: float, request: pytest.FixtureRequest
) -> None:
    if library == "NumPy":
        request.getfixturevalue("no_kernels")
    D, E, G = _system(3, 6, 0)
    D[wrong, 2, 2] = value
    assert eliminate_velocities(D, E, G, 6, 0).failed == wrong


def test_a_solve_without_a_compiler_is_that_with_one(
    no_kernels: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, trial = sample(MIDDLE), perturbed(sample(MIDDLE), 1)
    plain = solved(here, trial)
    monkeypatch.undo()
    _needs_kernels()
    fast = solved(here, trial)
    assert fast.iterations == plain.iterations
    np.testing.assert_allclose(fast.costs, plain.costs, rtol=1e-7)
    np.testing.assert_allclose(fast.point.trajectory, plain.point.trajectory, atol=1e-8)
    factors = []
    for found in (fast, plain):
        assert isinstance(found.normal.solution, SchurSystem)
        factors.append(Marginals(found.normal.solution, found.normal.eliminated).factors)
    np.testing.assert_allclose(factors[0], factors[1], rtol=1e-5, atol=1e-9)


def test_weights_that_are_all_zero_leave_nothing() -> None:
    observations, linear, weight = _random(0)
    for how in (eliminate, eliminate_in_numpy):
        found = how(observations, linear, np.zeros_like(weight), KEPT, FRAMES)
        assert not found.is_constrained.any()
        assert not found.used.any()
        assert not found.information.any()
        assert not found.points_step(np.ones((FRAMES, 6))).any()


@pytest.mark.parametrize("how", [eliminate, eliminate_in_numpy])
def test_a_row_without_weight_says_nothing_even_where_it_is_not_a_number(
    how: Callable[[LandmarkObservations, LinearObservations, np.ndarray, int, int], Eliminated],
) -> None:
    observations, linear, weight = _random(2)
    expected = how(observations, linear, weight, KEPT, FRAMES)
    rows = linear.rows.copy()
    rows[weight == 0] = np.nan
    found = how(observations, replace(linear, rows=rows), weight, KEPT, FRAMES)
    np.testing.assert_array_equal(found.is_constrained, expected.is_constrained)
    np.testing.assert_array_equal(found.pose_gradient, expected.pose_gradient)
    np.testing.assert_array_equal(found.information, expected.information)


@pytest.mark.parametrize("size", [1, 7, 8, 9, 17, 63, 64, 65, 81, 150])
def test_the_root_in_c_is_that_of_lapack(size: int) -> None:
    """Sizes about those of tiles and blocks; the last row is substituted forwards, and a bad pivot is told by its number."""
    library = kernels()
    if library is None:
        pytest.skip("no C compiler on this machine")
    generator = np.random.default_rng(size)
    rows, right = generator.standard_normal((size + 3, size)), generator.standard_normal(size)
    matrix = np.concatenate([np.tril(rows.T @ rows), right[None]])
    bad, number = matrix.copy(), size // 2
    assert library.root_of_rows(size + 1, size, matrix.ctypes.data) == 0
    root = np.linalg.cholesky(rows.T @ rows)
    np.testing.assert_allclose(np.tril(matrix[:-1]), root, rtol=0, atol=1e-13 * np.abs(root).max())
    np.testing.assert_allclose(root @ matrix[-1], right, rtol=0, atol=1e-11 * np.abs(right).max())
    for pivot in (-1.0, np.nan, np.inf):
        bad[number, number] = pivot
        assert library.root_of_rows(size + 1, size, bad.copy().ctypes.data) == number + 1


@pytest.mark.parametrize("spread", [1, 1_000_000])
def test_ids_are_found_among_dense_and_sparse_ones(spread: int) -> None:
    """By a table and by a search; ids below, between and above are not among them."""
    known = spread * np.array([7, 3, 12, -4, 5])
    ids = spread * np.array([5, 3, 4, 13, -5, -4, 12, 12, 2**40, -(2**40)])
    np.testing.assert_array_equal(places_among(known, ids), [4, 1, -1, -1, -1, 3, 2, 2, -1, -1])
    np.testing.assert_array_equal(places_among(known[:0], ids), np.full(len(ids), -1))
    assert not len(places_among(known, ids[:0]))
