"""What data sets and calibration files state of the uncertainty of a calibration."""

from dataclasses import replace
from pathlib import Path

import pytest

from spinfilters.core.errors import InputError
from spinfilters.io.camera import StereoRig, deviations_text
from spinfilters.io.dataset import Dataset, DatasetOptions
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.run.readers import read_dataset
from spinfilters.simulation.scenario import Scenario, simulate

LARGEST_LINE = 300


@pytest.fixture(scope="module")
def tracks() -> Dataset:
    """Of a simulator, whose calibration is exact."""
    return simulate(Scenario.simplified(epochs=4, landmarks=20))


def written(tracks: Dataset, folder: Path, **changes: float) -> Path:
    """A folder whose dataset.toml states these deviations of the calibration, or nothing."""
    write_dataset(replace(tracks, options=DatasetOptions(calibration=changes)), folder)
    return folder


def test_a_simulated_calibration_is_stated_to_be_exact(tracks: Dataset, tmp_path: Path) -> None:
    write_dataset(tracks, tmp_path)
    told = read_dataset(tmp_path).options.calibration
    assert told == tracks.options.calibration
    assert set(told) == {"focal_std", "center_std", "baseline_std", "clock_scale_std"}
    assert not any(told.values())


def test_a_calibration_file_tells_its_deviations(tracks: Dataset, tmp_path: Path) -> None:
    folder = written(tracks, tmp_path, center_std=0.25)
    for camera, text in (
        ("cam0", deviations_text([0.5, 0.7, 1.0, 2.0])),
        ("cam1", deviations_text([0.1, 0.1, 0.1, 3.0], 1e-4)),
    ):
        with (folder / camera / "sensor.yaml").open("a") as file:
            file.write(text)
    rig, told = tracks.rig, read_dataset(folder).options.calibration
    assert isinstance(rig, StereoRig)
    assert told["focal_std"] == pytest.approx(max(0.5 / rig.left.fx, 0.7 / rig.left.fy))
    assert told["baseline_std"] == pytest.approx(1e-4 / rig.baseline_m)
    assert told["center_std"] == 0.25  # dataset.toml comes first


@pytest.mark.parametrize(
    "line",
    [
        "intrinsics_std: [-1, 0, 0, 0]",
        "intrinsics_std: [.nan, 0, 0, 0]",
        "intrinsics_std: [1, 1]",
        "intrinsics_std: 0.5",
        "intrinsics_std: [200, 0, 0, 0]",
        "position_std: -0.1",
        "position_std: much",
        "position_std: 0.05",
        "position_std: .inf",
    ],
)
def test_a_deviation_that_is_none_is_one_line(tracks: Dataset, tmp_path: Path, line: str) -> None:
    folder = written(tracks, tmp_path)
    with (folder / "cam1" / "sensor.yaml").open("a") as file:
        file.write(line + "\n")
    with pytest.raises(InputError, match=r"cam1.sensor\.yaml") as refused:
        read_dataset(folder)
    assert len(str(refused.value).replace(str(tmp_path), "")) < LARGEST_LINE
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "table",
    [
        "calibration = 1",
        "[calibration]\nfocal_std = -0.001",
        "[calibration]\nfocal_std = nan",
        "[calibration]\nfocal_std = 0.5",
        "[calibration]\nfocal_std = true",
        "[calibration]\nfocal_std = 'small'",
        "[calibration]\nfocus = 0.1",
        "[calibration]\nclock_scale_std = 1e400",
    ],
)
def test_a_stated_deviation_that_is_none_is_one_line(tracks: Dataset, tmp_path: Path, table: str) -> None:
    folder = written(tracks, tmp_path)
    with (folder / "dataset.toml").open("a") as file:
        file.write("\n" + table + "\n")
    with pytest.raises(InputError, match=r"dataset\.toml") as refused:
        read_dataset(folder)
    assert "\n" not in str(refused.value)
