"""Arguments of ``calibrate`` with the board's, whose defaults the board takes. Nothing heavy is imported here: help is quick."""

from dataclasses import dataclass
from typing import Annotated

from spinfilters.io.stated_values import Argument, NumberRange

Corners = Annotated[str, Argument("inner corners of the board, columns x rows", metavar="9x6")]
Square = Annotated[float, NumberRange(1e-4, 10, "m"), Argument("side of a square", metavar="METRES")]
Markers = Annotated[bool, Argument("the board has markers (DICT_5X5_250, 3/4 of a square)")]
Window = Annotated[
    int,
    NumberRange(2, 50, "px", whole=True),
    Argument(
        "half width in which a corner is refined; smaller where corners are close together", metavar="PX"
    ),
]


@dataclass(frozen=True, kw_only=True)
class CalibrateArguments:
    """Arguments of ``calibrate``."""

    folder: Annotated[str, Argument("folder of the images", positional=True, metavar="FOLDER")]
    corners: Corners
    square: Square
    charuco: Markers = False
    window: Window = 11
    output: Annotated[str, Argument("folder of the calibration", short="-o", metavar="OUT")]
    check: Annotated[
        bool,
        Argument(
            "the checkout before use: parameters in range, rows that correspond, measured square, a disparity map in check.png"
        ),
    ] = False
