"""Rows of honest noise count what they say."""

import pandas as pd

from experiments.honest_noise import determined, doubts_of

TABLE = pd.DataFrame(
    [
        (0, "smoother", "stated", 0.02, 0.05),
        (1, "smoother", "stated", 0.02, 0.3),
        (2, "mekf", "stated", 0.02, 0.05),
        (3, "smoother", "silent", 0.02, 0.05),
        (4, "smoother", "stated", float("nan"), float("nan")),
    ],
    columns=["seed", "estimator", "noise", "std_moment_1", "std_moment_2"],
)


def test_moments_are_determined_where_the_smoother_knows_both_with_the_noise_stated() -> None:
    assert determined(TABLE).tolist() == [0]


def test_doubts_about_determined_runs_are_told_by_kind_with_seeds() -> None:
    table = _told("degraded", "errors are 3.1 times too large", "")
    table.loc[0, "verdict"] = "ok"
    assert list(doubts_of(table)) == []
    table.loc[2, "seed"] = 0
    assert list(doubts_of(table)) == ["rich, mekf, stated: errors are: 1 (0)"]


def test_a_run_without_a_verdict_is_told_by_what_stopped_it() -> None:
    table = _told(None, None, "took longer than study.time_limit_s, 600 s")
    assert list(doubts_of(table)) == ["rich, smoother, stated: took longer than study.time_limit_s: 1 (0)"]


def _told(verdict: str | None, reasons: str | None, reason: str) -> pd.DataFrame:
    return TABLE.assign(motion="rich", verdict=verdict, verdict_reasons=reasons, reason=reason)
