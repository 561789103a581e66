"""The run folder is an interface: what other programs find in it."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from pictures import unrendered_pictures

from spinfilters.cli.main import main
from spinfilters.core.errors import InputError
from spinfilters.evaluation.estimated_motion import STD_COLUMNS, read_map_ply
from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.io.sensor_tables import read_tum
from spinfilters.io.text_table import read_csv
from spinfilters.io.truth import TRUTH_COLUMNS
from spinfilters.models.status import Verdict
from spinfilters.plots import figures
from spinfilters.plots.figures import draw_run, picture_files
from spinfilters.run.array_files import read_history, write_history
from spinfilters.run.estimation import Comparison, compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.run.readers import read_dataset
from spinfilters.run.run_folder import figure_data_of, read_figure_data, write_run
from spinfilters.run.segment_runs import run_segments
from spinfilters.settings.run_settings import Settings, read_settings
from spinfilters.simulation.scenario import Scenario, simulate

NAMES = ("mekf", "ukf")


def silent(*_: object) -> None:
    """Report no progress."""


@dataclass(frozen=True)
class Run:
    """A run folder and what it was written from."""

    folder: Path
    comparison: Comparison
    settings: Settings


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Both filters on 40 epochs of tracks with a known map."""
    settings, folder = Settings(estimators=NAMES), tmp_path_factory.mktemp("run") / "run"
    setup = prepare(simulate(Scenario.simplified(epochs=40, landmarks=60)), settings)
    comparison = compare_estimators(setup, settings, silent)
    write_run(folder, comparison, settings)
    with unrendered_pictures():
        draw_run(figure_data_of(comparison), folder, silent)
    return Run(folder, comparison, settings)


@pytest.fixture(scope="module")
def summary(run: Run) -> dict:
    """summary.json, which must not need Python's NaN."""
    text = (run.folder / "summary.json").read_text(encoding="utf-8")
    return json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))


def test_summary_has_the_documented_keys(summary: dict) -> None:
    assert summary["schema"] == 1
    assert set(summary) >= {"dataset", "estimators"}
    assert list(summary["estimators"]) == list(NAMES)
    for estimate in summary["estimators"].values():
        assert set(estimate) >= {
            *("status", "frames", "measurements", "runtime_s", "principal_moments", "principal_moments_std"),
            *("principal_axes_g", "center_of_mass_g", "k1", "k2", "errors"),
        }
        assert estimate["status"] in {str(verdict) for verdict in Verdict}
        assert estimate["frames"] == 40
        assert set(estimate["measurements"]) == {"accepted", "rejected"}
        assert set(estimate["runtime_s"]) == {"total", "per_frame_median", "per_frame_max"}
        assert set(estimate["errors"]) >= {"ape_rmse_m", "ape_angle_rmse_deg", "rms_rate_rad_s"}


def test_summary_moments_ascend_to_one_and_axes_are_rows_of_a_rotation(summary: dict) -> None:
    for estimate in summary["estimators"].values():
        moments, axes = estimate["principal_moments"], np.array(estimate["principal_axes_g"])
        assert moments == sorted(moments)
        assert moments[2] == 1.0
        assert estimate["k1"] == pytest.approx(np.log(moments[2] / moments[1]))
        assert estimate["k2"] == pytest.approx(np.log(moments[1] / moments[0]))
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(axes) > 0


@pytest.mark.parametrize("name", NAMES)
def test_trajectory_table_is_the_truth_table_with_deviations(run: Run, name: str) -> None:
    table = read_csv(run.folder / name / "trajectory.csv")
    assert table.names == (*TRUTH_COLUMNS, *STD_COLUMNS)
    truth = run.comparison.setup.dataset.truth
    assert truth is not None
    np.testing.assert_array_equal(table.values[:, 0], truth.time)
    std = table.values[:, len(TRUTH_COLUMNS) :]
    errors = table.values[:, 1:4] - truth.center_of_mass
    assert np.all(np.abs(errors) < 6 * std[:, :3])


@pytest.mark.parametrize("name", NAMES)
def test_tum_trajectory_holds_the_bits_of_the_table(run: Run, name: str) -> None:
    table = read_csv(run.folder / name / "trajectory.csv").values
    poses = read_tum(run.folder / name / "trajectory.tum")
    np.testing.assert_array_equal(np.column_stack([poses.time, poses.values]), table[:, :8])


def test_true_poses_are_those_of_the_centre_of_mass(run: Run) -> None:
    truth = run.comparison.setup.dataset.truth
    assert truth is not None
    poses = read_tum(run.folder / "truth.tum")
    np.testing.assert_array_equal(poses.values, np.hstack([truth.center_of_mass, truth.q_ig]))


def test_map_holds_the_known_landmarks(run: Run) -> None:
    known = run.comparison.setup.dataset.known_map
    assert known is not None
    for name in NAMES:
        np.testing.assert_array_equal(read_map_ply(run.folder / name / "map.ply"), known.points)


def test_configuration_reads_back_as_the_settings(run: Run) -> None:
    assert read_settings(run.folder / "config.toml") == run.settings


