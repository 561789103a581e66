"""Additions to a run that is there already: drawn again by ``plot``, and made by ``compare --resume`` without running it again."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from spinfilters.cli.main import main
from spinfilters.filters.history import EPOCH_ARRAYS
from spinfilters.plots import figures
from spinfilters.run import comparison_run, optional_outputs
from spinfilters.run.array_files import read_arrays, write_arrays
from tests.cli.faults import Change, cut_off, refusal

FRAMES = 20
ESTIMATORS = ("mekf", "smoother")
ASKED = ("--estimators", "mekf,smoother", "--verdict", "filter")
PREDICTION, CONVERGENCE = "mekf/prediction.npz", "smoother/convergence.npz"
pytestmark = pytest.mark.usefixtures("few_figures", "prepared_once")

Resumed = Callable[..., Path]


def pictures(run: Path) -> dict[str, bytes]:
    """Every picture of a run folder."""
    return {path.name: path.read_bytes() for path in run.glob("*.png")}


@pytest.mark.usefixtures("few_surfaces")
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


def changed(name: str, **arrays: np.ndarray) -> Change:
    """Put other arrays in a file."""
    return lambda run: write_arrays(run / name, {**read_arrays(run / name), **arrays})


def without_array(name: str, array: str) -> Change:
    """Take an array out of a file."""

    def change(run: Path) -> None:
        write_arrays(run / name, {key: a for key, a in read_arrays(run / name).items() if key != array})

    return change


def no_epochs(name: str) -> Change:
    """Leave the arrays of a history without a row."""

    def change(run: Path) -> None:
        arrays = read_arrays(run / name)
        write_arrays(run / name, {k: a[:0] if k in EPOCH_ARRAYS else a for k, a in arrays.items()})

    return change


NOT_A_NUMBER = np.full(FRAMES, np.nan)
FAULTS = {
    "no prediction": (lambda run: (run / PREDICTION).unlink(), "is no history of a run (no such file); run"),
    "prediction of no epoch": (no_epochs(PREDICTION), "does not continue from"),
    "prediction cut off": (cut_off(PREDICTION), PREDICTION),
    "prediction without time": (without_array(PREDICTION, "time"), "time is missing"),
    "prediction at no time": (changed(PREDICTION, time=np.full(11, np.nan)), "time does not run forwards"),
    "prediction of another": (
        lambda run: shutil.copy(run / "smoother/prediction.npz", run / PREDICTION),
        "does not continue from",
    ),
    "no convergence": (
        lambda run: (run / CONVERGENCE).unlink(),
        "is no whole convergence (no such file); run",
    ),
    "convergence cut off": (cut_off(CONVERGENCE), CONVERGENCE),
    "convergence without states": (without_array(CONVERGENCE, "newest_mean"), "newest_mean"),
    "convergence of other shapes": (
        changed(CONVERGENCE, attitude=np.zeros((FRAMES, 4))),
        "attitude is float64",
    ),
    "convergence at no time": (changed(CONVERGENCE, time=NOT_A_NUMBER), "time does not run forwards"),
    "convergence of rotations": (changed(CONVERGENCE, blocks=np.array(["a", "w", "s"])), "its states are"),
}


@pytest.mark.usefixtures("unrendered", "few_surfaces")
@pytest.mark.parametrize(("change", "says"), FAULTS.values(), ids=FAULTS.keys())
def test_additions_that_cannot_be_drawn_again_are_refused_in_one_line(
    change: Change,
    says: str,
    unmapped: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    request: pytest.FixtureRequest,
) -> None:
    run, own = (
        tmp_path / "run",
        "prediction.png" if "prediction" in request.node.callspec.id else "convergence.png",
    )
    shutil.copytree(unmapped, run)
    change(run)
    said = refusal(capsys, "plot", str(run))
    assert says in said
    assert "run compare again with --resume" in said
    assert said.count(str(run)) == 1
    assert pictures(run).keys() == pictures(unmapped).keys()
    assert pictures(run)[own] == pictures(unmapped)[own]


@pytest.mark.usefixtures("few_surfaces")
@pytest.mark.parametrize("name", [PREDICTION, CONVERGENCE])
def test_an_addition_that_cannot_be_drawn_keeps_no_other_figure_from_being_drawn(
    name: str,
    unmapped: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run, other = tmp_path / "run", {PREDICTION: "convergence.png", CONVERGENCE: "prediction.png"}[name]
    shutil.copytree(unmapped, run)
    for path in run.glob("*.png"):
        path.write_bytes(b"")
    (run / name).unlink()
    monkeypatch.setattr(figures, "_figures", lambda _: [("rates", Figure)])
    assert name in refusal(capsys, "plot", str(run))
    assert pictures(run)[other] == pictures(unmapped)[other]
    assert pictures(run)["rates.png"].startswith(b"\x89PNG")


@pytest.fixture(scope="module")
def bare(recordings: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run of `unmapped`, without additions."""
    run = tmp_path_factory.mktemp("bare") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "_figures", lambda _: ())
        arguments = [*ASKED, "-o", str(run)]
        assert main(["compare", str(recordings / "unmapped"), *arguments]) == 0
    return run


