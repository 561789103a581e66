"""Dask gives the rows of one process, wherever its workers are; what it cannot do is one line."""

import gc
import os
import signal
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("distributed", reason="the extra campaign is not installed")

import psutil
from distributed import LocalCluster

from spinfilters.campaigns.dask_cluster import DaskCluster
from spinfilters.campaigns.engine import Advance, run_campaign
from spinfilters.campaigns.rows_folder import read_rows
from spinfilters.campaigns.study import Study
from spinfilters.core.errors import InputError
from tests.campaigns.study_samples import gyro_study
from tests.campaigns.test_engine import InProcess
from tests.campaigns.test_runner import fixed

pytestmark = pytest.mark.filterwarnings("default")


@pytest.fixture
def address() -> Iterator[str]:
    """A scheduler with one worker, somewhere else for all that the campaign knows."""
    options = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": ":0"}
    cluster: Any = LocalCluster(**options, protocol="tcp://")
    with cluster:
        yield cluster.scheduler_address


def _rows(folder: Path, study: Study) -> list[str]:
    return [fixed(row) for row in read_rows(folder, study.columns).to_pylist()]


def test_this_machine_and_a_cluster_give_the_rows_of_one_process_and_leave_none(
    tmp_path: Path, address: str
) -> None:
    study, advances, before = gyro_study(seeds=1), [], psutil.Process().children()
    run_campaign(study, tmp_path / "serial", InProcess())
    last = run_campaign(study, tmp_path / "here", DaskCluster(processes=2), progress=advances.append)
    assert (last.done, last.total, last.faulty) == (4, 4, 0)
    assert [advance.done for advance in advances] == list(range(5))  # one more after every row
    assert psutil.Process().children() == before
    run_campaign(study, tmp_path / "there", DaskCluster(address))
    assert psutil.Process().children() == before
    assert _rows(tmp_path / "here", study) == _rows(tmp_path / "serial", study)
    assert _rows(tmp_path / "there", study) == _rows(tmp_path / "serial", study)


def test_ctrl_c_keeps_the_rows_that_came_and_leaves_no_process(tmp_path: Path) -> None:
    study = gyro_study(seeds=40)

    def press_ctrl_c(advance: Advance) -> None:
        if advance.done == 3:
            signal.raise_signal(signal.SIGINT)

    before = psutil.Process().children()
    with pytest.raises(KeyboardInterrupt):
        run_campaign(study, tmp_path, DaskCluster(processes=2), progress=press_ctrl_c)
    assert len(read_rows(tmp_path, study.columns)) == 3
    assert psutil.Process().children() == before


def test_a_machine_without_sockets_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(*_: object, **__: object) -> None:
        raise PermissionError(1, os.strerror(1))

    monkeypatch.setattr(socket.socket, "bind", forbidden)
    with pytest.raises(InputError, match=r"Dask cannot start on this machine.*not permitted.*--scheduler"):
        list(DaskCluster().rows(gyro_study(), [(0,)]))
    gc.collect()  # what Dask had opened complains here and not in another test


@pytest.mark.parametrize(
    "address", ["ftp:/nowhere", "word", "", "tcp://", "a b:1", "foo://host:1", "host:99999"]
)
def test_what_is_no_address_is_refused_in_one_line(address: str, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="no address"):
        DaskCluster(address)
    assert capfd.readouterr().err == ""
