"""The command ``campaign``: what it says, what it refuses in one line, what a repeated run gives."""

import importlib.util
import json
from collections.abc import Callable
from pathlib import Path

import pytest
import tomli_w

import spinfilters
from spinfilters.campaigns.dask_cluster import DaskCluster
from spinfilters.cli.main import main
from spinfilters.core.errors import InputError
from tests.campaigns.study_samples import gyro_document
from tests.campaigns.test_engine import InProcess


@pytest.fixture(autouse=True)
def no_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make runs here: how Dask makes them has tests of its own."""
    monkeypatch.setattr(DaskCluster, "rows", lambda _, study, chunks: InProcess().rows(study, chunks))


@pytest.fixture
def study(tmp_path: Path) -> Path:
    path = tmp_path / "study.toml"
    path.write_text(tomli_w.dumps(gyro_document(seeds=1)))
    return path


def test_a_campaign_is_run_reported_and_one_of_its_runs_repeated(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["campaign", str(study), "-o", str(out)]) == 0
    assert "4 of 4 runs" in capsys.readouterr().out
    assert main(["campaign", "report", str(out)]) == 0
    assert (out / "report" / "index.html").exists()
    capsys.readouterr()
    assert main(["campaign", "repeat", str(out), "3", "-o", str(tmp_path / "again")]) == 0
    told = capsys.readouterr().out
    row = json.loads(told[: told.rindex("}") + 1])
    assert (row["run"], row["estimator"]) == (3, "ukf")
    assert (tmp_path / "again" / "gyro.csv").exists()


def test_a_campaign_without_any_result_is_no_success(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    refused = {"outcome": "failed", "reason": "the recording is too short"}
    monkeypatch.setattr(
        DaskCluster,
        "rows",
        lambda _, study, chunks: ({**row, **refused} for row in InProcess().rows(study, chunks)),
    )
    assert main(["campaign", str(study), "-o", str(tmp_path / "out")]) == 1
    assert (
        "4 of the new ones without a result (mostly: the recording is too short)" in capsys.readouterr().out
    )


def test_python_gives_a_frame_of_the_same_rows(study: Path, tmp_path: Path) -> None:
    rows = spinfilters.campaign(study, tmp_path / "out")
    assert rows["run"].tolist() == [0, 1, 2, 3]
    again = spinfilters.campaign(gyro_document(seeds=1))
    assert rows["error_rate_rad_s"].tolist() == again["error_rate_rad_s"].tolist()
    assert rows["error_rate_rad_s"].gt(0).all()
    with pytest.raises(InputError, match="give output"):
        spinfilters.campaign(study, resume=True)


Refused = list[tuple[Callable[[Path, Path], list[str]], str]]
REFUSED: Refused = [
    (lambda study, out: [str(study)], "-o OUT"),
    (lambda study, out: [str(study), "extra", "-o", str(out)], "one argument too many"),
    (lambda study, out: [str(out / "none.toml"), "-o", str(out)], "no such file"),
    (lambda study, out: [str(study), "-o", str(study)], "cannot be made a folder"),
    (lambda study, out: [str(study), "-o", str(study.parent)], "not empty"),
    (lambda study, out: [str(study), "-o", str(out), "--shard", "0/3"], "with --scheduler"),
    (lambda study, out: [str(study), "-o", str(out), "--workers", "0"], "--workers"),
    (lambda study, out: [str(study), "-o", str(out), "--scheduler", "nowhere"], "scheduler"),
    (lambda study, out: ["report"], "required: OUT"),
    (lambda study, out: ["report", str(study.parent)], "no campaign's folder"),
    (lambda study, out: ["report", str(out), "--resume"], "--resume is not for"),
    (lambda study, out: ["merge", str(out), "-o", str(out)], "with --scheduler"),
    (
        lambda study, out: ["repeat", str(out), "last"],
        "argument RUN: 'last' is not allowed; give a whole number",
    ),
]


@pytest.mark.parametrize(("arguments", "words"), REFUSED)
def test_what_cannot_be_done_is_one_line_and_exit_code_2(
    arguments: Callable[[Path, Path], list[str]],
    words: str,
    study: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    try:
        code = main(["campaign", *arguments(study, tmp_path / "out")])
    except SystemExit as ended:
        code = ended.code
    complaint = capsys.readouterr().err
    assert code == 2
    assert complaint.count("\n") == 1
    assert words in complaint
    assert "unexpected" not in complaint


def test_rows_are_kept_when_the_command_is_told_twice(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["campaign", str(study), "-o", str(out)]) == 0
    assert main(["campaign", str(study), "-o", str(out)]) == 2
    assert "--resume" in capsys.readouterr().err
    assert main(["campaign", str(study), "-o", str(out), "--resume"]) == 0
    assert len(list((out / "rows").iterdir())) == 1


@pytest.mark.parametrize("package", ["distributed", "pyarrow"])
def test_a_package_that_is_not_installed_is_named_with_its_extra(
    package: str,
    study: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == package else found(name))
    assert main(["campaign", str(study), "-o", str(tmp_path / "out")]) == 2
    complaint = capsys.readouterr().err
    assert complaint == (
        f"spinfilters: campaigns need {package}, which is not installed; install 'spinfilters[campaign]'\n"
    )
    assert not (tmp_path / "out").exists()
