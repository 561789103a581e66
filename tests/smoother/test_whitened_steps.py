"""Process factors whitened in C and in NumPy are the same."""

import numpy as np
import pytest

from spinfilters.smoother.kernels import kernels
from spinfilters.smoother.motion_factors import whitened_steps, whitened_steps_in_numpy
from spinfilters.smoother.priors import VariableOrdering
from tests.smoother.smoothing_samples import LAYOUT


def _needs_kernels() -> None:
    if kernels() is None:
        pytest.skip("no C compiler on this machine")


def _steps(
    seed: int, count: int, has_landmarks: bool
) -> tuple[VariableOrdering, np.ndarray, np.ndarray, np.ndarray]:
    """Defects, transitions and noise factors of any numbers."""
    random, n = np.random.default_rng(seed).standard_normal, LAYOUT.error_dim
    ordering = VariableOrdering(LAYOUT, count + 1, has_landmarks)
    return ordering, random((count, n)), random((count, n, n)), random((count, n, 12))


@pytest.mark.parametrize("count", [0, 1, 5])
@pytest.mark.parametrize("has_landmarks", [True, False])
def test_steps_are_whitened_in_c_as_in_numpy(count: int, has_landmarks: bool) -> None:
    _needs_kernels()
    steps = _steps(count, count, has_landmarks)
    for fast, plain in zip(whitened_steps(*steps), whitened_steps_in_numpy(*steps), strict=True):
        assert fast.shape == plain.shape
        np.testing.assert_allclose(fast, plain, rtol=1e-9, atol=1e-9)


def test_whitened_steps_have_the_information_that_their_noise_leaves() -> None:
    ordering, defect, transition, noise = _steps(3, 4, True)
    rows, blocks = whitened_steps(ordering, defect, transition, noise)
    d, c, moving = len(ordering.moving), len(ordering.constant), ordering.moving
    assert rows.shape == (4, d, 2 * d + c + 1)
    for k in range(4):
        spread = noise[k][moving] @ noise[k][moving].T
        told = transition[k][moving]
        plain = np.hstack([-told[:, moving], np.eye(d), -told[:, ordering.constant], defect[k, moving, None]])
        np.testing.assert_allclose(
            blocks[k],
            plain.T @ np.linalg.solve(spread, plain),
            rtol=1e-6,
            atol=1e-6 * np.abs(blocks[k]).max(),
        )


def test_a_step_that_is_not_finite_spoils_no_other() -> None:
    _needs_kernels()
    ordering, defect, transition, noise = _steps(4, 3, True)
    expected = whitened_steps(ordering, defect, transition, noise)[1]
    noise[1] = np.nan
    blocks = whitened_steps(ordering, defect, transition, noise)[1]
    assert np.isnan(blocks[1]).all()
    np.testing.assert_array_equal(blocks[[0, 2]], expected[[0, 2]])
