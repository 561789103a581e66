"""Data sets of attitudes, and of one camera with a known map, from a folder to consistent estimates."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plain_comparison import plain_comparison

from spinfilters.cli.main import main
from spinfilters.core.attitude_conversions import inverse, multiply, rotation_vector_from_quaternion
from spinfilters.core.errors import InputError
from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.sensor_format import SensorNoise
from spinfilters.models.sensor import CameraView
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.models.state_layout import ROTATION_BLOCKS
from spinfilters.run.preparation import prepare
from spinfilters.run.readers import read_dataset
from spinfilters.settings.run_settings import FILTER, Settings
from spinfilters.simulation.measurement_faults import Outliers, WrongAssociations, with_faults
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map

ATTITUDES = Scenario.simplified(kind="attitude", rate_rpm=RICH_RPM, epochs=80)
TRACKS = Scenario.simplified(kind="mono-tracks", rate_rpm=RICH_RPM, epochs=40, landmarks=200, pixel_std=0.5)


def estimated(dataset: Dataset, *names: str) -> tuple[Evaluation, ...]:
    """Evaluations of estimators, without tests of their models."""
    settings = Settings(estimators=names, verdict=FILTER)
    return plain_comparison(dataset, settings).evaluations


@pytest.mark.parametrize("scenario", [ATTITUDES, TRACKS], ids=lambda scenario: scenario.kind)
def test_estimates_are_consistent_at_the_last_epoch(scenario: Scenario) -> None:
    seeds, last = range(5), {"mekf": [], "smoother": []}
    dofs: set[int] = set()
    for seed in seeds:
        for evaluation in estimated(simulate(replace(scenario, seed=seed)), *last):
            assert not evaluation.history.has_failed
            assert evaluation.nees is not None
            last[evaluation.name].append(float(evaluation.nees.total[-1]))
            dofs.add(evaluation.nees.dof)
    (dof,) = dofs
    low, high = chi_square_band(dof, len(seeds), 0.999)
    for name, nees in last.items():
        assert low < np.mean(nees) < high, name


def test_attitudes_are_a_rotation_whose_first_attitude_is_measured() -> None:
    setup = prepare(simulate(ATTITUDES), Settings())
    assert setup.process.layout.blocks == ROTATION_BLOCKS
    assert setup.known_frames
    std = setup.initial.prior.std[setup.process.layout.slice("a")]
    assert (std == 1.0).all()


def test_wrong_ids_of_one_camera_do_not_mislead_the_initial_motion() -> None:
    dataset = with_faults(simulate(TRACKS), [WrongAssociations(0.3), Outliers(0.05)], 1)
    (stream,), truth, rig = dataset.log.streams, dataset.truth, dataset.rig
    assert truth is not None
    assert rig is not None
    view = CameraView(dataset.known_map, rig.calibration)
    samples = sensor_of(stream.sensor).initial_motion(stream, SensorNoise(pixel_std=0.5), view)
    assert samples is not None
    assert samples.attitude is not None
    np.testing.assert_array_equal(samples.time, truth.time)
    away = rotation_vector_from_quaternion(multiply(inverse(truth.q_ig), samples.attitude))
    assert np.linalg.norm(away, axis=1).max() < 0.03


def test_a_pose_beside_attitudes_adds_the_place() -> None:
    attitudes, poses = simulate(ATTITUDES), simulate(replace(ATTITUDES, kind="pose"))
    both = replace(attitudes, log=MeasurementLog((*attitudes.log.streams, *poses.log.streams)))
    assert "t" in prepare(both, Settings()).process.layout.blocks


def test_one_camera_without_a_map_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(InputError, match=r"one camera does not show the scale; give landmarks\.csv"):
        prepare(without_map(simulate(TRACKS)), Settings())
    assert main(["simulate", "-o", str(tmp_path / "data"), "--kind", "mono-tracks", "--frames", "5"]) == 0
    assert main(["compare", str(tmp_path / "data"), "-o", str(tmp_path / "run")]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_a_simulated_folder_of_one_camera_holds_one_calibration(tmp_path: Path) -> None:
    arguments = ["--kind", "mono-tracks", "--frames", "5", "--known-map"]
    assert main(["simulate", "-o", str(tmp_path / "data"), *arguments]) == 0
    assert (tmp_path / "data" / "cam0" / "sensor.yaml").exists()
    assert not (tmp_path / "data" / "cam1").exists()
    dataset = read_dataset(tmp_path / "data")
    assert dataset.known_map is not None
    assert dataset.rig is not None
    assert dataset.rig.calibration.shape == (4,)
    header = (tmp_path / "data" / "tracks.csv").read_text().splitlines()[0]
    assert header == "time_s,landmark_id,u_px,v_px"


def test_tracks_beside_another_kind_are_those_of_their_header(tmp_path: Path) -> None:
    for kind, sensor in (("mono-tracks", "monocular"), ("stereo-tracks", "stereo")):
        folder = tmp_path / kind
        main(["simulate", "-o", str(folder), "--kind", kind, "--frames", "5", "--known-map"])
        main(["simulate", "-o", str(tmp_path / "gyro"), "--kind", "gyro", "--frames", "5"])
        (folder / "gyro.csv").write_bytes((tmp_path / "gyro" / "gyro.csv").read_bytes())
        (folder / "dataset.toml").write_text('kind = "gyro"\n')
        assert set(read_dataset(folder).log.sensors) == {"gyro", sensor}
