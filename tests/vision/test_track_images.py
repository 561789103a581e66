"""Data sets of tracks: what the front end tells of their errors."""

from pathlib import Path

import pytest

from spinfilters.vision.track_images import SYSTEMATIC_PX, track_images


def test_errors_in_common_are_told_as_errors_of_a_calibration_that_is_exact(rendered_folder: Path) -> None:
    tracked = track_images(rendered_folder)
    told, (stream,) = tracked.dataset.options.calibration, tracked.dataset.log.streams
    u, _, right = stream.values.T
    assert told["center_std"] == pytest.approx(SYSTEMATIC_PX)
    assert SYSTEMATIC_PX / 100 < told["focal_std"] < SYSTEMATIC_PX / 10
    assert SYSTEMATIC_PX / (u - right).max() < told["baseline_std"] < SYSTEMATIC_PX / (u - right).min()
    assert told["clock_scale_std"] == 0
    assert tracked.dataset.options.covariance_inflation == tracked.document["error_correlation"]["inflation"]
