"""A study is checked whole before anything runs; its numbering does not depend on how many seeds there are."""

import copy
from pathlib import Path
from typing import Any

import pytest

from spinfilters.campaigns.runner import run_seeds, whole_number
from spinfilters.campaigns.study import read_study, study_from
from spinfilters.core.errors import InputError
from tests.campaigns.study_samples import GYRO, gyro_study


def test_cells_are_all_combinations_and_the_estimator_varies_fastest() -> None:
    study = gyro_study()
    assert [(c.levels["motion"], c.levels["estimator"]) for c in study.cells] == [
        ("rich", "mekf"),
        ("rich", "ukf"),
        ("short", "mekf"),
        ("short", "ukf"),
    ]
    assert len(study) == 12
    assert study.varied == ["motion", "estimator"]
    assert study.cells[2].recording.motion.epochs == 30
    assert study.cells[2].recording.motion.rate_rpm == (4.0, 9.0, 3.0)


def test_more_seeds_leave_runs_and_fingerprint_as_they_are() -> None:
    few, many = gyro_study(seeds=3), gyro_study(seeds=30)
    assert [few.run(k) for k in range(12)] == [many.run(k) for k in range(12)]
    assert few.fingerprint == many.fingerprint
    assert few.fingerprint != gyro_study(root_seed=1).fingerprint


def test_a_single_key_is_a_factor_over_the_levels_of_its_table() -> None:
    document = copy.deepcopy(GYRO)
    document["factors"]["noise.gyro_std_rad_s"] = [0.001, 0.01]
    document["factors"]["settings.process.torque_psd"] = [1e-6]
    study = study_from(document, "study")
    assert {c.recording.noise.gyro_std_rad_s for c in study.cells} == {0.001, 0.01}
    assert {c.settings.process.torque_psd for c in study.cells} == {1e-6}
    assert {c.levels["noise.gyro_std_rad_s"] for c in study.cells} == {"0.001", "0.01"}


def test_seeds_are_the_children_that_spawning_gives() -> None:
    import numpy as np

    seeds, children = run_seeds(7, 4), np.random.SeedSequence(7).spawn(5)[4].spawn(5)
    asked = (seeds.motion, seeds.measurements, seeds.faults, seeds.belief, seeds.factors)
    assert [whole_number(each) for each in asked] == [whole_number(each) for each in children]


BAD: list[tuple[dict[str, Any], str]] = [
    ({"study": {"name": "x"}}, "study.seeds is missing"),
    ({"study": {"name": "x", "seeds": 0}}, "seeds is 0"),
    ({"study": {"name": "x", "seeds": "ten"}}, "seeds is 'ten'"),
    ({"study": {"name": "x", "seeds": 1, "speed": 3}}, "unknown key study.speed"),
    ({"study": {"name": "x", "seeds": 1, "bound": "all"}}, '"run" or "motion" or "none"'),
    ({"study": 3}, "no table [study]"),
    ({"factors": {}}, "factors.estimator is missing"),
    ({"factors": {"estimator": ["kalman"]}, "motion": {}}, "unknown estimator 'kalman'"),
    ({"factors": {"estimator": "mekf"}}, "give a list of levels"),
    ({"factors": {"estimator": ["mekf", "mekf"]}}, "twice"),
    ({"factors": {"estimator": ["mekf"], "weather": ["rain"]}}, "unknown factor 'weather'"),
    ({"factors": {"estimator": ["mekf"], "motion": ["fast"]}}, "level"),
    ({"factors": {"estimator": ["mekf"], "noise.pixels": [1.0]}, "motion": {}}, "unknown key noise.pixels"),
    ({"factors": {"estimator": ["mekf"], "motion": [3]}}, "give names"),
    ({"wind": {}}, "unknown table 'wind'"),
    ({"motion": {"base": {"epochs": 2}}, "factors": {"estimator": ["mekf"]}}, "motion.epochs is 2"),
    ({"motion": {"rate_rpm": [1, 2, 3]}}, "give it in a level"),
    ({"sensor": {"base": {"kind": "sonar"}}}, "sonar"),
    ({"noise": {"base": {"pixel_std": True}}}, "noise.pixel_std"),
    ({"noise": {"base": {"gyro_bias_rad_s": [1.0, 2.0]}}}, "gyro_bias"),
    ({"settings": {"base": {"robust": {"gate": 3}}}}, "settings"),
    ({"settings": {"base": {"estimators": ["ukf"]}}}, "leave it out"),
    ({"fault": {"base": {"wrong_associations": 1.5}}}, "wrong_associations is 1.5"),
    ({"fault": {"base": {"dropout_s": [1.0]}}}, "dropout_s"),
    ({"fault": {"base": {"few_at_first": [2.0, 9.0]}}}, "fraction 2.0"),
    ({"study": {"name": "x", "seeds": 1, "initialisation": "drawn"}}, 'another sensor.kind, such as "pose"'),
    (
        {
            "study": {"name": "x", "seeds": 1, "initialisation": "drawn"},
            "sensor": {"base": {"kind": "stereo-tracks"}},
        },
        "sensor.known_map = true",
    ),
    (
        {"sensor": {"base": {"besides": {"gyro": 0.01}}}},
        "unknown key sensor.besides; known are kind, detection",
    ),
    ({"sensor": {"base": {"detection": {"gyro": 0.01}}}}, "sensor.detection is {'gyro': 0.01}"),
    ({"sensor": {"base": {"kind": "gyro", "beside": {"gyro": 0.01}}}}, "holds a kind twice"),
    ({"fault": {"base": {"dropout_s": [9.0, 1.0]}}}, "end after the start"),
    ({"fault": {"base": {"model": "ghost"}}}, "fault.model is 'ghost'"),
    ({"body": {"base": {"principal_moments": [1.0, 1.0, 5.0]}}}, "body.principal_moments"),
    ({"factors": {"estimator": [1]}, "motion": {}}, "such as mekf"),
    ({"motion": {"pixels-1": {"5": {}}, "rich": {}, "short": {}}}, '[motion."1.5"]'),
]


@pytest.mark.parametrize(("change", "words"), BAD)
def test_a_study_that_cannot_be_run_is_refused_in_one_line(change: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as refused:
        study_from({**copy.deepcopy(GYRO), **change}, "mine.toml")
    text = str(refused.value)
    assert text.startswith("mine.toml: ")
    assert words in text
    assert "\n" not in text
    assert len(text) < 300


def test_what_is_not_toml_is_refused(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text("study = [")
    with pytest.raises(InputError, match="is not TOML"):
        read_study(tmp_path / "study.toml")
