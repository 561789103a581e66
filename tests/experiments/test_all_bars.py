"""The table of all bars says of each speed whether it is what it is to be."""

from experiments.benchmarks.all_bars import Bar


def test_a_ratio_is_met_from_its_bar_on() -> None:
    assert Bar("work", 8.0, 8.0, "x", "smoother").met
    assert not Bar("work", 7.99, 8.0, "x", "smoother").met


def test_a_time_is_met_up_to_its_bar() -> None:
    assert Bar("work", 40.0, 40.0, "s", "long_gyro", most=True).met
    assert not Bar("work", 40.1, 40.0, "s", "long_gyro", most=True).met


def test_a_row_has_one_number_a_cell_and_its_command() -> None:
    row = str(Bar("work", 0.3912, 0.35, "ms", "landmark_filters --frames 1000", most=True))
    assert row == "| work | 0.391 ms | 0.35 ms | no | `landmark_filters --frames 1000` |"
    assert "| 8.62x | 8x | yes |" in str(Bar("work", 8.62, 8.0, "x", "smoother"))
