"""What a run computes and writes once."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from spinfilters.run import comparison_run, run_report
from spinfilters.run import optional_outputs as predictions
from spinfilters.run.comparison_run import RunOutput, compare_into
from spinfilters.run.optional_outputs import OptionalOutputs
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.verdict import doubts


def counted(monkeypatch: pytest.MonkeyPatch, module: Any, name: str, result: object) -> list[str]:
    """Calls of a function that is replaced by one that does nothing."""
    calls: list[str] = []

    def replaced(*_: object) -> object:
        calls.append(name)
        return result

    monkeypatch.setattr(module, name, replaced)
    return calls


def test_the_first_filter_beside_a_smoother_of_landmarks_is_asked_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    agreements = counted(monkeypatch, doubts, "agreement_diagnostics", [])
    noise = counted(monkeypatch, doubts, "filter_noise_diagnostics", ["told"])
    monkeypatch.setattr(doubts, "stated_level_diagnostics", lambda *_: [])
    setup: Any = SimpleNamespace(is_given=False, initial=SimpleNamespace(has_landmarks=True))
    pair: Any = [SimpleNamespace(name=name, history=None) for name in ("mekf", "smoother")]
    entries: Any = [
        SimpleNamespace(continues=name, forgets=False, is_baseline=False) for name in (True, False)
    ]
    found = doubts.Doubts(setup, Settings(), pair, [], [], None)
    assert [found.of(*each) for each in zip(pair, entries, strict=True)] == [["told"], ["told"]]
    assert len(agreements) == len(noise) == 1


def test_the_page_of_a_run_with_a_prediction_is_written_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pages = counted(monkeypatch, run_report, "write_run_report", None)
    counted(monkeypatch, comparison_run, "draw_run", [])
    predicted = counted(monkeypatch, predictions, "write_predictions", True)
    dataset = simulate(Scenario.simplified(kind="gyro", rate_rpm=RICH_RPM, epochs=60))
    settings = Settings(estimators=("mekf",))
    optional = OptionalOutputs(predict_s=1.0)
    written = compare_into(dataset, settings, RunOutput(tmp_path / "run", optional_outputs=optional))
    assert written.comparison is not None
    assert len(predicted) == len(pages) == 1
