"""Processes of this machine give the rows of one, whatever ends one of them."""

import signal
import sys
from pathlib import Path

import psutil
import pytest

from spinfilters.campaigns.engine import Advance, run_campaign
from spinfilters.campaigns.local_processes import LocalProcesses
from spinfilters.campaigns.rows_folder import read_rows
from spinfilters.campaigns.run_process import RunProcess
from spinfilters.campaigns.study import Study
from spinfilters.core.errors import InputError
from tests.campaigns.study_samples import gyro_study
from tests.campaigns.test_engine import InProcess
from tests.campaigns.test_runner import fixed

pytestmark = pytest.mark.filterwarnings("default")


def _rows(folder: Path, study: Study) -> list[str]:
    return [fixed(row) for row in read_rows(folder, study.columns).to_pylist()]


def test_two_processes_give_the_rows_of_one_and_leave_none(tmp_path: Path) -> None:
    study, advances, before = gyro_study(seeds=1), [], psutil.Process().children()
    run_campaign(study, tmp_path / "serial", InProcess())
    last = run_campaign(study, tmp_path / "here", LocalProcesses(2), progress=advances.append)
    assert (last.done, last.total, last.faulty) == (4, 4, 0)
    assert [advance.done for advance in advances] == list(range(5))  # one more after every row
    assert psutil.Process().children() == before
    assert _rows(tmp_path / "here", study) == _rows(tmp_path / "serial", study)


def test_ctrl_c_keeps_the_rows_that_came_and_leaves_no_process(tmp_path: Path) -> None:
    study = gyro_study(seeds=40)

    def press_ctrl_c(advance: Advance) -> None:
        if advance.done == 3:
            signal.raise_signal(signal.SIGINT)

    before = psutil.Process().children()
    with pytest.raises(KeyboardInterrupt):
        run_campaign(study, tmp_path, LocalProcesses(2), progress=press_ctrl_c)
    assert len(read_rows(tmp_path, study.columns)) == 3
    assert psutil.Process().children() == before


def test_a_process_that_cannot_be_started_ends_the_campaign_in_one_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    failing = (sys.executable, "-c", "raise SystemExit(3)")
    monkeypatch.setattr(RunProcess, "fork", lambda _: None)
    monkeypatch.setattr(
        "spinfilters.campaigns.local_processes.RunProcess", lambda study: RunProcess(study, failing)
    )
    with pytest.raises(InputError, match=r"cannot be started \(exit code 3\)"):
        list(LocalProcesses(2).rows(gyro_study(), [(0,), (1,)]))


@pytest.mark.skipif(sys.platform != "linux", reason="no process is forked")
def test_a_program_takes_the_place_of_a_forked_process_that_was_killed() -> None:
    process = RunProcess(gyro_study())
    try:
        process.fork()
        forked = process.pid
        first = process.row(0)
        assert forked is not None
        assert process.pid == forked
        psutil.Process(forked).kill()
        assert fixed(process.row(0)) == fixed(first)
        assert process.pid != forked
    finally:
        process.stop()


@pytest.mark.skipif(sys.platform != "linux", reason="no process is forked")
def test_a_run_of_a_forked_process_that_takes_too_long_has_a_row() -> None:
    process = RunProcess(gyro_study(time_limit_s=1e-3))
    try:
        process.fork()
        assert process.row(4)["outcome"] == "timeout"
    finally:
        process.stop()
