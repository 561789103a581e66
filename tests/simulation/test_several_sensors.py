"""Several sensors on one simulated motion: epochs that fall together, one map, one truth, one comparison."""

from pathlib import Path

import numpy as np
import pytest
from plain_comparison import plainly_compared

from spinfilters.api.simulation import simulate
from spinfilters.cli.main import main
from spinfilters.core.errors import InputError
from spinfilters.inference.first_epochs import LEADING_EPOCHS
from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.run.preparation import prepare
from spinfilters.run.readers import read_dataset
from spinfilters.settings.run_settings import FILTER, Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario
from spinfilters.simulation.scenario import simulate as simulate_scenario


def recording(epochs: int = 20) -> Dataset:
    beside = (("gyro", 0.1), ("pose", 0.5))
    return simulate_scenario(
        Scenario.simplified(
            kind="lidar-points", interval=1.0, epochs=epochs, rate_rpm=RICH_RPM, landmarks=60, beside=beside
        )
    )


def test_epochs_of_several_sensors_fall_together_to_the_bit() -> None:
    log, truth = recording(7).log, recording(7).truth
    assert log.sensors == ("lidar-points", "gyro", "pose")
    assert [len(stream.epoch_times) for stream in log.streams] == [7, 61, 13]
    assert truth is not None
    for stream in log.streams:
        assert np.isin(stream.epoch_times, truth.time).all()
    assert len(log.times) == len(truth.time) == 61


def test_a_recording_of_several_sensors_is_written_and_read(tmp_path: Path) -> None:
    dataset = recording(5)
    write_dataset(dataset, tmp_path / "all")
    read = read_dataset(tmp_path / "all")
    assert read.kind == "lidar-points"
    for stream in dataset.log.streams:
        np.testing.assert_array_equal(read.log.stream(stream.sensor).values, stream.values)


def test_an_initialisation_holds_enough_epochs_of_the_sensor_that_tells_the_motion() -> None:
    dataset, settings = recording(), Settings(estimators=("mekf",), verdict=FILTER)
    setup = prepare(dataset, settings)
    assert setup.end_of_initialisation >= dataset.log.stream("pose").epoch_times[LEADING_EPOCHS - 1]
    (found,) = plainly_compared(setup, settings).evaluations
    assert found.nees is not None
    assert found.nees.mean < 3.0


@pytest.mark.parametrize(
    ("beside", "words"),
    [
        ({"gyro": 0.0}, "interval"),
        ({"lidar-points": 1.0}, "twice"),
        ({"ears": 1.0}, "unknown"),
        ({"stereo-tracks": 1.0, "mono-tracks": 1.0}, "camera of their own"),
    ],
)
def test_sensors_that_cannot_stand_beside_each_other_are_refused(
    beside: dict[str, float], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        simulate("lidar-points", frames=5, beside=beside)


@pytest.mark.parametrize(
    "arguments",
    [["gyro", "often"], ["gyro", "nan"], ["gyro", "0.1", "--beside", "gyro", "0.2"], ["--kind", "0.1"]],
    ids=" ".join,
)
def test_a_wrong_interval_on_the_command_line_is_one_line(
    arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["simulate", "--frames", "5", "--kind", "pose", "--beside", *arguments]
    try:
        code = main([*command, "-o", str(tmp_path / "out")])
    except SystemExit as end:
        code = end.code
    assert code == 2
    assert "gyro" in capsys.readouterr().err or arguments[0] == "--kind"
    assert not (tmp_path / "out").exists()
