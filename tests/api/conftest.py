"""A gyro recording and a run on it that several tests share; none of them may change one."""

import numpy as np
import pytest

import spinfilters


@pytest.fixture(scope="session")
def gyro() -> spinfilters.Dataset:
    """A short simulated recording with truth."""
    return spinfilters.simulate("gyro", seed=3, frames=60, interval=0.1, rate_rpm=(40, 90, 30))


@pytest.fixture(scope="session")
def run(gyro: spinfilters.Dataset) -> spinfilters.Run:
    """Two filters on it, in memory."""
    return spinfilters.compare(gyro, "mekf,ukf")


@pytest.fixture(scope="session")
def own_csv(gyro: spinfilters.Dataset) -> str:
    """Text of a table with a header of its own."""
    stream = gyro.log.stream("gyro")
    rows = np.column_stack([stream.time, stream.values]).tolist()
    return "\n".join(["time,wx,wy,wz", *(",".join(map(repr, row)) for row in rows), ""])
