"""Folder of a calibration: draws are made once, read again, and reported, whatever has interrupted or damaged them."""

import json
import signal
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from spinfilters.campaigns import calibration_draws, calibration_report
from spinfilters.campaigns.calibration_draws import (
    DRAWS_FILE,
    STUDY_FILE,
    CalibrationDraw,
    CalibrationStudy,
    add_draw,
    read_draws,
)
from spinfilters.campaigns.calibration_report import PAGE_FILE, RESULT_FILE, rank_figure
from spinfilters.cli.main import main

STUDY = CalibrationStudy("gyro", ("mekf",), "identified")
COMPONENT = (0.1, 0.2, 0.3)
DRAW = CalibrationDraw(
    0,
    "mekf",
    "ok",
    True,
    0.5,
    {"rate": [COMPONENT] * 3, "moments": [COMPONENT] * 4, "axes": [COMPONENT] * 3},
    {"w": 1.0},
)


class Maker:
    """Draws without a simulation; a call of its own in place of a draw where one is given for the seed."""

    def __init__(self) -> None:
        self.seeds = list[int]()
        self.instead = dict[int, Callable[[], object]]()

    def __call__(self, _: str, seed: int, estimators: Sequence[str], __: bool) -> list[CalibrationDraw]:
        self.seeds.append(seed)
        if seed in self.instead:
            self.instead.pop(seed)()
            return []
        return [replace(DRAW, seed=seed, estimator=name) for name in estimators]


@pytest.fixture
def maker(monkeypatch: pytest.MonkeyPatch) -> Maker:
    """In place of simulation and estimators; pictures are drawn and not written."""
    found = Maker()
    monkeypatch.setattr(calibration_report, "save_figure", lambda figure, path: None)
    monkeypatch.setattr(calibration_draws, "made_draws", found)
    return found


def calibrate(folder: Path, draws: int, sensor: str = "gyro", estimators: str = "mekf") -> int:
    """Exit code of the command."""
    return main(["calibration", sensor, "--estimators", estimators, "-o", str(folder), "--draws", str(draws)])


def press() -> None:
    """Ctrl-C."""
    signal.raise_signal(signal.SIGINT)


def press_unheard() -> None:
    """Ctrl-C that a library takes for an error of its own."""
    with pytest.raises(KeyboardInterrupt):
        press()


def test_draws_are_made_read_again_and_reported(tmp_path: Path) -> None:
    assert calibrate(tmp_path, 1) == 0
    path = tmp_path / DRAWS_FILE
    first = path.read_text()
    path.write_text(first + '{"seed": 1, "dra')  # a call that was killed while it wrote
    assert calibrate(tmp_path, 2) == 0
    assert path.read_text().startswith(first)
    draws = read_draws(tmp_path, STUDY)
    assert list(draws) == [0, 1]
    assert set(draws[0][0].quantities) == {"rate", "moments", "axes"}
    result = json.loads((tmp_path / RESULT_FILE).read_text())
    assert result["estimators"]["mekf"]["draws"] == 2
    assert calibrate(tmp_path, 2, estimators="ukf") == 2


