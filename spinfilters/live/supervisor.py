"""Supervision of the smoother's process: feeding, watchdog, restart.

Nothing here ever waits for it.
"""

import multiprocessing
import os
import signal
import socket
import time
from collections import Counter
from dataclasses import dataclass
from multiprocessing.process import BaseProcess

import numpy as np

from spinfilters.errors import InputError, ShapeError
from spinfilters.estimators.timeline import Epoch
from spinfilters.live.messages import MOST_WAITING, Channel
from spinfilters.live.rebase import HandOver
from spinfilters.live.smoother_worker import SmootherTask, frame_message, hand_over_of, work
from spinfilters.models.measurement import MeasurementModel
from spinfilters.state.layout import StateLayout

FIRST_PATIENCE = 20.0
"""Seconds until the first hand-over: what the smoother computes with may have to be compiled."""
NICE = 5
"""By how much the smoother gives way to the filter."""


@dataclass(frozen=True)
class SupervisionOptions:
    """Limits at which a smoother is ended.

    Attributes
    ----------
    patience: seconds without a word, with epochs waiting, after which it is killed.   pause: s before it begins anew.
    """

    patience: float = 5.0
    pause: float = 1.0


class SmootherSupervisor:
    """One process at a time.

    Attributes
    ----------
    events: how often what happened.   trouble: why there is no smoother at present, empty where there is one.
    """

    def __init__(
        self, layout: StateLayout, models: dict[str, MeasurementModel], options: SupervisionOptions
    ) -> None:
        self._layout, self._models, self._options = layout, models, options
        self._process: BaseProcess | None = None
        self._killed: list[BaseProcess] = []
        self._channel: Channel | None = None
        self._last = self._ended = -np.inf
        self._handed, self._outstanding = 0, 0
        self.events: Counter[str] = Counter()
        self.trouble = "it has not begun yet"

    @property
    def pid(self) -> int | None:
        """Process identifier, None without a process."""
        return None if self._process is None else self._process.pid

    @property
    def may_begin(self) -> bool:
        """Whether a new process may begin: none runs and the pause is over."""
        return self._process is None and time.monotonic() - self._ended >= self._options.pause

    def begin(self, task: SmootherTask) -> None:
        """Start a smoother."""
        ours, theirs = socket.socketpair()
        context = multiprocessing.get_context("fork")  # models are inherited: nothing is pickled

        def run() -> None:
            """Run the smoother in its process."""
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
            os.nice(NICE)
            ours.close()
            devnull = os.open(os.devnull, os.O_WRONLY)
            os.dup2(devnull, 1)
            os.dup2(devnull, 2)
            work(theirs, task, self._models)

        process = context.Process(target=run, daemon=True)
        # a Ctrl-C meant for all processes of the terminal must not meet this one before it ignores them
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            process.start()
            self._process = process
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()
        self._channel, self._handed, self._outstanding = Channel(ours), 0, 0
        self._last, self.trouble = time.monotonic(), ""
        self.events["smoother begun"] += 1

    def send(self, frame: Epoch) -> None:
        """Send the smoother an epoch newer than all before."""
        if self._channel is None:
            return
        if not self._outstanding:
            self._last = time.monotonic()
        self._outstanding += 1
        self._channel.send(frame_message(frame))
        if self._channel.waiting > MOST_WAITING:
            self.end("smoother hung", "it does not take in measurements")

    def hand_overs(self) -> list[HandOver]:
        """Hand-overs of the smoother's process since the last call.

        Ends it where it is late, and notices where it has ended.
        """
        if self._channel is None or self._process is None:
            return []
        self._channel.pump()
        try:
            received = self._channel.received()
            found = [hand_over_of(message, self._layout) for message in received if message]
        except (InputError, ShapeError, KeyError, ValueError, OSError) as error:
            self.end("smoother broken", f"it sent what is no hand-over ({str(error)[:100]})")
            return []
        if received:
            self._last = time.monotonic()
        if found:
            self._outstanding, self._handed = 0, self._handed + len(found)
        if received:
            return found
        if self._channel.closed or not self._process.is_alive():
            code = self._process.exitcode
            self.end("smoother died", "its process ended" + ("" if code is None else f" (exit code {code})"))
        elif self._outstanding and time.monotonic() - self._last > self._allowed:
            self.end("smoother late", f"it said nothing for {self._allowed:g} s")
        return found

    def end(self, event: str, why: str) -> None:
        """Kill the process and record why."""
        self.events[event] += 1
        self._stop()
        self._ended, self.trouble = time.monotonic(), why

    def close(self) -> None:
        """End everything."""
        self._stop()
        self._reap(1.0)

    @property
    def _allowed(self) -> float:
        return self._options.patience if self._handed else max(self._options.patience, FIRST_PATIENCE)

    def _stop(self) -> None:
        if self._channel is not None:
            self._channel.close()
        if self._process is not None:
            self._process.kill()
            self._killed.append(self._process)
        self._process = self._channel = None
        self._reap(0.0)

    def _reap(self, wait: float) -> None:
        """Forget processes that have ended; to wait for one may take longer than an answer."""
        for process in self._killed:
            process.join(wait)
        self._killed = [process for process in self._killed if process.exitcode is None]
