"""What still holds of a live run is judged over the epochs that it has kept."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spinfilters.cli.main import main
from spinfilters.io.dataset import Dataset
from spinfilters.live.kept_epochs import KeptEpochs, LastAnswer, final_verdict
from spinfilters.live.sources import ArrivedEpoch
from spinfilters.models.status import MOMENTS, RATE, Holds, Verdict
from spinfilters.run.comparison_run import compare_dataset
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate

EPOCHS, INITIAL = 90, 60
SETTINGS = Settings(estimators=("mekf",))


@pytest.fixture(scope="module")
def recording() -> Dataset:
    return simulate(Scenario.simplified(kind="gyro", rate_rpm=RICH_RPM, epochs=EPOCHS, interval=0.2, seed=4))


def kept_of(recording: Dataset, order: list[int]) -> KeptEpochs:
    """The epochs behind the initialisation, kept in an order of arrival."""
    times = recording.log.times
    kept = KeptEpochs(recording, float(times[INITIAL - 1]))
    for k in order:
        kept.keep(ArrivedEpoch(float(times[k]), recording.log.slice(times[k], times[k]).streams))
    return kept


def answered(recording: Dataset) -> LastAnswer:
    """The answer of a filter at the end of the recording."""
    (evaluation,) = compare_dataset(recording, SETTINGS).evaluations
    history = evaluation.history
    return LastAnswer(float(history.time[-1]), history.belief(-1), "mekf")


def test_epochs_that_arrive_late_are_kept_in_their_place(recording: Dataset) -> None:
    order = [*range(INITIAL, 80), 81, 80, *range(82, EPOCHS)]
    log = kept_of(recording, order).dataset.log
    np.testing.assert_array_equal(log.stream("gyro").time, recording.log.stream("gyro").time)
    np.testing.assert_array_equal(log.stream("gyro").values, recording.log.stream("gyro").values)


def test_the_oldest_epochs_are_dropped_where_there_are_too_many(
    recording: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("spinfilters.live.kept_epochs.MOST_EPOCHS", 50)
    kept = kept_of(recording, list(range(INITIAL, EPOCHS)))
    np.testing.assert_array_equal(kept.dataset.log.times, recording.log.times[-50:])
    assert not kept.holds_initialisation


def test_a_right_answer_holds_as_that_of_the_recording(recording: Dataset) -> None:
    kept = kept_of(recording, list(range(INITIAL, EPOCHS)))
    found = final_verdict(kept, SETTINGS, answered(recording))
    assert found.status is not None
    assert found.status.verdict is Verdict.OK
    assert found.status.holds[RATE] is Holds.OK
    assert "90 epochs" in found.sentence


def test_an_answer_away_from_what_all_epochs_say_does_not_hold(recording: Dataset) -> None:
    last = answered(recording)
    error = np.zeros(last.belief.layout.error_dim)
    part = last.belief.layout.slice("w")
    error[part] = 8 * last.belief.std[part]
    moved = replace(last.belief, mean=last.belief.layout.retract(last.belief.mean, error))
    found = final_verdict(
        kept_of(recording, list(range(INITIAL, EPOCHS))), SETTINGS, replace(last, belief=moved)
    )
    assert found.status is not None
    assert found.status.holds[RATE] is Holds.DOUBTFUL
    assert found.status.holds[MOMENTS] is Holds.OK
    assert "joint deviations" in found.sentence


def test_the_summary_of_a_run_says_what_holds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, summary = tmp_path / "gyro", tmp_path / "summary.json"
    assert main(["simulate", "--kind", "gyro", "--frames", "90", "-o", str(folder)]) == 0
    command = ["live", str(folder), "--speed", "1e6", "--no-smoother", "--deadline-ms", "1e5"]
    assert main([*command, "--summary", str(summary)]) == 0
    assert "what holds, by the latest 90 epochs" in capsys.readouterr().err
    document = json.loads(summary.read_text(encoding="utf-8"))["what_holds"]
    assert document["epochs"] == 90
    assert set(document["holds"]) >= {"rate", "moments", "attitude"}
