"""Dask gives the rows of one process, wherever its workers are; what is no address is refused in one line."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("distributed", reason="the extra campaign is not installed")

import psutil
from distributed import LocalCluster

from spinfilters.campaigns.dask_cluster import DaskCluster
from spinfilters.campaigns.engine import run_campaign
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


def test_a_cluster_gives_the_rows_of_one_process_and_leaves_none(tmp_path: Path, address: str) -> None:
    study, before = gyro_study(seeds=1), psutil.Process().children()
    run_campaign(study, tmp_path / "serial", InProcess())
    run_campaign(study, tmp_path / "there", DaskCluster(address))
    assert psutil.Process().children() == before
    assert _rows(tmp_path / "there", study) == _rows(tmp_path / "serial", study)


@pytest.mark.parametrize(
    "address", ["ftp:/nowhere", "word", "", "tcp://", "a b:1", "foo://host:1", "host:99999"]
)
def test_what_is_no_address_is_refused_in_one_line(address: str, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="no address"):
        DaskCluster(address)
    assert capfd.readouterr().err == ""
