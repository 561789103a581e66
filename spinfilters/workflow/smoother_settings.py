"""What can be set about the smoother."""

from dataclasses import dataclass
from typing import Annotated

from spinfilters.errors import InputError
from spinfilters.estimators.smoothing.modes import FixedLag, FrozenVision, Full, Mode
from spinfilters.estimators.smoothing.robust_kernels import (
    Barron,
    Gate,
    Huber,
    LeastSquares,
    PseudoHuber,
    RobustKernel,
)
from spinfilters.estimators.smoothing.sliding_records import SlidingOptions
from spinfilters.logs.number_range import NumberRange

MODES = ("automatic", "full", "frozen", "window")
KERNELS = ("gate", "huber", "pseudo-huber", "barron", "none")
FEW = 300
"""Frames up to which "automatic" keeps everything."""


@dataclass(frozen=True)
class SmootherSettings:
    """How the smoother works on tracks without a map; other sensors tie nothing together and are always smoothed in full.

    Attributes
    ----------
    mode: "full" keeps everything, "frozen" eliminates landmarks for good that have not been seen for some revolutions,
        "window" keeps the newest frames; "automatic" is "full" for short recordings and "frozen" for others.
    frames: that stay at least, in the modes "frozen" and "window".   revolutions: see "frozen".
    kernel: of a residual: "gate" (nothing beyond width), "huber", "pseudo-huber", "barron" (alpha = shape) or "none"
        (least squares).
    width: where it begins to bend, standard deviations.   shape: Barron's alpha, at most 2.
    iterations: per frame, at most.
    """

    mode: str = "automatic"
    frames: Annotated[int, NumberRange(2, 1_000_000, whole=True)] = 180
    revolutions: Annotated[float, NumberRange(1e-6, 1e9)] = 8.0
    kernel: str = "gate"
    width: Annotated[float, NumberRange(1e-6, 1e9)] = 5.0
    shape: Annotated[float, NumberRange(-1e9, 2)] = 0.0
    iterations: Annotated[int, NumberRange(1, 1000, whole=True)] = 4

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise InputError(f"smoother.mode {self.mode!r} is unknown; choose from {', '.join(MODES)}")
        if self.kernel not in KERNELS:
            raise InputError(f"smoother.kernel {self.kernel!r} is unknown; choose from {', '.join(KERNELS)}")
        if not self.width > 0:
            raise InputError(f"smoother.width is {self.width}; give a positive number of standard deviations")
        FrozenVision(self.revolutions, self.frames)
        self.options(0)

    def options(self, frames: int) -> SlidingOptions:
        """For a recording of so many frames."""
        mode = self._mode(frames)
        return SlidingOptions(mode, iterations=self.iterations, kernel=self.robust_kernel)

    @property
    def robust_kernel(self) -> RobustKernel:
        """Of every sensor's residuals."""
        kernels: dict[str, RobustKernel] = {
            "gate": Gate(self.width, self.width),
            "huber": Huber(self.width),
            "pseudo-huber": PseudoHuber(self.width),
            "barron": Barron(self.shape, self.width),
            "none": LeastSquares(),
        }
        return kernels[self.kernel]

    def _mode(self, frames: int) -> Mode:
        if self.mode == "full" or (self.mode == "automatic" and frames <= FEW):
            return Full()
        return FixedLag(self.frames) if self.mode == "window" else FrozenVision(self.revolutions, self.frames)
