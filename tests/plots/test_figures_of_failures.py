"""Every picture of a run is drawn, whatever of the estimate is not finite."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.plots import style
from spinfilters.plots.figures import draw_run, picture_files
from spinfilters.run.estimation import Comparison, compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.run.run_folder import figure_data_of
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate

NAMES = ("mekf", "smoother")


@pytest.fixture(scope="module")
def comparisons() -> dict[str, Comparison]:
    """Runs on 12 epochs, by what was measured."""
    settings = Settings(estimators=NAMES)
    found = {}
    for kind in ("stereo-tracks", "gyro"):
        setup = prepare(simulate(Scenario.simplified(kind=kind, epochs=12, landmarks=40)), settings)
        found[kind] = compare_estimators(setup, settings, lambda *_: None)
    return found


def notes(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The sentences that stand in the place of pictures from now on; pictures are small."""
    written: list[str] = []
    real = style.note_figure

    def note_figure(text: str) -> Any:
        written.append(text)
        return real(text)

    monkeypatch.setattr(style, "note_figure", note_figure)
    monkeypatch.setattr(style, "_DPI", 20)
    return written


def drawn(comparison: Comparison, folder: Path, change: Callable[[Any], Any]) -> None:
    """All pictures of a comparison whose first history was changed."""
    from spinfilters.evaluation.estimator_evaluation import evaluate

    folder.mkdir()
    first, *others = comparison.evaluations
    truth = comparison.setup.dataset.truth
    changed = evaluate(change(first.history), truth, first.alignment)
    if first.bound is not None and changed.errors is not None and len(changed.errors.time) == 12:
        changed = replace(changed, bound=first.bound)
    figure_data = figure_data_of(replace(comparison, evaluations=(changed, *others)))
    assert draw_run(figure_data, folder, lambda *_: None) == picture_files(NAMES)
    for name in picture_files(NAMES):
        assert (folder / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("kind", "value", "part", "epochs"),
    [
        ("gyro", np.nan, "mean", slice(None)),
        ("stereo-tracks", np.nan, "mean", slice(3, 6)),
        ("stereo-tracks", np.nan, "factor", slice(None)),
        ("gyro", np.nan, "factor", slice(11, 12)),
        ("gyro", 1e300, "mean", slice(None)),
        ("stereo-tracks", 1e300, "factor", slice(3, 6)),
    ],
)
def test_every_picture_of_a_history_that_is_not_finite_is_drawn(
    kind: str,
    value: float,
    part: str,
    epochs: slice,
    comparisons: dict[str, Comparison],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def change(history: Any) -> Any:
        array = getattr(history, part).copy()
        array[epochs] = value
        return replace(history, **{part: array})

    replaced = notes(monkeypatch)
    drawn(comparisons[kind], tmp_path / "run", change)
    if np.isnan(value):
        assert not [text for text in replaced if "cannot be drawn" in text]


@pytest.mark.usefixtures("unrendered")
def test_a_picture_that_raises_is_replaced_by_a_note_and_the_others_are_drawn(
    comparisons: dict[str, Comparison], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def singular(*_: object) -> Any:
        raise np.linalg.LinAlgError("Singular matrix")

    def impossible(*_: object) -> Any:
        raise InputError("principal_moments: Jxx = -1e-17 kg m^2 is not positive; give three that are")

    monkeypatch.setattr("spinfilters.plots.summary.summary_figure", singular)
    monkeypatch.setattr("spinfilters.plots.time_courses.consistency_figure", impossible)
    replaced = notes(monkeypatch)
    drawn(comparisons["gyro"], tmp_path / "run", lambda history: history)
    assert [text.partition(":")[0] for text in replaced] == [
        "summary cannot be drawn",
        "consistency cannot be drawn",
    ]
    assert "Singular matrix" in replaced[0]
    assert "is not positive" in replaced[1]
