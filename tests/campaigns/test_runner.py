"""A run's row depends on its number alone, and an error of the run is what the row says."""

import copy
from typing import Any

import numpy as np
import pytest

from spinfilters.campaigns.row_columns import is_volatile, schema
from spinfilters.campaigns.runner import Runner
from spinfilters.campaigns.study import Study, study_from
from tests.campaigns.study_samples import GYRO, gyro_study

KNOWN_MAP: dict[str, Any] = {
    "study": {"name": "map", "seeds": 2, "initialisation": "drawn", "bound": "motion"},
    "factors": {"estimator": ["mekf"], "fault": ["none", "wrong"]},
    "motion": {"base": {"rate_rpm": [4.0, 9.0, 3.0], "epochs": 12}},
    "body": {"base": {"landmarks": 150}},
    "sensor": {"base": {"known_map": True, "recognition": [], "fewest_observations": 0}},
    "fault": {"none": {}, "wrong": {"wrong_associations": 0.2}},
}


def fixed(row: dict[str, Any]) -> str:
    """What must be the same whenever and wherever the run is made."""
    return repr({name: value for name, value in sorted(row.items()) if not is_volatile(name)})


@pytest.fixture(scope="module")
def drawn() -> Study:
    return study_from(KNOWN_MAP, "study")


def test_rows_are_the_same_in_any_order(drawn: Study) -> None:
    forwards, backwards = Runner(drawn), Runner(drawn)
    there = [fixed(forwards.row(run)) for run in range(4)]
    back = [fixed(backwards.row(run)) for run in reversed(range(4))]
    assert there == back[::-1]


def test_a_row_has_the_columns_of_the_schema_and_a_bound_of_its_motion(drawn: Study) -> None:
    runner = Runner(drawn)
    first, other = runner.row(0), runner.row(2)
    assert set(first) <= set(schema(drawn.columns).names)
    assert first["outcome"] == "done"
    assert first["bound_position_m"] == other["bound_position_m"] > 0
    assert first["nees_over_time"]
    assert np.mean(first["nees_over_time"]) == pytest.approx(first["nees"])


def test_cells_of_a_seed_see_the_same_motion_and_other_seeds_another(drawn: Study) -> None:
    runner = Runner(drawn)
    truths = [runner.recording(drawn.run(run)).truth for run in range(4)]
    paths = [truth.center_of_mass for truth in truths if truth is not None]
    np.testing.assert_array_equal(paths[0], paths[1])
    assert not np.allclose(paths[0], paths[2])


def test_a_drawn_belief_has_the_error_of_its_own_covariance() -> None:
    document = copy.deepcopy(KNOWN_MAP)
    document["study"] |= {"seeds": 30}
    document["factors"] = {"estimator": ["mekf"]}
    del document["fault"]
    study = study_from(document, "study")
    runner, squares = Runner(study), []
    for run in range(30):
        belief = runner.setup(study.run(run)).initial.belief
        truth = runner.recording(study.run(run)).truth
        assert truth is not None
        error = belief.mean[belief.layout.mean_slice("v")] - truth.velocity[0]
        squares.append(
            np.square(error / np.linalg.norm(belief.factor[belief.layout.slice("v")], axis=1)).sum()
        )
    assert 1.9 < np.mean(squares) < 4.4  # chi-square of 90 degrees of freedom over 30, at 1e-3


def test_a_run_that_is_refused_says_why() -> None:
    document = copy.deepcopy(GYRO)
    document["factors"]["estimator"] = ["smoother-latest"]
    row = Runner(study_from(document, "study")).row(0)
    assert row["outcome"] == "refused"
    assert "choose smoother" in row["reason"]


def test_an_unexpected_error_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("the end\nof it")

    monkeypatch.setattr(Runner, "compared", broken)
    row = Runner(gyro_study()).row(1)
    assert (row["outcome"], row["reason"]) == ("raised", "ZeroDivisionError: the end of it")
    assert row["estimator"] == "ukf"


def test_nees_of_a_gyro_with_a_gap_is_of_the_epochs_it_has() -> None:
    document = copy.deepcopy(GYRO) | {"fault": {"base": {"dropout_s": [5.0, 9.0]}}}
    row = Runner(study_from(document, "study")).row(0)
    assert row["epochs"] < 40
    assert row["nees"] < 5
