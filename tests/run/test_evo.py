"""Our trajectory errors are those of evo (M. Grupp), run as a program of its own.

Recipe: ``python3 -m venv evo && evo/bin/pip install evo``, then
``SPINFILTERS_EVO_APE=evo/bin/evo_ape pytest tests/run/test_evo.py``.
By hand: ``evo_ape tum RUN/truth.tum RUN/ukf/trajectory.tum`` and the same with ``-r angle_deg``.
"""

import json
import os
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest

from spinfilters.run.estimation import compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.run.run_folder import write_run
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate

EVO_APE = os.environ.get("SPINFILTERS_EVO_APE") or shutil.which("evo_ape")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose epochs are the truth's."""
    folder = tmp_path_factory.mktemp("evo") / "run"
    settings = Settings(estimators=("ukf",))
    setup = prepare(simulate(Scenario.simplified(epochs=40, landmarks=60)), settings)
    write_run(folder, compare_estimators(setup, settings, lambda *_: None), settings)
    return folder


@pytest.mark.skipif(EVO_APE is None, reason="no evo_ape on PATH and SPINFILTERS_EVO_APE is not set")
@pytest.mark.parametrize(
    ("relation", "key"), [("trans_part", "ape_rmse_m"), ("angle_deg", "ape_angle_rmse_deg")]
)
def test_absolute_errors_are_those_of_evo(run: Path, tmp_path: Path, relation: str, key: str) -> None:
    result = tmp_path / "result.zip"
    files = [str(run / "truth.tum"), str(run / "ukf" / "trajectory.tum")]
    command = [str(EVO_APE), "tum", *files, "-r", relation, "--save_results", str(result), "--no_warnings"]
    subprocess.run(
        command, check=True, capture_output=True, timeout=120, env={**os.environ, "HOME": str(tmp_path)}
    )
    with zipfile.ZipFile(result) as archive:
        theirs = json.loads(archive.read("stats.json"))["rmse"]
    ours = json.loads((run / "summary.json").read_text(encoding="utf-8"))["estimators"]["ukf"]["errors"][key]
    assert ours == pytest.approx(theirs, abs=1e-6)
    print(f"{key}: evo {theirs:.12g}, ours {ours:.12g}")
