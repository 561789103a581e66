"""``spinfilters compare --predict`` and ``--convergence``: the files they add, and what they refuse in one line."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float

from spinfilters.cli.main import main
from spinfilters.evaluation.trajectory import TRAJECTORY_COLUMNS
from spinfilters.logs.dataset_writing import write_dataset
from spinfilters.logs.table_files import read_csv
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.workflow import figures
from spinfilters.workflow.array_file import read_arrays, write_arrays

FRAMES, INTERVAL = 30, 0.5


@pytest.fixture(autouse=True)
def few_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """The figures of every run have their own tests."""
    monkeypatch.setattr(figures, "_figures", lambda _: ())


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Tracks without a map, the same with it, and a gyro."""
    folder = tmp_path_factory.mktemp("recordings")
    for kind in ("stereo-tracks", "gyro"):
        scenario = Scenario(kind=kind, rate_rpm=RICH_RPM, frames=FRAMES, interval=INTERVAL, landmarks=150)
        write_dataset(simulate(scenario), folder / kind)
    write_dataset(
        simulate(Scenario(rate_rpm=RICH_RPM, frames=FRAMES, interval=INTERVAL, landmarks=150)),
        folder / "unmapped",
    )
    (folder / "unmapped" / "landmarks.csv").unlink()
    return folder


