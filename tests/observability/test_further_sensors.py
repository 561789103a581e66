"""Further sensors beside a set: what becomes determined, how far bounds fall, and in which order."""

import pytest

from observability.analysis_report import analyse
from observability.cases import Case
from observability.cramer_rao import BLOCK_NAMES, MOMENTS
from observability.further_sensors import FurtherSensors, further_sensors
from observability.system import analysed_sensors

EPOCHS, INTERVAL = 12, 0.5
ATTITUDE, VELOCITY, RATE = (BLOCK_NAMES[block] for block in "avw")


def beside(*sensors: str) -> FurtherSensors:
    return further_sensors(Case(sensors), EPOCHS, INTERVAL, lambda *_: None)


@pytest.fixture(scope="module")
def beside_gyro() -> FurtherSensors:
    return beside("gyro")


def test_every_other_sensor_is_added_once_and_those_that_determine_more_come_first(
    beside_gyro: FurtherSensors,
) -> None:
    names = [each.name for each in beside_gyro.sensors]
    assert sorted(names) == sorted(analysed_sensors().keys() - {"gyro"})
    counts = [sum(each.becomes_determined.values()) for each in beside_gyro.sensors]
    assert counts == sorted(counts, reverse=True)
    assert not beside_gyro.refused


def test_an_attitude_that_only_its_first_epoch_defines_becomes_determined(
    beside_gyro: FurtherSensors,
) -> None:
    found = {each.name: each for each in beside_gyro.sensors}
    assert found["attitude"].becomes_determined == {ATTITUDE: 3}
    assert found["magnetometer"].becomes_determined == {ATTITUDE: 2}
    assert found["stereo"].becomes_determined[VELOCITY] == 3


def test_bounds_are_those_of_the_sets_analysed_by_themselves_and_never_rise(
    beside_gyro: FurtherSensors,
) -> None:
    (attitude,) = [each for each in beside_gyro.sensors if each.name == "attitude"]
    both = analyse(Case(("gyro", "attitude")), EPOCHS, INTERVAL)
    assert attitude.after.std(RATE) == both.verdicts[RATE].std_across
    assert all(gain > 1 - 1e-9 for each in beside_gyro.sensors for gain in each.gains.values())
    assert {RATE, MOMENTS} == attitude.gains.keys()


def test_quantities_in_other_axes_are_shown_and_not_compared() -> None:
    found = beside("stereo")
    (gyro,) = [each for each in found.sensors if each.name == "gyro"]
    assert ATTITUDE not in gyro.gains
    assert found.cell(gyro.after, gyro, ATTITUDE).endswith("*")
    assert found.sensors[0].mean_gain == max(each.mean_gain for each in found.sensors)
    assert "*: in other axes" in str(found)


def test_a_set_of_all_sensors_has_no_further_one() -> None:
    assert "none can be added" in str(beside(*analysed_sensors()))
