"""Readers of data sets whose measurements are first made from raw data: images, scans."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from spinfilters.data.measurement_log import MeasurementStream
    from spinfilters.data.truth import Truth


@dataclass(frozen=True, eq=False)
class RawMeasurements:
    """Measurements made from raw data.

    Attributes
    ----------
    stream: the measurements.   truth: told in the stream's frame g.
    remarks: what was left out or not determined.   doubts: reasons why no estimate from this stream is to be trusted.
    """

    stream: "MeasurementStream"
    truth: "Truth | None" = None
    remarks: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    inflation: float = 1.0


@dataclass(frozen=True)
class RawDataReader:
    """Maker of measurement streams from a folder's raw data.

    Attributes
    ----------
    kind: in dataset.toml.   made: kind of the data set that comes out.
    read: of a folder with its truth, or None.
    """

    kind: str
    made: str
    read: "Callable[[Path, Truth | None], RawMeasurements]"