@pytest.fixture(scope="module")
def unmapped(recordings: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run on tracks without a map, with both additions."""
    run = tmp_path_factory.mktemp("unmapped") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "_figures", lambda _: ())
        arguments = ["--estimators", "mekf,smoother", "--predict", "5", "--convergence", "-o", str(run)]
        assert main(["compare", str(recordings / "unmapped"), *arguments]) == 0
    return run


def table(path: Path) -> Float[np.ndarray, "n c"]:
    """Rows of a trajectory's file."""
    return read_csv(path, TRAJECTORY_COLUMNS).values


def refusal(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line of a command that must fail."""
    capsys.readouterr()
    try:
        code: object = main(arguments)
    except SystemExit as stop:  # argparse
        code = stop.code
    captured = capsys.readouterr()
    assert code == 2, captured.err
    assert len(captured.err.splitlines()) == 1, captured.err
    return captured.err


@pytest.mark.parametrize("name", ["mekf", "smoother"])
def test_a_prediction_goes_on_from_the_trajectory_in_its_own_columns(unmapped: Path, name: str) -> None:
    known = table(unmapped / name / "trajectory.csv")
    ahead = table(unmapped / name / "prediction.csv")
    time = ahead[:, 0] - known[-1, 0]
    np.testing.assert_allclose(time, INTERVAL * np.arange(1, 11), atol=1e-9)
    spread = ahead[:, TRAJECTORY_COLUMNS.index("std_rx")]
    assert (np.diff(np.concatenate([known[-1:, TRAJECTORY_COLUMNS.index("std_rx")], spread])) > 0).all()
    assert (unmapped / "prediction.png").stat().st_size > 10_000


def test_the_arrays_of_convergence_end_in_the_smoothed_trajectory(unmapped: Path) -> None:
    arrays = read_arrays(unmapped / "smoother" / "convergence.npz")
    smoothed = table(unmapped / "smoother" / "trajectory.csv")
    assert arrays["position"].shape == (FRAMES, FRAMES, 3)
    assert (np.isfinite(arrays["position"]).all(axis=2) == np.tri(FRAMES, dtype=bool)).all()
    assert arrays["log_ratios"].shape == (FRAMES, 2)
    difference = np.abs(arrays["position"][-1] - smoothed[:, 1:4])
    assert (difference < arrays["std_position"][-1]).all()
    assert (unmapped / "convergence.png").stat().st_size > 10_000


def test_a_gyro_run_is_predicted_for_every_estimator(recordings: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert main(["compare", str(recordings / "gyro"), "--predict", "2", "-o", str(run)]) == 0
    for name in ("mekf", "ukf", "smoother"):
        assert len(table(run / name / "prediction.csv")) == 4
    assert (run / "prediction.png").exists()


def test_a_run_that_is_not_asked_again_loses_its_additions(recordings: Path, tmp_path: Path) -> None:
    run, gyro = tmp_path / "run", str(recordings / "gyro")
    assert main(["compare", gyro, "--estimators", "mekf", "--predict", "2", "-o", str(run)]) == 0
    assert main(["compare", gyro, "--estimators", "mekf", "-o", str(run)]) == 0
    assert not (run / "prediction.png").exists()
    assert not (run / "mekf" / "prediction.csv").exists()


def test_resuming_a_complete_run_makes_the_prediction_that_is_asked_for(
    recordings: Path, tmp_path: Path
) -> None:
    run, gyro = tmp_path / "run", str(recordings / "gyro")
    assert main(["compare", gyro, "--estimators", "mekf", "-o", str(run)]) == 0
    resumed = ["--estimators", "mekf", "--resume", "--predict", "2", "-o", str(run)]
    assert main(["compare", gyro, *resumed]) == 0
    assert (run / "mekf" / "prediction.csv").exists()


@pytest.mark.parametrize("seconds", ["0", "-3", "nan", "inf", "1e999", "soon", "", "0.01", "1e7"])
def test_times_ahead_that_make_no_sense_are_refused_before_anything_is_written(
    seconds: str, recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    said = refusal(capsys, "compare", str(recordings / "gyro"), f"--predict={seconds}", "-o", str(run))
    assert "--predict" in said
    assert not list(run.glob("*"))


@pytest.mark.parametrize(
    ("kind", "estimators", "says"),
    [
        ("gyro", "smoother", "tracks without a known map"),
        ("stereo-tracks", "smoother", "tracks without a known map"),
        ("unmapped", "mekf", "the estimator smoother"),
    ],
)
def test_convergence_is_refused_where_there_is_none_to_show(
    recordings: Path, capsys: pytest.CaptureFixture[str], kind: str, estimators: str, says: str
) -> None:
    place = ["-o", str(recordings / "nowhere")]
    assert says in refusal(
        capsys, "compare", str(recordings / kind), "--convergence", "--estimators", estimators, *place
    )


def test_additions_of_all_segments_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = refusal(
        capsys, "compare", "any", "--segment", "all", "--predict", "3", "-o", str(tmp_path / "run")
    )
    assert "--segment N" in said


def pictures(run: Path) -> dict[str, bytes]:
    """Every picture of a run folder."""
    return {path.name: path.read_bytes() for path in run.glob("*.png")}


def test_additions_are_drawn_again_to_the_same_pictures(unmapped: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(unmapped, run)
    for path in run.glob("*.png"):
        path.write_bytes(b"")
    assert main(["plot", str(run)]) == 0
    assert pictures(run) == pictures(unmapped)
    assert pictures(run).keys() == {"prediction.png", "convergence.png"}


def test_a_run_without_additions_is_drawn_without_them(recordings: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert main(["compare", str(recordings / "gyro"), "--estimators", "mekf", "-o", str(run)]) == 0
    assert main(["plot", str(run)]) == 0
    assert pictures(run) == {}


def cut_off(name: str) -> Callable[[Path], object]:
    """Leave half of a file."""
    return lambda run: (run / name).write_bytes((run / name).read_bytes()[: (run / name).stat().st_size // 2])


def changed(name: str, **arrays: np.ndarray) -> Callable[[Path], object]:
    """Put other arrays in a file."""
    return lambda run: write_arrays(run / name, {**read_arrays(run / name), **arrays})


def without(name: str, array: str) -> Callable[[Path], object]:
    """Take an array out of a file."""

    def change(run: Path) -> None:
        write_arrays(run / name, {key: a for key, a in read_arrays(run / name).items() if key != array})

    return change


PREDICTION, CONVERGENCE = "mekf/prediction.npz", "smoother/convergence.npz"
NOT_A_NUMBER = np.full(FRAMES, np.nan)
FAULTS = {
    "no prediction": (lambda run: (run / PREDICTION).unlink(), PREDICTION),
    "prediction cut off": (cut_off(PREDICTION), PREDICTION),
    "prediction without time": (without(PREDICTION, "time"), "time is missing"),
    "prediction at no time": (changed(PREDICTION, time=np.full(11, np.nan)), "does not go on from"),
    "prediction of another": (
        lambda run: shutil.copy(run / "smoother/prediction.npz", run / PREDICTION),
        "does not go on from",
    ),
    "no convergence": (lambda run: (run / CONVERGENCE).unlink(), CONVERGENCE),
    "convergence cut off": (cut_off(CONVERGENCE), CONVERGENCE),
    "convergence without states": (without(CONVERGENCE, "newest_mean"), "newest_mean"),
    "convergence of other shapes": (
        changed(CONVERGENCE, attitude=np.zeros((FRAMES, 4))),
        "attitude is float64",
    ),
    "convergence at no time": (changed(CONVERGENCE, time=NOT_A_NUMBER), "time does not run forwards"),
    "convergence of rotations": (changed(CONVERGENCE, blocks=np.array(["a", "w", "s"])), "its states are"),
}


@pytest.mark.parametrize(("change", "says"), FAULTS.values(), ids=FAULTS.keys())
def test_additions_that_cannot_be_drawn_again_are_refused_in_one_line(
    change: Callable[[Path], object],
    says: str,
    unmapped: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = tmp_path / "run"
    shutil.copytree(unmapped, run)
    change(run)
    said = refusal(capsys, "plot", str(run))
    assert says in said
    assert "run compare again with --resume" in said
    assert pictures(run) == pictures(unmapped)
