"""``spinfilters condition``: its table, its files, and what it refuses."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from observability.conditioning import BEST_CONDITION, covariance_conditioning
from spinfilters.cli.main import main
from spinfilters.filters.history import EstimateHistory
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.models.status import EstimatorStatus, Verdict
from spinfilters.plots.observability_figures import conditioning_figure, covariance_figure
from spinfilters.run.array_files import write_history

LAYOUT = StateLayout(FULL_BLOCKS)


def conditioned(folder: Path, *arguments: str) -> dict:
    """The document of a run."""
    assert main(["condition", "-o", str(folder), *arguments]) == 0
    return json.loads((folder / "condition.json").read_text())


def rows_of(path: Path) -> list[dict[str, str]]:
    """Records of the table on disk."""
    return list(csv.DictReader(path.read_text().splitlines()))


def written_run(folder: Path, factors: np.ndarray, name: str = "mekf") -> Path:
    """A run folder with one history of these covariance factors."""
    count = len(factors)
    ones, numbers = np.ones(count), np.zeros(count, dtype=int)
    history = EstimateHistory(
        name=name,
        layout=LAYOUT,
        time=0.5 * np.arange(count),
        mean=np.tile(LAYOUT.origin(), (count, 1)),
        factor=factors,
        nis=ones,
        dof=numbers,
        log_likelihood=ones,
        accepted=numbers,
        rejected=numbers,
        runtime=ones,
        status=EstimatorStatus(Verdict.OK, ()),
    )
    (folder / name).mkdir(parents=True)
    write_history(folder / name / "history.npz", history)
    return folder


def test_the_default_holds_velocity_in_its_best_unit(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    found = conditioned(tmp_path)
    assert found["alpha_per_s"] == pytest.approx(np.sqrt(3) / 0.5)
    numbers = found["condition_numbers"]
    assert numbers["position and velocity, velocity in 3.464 m/s"] == pytest.approx(BEST_CONDITION)
    assert numbers["position and velocity, SI"] > 3 * BEST_CONDITION
    assert (
        numbers["pose and its velocities, own deviations (Jacobi)"] < numbers["pose and its velocities, SI"]
    )
    said = capsys.readouterr().out
    assert "13.93" in said
    assert all(sentence in said for sentence in found["text"])
    assert (tmp_path / "condition.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(("dt", "alpha"), [("0.1", "1"), ("3600", "4.81125e-4"), ("2", "30")])
@pytest.mark.usefixtures("unrendered")
def test_a_time_step_and_a_unit_get_the_number_of_the_corrected_section(
    tmp_path: Path, dt: str, alpha: str
) -> None:
    found = conditioned(tmp_path, "--time-step", dt, "--alpha", alpha, "--rate-rpm", "0", "0", "0")
    ratio = float(dt) * float(alpha)
    covariance = np.array([[ratio**2 / 3, ratio / 2], [ratio / 2, 1.0]])
    values = np.linalg.eigvalsh(covariance)
    (number,) = [value for name, value in found["condition_numbers"].items() if "velocity in" in name]
    assert number == pytest.approx(values[1] / values[0], rel=1e-6)
    assert found["best_time_step_s"] == pytest.approx(np.sqrt(3) / float(alpha))


@pytest.mark.usefixtures("unrendered")
def test_the_table_on_disk_has_its_least_number_at_the_best_time_step(tmp_path: Path) -> None:
    conditioned(tmp_path, "--alpha", "1")
    rows = rows_of(tmp_path / "condition.csv")
    numbers = np.array([float(row["position_velocity_alpha"]) for row in rows])
    steps = np.array([float(row["time_step_s"]) for row in rows])
    assert steps[np.argmin(numbers)] == pytest.approx(np.sqrt(3), rel=0.04)
    assert float(rows[0]["whole_jacobi"]) < float(rows[0]["whole_si"])


@pytest.mark.usefixtures("unrendered")
def test_a_run_has_the_condition_numbers_of_its_own_covariance(tmp_path: Path) -> None:
    generator = np.random.default_rng(2)
    factors = generator.standard_normal((5, 20, 20)) + 5 * np.eye(20)
    factors *= np.repeat([1e-3, 1e-2, 1e-4, 1e-1, 1e-3, 1.0], [3, 3, 3, 3, 3, 5])[:, np.newaxis]
    found = conditioned(tmp_path / "out", str(written_run(tmp_path / "run", factors)))
    expected = [np.linalg.cond(factor) ** 2 for factor in factors]
    estimator = found["estimators"]["mekf"]
    assert estimator["SI"]["largest"] == pytest.approx(max(expected), rel=1e-6)
    assert estimator["one unit per block"]["median"] < 1e-3 * estimator["SI"]["median"]
    rows = rows_of(tmp_path / "out" / "condition.csv")
    np.testing.assert_allclose([float(row["si"]) for row in rows], expected, rtol=1e-6)
    assert "take the median condition number from" in found["text"][0]


def test_an_epoch_without_a_covariance_has_no_number_and_stops_nothing() -> None:
    factors = np.stack([np.eye(20), np.full((20, 20), np.nan), np.zeros((20, 20)), np.eye(20)])
    found = covariance_conditioning("mekf", LAYOUT, np.arange(4.0), factors)
    np.testing.assert_array_equal(np.isfinite(found.plain), [True, False, False, True])
    assert len(covariance_figure([found]).axes[0].lines) == 3


@pytest.mark.parametrize("finite", [0, 2])
@pytest.mark.usefixtures("unrendered")
def test_a_run_without_covariances_has_null_in_the_document_and_a_dash_in_the_table(
    tmp_path: Path, finite: int, capsys: pytest.CaptureFixture
) -> None:
    factors = np.stack([np.eye(20)] * finite + [np.full((20, 20), np.nan)] * 2)
    run = written_run(tmp_path / "run", factors)
    written_run(tmp_path / "run", np.stack([np.eye(20)]), "ukf")
    found = conditioned(tmp_path / "out", str(run))
    estimator = found["estimators"]["mekf"]
    assert estimator["epochs_without_a_number"] == 2
    expected = (
        {"median": pytest.approx(1.0), "largest": pytest.approx(1.0)}
        if finite
        else {"median": None, "largest": None}
    )
    assert estimator["SI"] == expected
    said = capsys.readouterr().out
    (line,) = [line for line in said.splitlines() if "mekf" in line and "SI" in line and "epoch" not in line][
        :1
    ]
    assert line.split().count("-") == (0 if finite else 2)
    assert ("mekf: no epoch has a finite covariance" in said) == (not finite)
    assert [row["si"] for row in rows_of(tmp_path / "out" / "condition.csv")][:4] == (
        ["1", "1", "", ""] if finite else ["", "", "1"]
    )


@pytest.mark.parametrize("arguments", [("--rate-rpm", "0", "0", "60"), ("--rate-rpm", "0", "400", "0")])
@pytest.mark.usefixtures("unrendered")
def test_a_fast_rate_shortens_the_curves_and_not_the_answer(
    tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    found = conditioned(tmp_path, "--time-step", "1", *arguments)
    assert found["time_step_s"] == 1.0
    rows = rows_of(tmp_path / "condition.csv")
    assert rows[0]["whole_si"]
    assert rows[-1]["whole_si"] == rows[-1]["whole_jacobi"] == ""
    assert rows[-1]["position_velocity_si"]


@pytest.mark.usefixtures("unrendered")
def test_units_that_improve_nothing_are_not_recommended(tmp_path: Path) -> None:
    text = " ".join(conditioned(tmp_path, "--time-step", "2", "--alpha", "3")["text"])
    assert "no unit of rate improves on SI" in text
    assert "rates in" not in text


@pytest.mark.usefixtures("unrendered")
def test_the_shortest_time_step_is_answered(tmp_path: Path) -> None:
    found = conditioned(tmp_path, "--time-step", "1e-6")
    numbers = found["condition_numbers"]
    assert next(value for name, value in numbers.items() if "velocity in" in name) == pytest.approx(
        BEST_CONDITION
    )


def test_the_asked_time_step_is_labelled_and_crosses_no_words() -> None:
    figure = conditioning_figure(np.array([0.0, 1.0, 0.0]), 0.5, 3.0)
    over_time, _, units, whole = figure.axes
    for axes in (over_time, units, whole):
        legend = axes.get_legend()
        assert legend is not None
        assert "asked: 0.5 s" in [text.get_text() for text in legend.get_texts()]
        assert legend.get_frame().get_alpha() == 1.0
        assert not axes.texts
    best = over_time.get_legend()
    assert best is not None
    words = [text.get_text() for text in best.get_texts()]
    assert any("13.93" in each for each in words)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--time-step", "0"], "--time-step: '0' is not allowed; give a number from 1e-06 to 1e+06 s"),
        (["--time-step", "-1"], "--time-step: '-1' is not allowed"),
        (["--time-step", "nan"], "--time-step: 'nan' is not allowed"),
        (["--alpha", "1e300"], "--alpha: '1e300' is not allowed"),
        (["--alpha", "1e20"], "--alpha: '1e20' is not allowed; give a number from 1e-06 to 1e+06 1/s"),
        (["--alpha", "0"], "--alpha: '0' is not allowed"),
        (["--rate-rpm", "1e7", "0", "0"], "give a number from -1e+06 to 1e+06 rpm"),
        (["--rate-rpm", "1e6", "0", "0"], "give a shorter --time-step or a slower --rate-rpm"),
        (["nowhere"], "nowhere: no such folder"),
        (["nowhere", "--alpha", "1"], "a run has its own time steps and rates"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_input_is_refused_in_one_line(
    tmp_path: Path, arguments: list[str], text: str, capsys: pytest.CaptureFixture
) -> None:
    try:
        code = main(["condition", "-o", str(tmp_path / "out"), *arguments])
    except SystemExit as stopped:
        code = stopped.code
    complaint = capsys.readouterr().err
    assert code == 2
    assert text in complaint
    assert complaint.count("\n") == 1
    assert len(complaint) < 300
    assert not (tmp_path / "out").exists()


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "thesis.tex").write_text("chapter 1")
    assert main(["condition", "-o", str(tmp_path)]) == 2
    assert "is not empty and no result of condition" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_damaged_history_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "run" / "mekf").mkdir(parents=True)
    (tmp_path / "run" / "mekf" / "history.npz").write_bytes(b"not an archive")
    assert main(["condition", str(tmp_path / "run"), "-o", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
