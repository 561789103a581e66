"""``spinfilters.load`` and ``spinfilters.simulate``."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spinfilters
from spinfilters.cli.main import main
from spinfilters.core.errors import InputError

RACQUET = "round2/Gyroscope rotation rate 2025-01-23 18-29-01"


@pytest.mark.parametrize("kind", ["gyro", "pose"])
def test_the_command_writes_what_python_simulates(kind: str, tmp_path: Path) -> None:
    arguments = ["--kind", kind, "--seed", "3", "--frames", "8", "-o", str(tmp_path / "set")]
    assert main(["simulate", *arguments]) == 0
    written, made = spinfilters.load(tmp_path / "set"), spinfilters.simulate(kind, seed=3, frames=8)
    assert made.truth is not None
    (there,), (here,) = written.log.streams, made.log.streams
    np.testing.assert_array_equal(there.values, here.values)
    assert written.description == made.description


def test_noise_is_simulated_as_asked_and_stated(tmp_path: Path) -> None:
    levels = {"gyro_noise_std": 0.5, "torque_psd": 0.0, "force_psd": 2e-6}
    arguments = [word for name, level in levels.items() for word in ("--noise", name, str(level))]
    folder = tmp_path / "set"
    assert main(["simulate", "--kind", "gyro", "--frames", "400", *arguments, "-o", str(folder)]) == 0
    made = spinfilters.simulate("gyro", frames=400, noise=levels)
    assert made.truth is not None
    assert made.truth.rate_i is not None
    (there,), (here,) = spinfilters.load(folder).log.streams, made.log.streams
    np.testing.assert_array_equal(there.values, here.values)
    assert "gyro_noise_std = 0.5" in (folder / "dataset.toml").read_text()
    assert made.options.sensor_noise == {"gyro_noise_std": 0.5}
    assert made.options.densities == {"force_psd": 2e-6}
    # the rate is 1.05 rad/s, whose square the noise adds to
    spread = np.mean(np.sum(here.values**2, axis=1)) - np.mean(np.sum(made.truth.rate_i**2, axis=1))
    assert spread == pytest.approx(3 * 0.5**2, rel=0.15)


def test_noise_of_a_sensor_that_is_not_simulated_is_refused() -> None:
    with pytest.raises(
        InputError, match="pixel_std is of no sensor of this recording; give one of gyro_noise_std"
    ):
        spinfilters.simulate("gyro", frames=2, noise={"pixel_std": 1.0})


@pytest.mark.parametrize("kind", ["gyro", "stereo-tracks"])
def test_a_saved_data_set_is_loaded_as_it_was(kind: str, tmp_path: Path) -> None:
    made = spinfilters.simulate(kind, frames=4, known_map=kind != "gyro")
    found = spinfilters.load(spinfilters.save(made, tmp_path / "set"))
    assert found.options == made.options
    np.testing.assert_array_equal(found.log.streams[0].values, made.log.streams[0].values)
    assert (found.truth is None, found.known_map is None) == (False, kind == "gyro")
    with pytest.raises(InputError, match=r"tracks\.csv|gyro\.csv"):
        spinfilters.save(spinfilters.simulate("pose", frames=4), tmp_path / "set")


def test_the_map_of_simulated_tracks_is_told_on_request() -> None:
    assert spinfilters.simulate(frames=2).known_map is None
    assert spinfilters.simulate(frames=2, known_map=True).known_map is not None


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"kind": "radar"}, "'radar' is unknown"),
        ({"seed": -1}, "seed is -1; give a whole number from 0"),
        ({"seed": 0.5}, "seed is 0.5; give a whole number"),
        ({"frames": 1}, "1 epochs"),
        ({"frames": 10**9}, "frames is 1000000000; give a whole number from 1 to 100000"),
        ({"interval": float("nan")}, "interval is nan; give a number from"),
        ({"rate_rpm": (1, 2)}, "rate_rpm is (1, 2); give three numbers"),
        ({"rate_rpm": (1, 1e5, 1), "interval": 10.0}, "revolutions between epochs; give less than 100"),
        ({"moments": (-1, 1, 1)}, "moments is -1; give a number from"),
        ({"known_map": True}, "a gyro has no map"),
    ],
)
def test_what_cannot_be_simulated_is_refused_in_one_line(arguments: dict[str, Any], says: str) -> None:
    with pytest.raises(spinfilters.InputError) as refusal:
        spinfilters.simulate(**{"kind": "gyro", **arguments})
    assert says in str(refusal.value)


def test_a_segment_of_a_phyphox_export_is_loaded_by_its_number(shared_data: Callable[[str], Path]) -> None:
    folder = shared_data("racquet_phyphox") / "data" / RACQUET
    with pytest.raises(spinfilters.InputError, match="segment"):
        spinfilters.load(folder)
    dataset = spinfilters.load(folder, segment=4)
    assert dataset.segment is not None
    assert dataset.segment.number == 4