def test_data_set_reads_back_as_it_was_given(run: Run) -> None:
    dataset, given = read_dataset(run.folder / "dataset"), run.comparison.setup.dataset
    for stream, other in zip(dataset.log.streams, given.log.streams, strict=True):
        np.testing.assert_array_equal(stream.values, other.values)
        np.testing.assert_array_equal(stream.time, other.time)


def test_history_survives_its_file_bit_for_bit(run: Run, tmp_path: Path) -> None:
    history = run.comparison.evaluations[1].history
    write_history(tmp_path / "history.npz", history)
    copy = read_history(tmp_path / "history.npz")
    assert (copy.name, copy.layout, copy.status) == (history.name, history.layout, history.status)
    for name in ("time", "mean", "factor", "nis", "dof", "log_likelihood", "accepted", "rejected", "runtime"):
        np.testing.assert_array_equal(getattr(copy, name), getattr(history, name))


def test_every_figure_is_a_png(run: Run) -> None:
    expected = set(picture_files(("mekf", "ukf")))
    paths = list(run.folder.glob("*.png"))
    assert {path.name for path in paths} == expected
    assert all(path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n") for path in paths)


def test_plot_draws_what_was_deleted(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = [entry for entry in figures.figure_entries() if entry.name == "scene"]
    monkeypatch.setattr(figures, "figure_entries", lambda: scene)
    (run.folder / "scene.png").unlink()
    assert main(["plot", str(run.folder)]) == 0
    assert (run.folder / "scene.png").stat().st_size > 1000


def test_a_picture_drawn_again_says_what_the_first_said(run: Run) -> None:
    again, first = read_figure_data(run.folder), figure_data_of(run.comparison)
    assert again.conditions == first.conditions
    assert [e.history.initialisation for e in again.evaluations] == [24, 24]


def test_map_found_from_tracks_alone_is_drawn_again(tmp_path: Path) -> None:
    settings = Settings(estimators=("mekf",))
    dataset = read_unmapped(tmp_path / "data")
    comparison = compare_estimators(prepare(dataset, settings), settings, silent)
    write_run(tmp_path / "run", comparison, settings)
    points = read_figure_data(tmp_path / "run").map_points
    assert points is not None
    np.testing.assert_array_equal(points, comparison.maps["mekf"])
    assert not (tmp_path / "run" / "truth.tum").exists()


def test_a_filter_that_holds_no_landmarks_is_refused_without_a_map(tmp_path: Path) -> None:
    settings = Settings(estimators=("mekf", "filterpy-ekf"))
    setup = prepare(read_unmapped(tmp_path / "data"), settings)
    with pytest.raises(InputError, match="filterpy-ekf: holds no landmarks; give the tracks' map"):
        compare_estimators(setup, settings, silent)


def read_unmapped(folder: Path) -> Dataset:
    """Tracks whose landmarks are not known."""
    write_dataset(simulate(Scenario.simplified(epochs=20, landmarks=40)), folder)
    (folder / "landmarks.csv").unlink()
    return read_dataset(folder)


def test_a_run_replaces_one_of_another_kind_with_more_estimators(run: Run, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    write_run(folder, run.comparison, run.settings)
    settings = Settings(estimators=("mekf",))
    comparison = compare_estimators(
        prepare(simulate(Scenario.simplified(kind="gyro", epochs=12)), settings), settings, silent
    )
    write_run(folder, comparison, settings)
    assert {path.name for path in folder.iterdir()} == {"config.toml", "dataset", "mekf", "summary.json"}
    assert read_dataset(folder / "dataset").kind == "gyro"


@pytest.mark.usefixtures("unrendered")
def test_a_run_of_its_own_data_set_keeps_it(run: Run, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    write_run(folder, run.comparison, run.settings)
    assert main(["compare", str(folder / "dataset"), "--estimators", "mekf", "-o", str(folder)]) == 0
    assert read_dataset(folder / "dataset").known_map is not None


def test_an_interrupt_between_estimators_keeps_the_finished_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = Settings(estimators=NAMES)
    setup = prepare(simulate(Scenario.simplified(kind="gyro", epochs=12)), settings)

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("spinfilters.filters.ukf.MultiplicativeUkf", interrupted)
    comparison = compare_estimators(setup, settings, silent)
    assert comparison.interrupted
    assert [evaluation.name for evaluation in comparison.evaluations] == ["mekf"]


def test_segments_are_made_again_only_for_other_measurements(tmp_path: Path) -> None:
    settings = Settings(estimators=("mekf",))
    first, second = (simulate(Scenario.simplified(kind="gyro", epochs=12, seed=seed)) for seed in (0, 1))
    path = tmp_path / "segments" / "000" / "summary.json"
    run_segments([first], tmp_path, settings, silent)
    stamp = path.stat().st_mtime_ns
    run_segments([first], tmp_path, settings, silent)
    assert path.stat().st_mtime_ns == stamp
    (again,) = run_segments([second], tmp_path, settings, silent)
    assert path.stat().st_mtime_ns != stamp
    assert again.summary is not None
    assert "seed 1" in again.summary["dataset"]["description"]
