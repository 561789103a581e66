"""Noise levels of sensors: values of their ranges, and equal ones have equal hashes."""

import pytest

from spinfilters.core.errors import InputError
from spinfilters.filters.timeline import SensorNoise


@pytest.mark.parametrize("value", [1e30, 0.0, -1.0, float("nan"), float("inf"), True, "1"])
def test_a_level_outside_its_range_is_refused(value: float) -> None:
    with pytest.raises(InputError, match=r"pixel_std is .*a number from 1e-12 to 1e\+06 px"):
        SensorNoise(pixel_std=value)


def test_equal_levels_have_equal_hashes() -> None:
    assert hash(SensorNoise(pixel_std=2.0)) == hash(SensorNoise({"pixel_std": 2.0}))
    assert SensorNoise(gyro_scale_std=0.0) == SensorNoise()
