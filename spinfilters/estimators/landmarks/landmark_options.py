"""Options of filters with landmarks."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spinfilters.data.stated_values import NumberRange
from spinfilters.errors import InputError

PRECISIONS = ("float64", "float32")


@dataclass(frozen=True)
class LandmarkOptions:
    """Options of a filter with landmarks.

    Attributes
    ----------
    modes: errors that all landmarks share, at most; they stand in the state.
    explained: of the landmarks of a start, in all, that a mode must explain to be held, in squared standard deviations.
    largest_map: landmarks at most; those observed longest ago go first.
    precision: of what is kept of every landmark, "float64" or "float32".
    """

    modes: Annotated[int, NumberRange(1, 60, whole=True)] = 12
    explained: Annotated[float, NumberRange(0, 1e9)] = 0.5
    largest_map: Annotated[int, NumberRange(4, 10_000_000, whole=True)] = 20_000
    precision: str = "float64"

    def __post_init__(self) -> None:
        if not 1 <= self.modes <= 60 or self.largest_map < 4:
            raise InputError(
                f"landmarks.modes is {self.modes}, landmarks.largest_map is {self.largest_map}; give 1 to 60 modes and at least "
                "4 landmarks"
            )
        if not (np.isfinite(self.explained) and self.explained >= 0):
            raise InputError(f"landmarks.explained is {self.explained}; give a finite number of at least 0")
        if self.precision not in PRECISIONS:
            raise InputError(
                f"landmarks.precision {self.precision!r} is unknown; use one of {', '.join(PRECISIONS)}"
            )
