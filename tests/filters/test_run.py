"""The loop over time: it goes on where it was left, ends honestly, and refuses time that does not run forwards."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.core.errors import InputError, ShapeError
from spinfilters.filters import timeline as loop
from spinfilters.filters.compiled_steps import compiled_propagation
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Estimator, Measurement, UpdateReport
from spinfilters.filters.history import EPOCH_ARRAYS, GrowingHistory
from spinfilters.filters.timeline import Timeline, run, run_interruptible
from spinfilters.models.status import Verdict
from tests.filters.filter_samples import FULL, PROCESS, START, embedded, started

COUNT = 12


def rest() -> Timeline:
    """A few epochs after the start."""
    return embedded(0).timeline[START.epochs : START.epochs + COUNT]


def begin() -> float:
    """Time of the start's last epoch, s."""
    return embedded(0).timeline[START.epochs - 1].time


def is_compiled() -> bool:
    """Whether several epochs may be taken in by one call."""
    return compiled_propagation(FULL.error_dim) is not None


def ekf() -> Estimator:
    """At the start's last epoch."""
    estimator = MultiplicativeEkf(PROCESS)
    estimator.start(started(0).belief)
    return estimator


class UnlikelyEkf(MultiplicativeEkf):
    """Reports an infinite likelihood at its third update."""

    updates = 0

    def update(self, measurement: Measurement) -> UpdateReport:
        self.updates += 1
        report = super().update(measurement)
        return replace(report, log_likelihood=-np.inf) if self.updates == 3 else report


def test_a_run_in_two_parts_is_the_run_in_one() -> None:
    whole = run(ekf(), begin(), rest())
    estimator, rows = ekf(), GrowingHistory(FULL, begin())
    run(estimator, begin(), rest()[:5], None, rows)
    again = GrowingHistory.from_arrays(FULL, begin(), rows.arrays())
    assert (len(again), again.time, again.begin) == (5, rest()[4].time, begin())
    both = run(estimator, again.time, rest()[5:], None, again)
    for name in set(EPOCH_ARRAYS) - {"runtime"}:
        np.testing.assert_array_equal(getattr(both, name), getattr(whole, name), strict=True)


@pytest.mark.parametrize("together", [1, 5, COUNT])
def test_on_epoch_finds_the_epoch_among_the_rows(together: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop, "MOST_TOGETHER", together)
    rows, seen = GrowingHistory(FULL, begin()), []
    assert rows.belief is None
    run(ekf(), begin(), rest(), lambda index: seen.append((index, len(rows), rows.time)), rows)
    last = [*range(together - 1, COUNT, together), COUNT - 1]
    assert seen == [(k, k + 1, rest()[k].time) for k in sorted({*last} if is_compiled() else {*range(COUNT)})]
    assert rows.belief is not None


def test_ctrl_c_counts_the_epochs_done_before_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop, "MOST_TOGETHER", 1)

    def press(index: int) -> None:
        if index == 2:
            raise KeyboardInterrupt

    estimator, rows = ekf(), GrowingHistory(FULL, begin())
    run(estimator, begin(), rest()[:4], None, rows)
    history = run_interruptible(estimator, rows.time, rest()[4:], press, rows)
    assert history.status.verdict is Verdict.DEGRADED
    assert history.status.reasons == ("interrupted after 7 of 12 epochs",)
    assert len(history.time) == 7


def test_a_likelihood_that_is_not_finite_fails_the_run() -> None:
    estimator = UnlikelyEkf(PROCESS)
    estimator.start(started(0).belief)
    history = run(estimator, begin(), rest())
    assert history.has_failed
    assert "stopped being finite at epoch 2, t = " in history.status.reasons[0]
    assert len(history.time) == 2
    assert np.isfinite(history.log_likelihood).all()


def test_an_epoch_beyond_the_integrator_s_budget_fails_the_run_and_keeps_what_was_before() -> None:
    epochs = rest()
    late = (*epochs[:3], replace(epochs[3], time=epochs[3].time + 1e6))
    history = run(ekf(), begin(), late)
    assert history.has_failed
    assert "could not be integrated to epoch 3" in history.status.reasons[0]
    assert len(history.time) == 3


def test_nothing_to_do_is_refused_unless_all_is_done() -> None:
    with pytest.raises(InputError, match="no epoch is left"):
        run(ekf(), begin(), ())
    rows = GrowingHistory(FULL, begin())
    run(ekf(), begin(), rest(), None, rows)
    assert len(run(ekf(), rows.time, (), None, rows).time) == COUNT


@pytest.mark.parametrize("time", [1e9, np.nan])
def test_epochs_before_the_belief_are_refused(time: float) -> None:
    with pytest.raises(InputError):
        run(ekf(), time, rest())


def test_an_epoch_whose_time_is_no_number_is_refused() -> None:
    with pytest.raises(InputError, match="nan"):
        run(ekf(), begin(), (replace(rest()[0], time=np.nan),))
    with pytest.raises(InputError, match="order of time"):
        run(ekf(), begin(), rest()[::-1])


def test_rows_that_end_elsewhere_are_refused() -> None:
    with pytest.raises(InputError, match=r"continue from there, not from"):
        run(ekf(), begin(), rest(), None, GrowingHistory(FULL, begin() - 1.0))


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("mean", np.zeros((COUNT, 3))),
        ("nis", np.zeros(COUNT - 1)),
        ("dof", np.zeros(COUNT)),
        ("time", np.array(0.0)),
    ],
)
def test_arrays_that_are_no_history_are_refused(name: str, array: np.ndarray) -> None:
    rows = GrowingHistory(FULL, begin())
    run(ekf(), begin(), rest(), None, rows)
    with pytest.raises(ShapeError):
        GrowingHistory.from_arrays(FULL, begin(), rows.arrays() | {name: array})
    without = {key: value for key, value in rows.arrays().items() if key != name}
    with pytest.raises(ShapeError, match=f"{name} is missing"):
        GrowingHistory.from_arrays(FULL, begin(), without)
