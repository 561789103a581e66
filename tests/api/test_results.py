"""What a run shows of itself, and the arrays and tables that it gives."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

import spinfilters
from spinfilters.api.comparison import flattened, html_table
from spinfilters.evaluation.comparison_table import ComparisonCells
from spinfilters.evaluation.estimated_motion import TRAJECTORY_COLUMNS
from spinfilters.models.status import QUANTITIES


def test_a_run_is_a_mapping_from_names_to_results(run: spinfilters.Run) -> None:
    assert list(run) == ["mekf", "ukf"]
    assert len(run) == 2
    assert run["ukf"].name == "ukf"
    with pytest.raises(KeyError, match="'smoother' is not in this run; it has mekf, ukf"):
        _ = run["smoother"]


def test_a_result_tells_status_body_and_trajectory_with_deviations(run: spinfilters.Run) -> None:
    result = run["mekf"]
    assert result.status in ("ok", "degraded")
    assert (result.status == "ok") == (result.reasons == ())
    assert (result.status == "ok") == (result.checks == ())
    assert set(result.holds) == set(QUANTITIES)
    assert result.holds["position"] == "not determined"  # a gyro sees none
    body, path = result.body, result.trajectory
    assert (
        body.principal_moments.shape
        == body.principal_moments_std.shape
        == body.principal_axes_std.shape
        == (3,)
    )
    assert body.principal_axes_g.shape == (3, 3)
    assert body.center_of_mass_g is None  # a gyro tells none
    n = len(path.time)
    assert n == 60
    assert path.q_ig.shape == (n, 4)
    for array in (
        path.position,
        path.velocity,
        path.rate_i,
        path.std_position,
        path.std_attitude,
        path.std_rate,
    ):
        assert array.shape == (n, 3)


def test_printed_it_is_the_table_with_every_remark(run: spinfilters.Run) -> None:
    text = str(run)
    assert repr(run) == text
    assert "J smallest / largest" in text
    assert "what holds" in text
    assert "\x1b" not in text
    assert all(remark in text for remark in run.remarks)
    assert "<mekf: " in repr(run["mekf"])


def test_in_a_notebook_it_is_a_table_of_the_same_cells(run: spinfilters.Run) -> None:
    html = run._repr_html_()
    assert html.count("<table>") == html.count("</table>") == 1
    assert "<th>MEKF</th><th>UKF</th><th>BOUND</th>" in html
    assert f">{run['ukf'].status}</td>" in html


def test_texts_are_escaped_in_html() -> None:
    evil = "<script>alert('&')</script>"
    cells = ComparisonCells((evil,), (evil,), (((f"  {evil}", evil),),), (evil,))
    html = html_table(cells, [evil])
    assert "<script" not in html
    assert html.count("&lt;script&gt;alert(&#x27;&amp;&#x27;)&lt;/script&gt;") == 6


def test_a_figure_can_be_had_by_its_name(run: spinfilters.Run) -> None:
    assert isinstance(run.figure("rates"), Figure)
    assert isinstance(run.figure("errors-ukf"), Figure)
    with pytest.raises(spinfilters.InputError, match="figure 'cake' is unknown; choose from summary, rates"):
        run.figure("cake")


def test_data_frames_hold_the_summary_and_the_trajectory(run: spinfilters.Run) -> None:
    pytest.importorskip("pandas")
    table = run.to_dataframe()
    assert list(table.index) == ["mekf", "ukf"]
    assert table.loc["ukf", "status"] == run["ukf"].status
    np.testing.assert_array_equal(
        table.loc["mekf", "principal_moments_1"], run["mekf"].body.principal_moments[0]
    )
    frame = run["mekf"].to_dataframe()
    assert [frame.index.name, *frame.columns] == list(TRAJECTORY_COLUMNS)
    np.testing.assert_array_equal(frame["wx"], run["mekf"].trajectory.rate_i[:, 0])


def test_without_pandas_it_says_how_to_get_it(run: spinfilters.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    for table in (run, run["mekf"]):
        with pytest.raises(
            ImportError, match="needs pandas, which is not installed; install it with 'pip install pandas'"
        ):
            table.to_dataframe()


def test_documents_are_flattened_by_the_names_of_their_parts() -> None:
    document = {"a": {"b": 1, "c": [1.0, [2.0, None]]}, "why": ["one", "two"], "none": []}
    assert dict(flattened(document, "")) == {
        "a.b": 1,
        "a.c_1": 1.0,
        "a.c_2_1": 2.0,
        "a.c_2_2": None,
        "why": "one; two",
        "none": "",
    }


def test_used_and_rejected_measurements_are_counted_by_sensor() -> None:
    recording = spinfilters.simulate("pose", frames=24, rate_rpm=(4, 6, 3), beside={"gyro": 0.25})
    values = recording.log.streams[1].values.copy()
    values[-4] = 5.0  # a rate that no body of this recording has, between two poses
    gyro = replace(recording.log.streams[1], values=values)
    spoilt = replace(recording, log=replace(recording.log, streams=(recording.log.streams[0], gyro)))
    summary = spinfilters.compare(spoilt, "mekf", verdict="filter").summary["estimators"]["mekf"]
    told, sensors = summary["measurements"], summary["measurements_by_sensor"]
    assert list(sensors) == ["pose", "gyro"]
    assert sum(each["accepted"] for each in sensors.values()) == told["accepted"]
    assert (sensors["pose"]["rejected"], sensors["gyro"]["rejected"]) == (0, 1) == (0, told["rejected"])
