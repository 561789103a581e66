"""Ratios of errors with one gross error to those without."""

import pytest

from experiments.gross_errors import STUDIES, lines_of, quantiles, ratios
from spinfilters.campaigns.study import read_study

Row = dict[str, object]


def row(fault: str, seed: int, error: float | None, verdict: str = "ok", worst: float = 1.0) -> Row:
    """A row of a gyro's campaign, as far as it is looked at."""
    found = dict.fromkeys(("error_position_m", "error_velocity_m_s"))
    own = dict.fromkeys(("error_attitude_rad", "error_rate_rad_s", "error_moment_1", "error_moment_2"), error)
    names = {"estimator": "mekf", "fault": fault, "seed": seed, "verdict": verdict, "worst_error": worst}
    return {**names, **found, **own}


RIGHT = [row("none", 0, 0.3), row("none", 1, -0.4)]


def test_a_ratio_is_that_of_root_mean_squares_over_all_seeds() -> None:
    found = ratios([row("late", 0, 0.6), row("late", 1, 0.8)], RIGHT)
    assert found == {name: pytest.approx(2.0) for name in ("a", "w", "moments")}


def test_a_run_without_estimates_has_no_ratio_that_passes() -> None:
    assert set(ratios([row("late", 0, 0.3), row("late", 1, None)], RIGHT).values()) == {float("inf")}


def test_a_quantile_is_of_ratios_of_the_same_seed() -> None:
    wrong = [row("late", 0, 0.3), row("late", 1, 0.8)]
    assert quantiles(wrong, RIGHT) == {name: pytest.approx(1.95) for name in ("a", "w")}


def test_lines_mark_what_is_beyond_a_tenth_and_count_what_is_ok_and_wrong() -> None:
    wrong = [row("outlier-late", 0, 0.36, worst=4.5), row("outlier-late", 1, 0.48, verdict="degraded")]
    first, epoch, last = lines_of("gyro", [*RIGHT, *wrong])
    assert "a 1.200* (1.20), w 1.200* (1.20), moments 1.200*;" in first
    assert first.endswith("ok 1 of 2 and 2 of 2, of these wrong 1 and 0")
    assert "any, late" in epoch
    assert last.startswith("gyro: 1.1 not met; largest joined ratio 1.200 (mekf, late, a;")


def test_a_missing_measurement_stands_beside_errors_and_is_none() -> None:
    missing = [row("missing-late", 0, 0.6), row("missing-late", 1, 0.8)]
    wrong = [row("outlier-late", 0, 0.309), row("outlier-late", 1, 0.412)]
    *_, epoch, last = lines_of("gyro", [*RIGHT, *missing, *wrong])
    assert "a 1.030 (1.03)" in epoch
    assert last == "gyro: 1.1 met; largest joined ratio 1.030 (mekf, late, a; without the measurement 2.000)"


@pytest.mark.parametrize("sensor", ["pose", "gyro", "tracks"])
def test_a_study_has_every_error_at_begin_within_and_end(sensor: str) -> None:
    cells = read_study(STUDIES / f"gross-errors-{sensor}.toml").cells
    asked = {(cell.recording.fault.gross_error, cell.recording.fault.gross_error_epoch) for cell in cells}
    kinds = {kind for kind, _ in asked} - {""}
    assert asked == {("", 0), *((kind, epoch) for kind in kinds for epoch in (0, 1, 20, 45, -1))}
