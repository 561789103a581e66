"""Numbers that every seed draws: log-uniform, the same in all cells, and beside what is identified of them."""

import copy
from typing import Any

import numpy as np
import pytest

from spinfilters.campaigns.row_columns import schema
from spinfilters.campaigns.runner import Runner, run_seeds
from spinfilters.campaigns.study import Study, study_from
from spinfilters.core.errors import InputError
from tests.campaigns.study_samples import GYRO

LIMITS = [1e-3, 1e-1]


def document(limits: Any = LIMITS) -> dict[str, Any]:
    """Gyros of drawn noise, which is told or not."""
    found = copy.deepcopy(GYRO)
    found["factors"] = {"estimator": ["mekf"], "noise": ["silent", "stated"]}
    found["motion"] = {"base": {"rate_rpm": [4.0, 9.0, 3.0], "epochs": 40}}
    drawn = {"gyro_std_rad_s": {"log_uniform": limits}}
    found["noise"] = {"base": drawn, "silent": {"stated": False}, "stated": {}}
    return found


@pytest.fixture(scope="module")
def study() -> Study:
    return study_from(document(), "study")


def levels(study: Study, seeds: int) -> np.ndarray:
    """Drawn levels of both cells, (seeds, 2)."""
    return np.array(
        [
            [cell.recording_of(run_seeds(0, seed).factors).noise.gyro_std_rad_s for cell in study.cells]
            for seed in range(seeds)
        ]
    )


def test_a_drawn_number_is_log_uniform_between_its_limits_and_the_same_in_all_cells(study: Study) -> None:
    found = levels(study, 400)
    np.testing.assert_array_equal(found[:, 0], found[:, 1])
    share = np.log(found[:, 0] / LIMITS[0]) / np.log(LIMITS[1] / LIMITS[0])
    assert 0 <= share.min() < 0.02
    assert 0.98 < share.max() <= 1
    assert abs(share.mean() - 0.5) < 4 * np.sqrt(1 / 12 / 400)


def test_a_row_tells_the_drawn_level_and_what_is_identified_where_nobody_states_it(study: Study) -> None:
    silent, stated = (Runner(study).row(run) for run in (0, 1))
    assert set(silent) <= set(schema(study.columns).names)
    assert silent["true_gyro_noise_std"] == stated["true_gyro_noise_std"] == levels(study, 1)[0, 0]
    away = np.log(silent["found_gyro_noise_std"] / silent["true_gyro_noise_std"])
    assert abs(away) < 2 * silent["log_std_gyro_noise_std"]
    assert "found_gyro_noise_std" not in stated
    assert silent["nees"] > 0
    assert silent["nees_s"] > 0


@pytest.mark.parametrize("limits", [[2.0, 1.0], [0.0, 1.0], [1.0], "wide", [1, 2], [1e-3, 1e9]])
def test_limits_that_no_number_lies_between_are_refused(limits: Any) -> None:
    with pytest.raises(InputError, match=r"noise\.gyro_std_rad_s is ") as refusal:
        study_from(document(limits), "study")
    assert len(str(refusal.value)) < 300


def test_a_belief_cannot_be_drawn_by_limits() -> None:
    drawn = document() | {"belief": {"base": {"rate_rad_s": {"log_uniform": [0.1, 1.0]}}}}
    with pytest.raises(InputError, match=r"belief\.rate_rad_s is "):
        study_from(drawn, "study")
