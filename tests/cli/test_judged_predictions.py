"""``compare --predict`` where the truth goes on after the measurements: errors, deviations and NEES."""

import json
from collections.abc import Callable
from pathlib import Path
from shutil import copytree, ignore_patterns

import numpy as np
import pytest
from pictures import unrendered_pictures

from spinfilters.cli.main import main
from spinfilters.core.errors import InputError
from spinfilters.evaluation import reference_comparison
from spinfilters.evaluation.continuous_motion import ContinuousMotion
from spinfilters.evaluation.reference_fit import ReferenceFit
from spinfilters.io.reference_motion import ReferenceMotion
from spinfilters.io.text_table import read_csv
from spinfilters.io.truth import TRUTH_COLUMNS
from spinfilters.run.array_files import read_arrays, write_arrays
from spinfilters.run.predictions import race_figures, stamps_ahead
from spinfilters.run.reference_output import kept_reference
from tests.cli.faults import refusal

pytestmark = pytest.mark.usefixtures("few_figures", "prepared_once")


def compared(dataset: Path, run: Path, *more: str) -> dict[str, object]:
    """The estimators of a run on the first ten seconds, and the errors of what it predicts."""
    asked = ["--estimators", "mekf", "--verdict", "filter", "--segment", "0:10", "--predict", "4", *more]
    assert main(["compare", str(dataset), *asked, "-o", str(run)]) == 0
    return json.loads((run / "prediction.json").read_text())["estimators"]


def test_errors_of_a_prediction_are_its_motion_minus_the_truth(recordings: Path, tmp_path: Path) -> None:
    found = compared(recordings / "stereo-tracks", tmp_path / "run")["mekf"]
    assert isinstance(found, dict)
    assert found["rows"] == 8
    assert found["seconds"] == pytest.approx(4.0)
    predicted = np.loadtxt(tmp_path / "run" / "mekf" / "prediction.csv", delimiter=",", skiprows=1)
    truth = read_csv(recordings / "stereo-tracks" / "truth.csv", TRUTH_COLUMNS).values
    row = np.argmin(np.abs(truth[:, 0] - 14.0))
    off = np.linalg.norm(predicted[-1, 1:4] - truth[row, 1:4])
    assert found["errors"]["position"]["end"] == pytest.approx(off, rel=1e-6)
    assert found["nees_dof"] == 20
    low, high = found["nees_band_95"]
    assert 0.5 * low < found["nees_per_dof_end"] < 2.0 * high
    assert (tmp_path / "run" / "prediction-errors.png").stat().st_size > 10_000


