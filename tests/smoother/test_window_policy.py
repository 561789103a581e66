"""When epochs leave a window, and options that are refused."""

from collections.abc import Callable

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.smoother.sliding_smoother import SmootherOptions
from spinfilters.smoother.window import FixedLag, FullSmoothing, LandmarkMarginalization, WindowPolicy


@pytest.mark.parametrize(
    "make",
    [
        lambda: SmootherOptions(iterations=0),
        lambda: SmootherOptions(gate=0.0),
        lambda: FixedLag(1),
        lambda: LandmarkMarginalization(0.0),
        lambda: LandmarkMarginalization(epochs=1),
    ],
)
def test_options_without_a_meaning_are_refused(make: Callable[[], object]) -> None:
    with pytest.raises(InputError, match="give"):
        make()


@pytest.mark.parametrize(
    ("mode", "epochs", "std", "removed"),
    [
        (FixedLag(20), 20, 0.01, 0),
        (FixedLag(20), 23, 0.01, 0),
        (FixedLag(20), 24, 0.01, 4),
        (FixedLag(20), 27, 0.01, 7),
        (FixedLag(20), 60, 0.01, 16),
        (FixedLag(20), 60, 0.1, 0),
        (FixedLag(20), 123, 0.1, 0),
        (FixedLag(20), 124, np.inf, 4),
        (FixedLag(2), 3, 0.01, 1),
        (FixedLag(8), 9, 0.01, 1),
        (FixedLag(10), 11, 0.01, 0),
        (FixedLag(10), 12, 0.01, 2),
        (LandmarkMarginalization(epochs=150), 165, np.inf, 0),
        (LandmarkMarginalization(epochs=150), 166, np.inf, 16),
        (FullSmoothing(), 10_000, 0.001, 0),
    ],
    ids=str,
)
def test_epochs_leave_together_when_there_are_enough_of_them(
    mode: WindowPolicy, epochs: int, std: float, removed: int
) -> None:
    assert mode.batch_size(epochs, std) == removed
