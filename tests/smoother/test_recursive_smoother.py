"""The sliding smoother as an estimator: the one loop drives it, measurements come as they come, a snapshot brings it back."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.filters.late_measurements import Outcome, OutOfSequenceUpdates
from spinfilters.filters.timeline import advance, run
from spinfilters.models.state_layout import Gaussian
from spinfilters.models.status import EstimatorStatus, Verdict
from spinfilters.smoother.problem import InitialGuess
from spinfilters.smoother.recursive_smoother import RecursiveSmoother
from spinfilters.smoother.sliding_smoother import MarginalizedState, SmootherOptions
from spinfilters.smoother.window import FixedLag, FullSmoothing, LandmarkMarginalization, WindowPolicy
from tests.filters.out_of_sequence_samples import arrivals
from tests.smoother.smoothing_samples import LAYOUT, LONG, PROCESS, SOON, STD, sample

MODES = (FullSmoothing(), FixedLag(8, SOON), LandmarkMarginalization(0.5, 12, SOON))
BEGUN = 6


def _begun(mode: WindowPolicy) -> RecursiveSmoother:
    here = sample(LONG)
    models = tuple(measurement.model for measurement in here.epochs[0].measurements)
    smoother = RecursiveSmoother(PROCESS, SmootherOptions(mode), models)
    smoother.begin(
        here.prior, here.epochs[:BEGUN], InitialGuess(here.truth[:BEGUN], here.known.ids, here.known.points)
    )
    return smoother


def _driven(smoother: RecursiveSmoother, first: int, last: int) -> RecursiveSmoother:
    for before, epoch in pairwise(sample(LONG).epochs[first - 1 : last]):
        advance(smoother, epoch, epoch.time - before.time)
    return smoother


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_the_one_loop_over_time_drives_it(mode: WindowPolicy) -> None:
    here, smoother = sample(LONG), _begun(mode)
    history = run(smoother, here.epochs[BEGUN - 1].time, here.epochs[BEGUN:])
    assert len(history.time) == len(here.epochs) - BEGUN
    rows = smoother.smoothed()
    np.testing.assert_allclose([row.time for row in rows], [epoch.time for epoch in here.epochs])
    whitened = [
        np.linalg.solve(row.factor, LAYOUT.local(row.mean, x))
        for row, x in zip(rows, here.truth, strict=True)
    ]
    assert np.mean(np.square(whitened[1:])) < 2.5


HALTS = (BEGUN, 15, 26)


@cache
def _undisturbed(mode: WindowPolicy) -> tuple[Gaussian, tuple[MarginalizedState, ...]]:
    """Belief at the end and all epochs of a run without a snapshot."""
    whole = _driven(_begun(mode), BEGUN, 30)
    return whole.belief, tuple(whole.smoothed())


@cache
def _halted(mode: WindowPolicy) -> dict[int, tuple[dict[str, np.ndarray], np.ndarray, EstimatorStatus]]:
    """Snapshot, covariance factor and status at every halt of one run."""
    smoother, found = _begun(mode), {}
    for before, halt in pairwise((BEGUN, *HALTS)):
        _driven(smoother, before, halt)
        kept = {name: array.copy() for name, array in smoother.snapshot().items()}
        found[halt] = kept, smoother.belief.factor.copy(), smoother.status
    return found


@pytest.mark.parametrize("mode", MODES, ids=str)
@pytest.mark.parametrize("halt", HALTS)
def test_a_snapshot_leads_on_to_the_same_bits(mode: WindowPolicy, halt: int) -> None:
    (belief, rows), again = _undisturbed(mode), _begun(mode)
    kept, factor, status = _halted(mode)[halt]
    again.restore(kept)
    np.testing.assert_array_equal(again.belief.factor, factor)
    assert again.status == status
    _driven(again, halt, 30)
    np.testing.assert_array_equal(again.belief.mean, belief.mean)
    np.testing.assert_array_equal(again.belief.factor, belief.factor)
    for row, wanted in zip(again.smoothed(), rows, strict=True):
        np.testing.assert_array_equal(row.mean, wanted.mean)
        np.testing.assert_array_equal(row.factor, wanted.factor)


def test_a_snapshot_of_sensors_that_nobody_named_is_refused() -> None:
    with pytest.raises(InputError, match="sensors of its run"):
        RecursiveSmoother(PROCESS).restore(_begun(FullSmoothing()).snapshot())


@pytest.mark.parametrize("dt", [0.0, -0.1, np.nan])
def test_time_does_not_stand_still_or_go_backwards(dt: float) -> None:
    with pytest.raises(InputError, match="ahead"):
        _begun(FullSmoothing()).predict(dt)


def _online(mode: WindowPolicy) -> OutOfSequenceUpdates:
    """From a belief of the first state, whose pose defines g."""
    smoother = RecursiveSmoother(PROCESS, SmootherOptions(mode))
    smoother.start(Gaussian(LAYOUT, sample(LONG).truth[0], np.diag(STD)))
    return OutOfSequenceUpdates(smoother, 0.0, horizon_s=2.0)


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_observations_of_unknown_landmarks_may_come_late(mode: WindowPolicy) -> None:
    here, one, other = sample(LONG), _online(mode), _online(mode)
    stamps = [(epoch.time, epoch.measurements[0]) for epoch in here.epochs]
    order = np.argsort(np.arange(len(stamps)) + np.random.default_rng(2).uniform(0.0, 2.5, len(stamps)))
    for time, measurement in stamps:
        assert one.receive(time, measurement).outcome in {Outcome.TAKEN, Outcome.INSERTED}
    outcomes = [other.receive(*stamps[k]).outcome for k in order]
    assert outcomes.count(Outcome.INSERTED) > 3
    assert Outcome.TOO_LATE not in outcomes
    np.testing.assert_array_equal(other.belief.mean, one.belief.mean)
    np.testing.assert_array_equal(other.belief.factor, one.belief.factor)
    error = LAYOUT.local(one.belief.mean, here.truth[-1])
    assert np.abs(error / one.belief.std).max() < 5.0


def test_what_is_not_determined_yet_is_told_on_line() -> None:
    here, updates = sample(LONG), _online(FullSmoothing())
    for epoch in here.epochs[:3]:
        updates.receive(epoch.time, epoch.measurements[0])
    assert updates.status.verdict is Verdict.DEGRADED
    assert "not determined yet" in updates.status.reasons[0]


def test_two_packets_of_one_camera_at_one_instant_make_one_epoch() -> None:
    here, whole, parts = sample(LONG), _begun(FullSmoothing()), _begun(FullSmoothing())
    epoch = here.epochs[BEGUN]
    (m,) = epoch.measurements
    assert m.ids is not None
    half = len(m.values) // 2
    for smoother in (whole, parts):
        smoother.predict(0.5)
    report = whole.update(m)
    packets = [
        replace(m, values=m.values[s], parameters=m.parameters[s], ids=m.ids[s])
        for s in (np.s_[:half], np.s_[half:])
    ]
    reports = [parts.update(packet) for packet in packets]
    assert [r.accepted + r.rejected for r in reports] == [half, len(m.values) - half]
    assert abs(sum(r.accepted for r in reports) - report.accepted) <= 2
    assert len(parts.sliding.window.epochs) == BEGUN + 1
    away = LAYOUT.local(whole.belief.mean, parts.belief.mean)
    assert np.abs(away / whole.belief.std).max() < 0.2


def test_a_correlated_belief_keeps_its_correlations() -> None:
    """A pose that is as uncertain as the centre of mass is: what is seen of one tells the other."""
    factor = np.diag(np.full(LAYOUT.error_dim, 0.05))
    factor[LAYOUT.slice("w"), LAYOUT.slice("t")] = 0.2 * np.eye(3)
    smoother = RecursiveSmoother(PROCESS)
    smoother.start(Gaussian(LAYOUT, sample(LONG).truth[0], factor))
    before = smoother.belief.std
    smoother.update(next(m for _, m in arrivals() if m.model.name == "pose"))
    rates = LAYOUT.slice("w")
    assert (smoother.belief.std[rates] < 0.4 * before[rates]).all()
