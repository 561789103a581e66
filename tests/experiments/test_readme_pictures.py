"""The animation of README: made by its command, and small enough for a page."""

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from experiments import readme_pictures
from experiments.readme_pictures import ANIMATION, EPILOGUE, FRAME_MS, FRAMES, animation, found_inertia

ROOT = Path(__file__).parents[2]
FEW_FRAMES = 16


def durations(content: bytes) -> list[int]:
    """Time of each frame, ms; equal neighbours may have been put together."""
    with Image.open(BytesIO(content)) as picture:
        times = []
        for frame in range(getattr(picture, "n_frames", 1)):
            picture.seek(frame)
            times.append(picture.info["duration"])
        return times


def test_the_animation_of_the_readme_is_small_and_whole() -> None:
    content = (ROOT / "docs" / ANIMATION).read_bytes()
    assert len(content) < 1_500_000
    assert sum(durations(content)) == FRAME_MS * (FRAMES - 1 + EPILOGUE)
    assert f"/docs/{ANIMATION}" in (ROOT / "README.md").read_text()


def test_the_command_draws_every_epoch_and_the_estimate_ends_near_the_truth(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(readme_pictures, "FRAMES", FEW_FRAMES)
    found, truth = found_inertia()
    error = found.body.principal_moments - np.sort(truth.moments) / truth.moments.max()
    assert (np.abs(error[:2]) < 4 * found.body.principal_moments_std[:2]).all()
    assert sum(durations(animation(found, truth))) == FRAME_MS * (FEW_FRAMES - 1 + EPILOGUE)
