"""The motion that the recordings of other loggers hold, and how their tables are written."""

from pathlib import Path
from typing import Any

import numpy as np

import spinfilters

COUNT = 40
TIME = 0.02 * np.arange(COUNT)  # s
RATES = np.column_stack([0.3 + 0.1 * TIME, 1.5 * np.cos(2 * TIME), 1.5 * np.sin(2 * TIME)])  # rad/s
TURN = np.column_stack([np.zeros((COUNT, 2)), np.sin(0.4 * TIME), np.cos(0.4 * TIME)])  # x, y, z, w
DEGREES = np.degrees(RATES)
PLACE = np.column_stack([0.1 * TIME, 0.2 * TIME, 1.0 + 0.0 * TIME])  # m
START_NS = 1_403_636_579_763_555_584
STAMPS_NS = [START_NS + 20_000_000 * k for k in range(COUNT)]
STAMPS_US = [5_000_000 + 20_000 * k for k in range(COUNT)]


def text(path: Path, head: str, rows: Any, between: str = ",") -> Path:
    """A table with this head and rows."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(head + "".join(between.join(str(cell) for cell in row) + "\n" for row in rows))
    return path


def require_motion(dataset: spinfilters.Dataset) -> None:
    """The motion that every file holds."""
    stream = dataset.log.streams[0]
    np.testing.assert_allclose(
        stream.time - stream.time[0], TIME, atol=1e-3 if stream.time[0] > 1e8 else 1e-6
    )
    if stream.sensor == "gyro":
        np.testing.assert_allclose(stream.values, RATES, atol=2e-6)
        return
    np.testing.assert_allclose(stream.values[:, -4:], TURN, atol=2e-6)
    if stream.sensor == "pose":
        np.testing.assert_allclose(stream.values[:, :3], PLACE, atol=1e-9)
