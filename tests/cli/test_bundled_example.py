"""Without a data set the thesis' own problem is solved: tracks of unknown landmarks, its noise, and both are said."""

import json
from pathlib import Path

import numpy as np
import pytest

from spinfilters.cli.main import main
from spinfilters.run.readers import read_dataset

SHORT = ("--frames", "12", "--rate-rpm", "4", "9", "3")


def words(capsys: pytest.CaptureFixture[str]) -> str:
    """What was printed, on one line."""
    return " ".join(capsys.readouterr().out.split())


@pytest.mark.usefixtures("few_figures")
def test_the_default_has_no_map_and_the_noise_of_the_thesis_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["--estimators", "mekf,smoother", "--seed", "1", "--verdict", "filter"]
    assert main(["compare", *asked, "-o", str(tmp_path / "run")]) == 0
    said = words(capsys)
    assert "Map unknown. Seed 1." in said
    assert "pixels 1 px; disturbances: force 1e-06 (m/s^2)^2/Hz, torque 1e-06" in said
    document = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert document["conditions"]["map"] == "unknown"
    assert document["conditions"]["seed"] == 1
    assert document["process"]["force_psd"] == document["process"]["torque_psd"] == 1e-6
    assert not (tmp_path / "run" / "dataset" / "landmarks.csv").exists()
    mekf, smoother = document["estimators"].values()
    assert mekf["initialisation_epochs"] == 60
    assert mekf["observations"]["epochs"] == 55
    assert smoother["observations"]["epochs"] == 115
    assert smoother["observations"]["share_used"] > 0.99
    everything = mekf["observations"]["share_used"] == smoother["observations"]["share_used"] == 1.0
    assert document["identical_measurements"] is everything
    assert ("identical measurements" in said) is everything


@pytest.mark.usefixtures("few_figures")
def test_with_the_known_map_filterpy_joins_by_default(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def none_of_them(_: object, settings: object, *__: object) -> None:
        asked.append(settings)
        raise KeyboardInterrupt

    monkeypatch.setattr("spinfilters.run.comparison_run.compare_estimators", none_of_them)
    assert main(["compare", "--known-map", "-o", str(tmp_path / "run")]) == 2
    assert main(["compare", "-o", str(tmp_path / "run")]) == 2
    known, unknown = (settings.estimators for settings in asked)
    assert known == (*unknown, "filterpy-ekf", "filterpy-ukf")
    said = capsys.readouterr().err
    assert "interrupted; nothing unfinished is left behind" in said  # its settings alone
    assert "--resume" not in said


def test_a_data_set_has_its_own_map(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", str(tmp_path), "--known-map", "-o", str(tmp_path / "run")]) == 2
    assert "the known map of a data set is its landmarks.csv" in capsys.readouterr().err


def test_simulate_writes_the_same_problem_without_the_map_or_with_it(tmp_path: Path) -> None:
    blind, sighted = tmp_path / "blind", tmp_path / "sighted"
    assert main(["simulate", "-o", str(blind), *SHORT]) == 0
    assert main(["simulate", "-o", str(sighted), "--known-map", *SHORT]) == 0
    assert read_dataset(blind).known_map is None
    assert read_dataset(sighted).known_map is not None
    for folder in (blind, sighted):
        options = read_dataset(folder).options
        assert (options.force_psd, options.torque_psd, options.pixel_std) == (1e-6, 1e-6, 1.0)
        assert options.notes["seed"] == 0


def test_only_tracks_have_a_map_to_write(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "-o", str(tmp_path / "gyro"), "--kind", "gyro", "--known-map"]) == 2
    error = capsys.readouterr().err
    assert "a known map is for the kinds mono-tracks and stereo-tracks; a gyro has no map" in error


def test_simulate_says_in_how_many_epochs_the_body_is_in_view(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", "-o", str(tmp_path / "long"), "--frames", "12", "--interval", "20"]) == 0
    assert "the body is in view in " in words(capsys)
    assert main(["simulate", "-o", str(tmp_path / "short"), *SHORT]) == 0
    assert "in view" not in words(capsys)


def test_a_simulated_gyro_has_the_bias_that_is_asked_for_and_the_truth_tells_it(tmp_path: Path) -> None:
    plain, biased = tmp_path / "plain", tmp_path / "biased"
    assert main(["simulate", "-o", str(plain), "--kind", "gyro", *SHORT]) == 0
    assert (
        main(["simulate", "-o", str(biased), "--kind", "gyro", "--gyro-bias", "0.1", "-0.2", "0.3", *SHORT])
        == 0
    )
    rates = [read_dataset(folder).log.stream("gyro").values for folder in (plain, biased)]
    np.testing.assert_allclose(rates[1] - rates[0], np.tile([0.1, -0.2, 0.3], (12, 1)), atol=1e-12)
    truth = read_dataset(biased).truth
    assert truth is not None
    assert truth.gyro_bias is not None
    np.testing.assert_array_equal(truth.gyro_bias, [0.1, -0.2, 0.3])


def test_only_a_gyro_has_a_bias_to_simulate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        main(["simulate", "-o", str(tmp_path / "pose"), "--kind", "pose", "--gyro-bias", "0", "0", "1"]) == 2
    )
    assert "a gyro's bias is for the kind gyro; a pose has no gyro" in capsys.readouterr().err
