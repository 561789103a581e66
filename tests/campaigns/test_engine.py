"""Processes give the rows of one process; their death, their hanging and Ctrl-C lose nothing and repeat nothing."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from spinfilters.campaigns.campaign_folder import merge, read_folder
from spinfilters.campaigns.engine import Chunk, Processes, Shard, WorkerProcess, run_campaign
from spinfilters.campaigns.rows_folder import read_rows
from spinfilters.campaigns.runner import Row, Runner
from spinfilters.campaigns.study import Study
from spinfilters.core.errors import InputError
from spinfilters.run.run_lock import locked_run
from tests.campaigns.study_samples import gyro_study
from tests.campaigns.test_runner import fixed


class InProcess:
    """An executor without processes, which stops after so many runs as Ctrl-C would."""

    def __init__(self, until: int = 10**9) -> None:
        self.until, self.made = until, []

    def rows(self, study: Study, chunks: list[Chunk]) -> Iterator[Row]:
        runner = Runner(study)
        for run in (run for chunk in chunks for run in chunk):
            if len(self.made) == self.until:
                raise KeyboardInterrupt
            self.made.append(run)
            yield runner.row(run)


def _rows(folder: Path, study: Study) -> list[str]:
    return [fixed(row) for row in read_rows(folder, study.columns).to_pylist()]


@pytest.fixture(scope="module")
def serial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("serial")
    run_campaign(gyro_study(), folder, InProcess())
    return folder


def test_two_processes_give_the_rows_of_none(tmp_path: Path, serial: Path) -> None:
    study = gyro_study()
    advance = run_campaign(study, tmp_path / "out", Processes(2))
    assert (advance.done, advance.total, advance.faulty) == (12, 12, 0)
    assert _rows(tmp_path / "out", study) == _rows(serial, study)


def test_an_interrupted_campaign_goes_on_and_repeats_nothing(tmp_path: Path, serial: Path) -> None:
    study, stopped, rest = gyro_study(), InProcess(5), InProcess()
    with pytest.raises(KeyboardInterrupt):
        run_campaign(study, tmp_path, stopped)
    with pytest.raises(InputError, match="--resume"):
        run_campaign(study, tmp_path, rest)
    run_campaign(study, tmp_path, rest, resume=True)
    assert sorted(stopped.made + rest.made) == list(range(12))
    assert _rows(tmp_path, study) == _rows(serial, study)


def test_more_seeds_are_added_to_a_campaign(tmp_path: Path) -> None:
    run_campaign(gyro_study(seeds=1), tmp_path, InProcess())
    more = InProcess()
    run_campaign(gyro_study(seeds=2), tmp_path, more, resume=True)
    assert more.made == [4, 5, 6, 7]


def test_a_resume_with_fewer_seeds_than_rows_is_refused_and_changes_nothing(tmp_path: Path) -> None:
    run_campaign(gyro_study(seeds=2), tmp_path, InProcess())
    before = (tmp_path / "campaign.toml").read_bytes()
    with pytest.raises(InputError, match=r"holds runs of 2 seeds, study.seeds is 1; give at least 2"):
        run_campaign(gyro_study(seeds=1), tmp_path, InProcess(), resume=True)
    assert (tmp_path / "campaign.toml").read_bytes() == before


def test_a_second_campaign_on_the_same_folder_is_refused_and_changes_nothing(tmp_path: Path) -> None:
    run_campaign(gyro_study(seeds=1), tmp_path, InProcess())
    before = (tmp_path / "campaign.toml").read_bytes()
    with locked_run(tmp_path), pytest.raises(InputError, match="another run is writing"):
        run_campaign(gyro_study(seeds=2), tmp_path, InProcess(), resume=True)
    assert (tmp_path / "campaign.toml").read_bytes() == before


def test_shards_merge_into_the_rows_of_one(tmp_path: Path, serial: Path) -> None:
    study = gyro_study()
    for number in range(3):
        run_campaign(study, tmp_path / str(number), InProcess(), Shard(number, 3))
    assert merge([tmp_path / name for name in "201"], tmp_path / "all") == 12
    assert _rows(tmp_path / "all", study) == _rows(serial, study)
    with pytest.raises(InputError, match="not empty"):
        merge([tmp_path / "0"], tmp_path / "all")


def test_merged_shards_of_one_study_have_the_most_seeds_of_any(tmp_path: Path) -> None:
    run_campaign(gyro_study(seeds=1), tmp_path / "0", InProcess(), Shard(0, 2))
    run_campaign(gyro_study(seeds=2), tmp_path / "1", InProcess(), Shard(1, 2))
    merge([tmp_path / "0", tmp_path / "1"], tmp_path / "all")
    study, _ = read_folder(tmp_path / "all")
    assert study.options.seeds == 2


def test_another_study_and_a_foreign_folder_are_refused(tmp_path: Path, serial: Path) -> None:
    with pytest.raises(InputError, match="another study"):
        run_campaign(gyro_study(root_seed=9), serial, InProcess(), resume=True)
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(InputError, match="not empty"):
        run_campaign(gyro_study(), tmp_path, InProcess())
    with pytest.raises(InputError, match="does not exist"):
        Shard(3, 3)


def test_a_run_that_takes_too_long_has_a_row_and_the_next_is_made() -> None:
    study = gyro_study(time_limit_s=1e-3)
    rows = _served(WorkerProcess(study), [4, 5])
    assert [(row["run"], row["outcome"]) for row in rows] == [(4, "timeout"), (5, "timeout")]


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
    print(json.dumps({"run": run, "outcome": "done"}), flush=True)
"""


def _served(worker: WorkerProcess, runs: list[int]) -> list[Row]:
    rows: list[Row] = []
    try:
        worker.assign(runs)
        while worker.assigned:
            rows += worker.receive()
    finally:
        worker.stop()
    return rows


def test_a_run_that_its_process_dies_of_has_a_row_and_one_killed_by_chance_is_made_again(
    tmp_path: Path,
) -> None:
    command = (sys.executable, "-c", DYING, str(tmp_path / "once"))
    rows = _served(WorkerProcess(gyro_study(), command), [0, 1, 2, 3, 4])
    outcomes = ["done", "killed", "timeout", "done", "done"]
    assert [(row["run"], row["outcome"]) for row in rows] == list(enumerate(outcomes))
    assert "SIGKILL" in rows[1]["reason"]
    assert rows[1]["estimator"] == "ukf"


def test_processes_that_never_begin_end_the_campaign() -> None:
    with pytest.raises(InputError, match="cannot be started"):
        _served(WorkerProcess(gyro_study(), (sys.executable, "-c", "raise SystemExit(3)")), [0])
