"""Extents along axes that are known to a certain angle."""

from itertools import product

import numpy as np
import pytest

from spinfilters.vision.body_model import NetSurface, dimensions_of

_CORNERS = np.array(list(product((-0.1, 0.1), (-0.02, 0.02), (-0.03, 0.03))))
PLATE = NetSurface(_CORNERS, np.zeros((0, 3), dtype=int), np.zeros(8), _CORNERS, _CORNERS)
SURFACE_STD = np.array([3e-4, 4e-4, 5e-4])


def test_extents_along_the_axes_as_estimated_know_nothing_of_the_axes() -> None:
    found = dimensions_of(PLATE, SURFACE_STD, np.diag([0.0, 0.0, 0.1**2]))
    np.testing.assert_allclose(found.extents, [0.2, 0.04, 0.06])
    np.testing.assert_array_equal(found.surface_std, SURFACE_STD)
    assert found.axes_std[1] > 5e-3 > found.axes_std[0]
    assert found.axes_std[2] == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(found.std, np.hypot(SURFACE_STD, found.axes_std))


def test_axes_that_move_an_extent_by_more_than_the_surface_leaves_open_are_named() -> None:
    (said,) = dimensions_of(PLATE, SURFACE_STD, np.diag([0.0, 0.0, 0.1**2])).sentences
    assert said.startswith("axes x and y are known to 5.7 deg about z")
    assert "0.3 and 0.4 mm for the axes as estimated" in said
    assert dimensions_of(PLATE, SURFACE_STD, np.diag([1e-4, 1e-4, 1e-4]) ** 2).sentences == []
    assert len(dimensions_of(PLATE, SURFACE_STD, np.eye(3)).sentences) == 3
