"""A live run whose smoother is killed, stopped, fed NaN or slowed at random: ``python -m tests.hostile.smoother_faults [TIMES]``.

Every epoch must have a finite answer, NEES must stay in band, and the smoother must be back within ten seconds.
"""

import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterator

import numpy as np
from scipy.special import chdtri

from spinfilters.live.executive import Executive, LiveOptions, LiveSetup
from spinfilters.live.line_format import ArrivedEpoch
from spinfilters.live.supervisor import SupervisionOptions
from tests.live.test_executive import LAYOUT, MODEL, PROCESS, bind, epochs, started, truth

INTERVAL = 0.02
"""Seconds between epochs on the clock: the motion's 0.1 s, five times as fast."""
EPOCHS_OF_A_FAULT = 60


class FaultyRun:
    """Epochs on the clock, with a fault every so many."""

    def __init__(self, times: int) -> None:
        self._given = epochs((times + 1) * EPOCHS_OF_A_FAULT)
        supervision = SupervisionOptions(patience=0.3, pause=0.0)
        setup = LiveSetup(PROCESS, started(), 0.0, {"gyro": MODEL}, bind)
        self.executive = Executive(setup, LiveOptions(supervision=supervision, history=200))
        self.faults: Counter[str] = Counter()
        self.back: list[float] = []
        self._rng = np.random.default_rng(1)
        self._away: tuple[float, int] | None = None

    def arriving(self) -> Iterator[ArrivedEpoch | None]:
        """Epochs, and what is done to the smoother between them."""
        for k, epoch in enumerate(self._given):
            if k % EPOCHS_OF_A_FAULT == EPOCHS_OF_A_FAULT // 2:
                self._do(str(self._rng.choice(["kill", "stop", "nan", "slow"])))
            yield epoch
            due = time.monotonic() + INTERVAL
            while time.monotonic() < due:
                yield None
                time.sleep(0.002)
            self._look()

    def _do(self, fault: str) -> None:
        pid, supervisor = self.executive.supervisor.pid, self.executive.supervisor
        if pid is None:
            return
        self.faults[fault] += 1
        self._away = time.monotonic(), self._handed
        if fault == "nan":
            supervisor._channel.send(  # pyright: ignore[reportOptionalMemberAccess]
                {"time": np.array(np.nan), "0.name": np.array("gyro"), "0.values": np.full((1, 3), np.nan),
                 "0.parameters": np.full((1, 2), np.nan)}
            )  # fmt: skip
        elif fault == "slow":
            os.kill(pid, signal.SIGSTOP)
            time.sleep(0.015)
            os.kill(pid, signal.SIGCONT)
        else:
            os.kill(pid, signal.SIGKILL if fault == "kill" else signal.SIGSTOP)

    @property
    def _handed(self) -> int:
        return sum(n for event, n in self.executive.summary.events.items() if event.startswith("hand-over"))

    def _look(self) -> None:
        if self._away is not None and self._handed > self._away[1]:
            self.back.append(time.monotonic() - self._away[0])
            self._away = None


def main(times: int) -> int:
    """Run, print what was found, and say 1 where something is wrong."""
    run = FaultyRun(times)
    states, x = [], truth()
    for _ in run._given:
        x = PROCESS.step(x, 0.1)
        states.append(x)
    nees, finite, count = [], True, 0
    for answer, state in zip(run.executive.run(run.arriving()), states, strict=False):
        belief, count = answer.belief, count + 1
        error = LAYOUT.local(belief.mean, state)
        finite &= bool(np.isfinite(belief.mean).all() and np.isfinite(belief.factor).all())
        nees.append(float(error @ np.linalg.solve(belief.covariance, error)))
    bound = float(chdtri(LAYOUT.error_dim, 1e-6))
    print(f"faults {dict(run.faults)}; {count} of {len(states)} epochs answered, finite: {finite}")
    print(
        f"NEES per dof: mean {np.mean(nees) / LAYOUT.error_dim:.2f}, largest {max(nees):.1f} (bound {bound:.1f})"
    )
    print(f"back in use after at most {max(run.back):.1f} s, {len(run.back)} times")
    print(run.executive.summary.text())
    return int(count < len(states) or not finite or max(nees) > bound or max(run.back) > 10)


if __name__ == "__main__":
    raise SystemExit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 100))
