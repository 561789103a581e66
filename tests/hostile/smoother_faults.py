"""Live runs whose smoother is killed, stopped, fed NaN or slowed at random: ``python -m tests.hostile.smoother_faults``.

    [--runs 20] [--faults 5] [--believed 1]

Every epoch must have a finite answer, and the smoother must be back in use within ten seconds. Every run has a truth of its own:
its first state is drawn from the filter's first belief, its disturbances from the process noise. So the NEES of the runs' last
answers are independent, each chi-square with as many degrees of freedom as the error has, and their mean must lie within the 99 %
band. NEES along one run are correlated by its constants and its first state, and of a truth without disturbances they are small
whatever a filter does: neither would be a test. With --believed 0.01 filter and smoother believe in a hundredth of the
disturbances, and the band must show it.
"""

import argparse
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import count

import numpy as np

from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.live.answer import Answer, json_line
from spinfilters.live.executive import Executive
from spinfilters.live.live_options import LONG_RUN, LiveOptions, LiveSetup
from spinfilters.live.smoother_process import SupervisionOptions
from spinfilters.live.sources import ArrivedEpoch
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import Gaussian
from spinfilters.settings.run_settings import SmootherSettings
from tests.live.test_executive import LAYOUT, MODEL, STD, bind, truth

INTERVAL, PACE = 0.1, 5.0
"""Seconds between epochs of the motion, and how many of them pass in one on the clock."""
EPOCHS_OF_A_FAULT = 60
RATE_STD = 0.01
PSD = 1e-5
"""Of the torque, (rad/s^2)^2/Hz: in a run it moves the rate by more than a gyro's noise."""
KINDS = ("kill", "stop", "nan", "slow")
SLOW, SHARE, PERIOD = 1.0, 0.1, 0.05
"""Seconds for which a smoother is slowed, the share of its time that it has, and the seconds that this is shared out in."""
BACK_WITHIN = 10.0
CONFIDENCE = 0.99
SLIDING = SmootherSettings().options(LONG_RUN)


def motion(seed: int) -> Iterator[tuple[np.ndarray, ArrivedEpoch]]:
    """True states, and what a gyro says of them, without end."""
    rng, process = np.random.default_rng(seed), TorqueFreeProcess(LAYOUT, ProcessNoise(PSD, PSD))
    x = LAYOUT.retract(truth(), STD * rng.normal(size=len(STD)))
    for k in count(1):
        x, _, noise = process.linearise(x, INTERVAL)
        x = LAYOUT.retract(x, noise @ rng.normal(size=noise.shape[1]))
        instant = np.array([INTERVAL * k])
        values = x[LAYOUT.mean_slice("w")][None] + RATE_STD * rng.normal(size=(1, 3))
        yield x, ArrivedEpoch(float(instant[0]), (MeasurementStream("gyro", instant, values),))


@dataclass
class Fault:
    """What was done to a smoother, when it was over (s), and how many hand-overs there were then."""

    kind: str
    over: float
    handed: int


