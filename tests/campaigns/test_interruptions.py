"""Ctrl-C and kill -9 at random moments: no row is lost, made twice or changed."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Generator
from pathlib import Path

import numpy as np
import pytest

from spinfilters.campaigns import rows_folder
from spinfilters.campaigns.engine import Chunk, run_campaign
from spinfilters.campaigns.rows_folder import ROWS, part_files, read_rows
from spinfilters.campaigns.runner import Row, asked
from spinfilters.campaigns.study import Study
from tests.campaigns.study_samples import gyro_study

MOMENTS = 20
STUDY = gyro_study(seeds=40)


class Numbers:
    """An executor whose rows are numbers of their runs; an alarm rings some time after the first."""

    def __init__(self, alarm_s: float = 0.0) -> None:
        self.alarm_s = alarm_s

    def rows(self, study: Study, chunks: list[Chunk]) -> Generator[Row, None, None]:
        signal.setitimer(signal.ITIMER_REAL, self.alarm_s)
        for run in (run for chunk in chunks for run in chunk):
            drawn = np.random.default_rng(run).standard_normal(3).tolist()
            yield asked(study, run) | {
                "outcome": "done",
                "reason": "",
                "nees": drawn[0],
                "nees_over_time": drawn,
            }


def _interrupt(_number: int, _frame: object) -> None:
    raise KeyboardInterrupt


def _campaign(folder: Path, alarm_s: float, how: Callable[[int, object], None] | signal.Handlers) -> None:
    """Where the alarm has no handler it ends the process at once and wherever it is, as SIGKILL does."""
    signal.signal(signal.SIGALRM, how)
    try:
        run_campaign(STUDY, folder, Numbers(alarm_s), resume=True)
    except KeyboardInterrupt:
        os._exit(130)
    os._exit(0)


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_twenty_interruptions_at_random_moments_leave_the_rows_of_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if "fork" not in multiprocessing.get_all_start_methods():
        pytest.skip("no fork on this system")
    monkeypatch.setattr(rows_folder, "PART_ROWS", 20)  # so that moments fall into the writing of parts too
    generator = np.random.default_rng(0)
    for moment in range(MOMENTS):
        given = (
            tmp_path / "cut",
            float(generator.uniform(1e-4, 0.03)),
            (_interrupt, signal.SIG_DFL)[moment % 2],
        )
        child = multiprocessing.get_context("fork").Process(target=_campaign, args=given)
        child.start()
        child.join()
        assert child.exitcode in (0, 130, -signal.SIGALRM)
    run_campaign(STUDY, tmp_path / "cut", Numbers(), resume=True)
    run_campaign(STUDY, tmp_path / "serial", Numbers())
    cut, serial = (read_rows(tmp_path / name, STUDY.columns) for name in ("cut", "serial"))
    assert cut.equals(serial)
    parts = [rows_folder.pq.read_table(path, columns=["run"]) for path in part_files(tmp_path / "cut" / ROWS)]
    assert sorted(run for part in parts for run in part["run"].to_pylist()) == list(range(len(STUDY)))
