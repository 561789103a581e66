"""A run that hangs or that its process dies of has a row, and the next run is made."""

import os
import sys
import threading
from pathlib import Path

import pytest

from spinfilters.campaigns.run_process import RunProcess
from spinfilters.campaigns.runner import Row
from spinfilters.core.errors import InputError
from tests.campaigns.study_samples import gyro_study

DYING = """
import json, os, signal, sys
sys.stdin.readline()
print("ready", flush=True)
for line in sys.stdin:
    run = int(line)
    if run == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    if run == 2:
        os.kill(os.getpid(), signal.SIGALRM)
    if run == 3 and not os.path.exists(sys.argv[1]):
        open(sys.argv[1], "w").close()
        os.kill(os.getpid(), signal.SIGKILL)
    if run == 4:
        os._exit(7)
    print(json.dumps({"run": run, "outcome": "done"}), flush=True)
"""
HANGING = """
import sys, time
sys.stdin.readline()
print("ready", flush=True)
sys.stdin.readline()
print("begun", file=sys.stderr, flush=True)
time.sleep(600)
"""


def _rows(process: RunProcess, runs: list[int]) -> list[Row]:
    try:
        return [process.row(run) for run in runs]
    finally:
        process.stop()


def test_a_run_that_takes_too_long_has_a_row_and_the_next_is_made() -> None:
    rows = _rows(RunProcess(gyro_study(time_limit_s=1e-3)), [4, 5])
    assert [(row["run"], row["outcome"]) for row in rows] == [(4, "timeout"), (5, "timeout")]


def test_a_run_that_its_process_dies_of_has_a_row_and_one_killed_by_chance_is_made_again(
    tmp_path: Path,
) -> None:
    command = (sys.executable, "-c", DYING, str(tmp_path / "once"))
    rows = _rows(RunProcess(gyro_study(), command), [0, 1, 2, 3, 4, 5])
    outcomes = ["done", "killed", "timeout", "done", "killed", "done"]
    assert [(row["run"], row["outcome"]) for row in rows] == list(enumerate(outcomes))
    assert rows[1]["reason"].startswith(
        "its process ended 3 times: killed (SIGKILL), by the system when memory was short"
    )
    assert rows[4]["reason"] == "its process ended 3 times: exit code 7"
    assert rows[1]["estimator"] == "ukf"


def test_a_process_that_never_begins_is_one_sentence() -> None:
    with pytest.raises(InputError, match=r"cannot be started \(exit code 3\)"):
        RunProcess(gyro_study(), (sys.executable, "-c", "raise SystemExit(3)")).row(0)


def test_an_answer_without_end_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("spinfilters.campaigns.run_process.LARGEST_ANSWER", 100)
    process = RunProcess(gyro_study(), (sys.executable, "-c", "print('x' * 1000, flush=True)"))
    with pytest.raises(InputError, match="without end"):
        _rows(process, [0])


def test_a_stopped_process_releases_the_thread_that_waits_for_its_row() -> None:
    refused: list[str] = []
    process = RunProcess(gyro_study(), (sys.executable, "-c", HANGING))

    def wait() -> None:
        try:
            process.row(0)
        except InputError as error:
            refused.append(str(error))

    thread = threading.Thread(target=wait)
    thread.start()
    while process.pid is None:
        pass
    pid = process.pid
    process.stop()
    thread.join(60.0)
    assert refused
    assert "--resume" in refused[0]
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_ctrl_c_in_the_terminal_does_not_reach_a_process() -> None:
    process = RunProcess(gyro_study(), (sys.executable, "-c", DYING, ""))
    try:
        process.row(0)
        assert process.pid is not None
        assert os.getpgid(process.pid) != os.getpgid(0)
        assert os.getsid(process.pid) != os.getsid(0)
    finally:
        process.stop()