def test_a_finished_run_gets_the_errors_of_another_prediction(recordings: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    first = compared(recordings / "unmapped", run)
    assert compared(recordings / "unmapped", run, "--resume") == first


def test_a_gyro_is_judged_by_rate_and_mass_distribution(recordings: Path, tmp_path: Path) -> None:
    found = compared(recordings / "gyro", tmp_path / "run")["mekf"]
    assert isinstance(found, dict)
    assert set(found["errors"]) == {"attitude", "rate"}
    assert found["nees_dof"] == 8


def test_without_a_truth_after_the_measurements_nothing_is_judged(recordings: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    asked = ["--estimators", "mekf", "--verdict", "filter", "--predict", "4", "-o", str(run)]
    assert main(["compare", str(recordings / "gyro"), *asked]) == 0
    assert json.loads((run / "prediction.json").read_text())["estimators"] == {}
    assert not (run / "prediction-errors.png").exists()
    assert not (run / "mekf" / "prediction_errors.csv").exists()


def test_a_prediction_stops_at_every_stamp_of_the_truth_once() -> None:
    time = np.arange(0.0, 5.1, 0.5)
    truth = np.r_[time, 5.5 + 1e-7, 5.7, 6.0 - 1e-7, 9.0]
    np.testing.assert_allclose(stamps_ahead(time, 1.5, truth), [0.5, 0.7, 1.0, 1.5], atol=1e-6)


def test_a_reference_that_goes_on_judges_a_prediction_and_a_race_too(
    recordings: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    fits: list[str] = []
    fit = reference_comparison.fit_reference

    def counted(motion: ContinuousMotion, reference: ReferenceMotion) -> tuple[ReferenceFit, ReferenceMotion]:
        fits.append(motion.name)
        return fit(motion, reference)

    monkeypatch.setattr(reference_comparison, "fit_reference", counted)
    dataset, reference = tmp_path / "data", tmp_path / "mocap.tum"
    copytree(recordings / "stereo-tracks", dataset, ignore=ignore_patterns("truth.*"))
    truth = read_csv(recordings / "stereo-tracks" / "truth.csv", TRUTH_COLUMNS).values
    rows = np.column_stack([truth[:, 0] + 0.1, truth[:, 1:8]])  # another clock, 0.1 s late
    np.savetxt(reference, rows)
    cad = tmp_path / "cad.toml"
    cad.write_text("principal_moments = [0.5, 0.9, 1.0]\n")
    found = compared(dataset, tmp_path / "run", "--reference", str(reference), "--race", f"mekf,{cad}")[
        "mekf"
    ]
    assert isinstance(found, dict)
    assert found["judge"] == "mocap.tum"
    assert found["rows"] >= 7
    assert set(found["errors"]) == {"position", "attitude"}
    for each in found["errors"].values():
        assert 0.05 < each["end"] / each["end_std"] < 4.0
    assert found["nees_missing"]
    assert (tmp_path / "run" / "prediction-errors.png").stat().st_size > 10_000
    race = json.loads((tmp_path / "run" / "race.json").read_text())
    assert race["compared_with"] == "mocap.tum"
    ends = {name: values["angle_end_rad"] for name, values in race["inertias"].items()}
    assert ends["cad"] > 3 * ends["mekf"]
    assert fits == ["mekf"], "fitted once, for the reference's own files, the prediction and the race"
    assert_drawn_again_and_printed(tmp_path / "run", tmp_path / "printed")
    with unrendered_pictures():  # which have been compared
        again = compared(dataset, tmp_path / "run", "--resume")["mekf"]
        assert again == found, "the kept reference judges again"
        assert_refused_when_damaged(tmp_path / "run", "reference.npz", kept_reference, capsys)
        assert_refused_when_damaged(tmp_path / "run", "race.npz", race_figures, capsys)


def assert_drawn_again_and_printed(run: Path, folder: Path) -> None:
    """The reference and the race are in the folder: their pictures come again without the file, and as a paper prints them."""
    before = {path: path.read_bytes() for path in run.glob("*.png")}
    further = {"prediction", "prediction-errors", "race", "reference-mekf", "reference-differences-mekf"}
    assert {path.stem for path in before} == further
    for path in before:
        path.write_bytes(b"")
    assert main(["plot", str(run)]) == 0
    assert {path: path.read_bytes() for path in run.glob("*.png")} == before
    asked = ["--format", "svg", "--width", "84", "--figures", ",".join(sorted(further))]
    assert main(["plot", str(run), "-o", str(folder), *asked]) == 0
    assert {path.stem for path in folder.glob("*.svg")} == further


def assert_refused_when_damaged(
    run: Path, name: str, read: Callable[[Path], object], capsys: pytest.CaptureFixture[str]
) -> None:
    """One line with the file and the cure; the file is as before afterwards."""
    whole = (run / name).read_bytes()
    damaged = [whole[:-40], whole[: len(whole) // 3], b""]
    for array in ("time", "attitude", "rate"):
        kept = read_arrays_of(whole, run / name)
        if array in kept:
            write_arrays(run / name, kept | {array: kept[array][..., :1]})
            damaged.append((run / name).read_bytes())
    for content in damaged:
        (run / name).write_bytes(content)
        with pytest.raises(InputError, match=rf"{name}: .*; run compare again with --resume"):
            read(run)
    assert name in refusal(capsys, "plot", str(run)), "the command says so too"
    (run / name).write_bytes(whole)


def read_arrays_of(content: bytes, path: Path) -> dict[str, np.ndarray]:
    """Arrays of a file with this content."""
    path.write_bytes(content)
    return read_arrays(path)


def test_a_late_truth_ends_no_run_and_becomes_a_reference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dataset, run = tmp_path / "data", tmp_path / "run"
    assert main(["simulate", "--kind", "pose", "--frames", "24", "-o", str(dataset)]) == 0
    head, *rows = (dataset / "truth.csv").read_text().splitlines()
    late = [",".join([f"{float(row.split(',')[0]) + 0.1:.6f}", *row.split(",")[1:]]) for row in rows]
    (dataset / "truth.csv").write_text("\n".join([head, *late]) + "\n")
    asked = ["--estimators", "mekf", "--verdict", "filter", "--no-figures", "-o", str(run)]
    assert main(["compare", str(dataset), *asked]) == 0
    assert "its clock is" in " ".join(capsys.readouterr().out.split())
    assert (
        json.loads((run / "reference.json").read_text())["estimators"]["mekf"]["clock_offset_s"] is not None
    )
