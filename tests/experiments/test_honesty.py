"""The study of wrong models: its lines and its map, from rows of a campaign."""

from experiments.honesty import STUDIES, Outcome, SensorStudy, figure, lines_of
from spinfilters.campaigns.study import read_study
from spinfilters.simulation.model_faults.faulty_recording import model_faults


def outcome(fault: str, size: float, verdict: str, error: float, *named: str) -> Outcome:
    """Of one run."""
    row = {"fault.model": fault, "fault.model_size": str(size), "noise.stated": "true", "outcome": "done"}
    return Outcome.of(row | {"verdict": verdict, "worst_error": error, "model_errors": " ".join(named)})


def study() -> SensorStudy:
    """Drag that is found when it is large, and once missed."""
    faulty = (
        outcome("drag", 0.1, "ok", 2.0),
        outcome("drag", 1.0, "ok", 6.0),
        outcome("drag", 10.0, "degraded", 20.0, "torque", "drag"),
        outcome("torque", 0.1, "degraded", 9.0, "torque"),
    )
    clean = (outcome("", 0.0, "ok", 1.0), outcome("", 0.0, "degraded", 1.0, "drag"))
    return SensorStudy("gyro", faulty, clean)


def test_lines_count_alarms_misses_and_names() -> None:
    alarms, drag, torque, every = lines_of(study())
    assert "2 runs, 1 not ok, 1 with a model error named" in alarms
    assert "1 ok and wrong" in drag
    assert "with effect    2:    0 named first,    1 among two,   1 ok" in drag
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
