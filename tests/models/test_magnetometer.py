"""A magnetometer beside poses sharpens their attitude; a gyro alone does not tell the frame that its field is given in."""

from pathlib import Path

import numpy as np
import pytest

from spinfilters import load
from spinfilters.campaigns.runner import Runner
from spinfilters.campaigns.study import study_from
from spinfilters.core.errors import InputError
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate


def test_fields_beside_poses_sharpen_the_attitude_across_the_field() -> None:
    stds = []
    for beside in ((), (("magnetometer", 0.5),)):
        dataset = simulate(Scenario.simplified(kind="pose", rate_rpm=RICH_RPM, epochs=30, beside=beside))
        belief = prepare(dataset, Settings()).belief.state
        stds.append(belief.std[belief.layout.slice("a")])
    assert np.sqrt(np.mean(np.square(stds[1]))) < 0.75 * np.sqrt(np.mean(np.square(stds[0])))


def test_a_gyro_does_not_tell_the_attitude_in_the_frame_of_the_field() -> None:
    dataset = simulate(Scenario.simplified(kind="gyro", epochs=30, beside=(("magnetometer", 0.5),)))
    with pytest.raises(InputError, match="magnetometer measurements refer to frame i"):
        prepare(dataset, Settings())


def test_a_campaign_varies_the_noise_of_a_sensor_by_its_option() -> None:
    study = study_from(
        {
            "study": {"name": "fields", "seeds": 1, "bound": "none", "initialisation": "drawn"},
            "factors": {"estimator": ["mekf"], "noise.sensors.magnetometer_std": [2e-7]},
            "sensor": {"base": {"kind": "magnetometer"}},
            "motion": {"base": {"epochs": 12}},
        },
        "study",
    )
    row = Runner(study).row(0)
    assert (row["outcome"], row["true_magnetometer_std"]) == ("done", 2e-7)


def test_the_noise_of_a_sensor_is_drawn_within_its_limits() -> None:
    study = study_from(
        {
            "study": {"name": "fields", "seeds": 3},
            "factors": {"estimator": ["mekf"]},
            "sensor": {"base": {"kind": "magnetometer"}},
            "noise": {"base": {"sensors": {"magnetometer_std": {"log_uniform": [1e-8, 1e-6]}}}},
        },
        "study",
    )
    (cell,) = study.cells
    drawn = [cell.recording_of(np.random.SeedSequence(seed)).levels["magnetometer_std"] for seed in range(20)]
    assert len(set(drawn)) == 20
    assert 1e-8 < min(drawn) < 1e-7 < max(drawn) < 1e-6


def test_fields_in_two_units_are_refused_with_both_strengths(tmp_path: Path) -> None:
    (tmp_path / "dataset.toml").write_text('kind = "magnetometer"\n')
    rows = "\n".join(f"{0.1 * k:.1f},20,10,40,2e-5,1e-5,4e-5" for k in range(8))
    (tmp_path / "magnetometer.csv").write_text(f"time_s,bx,by,bz,fx,fy,fz\n{rows}\n")
    poses = "\n".join(f"{0.1 * k:.1f} 0 0 1 0 0 0 1" for k in range(8))
    (tmp_path / "poses.tum").write_text(f"{poses}\n")
    with pytest.raises(
        InputError, match=r"magnetometer.csv: the measured field .* 45.8 T, .* 4.58e-05 T .* tesla"
    ):
        load(tmp_path)
