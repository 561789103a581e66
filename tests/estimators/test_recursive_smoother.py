"""The sliding smoother as an estimator: the one loop drives it, and a snapshot brings it back to the same bits."""

from itertools import pairwise

import numpy as np
import pytest
from smoothing_samples import LAYOUT, LONG, PROCESS, SOON, sample

from spinfilters.errors import InputError
from spinfilters.estimators.run import advance, run
from spinfilters.estimators.smoothing.modes import FixedLag, FrozenVision, Full, Mode
from spinfilters.estimators.smoothing.recursive import RecursiveSmoother
from spinfilters.estimators.smoothing.sliding_records import SlidingOptions

MODES = (Full(), FixedLag(8, SOON), FrozenVision(0.5, 12, SOON))
BEGUN = 6


def _begun(mode: Mode) -> RecursiveSmoother:
    here = sample(LONG)
    smoother = RecursiveSmoother(PROCESS, here.prior, SlidingOptions(mode), here.frames)
    smoother.begin(here.truth[:BEGUN], here.known.ids, here.known.points)
    return smoother


def _driven(smoother: RecursiveSmoother, first: int, last: int) -> RecursiveSmoother:
    for before, frame in pairwise(sample(LONG).frames[first - 1 : last]):
        advance(smoother, frame, frame.time - before.time)
    return smoother


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_the_one_loop_over_time_drives_it(mode: Mode) -> None:
    here, smoother = sample(LONG), _begun(mode)
    history = run(smoother, here.frames[BEGUN - 1].time, here.frames[BEGUN:])
    assert len(history.time) == len(here.frames) - BEGUN
    rows = smoother.smoothed()
    np.testing.assert_array_equal([row.time for row in rows], [frame.time for frame in here.frames])
    whitened = [
        np.linalg.solve(row.factor, LAYOUT.local(row.mean, x))
        for row, x in zip(rows, here.truth, strict=True)
    ]
    assert np.mean(np.square(whitened[1:])) < 2.5


@pytest.mark.parametrize("mode", MODES, ids=str)
@pytest.mark.parametrize("halt", [BEGUN, 15, 26])
def test_a_snapshot_leads_on_to_the_same_bits(mode: Mode, halt: int) -> None:
    halted, whole = _driven(_begun(mode), BEGUN, halt), _driven(_begun(mode), BEGUN, 30)
    kept = {name: array.copy() for name, array in halted.snapshot().items()}
    again = _begun(mode)
    again.restore(kept)
    np.testing.assert_array_equal(again.belief.factor, halted.belief.factor)
    _driven(again, halt, 30)
    np.testing.assert_array_equal(again.belief.mean, whole.belief.mean)
    np.testing.assert_array_equal(again.belief.factor, whole.belief.factor)
    for row, wanted in zip(again.smoothed(), whole.smoothed(), strict=True):
        np.testing.assert_array_equal(row.mean, wanted.mean)
        np.testing.assert_array_equal(row.factor, wanted.factor)


def test_a_snapshot_of_other_frames_is_refused() -> None:
    kept = _begun(Full()).snapshot()
    kept["window_time"] = kept["window_time"] + 0.1
    with pytest.raises(InputError, match="not those of this timeline"):
        _begun(Full()).restore(kept)


def test_there_is_nothing_to_predict_beyond_the_timeline() -> None:
    smoother = _driven(_begun(FixedLag(8)), BEGUN, 30)
    with pytest.raises(InputError, match="no frame follows"):
        smoother.predict(0.5)
