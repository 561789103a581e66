"""``spinfilters.compare``: the same as the command, in memory or in a folder."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spinfilters
from spinfilters.cli.main import main
from spinfilters.core.errors import InputError
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.plots import figures
from spinfilters.run import comparison_run
from spinfilters.run.estimation import Comparison, compare_estimators
from spinfilters.settings.run_settings import ProcessSettings, SensorSettings, Settings


@pytest.fixture
def few_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """One picture instead of all."""
    every = figures._figures
    monkeypatch.setattr(figures, "_figures", lambda run: list(every(run))[:1])


@pytest.fixture(scope="module")
def recording(gyro: spinfilters.Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording in a folder."""
    folder = tmp_path_factory.mktemp("recording") / "gyro"
    write_dataset(gyro, folder)
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    """Files whose bytes do not depend on the time that a run took."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.glob("**/trajectory.*")}


@pytest.mark.usefixtures("few_figures")
def test_a_saved_run_is_the_run_folder_of_the_command(recording: Path, tmp_path: Path) -> None:
    theirs = tmp_path / "command"
    assert main(["compare", str(recording), "--estimators", "mekf,ukf", "-o", str(theirs)]) == 0
    run = spinfilters.compare(recording, ["mekf", "ukf"])
    ours = run.save(tmp_path / "python")
    assert contents(ours) == contents(theirs) != {}
    files = [sorted(str(path.relative_to(each)) for path in each.glob("**/*")) for each in (ours, theirs)]
    assert files[0] == files[1]
    assert (ours / "summary.png").exists()


@pytest.mark.usefixtures("few_figures")
def test_a_run_in_a_folder_is_written_there_and_read_from_there_again(
    recording: Path, tmp_path: Path
) -> None:
    first = spinfilters.compare(recording, "mekf", output=tmp_path / "run", predict=1.0)
    assert first.folder == tmp_path / "run"
    assert (tmp_path / "run" / "mekf" / "prediction.csv").exists()
    again = spinfilters.compare(recording, "mekf", output=tmp_path / "run", resume=True)
    assert again.comparison is None
    np.testing.assert_array_equal(again["mekf"].trajectory.rate_i, first["mekf"].trajectory.rate_i)
    assert again.summary["estimators"] == first.summary["estimators"]
    loaded = spinfilters.load_run(tmp_path / "run")
    assert loaded.settings == again.settings
    assert str(loaded) == str(again)
    np.testing.assert_array_equal(loaded["mekf"].trajectory.rate_i, first["mekf"].trajectory.rate_i)
    with pytest.raises(InputError, match=r"read from .*run; copy that folder"):
        again.save(tmp_path / "copy")


@pytest.mark.usefixtures("few_figures")
def test_a_finished_run_is_read_with_every_estimators_landmarks(tmp_path: Path) -> None:
    tracks = spinfilters.simulate(frames=8, known_map=True)
    first = spinfilters.compare(tracks, "mekf,ukf", output=tmp_path / "run")
    again = spinfilters.compare(tracks, "mekf,ukf", output=tmp_path / "run", resume=True)
    for name in first:
        there, here = first[name].landmarks, again[name].landmarks
        assert there is not None
        assert here is not None
        np.testing.assert_array_equal(here, there)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("y.csv", "a run is not saved as .csv; give a name that ends in .nc, .mcap or .rrd, or a folder"),
        ("y.JSON", "a run is not saved as .json"),
        ("none/x.NC", "make the folder none first"),
    ],
)
def test_a_run_is_not_saved_where_no_such_file_can_be(
    name: str, says: str, gyro: spinfilters.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("xarray")
    monkeypatch.chdir(tmp_path)
    run = spinfilters.compare(gyro, "mekf", settings={"verdict": "filter"})
    for each in (run, replace(run, comparison=None)):  # as it ended, and as it is loaded
        with pytest.raises(InputError, match=re.escape(says)):
            each.save(name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("few_figures")
def test_capitals_of_a_suffix_do_not_matter_and_a_folder_may_have_a_dot(
    gyro: spinfilters.Dataset, tmp_path: Path
) -> None:
    pytest.importorskip("xarray")
    run = spinfilters.compare(gyro, "mekf", settings={"verdict": "filter"})
    assert run.save(tmp_path / "x.NC").is_file()
    assert (run.save(tmp_path / "run.2026") / "summary.json").is_file()


def test_nothing_is_written_unless_asked_for(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert spinfilters.compare(recording, "mekf").folder is None
    assert list(tmp_path.iterdir()) == []


def test_settings_may_be_an_object_a_mapping_or_a_file(gyro: spinfilters.Dataset, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text('estimators = ["mekf"]\n[sensors]\ngyro_noise_std = 0.02\n')
    tables = {"estimators": ["mekf"], "sensors": {"gyro_noise_std": 0.02}}
    typed = Settings(estimators=("mekf",), sensors=SensorSettings(gyro_noise_std=0.02))
    runs = [spinfilters.compare(gyro, settings=each) for each in (tables, typed, tmp_path / "mine.toml")]
    assert all(run.settings == typed and list(run) == ["mekf"] for run in runs)
    moments = [run["mekf"].body.principal_moments for run in runs]
    np.testing.assert_array_equal(moments, [moments[0]] * 3)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"data": 3}, "data is 3; give a path, a data set, a DataFrame"),
        ({"data": "nowhere.csv"}, "nowhere.csv: no such file"),
        ({"data": "mine", "segment": "every"}, "'every' is no segment; give a number, times START:END"),
        ({"segment": 2}, "segment 2 is of a recording's folder"),
        ({"estimators": ["kalman"]}, "unknown estimator 'kalman'; choose from mekf"),
        ({"estimators": []}, "or a list of at least one"),
        ({"estimators": Settings()}, "give them by name: compare(data, settings=...)"),
        ({"settings": {"sensors": {"gyro_noise_std": -1}}}, "settings: sensors.gyro_noise_std is -1; give"),
        ({"settings": {"speed": 1}}, "settings: unknown key 'speed'"),
        ({"resume": True}, "work in a run folder; give output"),
        ({"convergence": True}, "work in a run folder; give output"),
        ({"predict": -1.0, "output": "run"}, "predict is -1.0; give a number from"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(
    arguments: dict[str, Any],
    says: str,
    gyro: spinfilters.Dataset,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(spinfilters.InputError) as refusal:
        spinfilters.compare(**{"data": gyro, **arguments})
    assert says in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("made", "says"),
    [
        ("", "no-run/summary.json: cannot be read (No such file or directory); give a folder made by"),
        ("segments/001", "no-run: holds runs of several segments; give one of them (segments/...)"),
        ("summary.json", "no-run/summary.json: cannot be read (Is a directory); give a folder made by"),
    ],
)
def test_what_is_no_run_is_not_loaded(made: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "no-run" / made).mkdir(parents=True)
    with pytest.raises(spinfilters.InputError) as refusal:
        spinfilters.load_run(tmp_path / "no-run")
    assert says in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_an_interrupted_comparison_raises_as_python_does(
    gyro: spinfilters.Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*arguments: object) -> Comparison:
        made = compare_estimators(*arguments)  # pyright: ignore[reportArgumentType]
        return Comparison(made.setup, made.evaluations, True, made.maps)

    monkeypatch.setattr(comparison_run, "compare_estimators", interrupted)
    with pytest.raises(KeyboardInterrupt, match="nothing was written"):
        spinfilters.compare(gyro, "mekf")


def test_progress_is_told_by_name(gyro: spinfilters.Dataset) -> None:
    told: list[tuple[str, int, int]] = []
    settings = Settings(estimators=("mekf",), process=ProcessSettings(tolerance=1e-6))
    spinfilters.compare(gyro, settings=settings, progress=lambda *step: told.append(step))
    assert {name for name, _, _ in told} == {"start", "mekf"}
    last = [(done, total) for name, done, total in told if name == "mekf"][-1]
    assert last[0] == last[1]
