"""Runs in batches have the numbers of runs made one by one, whatever way each of them went."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from spinfilters.campaigns.batch import Batches
from spinfilters.campaigns.row_columns import is_volatile
from spinfilters.campaigns.runner import Row, Runner
from spinfilters.campaigns.study import study_from
from spinfilters.core.c_library import compiler
from spinfilters.core.errors import InputError
from spinfilters.evaluation.metrics import METRICS

OF_VERDICT = ("verdict", "verdict_reasons", "verdict_checks")
POSES: dict[str, Any] = {
    "study": {"name": "poses", "seeds": 4, "bound": "none", "initialisation": "drawn"},
    "factors": {"estimator": ["mekf"]},
    "motion": {"base": {"epochs": 20}},
    "body": {"base": {"landmarks": 20}},
    "sensor": {"base": {"kind": "pose"}},
}


def rows_both_ways(**tables: Any) -> list[tuple[Row, Row]]:
    """Every run's row of a batch, beside that of the run made by itself."""
    study = study_from({**POSES, **tables}, "study")
    runs, runner = range(len(study)), Runner(study)
    batch = {row["run"]: row for row in Batches().rows(study, [(run,) for run in runs])}
    return [(batch[run], runner.row(run)) for run in runs]


def assert_same_numbers(batch: Row, single: Row) -> None:
    """Whether two rows agree in all but times and verdicts."""
    for name, value in single.items():
        if is_volatile(name) or name in OF_VERDICT or name.startswith("holds_"):
            continue
        if isinstance(value, list | float) and value is not None:
            np.testing.assert_allclose(batch[name], value, rtol=1e-6, atol=1e-9, err_msg=name)
        else:
            assert batch[name] == value, name


def test_rows_of_a_batch_have_the_numbers_of_runs_made_one_by_one() -> None:
    for batch, single in rows_both_ways():
        assert_same_numbers(batch, single)
        assert batch["nis"] == pytest.approx(single["nis"], rel=1e-9)


def test_runs_of_attitudes_beside_a_gyro_are_those_made_one_by_one() -> None:
    for batch, single in rows_both_ways(sensor={"base": {"kind": "attitude", "beside": {"gyro": 0.5}}}):
        assert_same_numbers(batch, single)


def test_a_run_whose_updates_are_iterated_is_made_by_itself() -> None:
    pairs = rows_both_ways(belief={"base": {"attitude_rad": 0.5, "position_m": 0.3}})
    for batch, single in pairs:
        assert_same_numbers(batch, single)
    assert any(batch["verdict_checks"] == single["verdict_checks"] for batch, single in pairs)


def test_a_metric_that_takes_one_run_has_the_same_numbers_in_a_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    one_by_one = tuple(replace(each, of_many=False) for each in METRICS)
    together = rows_both_ways()
    monkeypatch.setattr("spinfilters.campaigns.batch.metrics", lambda: one_by_one)
    for (batch, _), (other, _) in zip(together, rows_both_ways(), strict=True):
        assert_same_numbers(batch, other)


@pytest.mark.skipif(compiler() is None, reason="runs are made one by one, with verdicts")
def test_a_batch_claims_no_verdict() -> None:
    assert all(batch["verdict"] != "ok" for batch, _ in rows_both_ways())


@pytest.mark.parametrize(
    ("tables", "cure"),
    [
        ({"study": {**POSES["study"], "initialisation": "data"}}, "drawn"),
        ({"study": {**POSES["study"], "bound": "run"}}, "motion"),
        ({"sensor": {"base": {"kind": "stereo-tracks", "known_map": True}}}, "landmarks"),
        ({"fault": {"base": {"dropout_s": [2.0, 4.0]}}}, "faults"),
        ({"noise": {"base": {"stated": False}}}, "stated noise"),
        ({"motion": {"base": {"epochs": 2000}}}, "at most"),
    ],
)
def test_studies_that_batches_cannot_make_are_refused_with_the_cure(
    tables: dict[str, Any], cure: str
) -> None:
    study = study_from({**POSES, **tables}, "study")
    with pytest.raises(InputError, match=cure) as raised:
        list(Batches().rows(study, [(0,)]))
    assert "--batch" in str(raised.value)
