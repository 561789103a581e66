"""What a live filter's latest epochs say against it."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from spinfilters.evaluation.filter_noise_tests import FilterEpoch, NoiseTest, summed_tests
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import MapChange, Measurement, UpdateReport
from spinfilters.live.executive import FALSE_ALARM, WINDOW, Executive, RunningVerdict, chance
from spinfilters.live.filter_track import HandOver
from spinfilters.live.sources import ArrivedEpoch
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensors.gyro import gyro_parameters
from spinfilters.models.state_layout import Gaussian
from tests.hostile.smoother_faults import INTERVAL, PSD, RATE_STD, motion
from tests.live.test_executive import LAYOUT, MODEL, STD, executive, truth

EPOCHS = 150


class Verdicts:
    """A filter with a running verdict on a gyro whose truth has disturbances."""

    def __init__(self, seed: int, believed: float = 1.0, stated: float = 1.0) -> None:
        self.process = TorqueFreeProcess(LAYOUT, ProcessNoise(believed * PSD, believed * PSD))
        self.filter, self.verdict, self.time = (
            MultiplicativeEkf(self.process),
            RunningVerdict(self.process),
            0.0,
        )
        self.filter.start(Gaussian(LAYOUT, truth(), np.diag(STD)))
        self._given, self._std = motion(seed), stated * RATE_STD

    def run(self, epochs: int, shift: float = 0.0) -> list[str]:
        """So many epochs more, of a gyro that is wrong by a shift, rad/s; the reasons."""
        for _, epoch in islice(self._given, epochs):
            before, values = self.filter.belief, epoch.streams[0].values + shift
            self.filter.predict(INTERVAL)
            report = self.filter.update(Measurement(MODEL, values, gyro_parameters(1, self._std, 0.0)))
            self.time = epoch.time
            given = FilterEpoch(before, self.filter.belief, INTERVAL, report.nis, report.dof)
            self.verdict.take(given, [report], self.time)
        return self.verdict.reasons


@pytest.mark.parametrize("seed", range(6))
def test_a_filter_that_is_told_its_noise_is_believed(seed: int) -> None:
    assert Verdicts(seed).run(EPOCHS) == []


def test_a_noise_understated_is_doubted_with_its_number() -> None:
    (reason,) = Verdicts(0, stated=0.4).run(EPOCHS)
    assert "squared" in reason or "as large as their noise explains" in reason


def test_disturbances_understated_are_doubted_by_their_own_test() -> None:
    run = Verdicts(0, believed=0.01)
    run.run(4 * EPOCHS)
    torque = summed_tests(run.verdict._all).noise["torque"]
    assert 20 < torque.ratio < 200
    assert chance(torque) < FALSE_ALARM
    assert not run.verdict.is_believed


def test_what_an_epoch_is_expected_to_tell_is_positive_where_the_mean_turns_far() -> None:
    """The covariance after an update stands in the tangent space of its own mean, which a wide prior moves far."""
    run = Verdicts(0, believed=0.04)
    tester, told = run.verdict._tester, []
    with pytest.MonkeyPatch.context() as patch:
        take = tester.take
        patch.setattr(tester, "take", lambda epoch: told.append(take(epoch)) or told[-1])
        run.run(80)
    assert np.array(told)[:, 1, 1].min() > 0


def test_what_is_left_out_is_doubted_until_it_is_over() -> None:
    run = Verdicts(1)
    assert run.run(WINDOW) == []
    before, refused = run.filter.belief, UpdateReport(0.0, 0, 0, WINDOW)
    run.filter.predict(INTERVAL)
    run.verdict.take(FilterEpoch(before, run.filter.belief, INTERVAL, 0.0, 0), [refused], run.time)
    (reason,) = run.verdict.reasons
    assert f"{WINDOW} of {2 * WINDOW - 1} measurements" in reason
    assert run.verdict.is_believed
    assert run.run(WINDOW) == []


def test_landmarks_that_are_made_anew_count_as_left_out() -> None:
    process = TorqueFreeProcess(LAYOUT, ProcessNoise(PSD, PSD))
    verdict, belief = RunningVerdict(process), Gaussian(LAYOUT, truth(), np.diag(STD))
    ids = np.arange(10)
    report = UpdateReport(0.0, 0, 10, 0, map_change=MapChange(ids[:0], np.zeros(0), ids, ids))
    verdict.take(FilterEpoch(belief, belief, INTERVAL, 0.0, 0), [report], 1.0)
    assert verdict.reasons == [
        "10 of 10 measurements of the last 1 epochs could not be used or were rejected"
    ]


def test_a_doubt_lasts_until_the_filter_stands_on_a_later_past_that_is_believed() -> None:
    run = Verdicts(0, stated=0.3)
    reasons = run.run(EPOCHS)
    run.verdict.rebased(run.time + 1, is_believed=False)
    run.verdict.rebased(0.0, is_believed=True)
    assert run.verdict.reasons == reasons
    run.verdict.rebased(run.time + 1, is_believed=True)
    assert run.verdict.is_believed


def test_the_chance_of_a_sum_is_that_of_a_scaled_chi_square() -> None:
    rng = np.random.default_rng(0)
    sums = 3.0 * rng.chisquare(4, 20_000)
    tests = [NoiseTest(value, 12.0, 72.0, 36.0) for value in sums.tolist()]
    share = np.mean([chance(test) < 0.01 for test in tests])
    assert 0.008 < share < 0.012
    assert chance(NoiseTest()) == 1.0


def doubted() -> Executive:
    """An executive whose filter has been told nonsense; the smoother has begun before that."""
    runner = executive()
    given = [epoch for _, epoch in islice(motion(0), EPOCHS)]
    wrong = [ArrivedEpoch(e.time, (replace(e.streams[0], values=-2 * e.streams[0].values),)) for e in given]
    answers = list(runner.run(iter([*given[:20], *wrong[20:60]])))
    assert str(answers[19].status.verdict) == "ok"
    assert str(answers[-1].status.verdict) == "degraded"
    return runner


def test_a_filter_in_doubt_takes_the_smoother_that_is_not_however_far_it_is() -> None:
    runner = doubted()
    far = Gaussian(LAYOUT, LAYOUT.retract(runner.track.belief.mean, 50 * STD), np.diag(1e-3 * STD))
    given = HandOver(runner.track.time, far, "ok")
    assert runner._doubt(given) is None
    runner._smoother_believed = False
    assert runner._doubt(given) == "far from the filter"
