"""``spinfilters.observe_recording``: rank and bound at the smoother's estimate of a recording."""

from pathlib import Path

import numpy as np
import pytest

import spinfilters
from spinfilters.cli.main import main

RICH = (4.0, 6.0, 3.0)


def test_the_bound_of_poses_is_what_the_smoother_states() -> None:
    dataset = spinfilters.simulate("pose", frames=40, rate_rpm=RICH)
    found = spinfilters.observe_recording(dataset)
    run = spinfilters.compare(dataset, "smoother", verdict="filter")
    history = run["smoother"].evaluation.history
    deviations = np.sqrt(np.einsum("ij,ij->i", history.factor[-1], history.factor[-1]))
    np.testing.assert_allclose(found.report.bound.std[-1], deviations, rtol=0.02)
    assert (found.document["rank"], found.document["dimension"]) == (20, 20)
    assert str(found).startswith("pose of 40 epochs in 19.5 s; the sensor pose, ")


def test_the_interval_of_epochs_does_not_depend_on_the_origin_of_the_clock() -> None:
    stream = spinfilters.simulate("attitude", frames=30, rate_rpm=RICH).log.stream("attitude")
    dataset = spinfilters.Dataset.from_arrays("attitude", stream.time + 1.7e9, stream.values)
    assert "after 30 frames at 0.5 s" in str(spinfilters.observe_recording(dataset))


def test_tracks_take_the_landmarks_seen_most_often() -> None:
    found = spinfilters.observe_recording(spinfilters.simulate("stereo-tracks", frames=12, rate_rpm=RICH))
    assert "the 60 landmarks seen most often of " in str(found)
    assert found.report.bound.std.shape == (12, 20 + 180)
    assert found.report.final["body rate", "rad/s"] < 0.05


def test_a_moving_camera_is_where_its_trajectory_says() -> None:
    dataset = spinfilters.simulate("stereo-tracks", frames=12, rate_rpm=RICH, inspector="circle")
    assert spinfilters.observe_recording(dataset).report.final["body rate", "rad/s"] < 0.05


def test_the_bias_of_a_gyro_is_an_unknown_where_settings_give_its_prior() -> None:
    dataset = spinfilters.simulate("gyro", frames=40, rate_rpm=RICH)
    found = spinfilters.observe_recording(dataset, {"initialisation": {"gyro_bias_std": 0.01}})
    assert 0 < found.report.final["gyro bias", "rad/s"] < 0.0101
    assert found.document["dimension"] == 14


def test_a_stated_belief_is_the_bounds_prior() -> None:
    dataset = spinfilters.simulate("gyro", frames=8, rate_rpm=RICH)
    belief = {"from_truth": True, "std": {"mass_distribution": 0.01}}
    found = spinfilters.observe_recording(dataset, {"initialisation": belief})
    layout = found.report.bound.layout
    assert found.report.bound.std[-1, layout.slice("s")].max() < 0.0101


def test_a_further_sensor_is_added_to_those_of_a_recording() -> None:
    found = spinfilters.observe_recording(
        spinfilters.simulate("gyro", frames=12, rate_rpm=RICH), further=True
    )
    assert found.further is not None
    assert found.further.stated.case.sensors == ("gyro",)
    gains = {each.name: each.becomes_determined for each in found.further.sensors}
    assert gains["pose"]
    assert "simulated measurements" in str(found)


@pytest.mark.usefixtures("unrendered")
def test_the_command_answers_the_same(tmp_path: Path) -> None:
    dataset = tmp_path / "gyro"
    assert main(["simulate", "--kind", "gyro", "--frames", "20", "-o", str(dataset)]) == 0
    assert main(["observe", "--recording", str(dataset), "-o", str(tmp_path / "run")]) == 0
    found = spinfilters.observe_recording(dataset)
    assert (tmp_path / "run" / "observe.txt").read_text() == f"{found}\n"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--recording", "x", "--sensor", "gyro"], "--sensor is of a motion that is asked for"),
        (["--segment", "1"], "--segment is of a recording"),
    ],
)
def test_options_of_another_question_are_refused(
    arguments: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    assert main(["observe", *arguments, "-o", str(tmp_path / "run")]) == 2
    assert says in capsys.readouterr().err