@pytest.fixture
def resumed(bare: Path, recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Resumed:
    """Resumes a copy of the bare run with more arguments, no estimator at work; gives its folder."""
    run = tmp_path / "run"
    shutil.copytree(bare, run)
    monkeypatch.setattr(comparison_run, "compare_estimators", None)

    def resume(*arguments: str) -> Path:
        place = [*ASKED, "--resume", "-o", str(run)]
        assert main(["compare", str(recordings / "unmapped"), *place, *arguments]) == 0
        return run

    return resume


def test_a_finished_run_is_predicted_from_its_files_as_if_at_once(
    resumed: Resumed, unmapped: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(optional_outputs, "prepare", None)
    run = resumed("--predict", "5")
    for name in (
        "prediction.png",
        *(f"{n}/prediction.{kind}" for n in ESTIMATORS for kind in ("csv", "npz")),
    ):
        assert (run / name).read_bytes() == (unmapped / name).read_bytes()
    assert not (run / "convergence.png").exists()


@pytest.mark.usefixtures("few_surfaces")
def test_convergence_is_added_to_a_finished_run_as_if_at_once(
    resumed: Resumed, unmapped: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = resumed("--convergence")
    assert "made convergence.png" in capsys.readouterr().out
    assert (run / "convergence.png").read_bytes() == (unmapped / "convergence.png").read_bytes()
    _assert_same_but_for_times(run, unmapped)
    monkeypatch.setattr(optional_outputs, "prepare", None)
    resumed("--convergence")
    assert "nothing is left to do" in capsys.readouterr().out


@pytest.mark.usefixtures("unrendered", "few_surfaces")
def test_a_damaged_convergence_is_made_again(resumed: Resumed, unmapped: Path) -> None:
    run = resumed("--convergence")
    (run / CONVERGENCE).write_bytes(b"no archive")
    resumed("--convergence")
    _assert_same_but_for_times(run, unmapped)


@pytest.mark.usefixtures("unrendered")
def test_without_figures_the_numbers_are_written_and_drawn_when_asked_for(
    resumed: Resumed, capsys: pytest.CaptureFixture[str]
) -> None:
    run = resumed("--predict", "5", "--race", "mekf,smoother", "--convergence", "--no-figures")
    assert "no prediction was made" not in capsys.readouterr().out
    assert all((run / name).exists() for name in (PREDICTION, CONVERGENCE, "race.json"))
    assert not [*run.glob("*.png"), *run.glob("smoother/*.png"), *run.glob("smoother/*.gif")]
    assert main(["plot", str(run)]) == 0
    assert pictures(run).keys() == {"prediction.png", "convergence.png", "race.png"}


def _assert_same_but_for_times(run: Path, other: Path) -> None:
    """Arrays of convergence are the same, but for the measured seconds of the solves."""
    own, others = (read_arrays(folder / CONVERGENCE) for folder in (run, other))
    assert own.keys() == others.keys()
    for arrays in (own, others):
        arrays["costs"] = arrays["costs"][:, 1:]
    for name, array in own.items():
        np.testing.assert_array_equal(array, others[name])


FINISHED_FAULTS = {
    "another's history": (
        lambda run: shutil.copy(run / "smoother/history.npz", run / "mekf/history.npz"),
        "is of 'smoother', not of mekf",
    ),
    "no history": (lambda run: (run / "mekf/history.npz").unlink(), "mekf/history.npz"),
    "no process": (
        lambda run: (run / "summary.json").write_text(
            (run / "summary.json").read_text().replace('"process"', '"motion"')
        ),
        "summary.json is not whole",
    ),
}


@pytest.mark.usefixtures("unrendered")
@pytest.mark.parametrize(("change", "says"), FINISHED_FAULTS.values(), ids=FINISHED_FAULTS.keys())
def test_a_finished_run_that_is_damaged_is_not_predicted(
    change: Change, says: str, resumed: Resumed, recordings: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = resumed()
    change(run)
    asked = [*ASKED, "--resume", "--predict", "5", "-o", str(run)]
    assert says in refusal(capsys, "compare", str(recordings / "unmapped"), *asked)
    assert not (run / "prediction.png").exists()
