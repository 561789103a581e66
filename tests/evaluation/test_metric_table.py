"""The table of metrics: one line is enough for every output, also from outside the package."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from contracts.plugin import installed_plugin, program_of

import spinfilters
from spinfilters.api.comparison import Run
from spinfilters.campaigns.campaign_report import write_report
from spinfilters.campaigns.row_columns import result_columns, schema
from spinfilters.campaigns.rows_folder import RowsFolder, keep_study, open_folder, read_rows
from spinfilters.campaigns.runner import asked, when_and_where
from spinfilters.core.errors import InputError
from spinfilters.evaluation.epoch_spans import own_span
from spinfilters.evaluation.metrics import METRICS, Form, Metric, metrics, number
from spinfilters.run.run_summary import estimator_numbers
from tests.campaigns.study_samples import gyro_study

PROGRAM = program_of(Path(__file__).parents[2] / "docs" / "how-to" / "add-a-metric.md")
KEY, LABEL = "nutation_rms_rad", "nutation angle, rms [deg]"


@pytest.fixture
def module(tmp_path: Path) -> Iterator[Path]:
    """The module of the how-to page in an installed distribution, on the path."""
    with installed_plugin("spinfilters.metrics", "nutation = nutation:METRIC", PROGRAM, tmp_path) as file:
        yield file


def _run(folder: Path | None = None) -> Run:
    data = spinfilters.simulate("gyro", seed=1, frames=40, interval=0.1)
    return spinfilters.compare(data, estimators="mekf", output=folder)


@pytest.mark.usefixtures("module", "unrendered")
def test_a_metric_from_outside_is_in_the_summary_the_terminal_the_page_and_the_notebook(
    tmp_path: Path,
) -> None:
    run = _run(tmp_path / "run")
    numbers = json.loads((tmp_path / "run" / "summary.json").read_text())["estimators"]["mekf"]
    angle = np.rad2deg(numbers[KEY])
    assert 0 < angle < 90
    assert numbers["shared_epochs"][KEY] == numbers[KEY]  # of one estimator
    for page in (str(run), run._repr_html_(), (tmp_path / "run" / "report.html").read_text()):
        assert LABEL in page
        assert f"{angle:.3g}" in page


@pytest.mark.usefixtures("module", "unrendered")
def test_a_metric_from_outside_is_in_the_rows_and_the_report_of_a_campaign(tmp_path: Path) -> None:
    study, evaluation = gyro_study(), _run()["mekf"].evaluation
    (tmp_path / "campaign").mkdir()
    open_folder(tmp_path / "campaign", study, resume=False)
    keep_study(tmp_path / "campaign", study, ())
    with RowsFolder(tmp_path / "campaign", study.columns) as rows:
        row = asked(study, 0) | {"outcome": "done", "reason": ""} | when_and_where()
        rows.append(row | result_columns(evaluation))
    (value,) = read_rows(tmp_path / "campaign", study.columns)[KEY].to_pylist()
    assert value == metrics()[-1].of(own_span(evaluation))
    page = write_report(tmp_path / "campaign")
    assert LABEL in page.read_text()
    assert f"{np.rad2deg(value):#.3g}" in page.read_text()
    head, *cells = (page.parent / "cells.csv").read_text().splitlines()
    assert float(dict(zip(head.split(","), cells[0].split(","), strict=True))[KEY]) == value


def test_a_metric_that_cannot_be_computed_is_none_and_costs_no_result(module: Path) -> None:
    module.write_text(PROGRAM.replace("return np.sqrt(", "return np.linalg.inv(0 * np.eye(2)) * np.sqrt("))
    evaluation = _run()["mekf"].evaluation
    numbers = estimator_numbers(evaluation)
    assert numbers[KEY] is None
    assert numbers["status"] == str(evaluation.history.status.verdict)


def test_a_key_that_two_metrics_have_is_refused(module: Path) -> None:
    module.write_text(PROGRAM.replace("nutation_rms_rad", "runtime_s.total"))
    with pytest.raises(InputError, match=r"two metrics have the key 'runtime_s\.total'"):
        metrics()


def test_every_metric_is_somewhere_and_its_bound_has_a_column_beside_it() -> None:
    names = schema(["estimator"]).names
    assert len(set(names)) == len(names)
    for metric in METRICS:
        assert metric.key or metric.label or metric.column_name
        assert not metric.bound_column or metric.column_name in names
    motion = [metric for metric in METRICS if metric.column_name == "error_attitude_rad"]
    assert [metric.bound_column for metric in motion] == ["bound_attitude_rad"]


@pytest.mark.parametrize(
    ("form", "scale", "value", "text"),
    [
        (number(".3g"), 1e3, 0.0121, "12.1"),
        (number("+#.2g"), 1.0, 0.02, "+0.020"),
        (lambda share, scale: f"{100 * share:.0f} %", 1.0, 0.5, "50 %"),
        (number(".1f"), 1.0, [1.0, 2.0], "1.0 2.0"),
        (number(".1f"), 1.0, None, None),
    ],
)
def test_a_value_is_shown_in_its_unit_and_format(
    form: Form, scale: float, value: Any, text: str | None
) -> None:
    assert Metric("x", "x", "", lambda _: None, scale, form).text(value) == text
