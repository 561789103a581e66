"""Readers of data sets whose measurements are first made from raw data: images, scans."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from spinfilters.plugins import PluginGroup

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


RAW_DATA: Final = PluginGroup("spinfilters.front_ends", "READER", RawDataReader)
"""All of them: one per module of `spinfilters.front_ends`, and those of the entry points of that group."""


def raw_data_reader(kind: str) -> RawDataReader | None:
    """The reader of a kind, or None."""
    return next((reader for reader in RAW_DATA.entries if reader.kind == kind), None)