@pytest.mark.parametrize("how", [press, press_unheard])
def test_an_interrupted_call_says_how_many_draws_there_are(
    how: Callable[[], None], maker: Maker, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    maker.instead[2] = how
    assert calibrate(tmp_path, 4) == 2
    assert f"interrupted; 2 of 4 draws are in {tmp_path}, run the command again" in capsys.readouterr().err
    assert "Unfinished: 2 of 4 draws" in (tmp_path / PAGE_FILE).read_text()
    assert json.loads((tmp_path / RESULT_FILE).read_text())["draws"]["asked"] == 4
    assert calibrate(tmp_path, 4) == 0
    assert maker.seeds == [0, 1, 2, 2, 3]
    assert "Unfinished" not in (tmp_path / PAGE_FILE).read_text()


def test_a_call_that_is_interrupted_in_its_first_draw_writes_no_report(
    maker: Maker, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    maker.instead[0] = press
    assert calibrate(tmp_path, 4) == 2
    assert "0 of 4 draws are in" in capsys.readouterr().err
    assert not (tmp_path / PAGE_FILE).exists()
    assert calibrate(tmp_path, 1, estimators="mekf,ukf") == 0  # nothing of the first study is in the way


def test_a_recording_without_an_estimate_is_counted_and_not_made_again(maker: Maker, tmp_path: Path) -> None:
    maker.instead[1] = lambda: None
    for _ in range(2):
        assert calibrate(tmp_path, 3) == 0
    assert maker.seeds == [0, 1, 2]
    page = (tmp_path / PAGE_FILE).read_text()
    assert "1 of the 3 drawn recordings" in page
    assert "2 of 3 draws" in page


def test_draws_have_seeds_from_the_first_on(maker: Maker, tmp_path: Path) -> None:
    assert calibrate(tmp_path, 1) == 0
    command = ["calibration", "gyro", "--estimators", "mekf", "-o", str(tmp_path), "--draws", "2"]
    assert main([*command, "--first", "7"]) == 0
    assert maker.seeds == [0, 7, 8]
    assert json.loads((tmp_path / RESULT_FILE).read_text())["draws"] == {
        "asked": 3,
        "made": 3,
        "without_estimate": 0,
    }


def test_a_seed_that_lacks_an_estimator_is_made_again_and_counts_once(maker: Maker, tmp_path: Path) -> None:
    assert calibrate(tmp_path, 2, estimators="mekf,ukf") == 0
    add_draw(tmp_path, STUDY, 2, [replace(DRAW, seed=2)])
    assert calibrate(tmp_path, 3, estimators="mekf,ukf") == 0
    path = tmp_path / DRAWS_FILE
    path.write_text(2 * path.read_text())
    assert calibrate(tmp_path, 3, estimators="mekf,ukf") == 0
    assert maker.seeds == [0, 1, 2]
    result = json.loads((tmp_path / RESULT_FILE).read_text())
    assert [result["estimators"][name]["draws"] for name in ("mekf", "ukf")] == [3, 3]


@pytest.mark.parametrize("names", ["mekff", "", ",", "mekf,mekf"])
def test_wrong_names_are_refused_before_anything_is_written(
    names: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert calibrate(tmp_path / "new", 2, estimators=names) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    "line",
    [
        b'{"seed": 1}',
        b'{"seed": 1, "draws": [{}]}',
        b'{"seed": 1, "draws": 3}',
        b"[1]",
        b"\xff\xfe",
        b"[" * 100_000,
        json.dumps({"seed": 1, "draws": [asdict(replace(DRAW, seed=2))]}).encode(),
        json.dumps({"seed": 1, "draws": [asdict(replace(DRAW, seed=1, quantities={"rate": [COMPONENT]}))]}).encode(),
        json.dumps({"seed": 1, "draws": [asdict(replace(DRAW, seed=1, quantities={"mass": [COMPONENT] * 3}))]}).encode(),
        json.dumps({"seed": 1, "draws": [asdict(DRAW) | {"seed": 1, "worst": "big"}]}).encode(),
        json.dumps({"seed": 1, "draws": [asdict(DRAW) | {"seed": 1, "scores": {"rate": [[1.0]] * 3}}]}).encode(),
        json.dumps({"seed": 1, "draws": [asdict(DRAW) | {"seed": 1, "mixture_nees": {"w": None}}]}).encode(),
    ],
)  # fmt: skip
def test_a_damaged_line_is_no_draw_and_its_seed_is_made_again(
    line: bytes, maker: Maker, tmp_path: Path
) -> None:
    assert calibrate(tmp_path, 1) == 0
    with (tmp_path / DRAWS_FILE).open("ab") as file:
        file.write(line + b"\n")
    assert calibrate(tmp_path, 2) == 0
    assert maker.seeds == [0, 1]
    assert list(read_draws(tmp_path, STUDY)) == [0, 1]


def test_a_draw_of_an_earlier_version_has_the_scores_of_its_gaussians(maker: Maker, tmp_path: Path) -> None:
    assert calibrate(tmp_path, 1) == 0
    line = json.loads((tmp_path / DRAWS_FILE).read_text())
    for name in ("scores", "mixture_nees"):
        del line["draws"][0][name]
    (tmp_path / DRAWS_FILE).write_text("".join(json.dumps(_of_seed(line, k)) + "\n" for k in range(10)))
    assert calibrate(tmp_path, 10) == 0
    assert maker.seeds == [0]
    component = json.loads((tmp_path / RESULT_FILE).read_text())["estimators"]["mekf"]["all"]["rate"]["x"]
    assert component["crps"] == component["gaussian_crps"]


def _of_seed(line: dict[str, Any], seed: int) -> dict[str, Any]:
    return line | {"seed": seed, "draws": [each | {"seed": seed} for each in line["draws"]]}


def test_a_damaged_study_is_named_and_mended_by_removing_it(
    maker: Maker, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert calibrate(tmp_path, 1) == 0
    (tmp_path / STUDY_FILE).write_text("{")
    assert calibrate(tmp_path, 1) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert f"{STUDY_FILE}: is no JSON" in said
    assert "remove this file" in said
    (tmp_path / STUDY_FILE).unlink()
    assert calibrate(tmp_path, 1) == 0
    assert maker.seeds == [0]


def test_draws_of_another_sensor_are_refused_where_the_study_is_missing(
    maker: Maker, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert calibrate(tmp_path, 1, sensor="pose") == 0
    (tmp_path / STUDY_FILE).unlink()
    assert calibrate(tmp_path, 1) == 2
    said = capsys.readouterr().err
    assert f"{DRAWS_FILE}: line 1 holds a draw of 'pose" in said
    (tmp_path / DRAWS_FILE).write_text(
        json.dumps({"seed": 0, "draws": [asdict(DRAW)]})
    )  # of an earlier version
    assert calibrate(tmp_path, 1) == 2
    assert "does not say of what sensor" in capsys.readouterr().err
    assert maker.seeds == [0]


def test_a_figure_of_few_draws_says_so_in_place_of_curves_and_legend() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = rank_figure("mekf, 2 of 4 draws", {"all draws": {}, "given ok": {}}, [DRAW])
    said = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert said == ["fewer than 10 draws"] * 7  # two rows of three quantities, and coverage
