"""Units that are others show by the size of things."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.run.readers import read_dataset
from spinfilters.simulation.model_faults import faulty_recording, model_faults
from spinfilters.simulation.scenario import RICH_RPM, THESIS_RPM, Scenario, simulate
from spinfilters.verdict.recording_tests import wrong_units

KINDS = ("pose", "gyro", "stereo-tracks")


def scenario(kind: str, **values: float) -> Scenario:
    """Rich and short."""
    return replace(Scenario.simplified(kind=kind, rate_rpm=RICH_RPM, epochs=20, landmarks=30), **values)


def in_unit(name: str, kind: str, size: float) -> Dataset:
    """With a unit that is ``size`` times too large."""
    seeds = tuple(np.random.SeedSequence(1).spawn(3))
    return faulty_recording(scenario(kind), model_faults()[name], size, seeds)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("interval", [0.005, 0.5, 5.0])
@pytest.mark.parametrize("rate", [RICH_RPM, THESIS_RPM])
def test_plausible_recordings_are_not_doubted(
    kind: str, interval: float, rate: tuple[float, float, float]
) -> None:
    assert wrong_units(simulate(replace(scenario(kind, interval=interval), rate_rpm=rate))) == []


def test_a_disc_at_rates_near_the_largest_of_a_gyro_is_not_doubted() -> None:
    rate = (4.0, 3.0, 600.0)
    disc = simulate(
        replace(scenario("gyro", interval=0.0096), rate_rpm=rate, principal_moments=(0.518, 0.518, 1.0))
    )
    assert np.linalg.norm(disc.log.stream("gyro").values, axis=1).max() > 60
    assert wrong_units(disc) == []


def test_real_discs_are_not_told_another_unit(shared_data: Callable[[str], Path]) -> None:
    for folder in sorted(shared_data("flatball_discs").glob("0*")):
        assert wrong_units(read_dataset(folder)) == []


@pytest.mark.parametrize(
    ("name", "kind", "size", "cure"),
    [
        ("clock-unit", "pose", 1e3, "--clock ms"),
        ("clock-unit", "stereo-tracks", 1e9, "--clock ms"),
        ("clock-unit", "gyro", 1e3, "--clock ms"),
        ("gyro-unit", "gyro", 57.3, "--unit deg/s"),
        ("length-unit", "pose", 1e3, "in m, not in mm"),
        ("length-unit", "stereo-tracks", 1e3, "in m, not in mm"),
    ],
)
def test_a_wrong_unit_is_named_with_its_cure(name: str, kind: str, size: float, cure: str) -> None:
    found = {each.name: each for each in wrong_units(in_unit(name, kind, size))}
    assert name in list(found)[:2]
    assert cure in found[name].cure
    assert len(f"{found[name].sentence}: {found[name].cure}") < 200


def poses_read(change: Callable[[np.ndarray], np.ndarray], offset: float = 1.0) -> Dataset:
    """Poses whose rows (t, q) are written in another convention, their origin at a share of the usual offset."""
    center = tuple(offset * each for each in Scenario.simplified().center_of_mass_g)
    made = simulate(replace(scenario("pose", epochs=60), center_of_mass_g=center))
    (stream,) = made.log.streams
    return replace(made, log=MeasurementLog((replace(stream, values=change(stream.values)),)))


def inverted(values: np.ndarray) -> np.ndarray:
    """The frame's attitude in the body."""
    return values * [1, 1, 1, -1, -1, -1, 1]


def scalar_first(values: np.ndarray) -> np.ndarray:
    """Written w, x, y, z."""
    return values[:, [0, 1, 2, 6, 3, 4, 5]]


def left_handed(values: np.ndarray) -> np.ndarray:
    """Places whose y axis points the other way."""
    return values * [1, -1, 1, 1, 1, 1, 1]


@pytest.mark.parametrize(
    ("change", "read"),
    [
        (inverted, "read inverted"),
        (scalar_first, "with the scalar first,"),
        (lambda values: scalar_first(inverted(values)), "with the scalar first, and inverted"),
        (left_handed, "in a frame with another y axis"),
    ],
)
def test_a_convention_that_places_contradict_is_named(
    change: Callable[[np.ndarray], np.ndarray], read: str
) -> None:
    (found,) = wrong_units(poses_read(change))
    assert found.name == "attitude-convention"
    assert read in found.sentence
    assert "the scalar last" in found.cure


def test_nothing_tells_the_convention_of_poses_of_the_centre_of_mass() -> None:
    assert wrong_units(poses_read(lambda values: values, offset=0.0)) == []
    assert wrong_units(poses_read(inverted, offset=0.0)) == []


def test_real_poses_are_told_no_other_convention(shared_data: Callable[[str], Path]) -> None:
    for name in ("hinged_elbow_tosses", "contactnets_cube_tosses"):
        for folder in sorted(path for path in shared_data(name).iterdir() if path.is_dir()):
            assert "attitude-convention" not in [each.name for each in wrong_units(read_dataset(folder))]
