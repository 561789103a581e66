"""The embedded filter in a comparison."""

from pathlib import Path

import pytest

from spinfilters.cli.main import main
from spinfilters.core.c_library import compiler
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


def test_a_sensor_that_it_does_not_take_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = str(tmp_path / "data")
    assert (
        main(["simulate", "-o", data, "--kind", "attitude", "--rate-rpm", "4", "9", "3", "--frames", "30"])
        == 0
    )
    assert main(["compare", data, "-o", str(tmp_path / "run"), "--estimators", "embedded"]) == 2
    assert "not attitude; leave it out" in capsys.readouterr().err.replace("\n", " ")
