"""The study of wrong models: its lines and its map, from rows of a campaign."""

from dataclasses import replace

from experiments.honesty import STUDIES, FaultOutcome, SensorStudy, figure, is_told, lines_of
from spinfilters.campaigns.runner import Runner
from spinfilters.campaigns.study import read_study, study_from
from spinfilters.simulation.model_faults import model_faults


def outcome(fault: str, size: float, verdict: str, error: float, *named: str) -> FaultOutcome:
    """Of one run."""
    row = {"fault.model": fault, "fault.model_size": str(size), "noise.stated": "true", "outcome": "done"}
    return FaultOutcome.of(row | {"verdict": verdict, "worst_error": error, "model_errors": " ".join(named)})


def study() -> SensorStudy:
    """Drag that is found when it is large, and once missed."""
    faulty = (
        replace(outcome("drag", 0.3, "ok", 9.0), told=False),
        outcome("drag", 0.1, "ok", 2.0),
        outcome("drag", 1.0, "ok", 6.0),
        outcome("drag", 10.0, "degraded", 20.0, "torque", "hinge/drag"),
        outcome("torque", 0.1, "degraded", 9.0, "torque"),
    )
    clean = (outcome("", 0.0, "ok", 1.0), outcome("", 0.0, "degraded", 1.0, "drag"))
    return SensorStudy("gyro", faulty, clean)


def test_lines_count_alarms_misses_and_names() -> None:
    alarms, drag, torque, every = lines_of(study())
    assert "2 runs, 1 not ok, 1 with a model error named" in alarms
    assert "1 ok and wrong" in drag
    assert (
        "with effect    2:    0 named first,    1 among two,   1 ok; beside   1 of which nothing could tell"
        in drag
    )
    assert "1 named first" in torque
    assert "with effect    3:" in every


def test_the_map_has_a_row_for_each_wrong_model() -> None:
    drawn = figure([study()])
    labels = [each.get_text() for each in drawn.axes[0].get_yticklabels()]
    assert labels == ["drag (50%)", "torque (100%)"]
    assert "1 of 2 right recordings doubted" in drawn.axes[0].get_title()


def test_the_studies_hold_every_fault_that_their_sensor_can_have() -> None:
    for sensor, kind in (("pose", "pose"), ("gyro", "gyro"), ("tracks", "stereo-tracks")):
        cells = read_study(STUDIES / f"honesty-{sensor}.toml").cells
        asked = {cell.levels["fault.model"] for cell in cells}
        assert asked == {name for name, fault in model_faults().items() if kind in fault.kinds}


def test_a_test_that_knows_what_it_looks_for_tells_a_plain_error_and_neither_a_tiny_one_nor_a_unit() -> None:
    document = dict(read_study(STUDIES / "honesty-gyro.toml").document)
    document["study"] = {**document["study"], "seeds": 1}
    document["noise"] = {"base": {**document["noise"]["base"], "stated": True}}
    document["motion"] = {"base": {**document["motion"]["base"], "epochs": 30}}
    document["factors"] = {
        "estimator": ["smoother"],
        "fault.model": ["gyro-bias"],
        "fault.model_size": [0.01, 10.0],
    }
    runner = Runner(study_from(document, "told"))
    assert [is_told(runner, index, "gyro-bias") for index in (0, 1)] == [False, True]
    assert not is_told(runner, 0, "length-unit")
