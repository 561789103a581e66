"""A Dask cluster gives the rows of one process."""

import pytest

from spinfilters.campaigns.dask_cluster import DaskCluster
from spinfilters.campaigns.runner import Runner
from spinfilters.core.errors import InputError
from tests.campaigns.study_samples import gyro_study
from tests.campaigns.test_runner import fixed

distributed = pytest.importorskip("distributed", reason="the extra campaign is not installed")


@pytest.mark.filterwarnings("default")
def test_a_cluster_gives_the_rows_of_one_process() -> None:
    study = gyro_study(seeds=1)
    runner = Runner(study)
    options = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": None}
    with distributed.LocalCluster(**options, protocol="tcp://") as cluster:
        rows = list(DaskCluster(cluster.scheduler_address).rows(study, [(0, 1), (2, 3)]))
    found = {row["run"]: fixed(row) for row in rows}
    assert found == {run: fixed(runner.row(run)) for run in range(4)}


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize(
    "address", ["ftp:/nowhere", "word", "", "tcp://", "a b:1", "foo://host:1", "host:99999"]
)
def test_what_is_no_address_is_refused_in_one_line(address: str, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="no address"):
        list(DaskCluster(address).rows(gyro_study(), [(0,)]))
    assert capfd.readouterr().err == ""
