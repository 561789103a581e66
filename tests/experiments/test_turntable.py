"""Real tracks of a body that rotates about one axis."""

from pathlib import Path

import numpy as np
import pytest

from experiments.turntable import turntable, turntable_dataset

DATA = Path("../shared/data/vgg_dinosaur_turntable")


@pytest.mark.skipif(not (DATA / "viff.xy").exists(), reason="the real tracks are not here")
def test_one_camera_sees_the_dinosaur_rotate_by_ten_degrees_about_one_axis() -> None:
    found = turntable(turntable_dataset(DATA), "smoother")
    degrees = np.rad2deg(found.angles)
    assert degrees.mean() == pytest.approx(9.99, abs=0.05)
    assert degrees.std() < 0.05
    assert np.rad2deg(found.axis_spread) < 0.15
    # principal-axis rotation tells no moments, and the verdict says so
    assert "moments of inertia are not determined" in "; ".join(found.evaluation.history.status.reasons)
