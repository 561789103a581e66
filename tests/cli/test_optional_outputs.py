"""``spinfilters compare --predict`` and ``--convergence``: the files they add, and what they refuse in one line."""

from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float

from spinfilters.cli.main import main
from spinfilters.evaluation.estimated_motion import TRAJECTORY_COLUMNS
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Measurement, UpdateReport
from spinfilters.io.text_table import read_csv
from spinfilters.run import estimators
from spinfilters.run.array_files import read_arrays
from spinfilters.run.run_folder import CONSTANTS_PICTURE, COSTS_PICTURE, SETTLING_ANIMATIONS, SURFACE_PICTURES
from tests.cli.faults import refusal

FRAMES, INTERVAL = 20, 0.5
pytestmark = pytest.mark.usefixtures("few_figures", "prepared_once")


def table(path: Path) -> Float[np.ndarray, "n c"]:
    """Rows of a trajectory's file."""
    return read_csv(path, TRAJECTORY_COLUMNS).values


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
    assert arrays["trusted"].shape == (FRAMES,)
    assert not arrays["trusted"][0]
    difference = np.abs(arrays["position"][-1] - smoothed[:, 1:4])
    assert (difference < arrays["std_position"][-1]).all()
    assert (unmapped / "convergence.png").stat().st_size > 10_000
    assert (arrays["costs"] > 0).all()
    pictures = (*SURFACE_PICTURES.values(), *SETTLING_ANIMATIONS.values(), CONSTANTS_PICTURE, COSTS_PICTURE)
    assert all((unmapped / "smoother" / name).stat().st_size > 10_000 for name in pictures)


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


def test_where_every_estimator_failed_one_line_says_that_nothing_is_predicted(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Failing(MultiplicativeEkf):
        def update(self, measurement: Measurement) -> UpdateReport:
            raise np.linalg.LinAlgError("not positive definite")

    monkeypatch.setattr(estimators, "MultiplicativeEkf", Failing)
    run = tmp_path / "run"
    asked = ["--estimators", "mekf", "--predict", "2", "-o", str(run)]
    for more in ([], ["--resume"]):
        assert main(["compare", str(recordings / "gyro"), *asked, *more]) == 0
        said = capsys.readouterr().out.splitlines()
        assert sum("no prediction was made: every estimator failed" in line for line in said) == 1
        assert not (run / "prediction.png").exists()


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
