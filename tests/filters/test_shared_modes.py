"""Errors that landmarks share, where there is hardly a landmark."""

import numpy as np
import pytest

from spinfilters.filters.shared_modes import LandmarkOptions, SharedErrors, shared_modes
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout

LAYOUT = StateLayout(FULL_BLOCKS)


@pytest.mark.parametrize("count", [0, 1])
def test_a_map_of_hardly_a_landmark_leaves_the_state_as_it_is(count: int) -> None:
    generator = np.random.default_rng(count)
    n, R = LAYOUT.error_dim, 4
    state = np.diag(np.linspace(0.1, 1.0, n))
    errors = SharedErrors(
        LAYOUT,
        LAYOUT.origin(),
        generator.standard_normal((count, 3)),
        state,
        generator.standard_normal((count, 3, R)),
        np.tile(np.eye(3), (count, 1, 1)),
    )
    held = shared_modes(errors, LandmarkOptions())
    assert held.modes.shape[:2] == (count, 3)
    assert np.isfinite(held.factor).all()
    if not count:
        np.testing.assert_allclose(held.factor[:n] @ held.factor[:n].T, state @ state.T, atol=1e-12)
