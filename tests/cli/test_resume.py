"""``spinfilters compare --resume``: what an interrupted command leaves behind, and how it goes on."""

import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from forked import kill_at, killed
from pictures import unrendered_pictures

from spinfilters.cli.main import main
from spinfilters.filters import timeline
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.inference.setup import Setup
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.run import comparison_run, estimators
from spinfilters.run.checkpoints import CHECKPOINT_FILE, CheckpointInterval, checkpoint_stores
from spinfilters.run.estimation import Comparison, compare_estimators
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from tests.cli.faults import Change, replaced

Progress = Callable[[str, int, int], None]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """60 frames of poses."""
    folder = tmp_path_factory.mktemp("data") / "poses"
    write_dataset(simulate(Scenario.simplified(kind="pose", rate_rpm=RICH_RPM, epochs=60)), folder)
    return folder


@pytest.fixture(autouse=True)
def few_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures take most of a run's time and have their own tests."""
    monkeypatch.setattr(comparison_run, "draw_run", lambda *_: [])


@pytest.fixture(scope="module")
def wanted(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Trajectories of a run that nobody disturbed."""
    run = tmp_path_factory.mktemp("wanted") / "run"
    with unrendered_pictures():
        assert main(["compare", str(dataset), "-o", str(run)]) == 0
    return trajectories(run)


def trajectories(run: Path) -> dict[str, bytes]:
    """Every trajectory of a run folder, as bytes."""
    found = {str(path.relative_to(run)): path.read_bytes() for path in run.glob("*/trajectory.*")}
    assert len(found) == 6
    return found


def disturbed(event: Progress, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let something happen as the command reports its progress, and keep a checkpoint of every epoch."""

    def compare(setup: Setup, settings: Settings, progress: Progress, *further: object) -> Comparison:
        def report(name: str, done: int, total: int) -> None:
            progress(name, done, total)
            event(name, done, total)

        return compare_estimators(setup, settings, report, *further)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(timeline, "MOST_TOGETHER", 1)
    monkeypatch.setattr(comparison_run, "compare_estimators", compare)
    monkeypatch.setattr(
        comparison_run,
        "checkpoint_stores",
        lambda *run: checkpoint_stores(run[0], run[1], run[2], CheckpointInterval(0.0, 1.0)),
    )


@pytest.fixture
def halted(dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run folder whose command was killed in the middle of the UKF."""
    run = tmp_path / "run"
    with monkeypatch.context() as patch:
        disturbed(kill_at("ukf", 6), patch)
        assert killed(lambda: main(["compare", str(dataset), "-o", str(run)]))
    assert {path.name for path in run.iterdir()} == {".lock", "config.toml", "mekf", "ukf"}
    return run


def test_a_killed_command_goes_on_to_the_same_trajectories(
    halted: Path, dataset: Path, wanted: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The finished EKF is not run again: any update of it would fail. (The smoother has an EKF of its own to set out from.)"""

    class Refusing(MultiplicativeEkf):
        update = None  # pyright: ignore[reportAssignmentType]

    monkeypatch.setattr(estimators, "MultiplicativeEkf", Refusing)
    assert main(["compare", str(dataset), "-o", str(halted), "--resume"]) == 0
    assert trajectories(halted) == wanted
    assert not list(halted.rglob(CHECKPOINT_FILE))
    assert not list(halted.rglob(".*.part"))


def test_without_resume_the_run_is_made_anew(halted: Path, dataset: Path, wanted: dict[str, bytes]) -> None:
    (halted / "mekf" / CHECKPOINT_FILE).write_bytes(b"damaged")
    assert main(["compare", str(dataset), "-o", str(halted)]) == 0
    assert trajectories(halted) == wanted


def test_resume_without_anything_to_go_on_from_is_a_run(
    dataset: Path, wanted: dict[str, bytes], tmp_path: Path
) -> None:
    assert main(["compare", str(dataset), "-o", str(tmp_path / "run"), "--resume"]) == 0
    assert trajectories(tmp_path / "run") == wanted


def test_a_complete_run_is_left_alone(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ["compare", str(dataset), "-o", str(tmp_path / "run"), "--resume"]
    assert main(arguments) == 0
    monkeypatch.setattr(comparison_run, "prepare", None)
    capsys.readouterr()
    assert main(arguments) == 0
    assert "is complete, nothing is left to do" in capsys.readouterr().out


OTHER_KNOWLEDGE = {
    "true body": replaced("truth.toml", "    1.0,", "    1.01,"),
    "noise": replaced("dataset.toml", "position_std = 0.005", "position_std = 0.5"),
}


@pytest.mark.parametrize("change", OTHER_KNOWLEDGE.values(), ids=OTHER_KNOWLEDGE.keys())
def test_a_complete_run_of_another_data_set_is_made_again(
    change: Change, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The measured values are the same, but the rest of what is known decides the numbers too."""
    data, arguments = tmp_path / "data", ["--estimators", "mekf", "-o", str(tmp_path / "run"), "--resume"]
    shutil.copytree(dataset, data)
    assert main(["compare", str(data), *arguments]) == 0
    change(data)
    capsys.readouterr()
    assert main(["compare", str(data), *arguments]) == 0
    assert "is complete" not in capsys.readouterr().out
    assert main(["compare", str(data), *arguments]) == 0
    assert "is complete" in capsys.readouterr().out


def test_ctrl_c_says_how_to_go_on(
    dataset: Path,
    wanted: dict[str, bytes],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def press(name: str, done: int, _: int) -> None:
        if (name, done) == ("ukf", 9):
            os.kill(os.getpid(), signal.SIGINT)

    run = tmp_path / "run"
    with monkeypatch.context() as patch:
        disturbed(press, patch)
        assert main(["compare", str(dataset), "-o", str(run)]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert "interrupted" in said
    assert "--resume" in said
    assert (run / "mekf" / "history.npz").is_file()
    assert main(["compare", str(dataset), "-o", str(run), "--resume"]) == 0
    assert trajectories(run) == wanted


COMPILING = "spinfilters: compiling the models for this machine, once ..."
"""Of a state with drag, where no test before has compiled them."""
OTHERS = {
    "settings": (["--drag"], "process.drag = False, now it is True"),
    "estimator": (["--estimators", "filterpy-ekf"], "of the estimator 'mekf', not of filterpy-ekf"),
}


@pytest.mark.parametrize(("options", "says"), OTHERS.values(), ids=OTHERS.keys())
def test_the_checkpoint_of_another_run_is_refused_in_one_line(
    options: list[str], says: str, halted: Path, dataset: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (halted / "filterpy-ekf").mkdir()
    kept = (halted / "mekf" / CHECKPOINT_FILE).read_bytes()
    (halted / "filterpy-ekf" / CHECKPOINT_FILE).write_bytes(kept)
    capsys.readouterr()
    assert main(["compare", str(dataset), "-o", str(halted), "--resume", *options]) == 2
    said = capsys.readouterr().err.removeprefix(f"{COMPILING}\n")
    assert len(said.splitlines()) == 1
    assert says in said
    assert (halted / "mekf" / CHECKPOINT_FILE).read_bytes() == kept


def test_a_damaged_checkpoint_is_refused_in_one_line(
    halted: Path, dataset: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = halted / "ukf" / CHECKPOINT_FILE
    path.write_bytes(path.read_bytes()[:5000])
    capsys.readouterr()
    assert main(["compare", str(dataset), "-o", str(halted), "--resume"]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert "ukf/checkpoint.npz: is no whole checkpoint" in said
    assert "--resume" in said
