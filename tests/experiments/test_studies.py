"""Studies of this repository as factor tables."""

from pathlib import Path

import pytest

from spinfilters.campaigns.study import read_study

STUDIES = sorted(Path(__file__).parents[2].joinpath("experiments/studies").glob("*.toml"))


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_a_study_can_be_read_and_tells_what_it_asks(path: Path) -> None:
    study = read_study(path)
    assert study.options.description
    assert len({tuple(cell.levels.values()) for cell in study.cells}) == len(study.cells) > 0
