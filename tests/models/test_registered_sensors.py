"""Every sensor of the registry keeps the contract; sensors from outside join it."""

import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from contracts.sensor import check_sensor

from spinfilters.cli.main import main
from spinfilters.core.errors import InputError
from spinfilters.core.plugins import installed_plugins
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.sensor_format import SensorNoise, dataset_kinds, noise_options
from spinfilters.models.sensor import Sensor
from spinfilters.models.sensor_registry import all_sensors, sensor_of
from spinfilters.models.sensors.magnetometer import MagnetometerSensor
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout
from spinfilters.run.run_summary import read_summary
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate

HOW_TO = Path(__file__).parents[2] / "docs" / "how-to" / "add-a-sensor.md"
STORED = [sensor for sensor in all_sensors() if sensor.format is not None]


@pytest.fixture
def distribution(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An installed distribution without files, on the path; entry points that a test writes into it are found."""
    information = tmp_path / "site" / "range_sensor-1.0.dist-info"
    information.mkdir(parents=True)
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: range-sensor\nVersion: 1.0\n")
    monkeypatch.syspath_prepend(str(information.parent))
    yield information
    monkeypatch.undo()
    sys.modules.pop("range_sensor", None)
    installed_plugins.cache_clear()


def installed(distribution: Path, module: str, entry_point: str = "range = range_sensor:SENSOR") -> None:
    """Write a module and its entry point, and let the registry look again."""
    (distribution.parent / "range_sensor.py").write_text(module)
    (distribution / "entry_points.txt").write_text(f"[spinfilters.sensors]\n{entry_point}\n")
    installed_plugins.cache_clear()


def how_to_module() -> str:
    """The program of the how-to page."""
    (program,) = re.findall(r"^```python\n(.*?)^```", HOW_TO.read_text(), re.MULTILINE | re.DOTALL)
    return program


@pytest.mark.parametrize("sensor", STORED, ids=lambda sensor: sensor.name)
def test_every_registered_sensor_keeps_the_contract(sensor: Sensor, tmp_path: Path) -> None:
    check_sensor(sensor, tmp_path)


def test_the_registry_has_every_sensor_once_and_every_kind() -> None:
    names = [sensor.name for sensor in all_sensors()]
    assert names == sorted(set(names))
    assert {sensor.format.kind for sensor in STORED if sensor.format is not None} == set(dataset_kinds())


@pytest.mark.parametrize("sensor", STORED, ids=lambda sensor: sensor.name)
def test_a_sensor_that_reads_the_attitude_without_landmarks_knows_its_frames(sensor: Sensor) -> None:
    assert sensor.format is not None
    stream = simulate(Scenario.simplified(kind=sensor.format.kind, epochs=2)).log.streams[0]
    layout = StateLayout(FULL_BLOCKS if sensor.sees_place else ROTATION_BLOCKS)
    reads = stream.ids is None and "a" in sensor.bind(stream, layout, SensorNoise(), None).model.needs
    assert sensor.knows_frames(stream) == reads


class DirectionOfItsOwn(MagnetometerSensor):
    """A magnetometer in a field that an estimator would find."""

    tells_frames = False


def test_a_sensor_may_state_that_its_frames_are_not_given() -> None:
    dataset = simulate(Scenario.simplified(kind="magnetometer", epochs=2))
    assert not DirectionOfItsOwn().knows_frames(dataset.log.streams[0])


def test_the_sensor_of_the_how_to_page_keeps_the_contract(distribution: Path, tmp_path: Path) -> None:
    installed(distribution, how_to_module())
    check_sensor(sensor_of("range"), tmp_path / "data")


@pytest.mark.usefixtures("unrendered")
def test_a_data_set_of_a_sensor_from_outside_is_compared(distribution: Path, tmp_path: Path) -> None:
    installed(distribution, how_to_module())
    ranges = simulate(Scenario.simplified(kind="range", rate_rpm=RICH_RPM, epochs=80, seed=2))
    poses = simulate(Scenario.simplified(kind="pose", rate_rpm=RICH_RPM, epochs=80, seed=2))
    both = replace(ranges, log=MeasurementLog((*poses.log.streams, *ranges.log.streams)))
    write_dataset(both, tmp_path / "data")
    assert main(["compare", str(tmp_path / "data"), "-o", str(tmp_path / "run")]) == 0
    document = read_summary(tmp_path / "run")
    assert document["conditions"]["noise"]["range_std"]["value"] == 0.005
    for estimator in document["estimators"].values():
        assert estimator["status"] == "ok"
        assert estimator["measurements"]["accepted"] > 40
        assert estimator["measurements"]["rejected"] == 0


def test_a_sensor_that_tells_no_motion_is_refused_alone(
    distribution: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    installed(distribution, how_to_module())
    write_dataset(simulate(Scenario.simplified(kind="range", epochs=20)), tmp_path / "data")
    assert main(["compare", str(tmp_path / "data"), "-o", str(tmp_path / "run")]) == 2
    assert "range measurements do not determine the initial motion" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("module", "entry_point", "says"),
    [
        ("raise RuntimeError('no\\nlicence')", "range = range_sensor:SENSOR", "RuntimeError: no licence"),
        ("", "range = range_sensor:SENSOR", "cannot be loaded: AttributeError"),
        ("", "range = no_such_module:SENSOR", "cannot be loaded: ModuleNotFoundError"),
        ("SENSOR = 3", "range = range_sensor:SENSOR", "is int, not a StoredSensor"),
        (
            "from spinfilters.models.sensors.gyro import GyroSensor\nSENSOR = GyroSensor()",
            "range = range_sensor:SENSOR",
            "sensor 'gyro' is registered twice",
        ),
    ],
)
def test_a_plug_in_that_cannot_be_used_is_named_in_one_line(
    distribution: Path, module: str, entry_point: str, says: str
) -> None:
    installed(distribution, module, entry_point)
    with pytest.raises(InputError) as raised:
        dataset_kinds()
    assert says in str(raised.value)
    assert "uninstall" in str(raised.value)
    assert "\n" not in str(raised.value)
    assert len(str(raised.value)) < 300


def test_a_plug_in_with_a_format_alone_is_no_sensor(distribution: Path) -> None:
    """The data layer can store its rows; nobody can estimate from them."""
    installed(distribution, "from spinfilters.io.sensor_format import StoredSensor\nSENSOR = StoredSensor()")
    with pytest.raises(InputError, match="the registered StoredSensor is no Sensor; mend or uninstall it"):
        all_sensors()


def test_a_noise_option_from_outside_has_its_default(distribution: Path) -> None:
    installed(distribution, how_to_module())
    assert noise_options()["range_std"].allowed.unit == "m"
    assert SensorNoise().range_std == 0.01
    assert SensorNoise(range_std=0.5, pixel_std=2.0).values["range_std"] == 0.5
    with pytest.raises(InputError, match="range_std is nan"):
        SensorNoise(range_std=np.nan)
    with pytest.raises(InputError, match="sensor noise colour is unknown"):
        SensorNoise(colour=1.0)