class FaultyRun:
    """Epochs on the clock until all faults are over, with one so many epochs after the smoother came back from the last."""

    def __init__(self, seed: int, faults: int, believed: float) -> None:
        self.state, self.given, self._seed = truth(), 0, seed
        process = TorqueFreeProcess(LAYOUT, ProcessNoise(believed * PSD, believed * PSD))
        filter_ = MultiplicativeEkf(process)
        filter_.start(Gaussian(LAYOUT, truth(), np.diag(STD)))
        setup = LiveSetup(process, filter_, 0.0, {"gyro": MODEL}, bind)
        supervision = SupervisionOptions(patience=2.5, pause=0.0)
        self.executive = Executive(setup, LiveOptions(supervision=supervision, history=500, sliding=SLIDING))
        self.faults: Counter[str] = Counter()
        self.back: list[float] = []
        self._rng, self._fault, self._wanted = np.random.default_rng(seed), None, faults
        self._quiet = 0

    def answers(self) -> Iterator[Answer]:
        """All of them."""
        return self.executive.run(self._arriving())

    def _arriving(self) -> Iterator[ArrivedEpoch | None]:
        for state, epoch in motion(self._seed):
            self.state, self.given, self._quiet = state, self.given + 1, self._quiet + 1
            yield ArrivedEpoch(epoch.time, epoch.streams)
            due = time.monotonic() + INTERVAL / PACE
            while time.monotonic() < due:
                self._meddle()
                yield None
                time.sleep(0.002)
            if len(self.back) == self._wanted and self._quiet > EPOCHS_OF_A_FAULT:
                return

    def _meddle(self) -> None:
        """Begin a fault that is due, go on with one, and see whether the smoother is back."""
        pid, handed = self.executive.supervisor.pid, self.executive.summary.events["hand-over"]
        if self._fault is None:
            due = self._wanted > self.faults.total() and self._quiet > EPOCHS_OF_A_FAULT
            if due and pid is not None and handed:
                self._begin(str(self._rng.choice(KINDS)), pid, handed)
            return
        now = time.monotonic()
        if self._fault.kind == "slow" and pid is not None:
            stopped = now < self._fault.over and now % PERIOD > SHARE * PERIOD
            _signal(pid, signal.SIGSTOP if stopped else signal.SIGCONT)
        if now < self._fault.over:
            self._fault.handed = handed
        elif handed > self._fault.handed or now - self._fault.over > BACK_WITHIN:
            self.back.append(now - self._fault.over if handed > self._fault.handed else np.inf)
            self._fault, self._quiet = None, 0

    def _begin(self, kind: str, pid: int, handed: int) -> None:
        self.faults[kind] += 1
        self._fault = Fault(kind, time.monotonic() + (SLOW if kind == "slow" else 0.0), handed)
        if kind == "kill":
            _signal(pid, signal.SIGKILL)
        elif kind == "stop":
            _signal(pid, signal.SIGSTOP)
        elif kind == "nan":
            channel, nan = self.executive.supervisor._channel, np.nan
            assert channel is not None
            message = {"time": np.array(self.executive.track.time + 1e-3), "0.name": np.array("gyro")}
            channel.send(message | {"0.values": np.full((1, 3), nan), "0.parameters": np.full((1, 2), nan)})


def _signal(pid: int, number: int) -> None:
    with suppress(ProcessLookupError):  # it has ended meanwhile
        os.kill(pid, number)


def main() -> int:
    """Run, print what was found, and say 1 where something is wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--faults", type=int, default=5)
    parser.add_argument("--believed", type=float, default=1.0)
    options = parser.parse_args()
    faults, events, back, nees = Counter[str](), Counter[str](), list[float](), list[float]()
    answered, wanted, infinite = 0, 0, 0
    for seed in range(options.runs):
        run = FaultyRun(seed, options.faults, options.believed)
        last = None
        for answer in run.answers():
            answered, last = answered + 1, answer
            json_line(answer)  # refuses what is not finite
            infinite += not np.isfinite(answer.belief.factor).all()
        assert last is not None
        wanted += run.given
        error = LAYOUT.local(last.belief.mean, run.state)
        nees.append(float(error @ np.linalg.solve(last.belief.covariance, error)))
        longest = max(run.back, default=0.0)
        print(
            f"run {seed + 1} of {options.runs}: {run.faults.total()} faults, back after at most {longest:.1f} s",
            file=sys.stderr,
        )
        faults, events, back = faults + run.faults, events + run.executive.summary.events, back + run.back
    low, high = (
        float(limit) / LAYOUT.error_dim
        for limit in chi_square_band(LAYOUT.error_dim, options.runs, CONFIDENCE)
    )
    mean = float(np.mean(nees)) / LAYOUT.error_dim
    print(
        f"{faults.total()} faults {dict(faults)}; {answered} of {wanted} epochs answered, {infinite} not finite"
    )
    print(f"NEES per dof of {options.runs} last answers: mean {mean:.2f}, band {low:.2f} to {high:.2f}")
    print(f"back in use after {np.median(back):.1f} s, at most {max(back):.1f} s, {len(back)} times")
    print(f"events: {dict(sorted(events.items()))}")
    wrong = answered < wanted or infinite or not low < mean < high or max(back) > BACK_WITHIN
    return int(wrong or len(back) < faults.total())


if __name__ == "__main__":
    raise SystemExit(main())
