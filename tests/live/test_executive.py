"""The executive: answers whatever becomes of the smoother, and nothing is counted twice."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Measurement
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.live.answer import Answer, json_line, tum_line
from spinfilters.live.executive import Executive
from spinfilters.live.filter_track import FilterTrack, HandOver
from spinfilters.live.live_options import LiveOptions, LiveSetup
from spinfilters.live.smoother_process import SupervisionOptions
from spinfilters.live.sources import ArrivedEpoch
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensors.gyro import Gyro, gyro_parameters
from spinfilters.models.state_layout import ROTATION_BLOCKS, Gaussian, StateLayout
from spinfilters.models.status import Verdict

LAYOUT = StateLayout(ROTATION_BLOCKS)
PROCESS = TorqueFreeProcess(LAYOUT, ProcessNoise(1e-6, 1e-6))
MODEL = Gyro(LAYOUT)
STD = np.concatenate([np.full(3, 1e-3), np.full(3, 0.01), np.full(5, 0.1)])
WAIT = 20.0


def truth() -> np.ndarray:
    x = LAYOUT.origin()
    x[LAYOUT.mean_slice("w")] = (0.4, 0.9, 0.3)
    x[LAYOUT.mean_slice("s")] = (0.1, -0.05, 0.02, 0.0, 0.03)
    return x


def epochs(count: int) -> list[ArrivedEpoch]:
    rng, x, made = np.random.default_rng(3), truth(), []
    for k in range(count):
        x = PROCESS.step(x, 0.1)
        values = x[LAYOUT.mean_slice("w")][None] + 0.01 * rng.normal(size=(1, 3))
        instant = np.array([0.1 * (k + 1)])
        made.append(ArrivedEpoch(float(instant[0]), (MeasurementStream("gyro", instant, values),)))
    return made


def bind(stream: MeasurementStream) -> Measurement:
    return Measurement(MODEL, stream.values, gyro_parameters(len(stream), 0.01, 0.0))


def started() -> MultiplicativeEkf:
    filter_ = MultiplicativeEkf(PROCESS)
    filter_.start(Gaussian(LAYOUT, truth(), np.diag(STD)))
    return filter_


def executive(**options: object) -> Executive:
    setup = LiveSetup(PROCESS, started(), 0.0, {"gyro": MODEL}, bind)
    supervision = SupervisionOptions(patience=1.0, pause=0.0)
    chosen: dict = {"smoother": False, "supervision": supervision, **options}
    return Executive(setup, LiveOptions(**chosen))


def answered(runner: Executive, given: Iterator[ArrivedEpoch | None] | list[ArrivedEpoch]) -> list[Answer]:
    return list(runner.run(iter(given)))


def filtered(given: list[ArrivedEpoch]) -> Gaussian:
    """The belief of a plain filter over the same epochs."""
    track = FilterTrack(started(), 0.0)
    for epoch in given:
        track.take(executive()._frame(epoch))
    return track.belief


def until(runner: Executive, happened: Callable[[], bool]) -> Iterator[None]:
    """Let the executive serve the smoother until something has happened."""
    deadline = time.monotonic() + WAIT
    while not happened() and time.monotonic() < deadline:
        yield None
        time.sleep(0.005)
    assert happened(), f"did not happen; {runner.summary.events}, {runner.supervisor.events}"


def test_without_a_smoother_the_answers_are_the_filter_s() -> None:
    given = epochs(10)
    answers = answered(executive(ahead=2.0), given)
    np.testing.assert_array_equal(answers[-1].belief.mean, filtered(given).mean)
    assert [answer.time for answer in answers] == [epoch.time for epoch in given]
    assert answers[-1].ahead is not None
    assert answers[-1].ahead[0] == pytest.approx(3.0)
    assert '"ahead"' in json_line(answers[-1])
    assert tum_line(answers[-1]).split()[0] == "1.000000000"


def test_disorder_duplicates_jumps_and_gaps_are_counted_and_lose_nothing() -> None:
    given = epochs(20)
    far = replace(given[3], time=1e6)
    order = [*given[:8], given[9], given[8], given[9], far, *given[10:15], *given[18:]]
    runner = executive()
    answered(runner, order)
    events = runner.summary.events
    assert events["late, put in its place"] == events["epoch twice"] == events["jump of time"] == 1
    assert events["gap"] == 1
    expected = filtered([*given[:15], *given[18:]])
    np.testing.assert_allclose(runner.track.belief.mean, expected.mean, rtol=0, atol=1e-12)


def test_a_handed_over_past_is_brought_up_to_now_with_nothing_counted_twice() -> None:
    """The filter's own belief of the past, handed over, changes nothing; epochs after it come in once."""
    given = epochs(12)
    runner = executive()
    answered(runner, given)
    past = runner.track.belief_at(given[5].time)
    runner._take_over(HandOver(given[5].time, past))
    while runner.track.is_rebasing:
        runner.track.rebase_step()
    expected = filtered(given)
    np.testing.assert_allclose(runner.track.belief.mean, expected.mean, atol=1e-12)
    np.testing.assert_allclose(runner.track.belief.covariance, expected.covariance, rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize("wrong", ["nan", "far"])
def test_a_wrong_hand_over_is_refused_and_the_answer_stays(wrong: str) -> None:
    given = epochs(6)
    runner = executive()
    answered(runner, given)
    before = runner.track.belief
    state = runner.track.belief_at(given[3].time)
    mean = np.full_like(state.mean, np.nan) if wrong == "nan" else LAYOUT.retract(state.mean, 30 * state.std)
    runner._take_over(HandOver(given[3].time, Gaussian(LAYOUT, mean, state.factor)))
    assert not runner.track.is_rebasing
    assert sum(count for event, count in runner.summary.events.items() if "refused" in event) == 1
    np.testing.assert_array_equal(runner.track.belief.mean, before.mean)


def test_the_smoother_hands_over_and_after_a_kill_or_a_stop_it_comes_back() -> None:
    """Every epoch has an answer, finite, whatever is done to the process."""
    given, said = epochs(30), []
    runner = executive(smoother=True)

    def handed() -> int:
        return sum(count for event, count in runner.summary.events.items() if event.startswith("hand-over"))

    def arriving() -> Iterator[ArrivedEpoch | None]:
        for k, epoch in enumerate(given):
            yield epoch
            if k in (2, 9, 19, 29):
                before = handed()
                yield from until(runner, lambda before=before: handed() > before)
            if k in (4, 14):
                pid, begun = runner.supervisor.pid, runner.supervisor.events["smoother begun"]
                assert pid is not None
                os.kill(pid, signal.SIGKILL if k == 4 else signal.SIGSTOP)
                if k == 14:
                    yield given[k + 1]
                yield from until(
                    runner, lambda begun=begun: runner.supervisor.events["smoother begun"] > begun
                )

    said = answered(runner, arriving())
    assert len(said) == 30
    assert all(np.isfinite(answer.belief.mean).all() for answer in said)
    assert runner.supervisor.events["smoother died"] == 1
    assert runner.supervisor.events["smoother late"] == 1
    assert any("without the smoother" in reason for answer in said for reason in answer.status.reasons) or (
        said[-1].status.verdict is Verdict.OK
    )
    error = LAYOUT.local(said[-1].belief.mean, filtered(given).mean) / said[-1].belief.std
    assert np.abs(error).max() < 1.0


def test_one_wrong_time_ahead_leaves_every_later_epoch_its_answer() -> None:
    given = epochs(20)
    wrong = replace(given[10], time=given[10].time + 50.0)
    runner = executive()
    answers = answered(runner, [*given[:10], wrong, *given[10:]])
    assert len(answers) == 21
    assert "must confirm" in answers[10].status.reasons[-1]
    np.testing.assert_array_equal(runner.track.belief.mean, filtered(given).mean)


def test_a_late_epoch_within_what_is_caught_up_with_gives_the_hand_over_up() -> None:
    given = epochs(12)
    runner = executive()
    answered(runner, [*given[:8], *given[9:]])
    past = runner.track.belief_at(given[5].time)
    runner._take_over(HandOver(given[5].time, past))
    for _ in range(4):
        runner.track.rebase_step()
    answered(runner, [given[8]])
    assert not runner.track.is_rebasing
    np.testing.assert_allclose(runner.track.belief.mean, filtered(given).mean, atol=1e-12)
