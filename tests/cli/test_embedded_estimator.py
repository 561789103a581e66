"""The embedded filter in a comparison."""

from pathlib import Path

import numpy as np
import pytest

from spinfilters.cli.main import main
from spinfilters.core.c_library import compiler
from spinfilters.run import estimators
from spinfilters.run.run_summary import read_summary

pytestmark = pytest.mark.skipif(
    compiler() is None, reason="the embedded filter is C and there is no compiler"
)


@pytest.mark.usefixtures("few_figures")
def test_float_and_double_are_compared_on_identical_measurements(tmp_path: Path) -> None:
    data, run = str(tmp_path / "data"), tmp_path / "run"
    assert (
        main(["simulate", "-o", data, "--kind", "gyro", "--rate-rpm", "4", "9", "3", "--frames", "70"]) == 0
    )
    assert main(["compare", data, "-o", str(run), "--estimators", "mekf,embedded,embedded-double"]) == 0
    mekf, narrow, double = read_summary(run)["estimators"].values()
    assert narrow["measurements"] == double["measurements"] == mekf["measurements"]
    assert narrow["k1"] == pytest.approx(double["k1"], abs=1e-3)
    assert double["k1"] == pytest.approx(mekf["k1"], abs=1e-3)


@pytest.mark.parametrize(
    ("simulated", "setting", "block"),
    [
        (
            ["--kind", "gyro", "--rate-rpm", "4", "9", "3", "--gyro-bias", "0.02", "-0.01", "0.015"],
            "initialisation.gyro_bias_std=0.05",
            "gyro_bias",
        ),
        (["--kind", "pose"], "process.gravity=true", "acceleration"),
    ],
)
def test_a_further_block_of_a_run_is_estimated_and_goes_into_a_generated_filter(
    tmp_path: Path,
    simulated: list[str],
    setting: str,
    block: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(estimators, "TURN", np.inf)  # the C filter has no second-order terms of the motion
    data, run = str(tmp_path / "data"), tmp_path / "run"
    assert main(["simulate", "-o", data, "--frames", "70", *simulated]) == 0
    asked = ["--estimators", "mekf,embedded-double", "--no-figures", "--set", setting]
    assert main(["compare", data, "-o", str(run), *asked]) == 0
    mekf, ours = read_summary(run)["estimators"].values()
    assert ours[block] == pytest.approx(mekf[block], abs=0.05 * max(mekf[f"{block}_std"]))
    assert ours[f"{block}_std"] == pytest.approx(mekf[f"{block}_std"], rel=0.02)
    option = {"gyro_bias": ["--sensor", "gyro", "--gyro-bias-std", "0.05"]}.get(
        block, ["--sensor", "pose", "--acceleration"]
    )
    folder = tmp_path / "filter"
    assert main(["embed", "-o", str(folder), *option, "--from-run", str(run / "embedded-double")]) == 0
    without = ["embed", "-o", str(tmp_path / "without"), *option[:2], "--from-run", str(run)]
    assert main(without) == 2
    assert f"give {option[2]} too" in capsys.readouterr().err
    begun = (folder / "start_state.h").read_text()
    assert f"(sf_real){ours[block][0]:.6g}"[:14] in begun


def test_a_sensor_that_it_does_not_take_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = str(tmp_path / "data")
    assert (
        main(["simulate", "-o", data, "--kind", "attitude", "--rate-rpm", "4", "9", "3", "--frames", "30"])
        == 0
    )
    assert main(["compare", data, "-o", str(tmp_path / "run"), "--estimators", "embedded"]) == 2
    assert "not attitude; leave it out" in capsys.readouterr().err.replace("\n", " ")
