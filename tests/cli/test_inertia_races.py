"""``compare --race``: several inertias from one state, compared with the true motion where it goes on."""

import json
from pathlib import Path

import numpy as np
import pytest

from spinfilters.cli.main import main
from spinfilters.core.attitude_conversions import angle_between
from spinfilters.evaluation.prediction_errors import NamedInertia, propagate_inertias
from tests.cli.faults import refusal

pytestmark = pytest.mark.usefixtures("few_figures")


def test_a_wrong_inertia_loses_against_the_true_one(recordings: Path, tmp_path: Path) -> None:
    cad = tmp_path / "cad.toml"
    cad.write_text("principal_moments = [0.5, 0.9, 1.0]\n")
    run = tmp_path / "run"
    asked = ["--estimators", "mekf", "--verdict", "filter", "--segment", "0:10", "--predict", "4"]
    asked += ["-o", str(run)]
    for more in ([], ["--resume"]):
        race = ["--race", f"mekf,truth,{cad}", *more]
        assert main(["compare", str(recordings / "stereo-tracks"), *asked, *race]) == 0
        found = json.loads((run / "race.json").read_text())
        assert found["compared_with"] == "the true motion"
        ends = {name: values["angle_end_rad"] for name, values in found["inertias"].items()}
        assert set(ends) == {"mekf", "truth", "cad"}
        assert ends["cad"] > 3 * max(ends["truth"], ends["mekf"])
        assert (run / "race.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("principal_moments = [3, 1, 0.1]\n", "3"),
        ("inertia_g = [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]\n", "not symmetric"),
        ("moments = [1, 1, 1]\n", "give principal_moments"),
        ("principal_moments = [1, 1, 1]\nprincipal_axes_g = [[1,0,0],[0,1,0],[0,0,-1]]\n", "right-handed"),
    ],
)
def test_an_inertia_that_no_body_has_is_refused_in_one_line(
    text: str, words: str, recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cad = tmp_path / "cad.toml"
    cad.write_text(text)
    asked = ["compare", str(recordings / "gyro"), "--predict", "2", "-o", str(tmp_path / "run")]
    said = refusal(capsys, *asked, "--race", str(cad))
    assert "cad.toml" in said
    assert words in said


def test_a_race_asks_for_its_time_and_for_inertias_that_exist(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["compare", str(recordings / "gyro"), "-o", str(tmp_path / "run")]
    assert "--predict" in refusal(capsys, *asked, "--race", "mekf")
    assert "no estimator" in refusal(capsys, *asked, "--predict", "2", "--race", "nobody")


def test_axes_of_an_inertia_may_be_in_any_order() -> None:
    time, still, rate = np.linspace(0.0, 20.0, 5), np.array([0.0, 0.0, 0.0, 1.0]), np.array([0.1, 1.0, 0.2])
    turned = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    moments = np.array([0.8, 1.0, 1.1])
    one, other = propagate_inertias(
        [NamedInertia("one", moments, np.eye(3)), NamedInertia("other", turned @ moments, turned)],
        still,
        rate,
        time,
    )
    assert angle_between(one.attitude, other.attitude).max() < 1e-9
    assert other.rate_from(one.rate).max() < 1e-9
