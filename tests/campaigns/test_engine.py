"""A campaign makes each run once, goes on where it was interrupted, and keeps to its own folder."""

from collections.abc import Generator
from pathlib import Path

import pytest

from spinfilters.campaigns.engine import Chunk, run_campaign
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

    def rows(self, study: Study, chunks: list[Chunk]) -> Generator[Row, None, None]:
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


def test_another_study_and_a_foreign_folder_are_refused(tmp_path: Path, serial: Path) -> None:
    with pytest.raises(InputError, match="another study"):
        run_campaign(gyro_study(root_seed=9), serial, InProcess(), resume=True)
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(InputError, match="not empty"):
        run_campaign(gyro_study(), tmp_path, InProcess())
