"""A run that is killed at any time goes on to the same numbers, bit for bit."""

import os
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from forked import kill_at, killed

from spinfilters.filters import timeline
from spinfilters.filters.history import EstimateHistory, GrowingHistory
from spinfilters.filters.timeline import run
from spinfilters.inference.setup import Setup
from spinfilters.models.status import EstimatorStatus, Finding
from spinfilters.run import checkpoints as checkpoint_store
from spinfilters.run.checkpoints import (
    CheckpointInterval,
    checkpoint_stores,
    fingerprint_of,
    load_checkpoint,
    remove_checkpoints,
    save_checkpoint,
    save_ended,
)
from spinfilters.run.estimation import compare_estimators
from spinfilters.run.run_folder import finished_run, write_run
from tests.run.checkpoint_samples import (
    EVERY_FRAME,
    NAMES,
    SETTINGS,
    UNBOUNDED,
    epochs_to_do,
    fingerprint,
    fresh,
    make_run,
    results,
    sample,
    silent,
    unmapped,
)

KILLS = [(NAMES[k % 2], int(f)) for k, f in enumerate(np.random.default_rng(7).integers(1, 29, 6))]


@pytest.fixture(autouse=True)
def every_epoch_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that a run can be stopped at any of them; the run that nobody disturbed takes them in together."""
    monkeypatch.setattr(timeline, "MOST_TOGETHER", 1)


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    """Results of a run that nobody disturbed."""
    folder = tmp_path_factory.mktemp("uninterrupted") / "run"
    write_run(folder, compare_estimators(sample(), SETTINGS, silent, extent=UNBOUNDED), SETTINGS)
    assert epochs_to_do() >= 28
    return results(folder)


@pytest.mark.parametrize(("name", "epoch"), KILLS)
def test_a_run_that_is_killed_goes_on_to_the_same_bits(
    name: str, epoch: int, uninterrupted: dict[str, object], tmp_path: Path
) -> None:
    assert killed(lambda: make_run(tmp_path / "run", kill_at(name, epoch)))
    done: list[tuple[str, int]] = []
    make_run(tmp_path / "run", lambda *report: done.append(report[:2]))
    assert done[0] == ("mekf", epoch - 1 if name == "mekf" else epochs_to_do())
    assert results(tmp_path / "run") == uninterrupted
    assert not list(tmp_path.rglob(checkpoint_store.CHECKPOINT_FILE))


def test_a_run_that_is_killed_again_and_again_ends_in_the_same_bits(
    uninterrupted: dict[str, object], tmp_path: Path
) -> None:
    """Checkpoints at whatever epochs the clock chooses."""
    for name, epoch in sorted(KILLS):
        killed(lambda: make_run(tmp_path / "run", kill_at(name, epoch), CheckpointInterval(0.002, 1.0)))  # noqa: B023
    make_run(tmp_path / "run", interval=CheckpointInterval(0.002, 1.0))
    assert results(tmp_path / "run") == uninterrupted


@pytest.mark.parametrize("place", ["write_history", "write_json", "remove_checkpoints"])
def test_a_run_that_is_killed_while_it_is_written_is_written_again(
    place: str, uninterrupted: dict[str, object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(f"spinfilters.run.run_folder.{place}", lambda *_: os.kill(os.getpid(), signal.SIGKILL))
        assert killed(lambda: make_run(tmp_path / "run"))
    done: list[tuple[str, int]] = []
    make_run(tmp_path / "run", lambda *report: done.append(report[:2]))
    assert done == [(name, epochs_to_do()) for name in NAMES]
    assert results(tmp_path / "run") == uninterrupted


EVERY_ESTIMATOR = [(sample, name) for name in (*NAMES, "filterpy-ekf", "filterpy-ukf")]
EVERY_ESTIMATOR += [(unmapped, name) for name in NAMES]


@pytest.mark.parametrize(("data", "name"), EVERY_ESTIMATOR)
def test_every_estimator_s_state_is_one_file(data: Callable[[], Setup], name: str, tmp_path: Path) -> None:
    setup, path = data(), tmp_path / "state.npz"
    begin, rest = setup.end_of_initialisation, setup.timeline[len(setup.initial.mean) :]
    mine = fingerprint_of(name, setup.timeline, setup.belief, SETTINGS.document)
    whole = run(fresh(name, setup), begin, rest)
    first, half = fresh(name, setup), GrowingHistory(setup.process.layout, begin)
    run(first, begin, rest[:9], None, half)
    save_checkpoint(path, first, half, mine)
    second = fresh(name, setup)
    found = load_checkpoint(path, second, mine)
    assert (found.status, found.rows.time, len(found.rows)) == (None, rest[8].time, 9)
    assert_same(run(second, found.rows.time, rest[9:], None, found.rows), whole)


def assert_same(one: EstimateHistory, other: EstimateHistory) -> None:
    """Bit for bit, but for the time it took."""
    assert (one.name, one.status) == (other.name, other.status)
    for array in ("time", "mean", "factor", "nis", "dof", "log_likelihood", "accepted", "rejected"):
        np.testing.assert_array_equal(getattr(one, array), getattr(other, array), strict=True)


def test_a_state_without_history_is_kept_too(tmp_path: Path) -> None:
    estimator, time = fresh("mekf"), sample().end_of_initialisation
    estimator.predict(0.5)
    save_checkpoint(
        tmp_path / "state.npz", estimator, GrowingHistory(estimator.layout, time + 0.5), fingerprint("mekf")
    )
    other = fresh("mekf")
    found = load_checkpoint(tmp_path / "state.npz", other, fingerprint("mekf"))
    assert (found.rows.time, len(found.rows)) == (time + 0.5, 0)
    np.testing.assert_array_equal(other.belief.factor, estimator.belief.factor)


def test_a_run_that_failed_is_not_made_again(tmp_path: Path) -> None:
    rows = GrowingHistory(fresh("ukf").layout, sample().end_of_initialisation)
    failed = EstimatorStatus().failed("the covariance could not be factorised")
    (tmp_path / "ukf").mkdir()
    path = tmp_path / "ukf" / checkpoint_store.CHECKPOINT_FILE
    save_ended(path, rows.ended("ukf", failed), rows.begin, fingerprint("ukf"))
    settings = replace(SETTINGS, estimators=("ukf",))
    comparison = compare_estimators(
        sample(), settings, silent, checkpoint_stores(tmp_path, sample(), settings)
    )
    (evaluation,) = comparison.evaluations
    assert evaluation.history.has_failed
    assert len(evaluation.history.time) == len(sample().initial.mean)
    assert not comparison.interrupted


def test_a_run_that_has_ended_keeps_all_of_its_findings(tmp_path: Path) -> None:
    numbers = {"chi_square": 31.5, "text": "a hinge"}
    first = Finding(
        "model-error:hinge", "most like a hinge", "lock it", numbers, frozenset({"rate", "moments"})
    )
    status = EstimatorStatus().doubted(first).failed("the covariance could not be factorised")
    rows = GrowingHistory(fresh("ukf").layout, sample().end_of_initialisation)
    save_ended(tmp_path / "ended.npz", rows.ended("ukf", status), rows.begin, fingerprint("ukf"))
    assert load_checkpoint(tmp_path / "ended.npz", fresh("ukf"), fingerprint("ukf")).status == status


def test_ctrl_c_keeps_the_epoch_at_which_it_came(uninterrupted: dict[str, object], tmp_path: Path) -> None:
    def press(name: str, done: int, _: int) -> None:
        if (name, done) == ("ukf", 11):
            os.kill(os.getpid(), signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    comparison = make_run(tmp_path / "run", press, CheckpointInterval(3600.0))
    assert comparison.interrupted
    assert "interrupted after 11 of" in comparison.evaluations[1].history.status.reasons[0]
    assert signal.getsignal(signal.SIGINT) is before
    assert finished_run(tmp_path / "run", sample().dataset, SETTINGS) is None
    done: list[tuple[str, int]] = []
    make_run(tmp_path / "run", lambda *report: done.append(report[:2]))
    assert done[:3] == [("mekf", epochs_to_do()), ("ukf", 11), ("ukf", 12)]
    assert results(tmp_path / "run") == uninterrupted


def test_ctrl_c_after_the_last_epoch_stops_before_the_next_estimator(tmp_path: Path) -> None:
    store = checkpoint_stores(tmp_path, sample(), SETTINGS)("mekf")
    with (
        pytest.raises(KeyboardInterrupt),
        store.running(fresh("mekf"), GrowingHistory(sample().process.layout, 0.0)),
    ):
        os.kill(os.getpid(), signal.SIGINT)


def test_a_slow_disk_gets_its_share_of_the_time_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that only writing moves: 1 s each, so that the next is due a hundred seconds later."""
    clock, written = [0.0], []

    def write(*_: object) -> None:
        clock[0] += 1.0
        written.append(clock[0])

    monkeypatch.setattr(checkpoint_store, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(checkpoint_store, "save_checkpoint", write)
    store = checkpoint_stores(tmp_path, sample(), SETTINGS, CheckpointInterval(5.0, 0.01))("mekf")
    with store.running(fresh("mekf"), GrowingHistory(sample().process.layout, 0.0)) as keep:
        for _ in range(400):
            clock[0] += 0.5
            keep()
    assert written == [6.0, 107.0]


def make_partial(folder: Path) -> None:
    """A run that was killed early."""
    assert killed(lambda: make_run(folder, kill_at("mekf", 5)))
    assert (folder / "mekf" / checkpoint_store.CHECKPOINT_FILE).is_file()


def test_removed_checkpoints_leave_results_alone(tmp_path: Path) -> None:
    make_partial(tmp_path)
    (tmp_path / "ukf").mkdir()
    (tmp_path / "ukf" / "history.npz").write_bytes(b"")
    remove_checkpoints(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"config.toml", "ukf"}


def test_a_new_run_in_the_folder_of_an_interrupted_one_leaves_no_checkpoint(tmp_path: Path) -> None:
    make_partial(tmp_path)
    comparison = compare_estimators(sample(), SETTINGS, silent)
    write_run(tmp_path, comparison, SETTINGS)
    assert not list(tmp_path.rglob(checkpoint_store.CHECKPOINT_FILE))
    assert finished_run(tmp_path, sample().dataset, SETTINGS) is not None


def test_every_epoch_can_be_kept(tmp_path: Path) -> None:
    estimator, rows = fresh("mekf"), GrowingHistory(sample().process.layout, sample().end_of_initialisation)
    store = checkpoint_stores(tmp_path, sample(), SETTINGS, EVERY_FRAME)("mekf")
    with store.running(estimator, rows) as keep:
        run(estimator, rows.time, sample().timeline[-epochs_to_do() :][:3], lambda _: keep(), rows)
    kept = store.resume(fresh("mekf"))
    assert kept is not None
    assert len(kept.rows) == 3
