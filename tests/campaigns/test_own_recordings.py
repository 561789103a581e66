"""Campaigns over data sets that a user has, in place of simulated ones."""

from pathlib import Path
from typing import Any

import pytest

import spinfilters
from spinfilters.campaigns.runner import Runner
from spinfilters.campaigns.study import Study, study_from
from spinfilters.core.errors import InputError
from spinfilters.io.dataset_folder import write_dataset


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of two recordings of poses."""
    folder = tmp_path_factory.mktemp("recordings")
    for seed in (0, 1):
        write_dataset(spinfilters.simulate("pose", seed=seed, frames=16), folder / f"toss-{seed}")
    return folder


def study(recording: Any, seeds: int = 2, **tables: Any) -> Study:
    """A study of the MEKF from beliefs drawn about the truth."""
    options = {"name": "own", "seeds": seeds, "initialisation": "drawn", "bound": "none"}
    factors = {
        "recording": recording,
        "estimator": ["mekf"],
        "settings.sensors.pose_position_std": [0.003, 0.01],
    }
    document = {"study": options, "factors": factors, "settings": {"base": {"verdict": "filter"}}}
    return study_from({**document, **tables}, "own.toml")


def test_a_folder_names_the_recordings_in_it_and_settings_vary(recordings: Path) -> None:
    made = study([str(recordings)])
    assert len(made) == 8
    assert [Path(cell.own_recording).name for cell in made.cells] == ["toss-0", "toss-0", "toss-1", "toss-1"]
    assert study([str(recordings / "toss-*")]).levels == made.levels
    rows = [Runner(made).row(index) for index in range(len(made))]
    assert {row["outcome"] for row in rows} == {"done"}, rows[0]["reason"]
    again = Runner(made).row(5)
    same = {key: value for key, value in again.items() if not key.startswith(("time_", "host", "finished"))}
    assert same == {key: rows[5][key] for key in same}


def test_disturbances_vary_over_own_recordings(recordings: Path) -> None:
    factors = {
        "recording": [str(recordings / "toss-0")],
        "estimator": ["mekf"],
        "settings.process.torque_psd": [1e-8, 1e-4],
    }
    made = study(None, seeds=1, factors=factors)
    assert [cell.settings.process.torque_psd for cell in made.cells] == [1e-8, 1e-4]
    narrow, wide = (Runner(made).row(index) for index in range(2))
    assert {narrow["outcome"], wide["outcome"]} == {"done"}, (narrow["reason"], wide["reason"])
    assert narrow["settings.process.torque_psd"] == "1e-08"
    assert narrow["nis"] > wide["nis"]


@pytest.mark.parametrize(
    ("recording", "changes", "message"),
    [
        (["absent/place"], {}, "names no data set"),
        ([3], {}, "give a path, or a list of paths"),
        (None, {"motion": {"base": {"epochs": 30}}}, "motion is of simulated recordings"),
    ],
)
def test_recordings_that_cannot_be_are_refused(
    recordings: Path, recording: Any, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        study(recording or [str(recordings)], **changes)


def test_seeds_without_anything_drawn_are_refused(recordings: Path) -> None:
    options = {"name": "own", "seeds": 3, "initialisation": "data"}
    with pytest.raises(InputError, match="all seeds are one run"):
        study([str(recordings)], study=options)
