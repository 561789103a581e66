"""What a gyro alone tells of its own bias, exactly: all of it, or all but one direction, or nothing new."""

import pytest

from observability.canonical_motions import point_of
from observability.certificate import certify
from observability.coordinates import FilterChart
from observability.exact_numbers import rationals
from observability.system import System, SystemSensor
from spinfilters.models.sensors.gyro import Gyro
from spinfilters.models.state_blocks import GYRO_BIAS
from spinfilters.models.state_layout import ROTATION_BLOCKS, StateLayout
from tests.observability.analyser_samples import MOTIONS

ROTATION = StateLayout(ROTATION_BLOCKS)


def rank(layout: StateLayout, motion: str) -> int:
    """Exact rank of what a gyro tells in the filters' state."""
    chart, gyro = FilterChart(layout), SystemSensor(Gyro(layout), (rationals((0.002, 0.0)),))
    return certify(System(chart, [gyro]), point_of(chart, MOTIONS[motion])).rank


@pytest.mark.parametrize(
    ("motion", "told"),
    [
        ("tumble", 3),
        ("rate in a principal plane", 3),
        ("axisymmetric, nutating", 2),
        ("spin about the major axis", 0),
        ("equal moments", 0),
        ("no rotation", 0),
    ],
)
def test_so_many_directions_of_the_bias_are_told_beside_all_that_a_perfect_gyro_tells(
    motion: str, told: int
) -> None:
    assert rank(ROTATION.joined(GYRO_BIAS), motion) == rank(ROTATION, motion) + told
