"""What can be set about the smoother."""

from dataclasses import dataclass
from typing import Annotated

from spinfilters.data.stated_values import NumberRange
from spinfilters.errors import InputError
from spinfilters.estimators.robust.losses import (
    Barron,
    Gate,
    Huber,
    LeastSquares,
    PseudoHuber,
    RobustLoss,
)
from spinfilters.estimators.smoothing.window.smoother_records import SmootherOptions
from spinfilters.estimators.smoothing.window.window_policy import (
    FixedLag,
    FullSmoothing,
    LandmarkMarginalization,
    WindowPolicy,
)

MODES = ("automatic", "full", "frozen", "window")
LOSSES = ("gate", "huber", "pseudo-huber", "barron", "none")
FEW = 300
"""Epochs up to which "automatic" keeps everything."""


@dataclass(frozen=True)
class SmootherSettings:
    """Settings of the smoother on tracks without a map.

    Attributes
    ----------
    mode: "full" keeps everything, "frozen" eliminates landmarks for good that have not been seen for some revolutions,
        "window" keeps the latest epochs; "automatic" is "full" for short recordings and "frozen" for others.
    epochs: that stay at least, in the modes "frozen" and "window".   revolutions: see "frozen".
    loss: of a residual: "gate" (nothing beyond width), "huber", "pseudo-huber", "barron" (alpha = shape) or "none"
        (least squares).
    width: where it begins to bend, standard deviations.   shape: Barron's alpha, at most 2.
    iterations: per epoch, at most.
    """

    mode: str = "automatic"
    epochs: Annotated[int, NumberRange(2, 1_000_000, whole=True)] = 180
    revolutions: Annotated[float, NumberRange(1e-6, 1e9)] = 8.0
    loss: str = "gate"
    width: Annotated[float, NumberRange(1e-6, 1e9)] = 5.0
    shape: Annotated[float, NumberRange(-1e9, 2)] = 0.0
    iterations: Annotated[int, NumberRange(1, 1000, whole=True)] = 4

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise InputError(f"smoother.mode {self.mode!r} is unknown; choose from {', '.join(MODES)}")
        if self.loss not in LOSSES:
            raise InputError(f"smoother.loss {self.loss!r} is unknown; choose from {', '.join(LOSSES)}")
        if not self.width > 0:
            raise InputError(f"smoother.width is {self.width}; give a positive number of standard deviations")
        LandmarkMarginalization(self.revolutions, self.epochs)
        self.options(0)

    def options(self, epochs: int) -> SmootherOptions:
        """For a recording of so many epochs."""
        mode = self._mode(epochs)
        return SmootherOptions(mode, iterations=self.iterations, loss=self.robust_loss)

    @property
    def robust_loss(self) -> RobustLoss:
        """Robust loss of every sensor's residuals."""
        losses: dict[str, RobustLoss] = {
            "gate": Gate(self.width, self.width),
            "huber": Huber(self.width),
            "pseudo-huber": PseudoHuber(self.width),
            "barron": Barron(self.shape, self.width),
            "none": LeastSquares(),
        }
        return losses[self.loss]

    def _mode(self, epochs: int) -> WindowPolicy:
        if self.mode == "full" or (self.mode == "automatic" and epochs <= FEW):
            return FullSmoothing()
        return (
            FixedLag(self.epochs)
            if self.mode == "window"
            else LandmarkMarginalization(self.revolutions, self.epochs)
        )
