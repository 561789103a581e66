"""Rows of stated noise count the doubts that name the true level."""

import pandas as pd

from experiments.stated_noise import named_level, rows_of

DOUBT = (
    "sensors.gyro_noise_std is 0.01, the data have 0.0051 +- 0.0002 (9 deviations of chance): state another"
)
FAR = DOUBT.replace("0.0051", "0.009")
TABLE = pd.DataFrame(
    [
        ("mekf", "2", "degraded", DOUBT, 3.0, 0.005),
        ("mekf", "2", "degraded", FAR, 3.0, 0.005),
        ("mekf", "2", "ok", None, 2.5, 0.005),
        ("mekf", "1", "ok", "", 1.5, 0.005),
    ],
    columns=["estimator", "settings", "verdict", "verdict_reasons", "worst_error", "true_gyro_noise_std"],
)


def test_a_doubt_names_the_level_that_the_data_have() -> None:
    assert named_level("another reason; " + DOUBT) == ("gyro_noise_std", 0.0051)
    assert named_level("process.torque_psd is 1, the data have 2 +- 1") is None


def test_only_levels_near_the_true_one_are_counted_as_such() -> None:
    assert list(rows_of(TABLE)) == [
        "| mekf, 2 | 1 of 3 | 2 | 1 | 2.5 |",
        "| mekf, 1 | 1 of 1 | 0 | 0 | 1.5 |",
    ]
