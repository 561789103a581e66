"""Smoother in a process of its own: what it is sent, what it answers, and the supervision that begins it anew."""

import io
import multiprocessing
import os
import resource
import select
import signal
import socket
import struct
import time
import zipfile
import zlib
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.process import BaseProcess

import numpy as np

from spinfilters.core.errors import InputError, ShapeError
from spinfilters.filters.estimator import LandmarkBelief, Measurement
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.filters.timeline import Epoch
from spinfilters.live.filter_track import HandOver
from spinfilters.live.live_arguments import LiveArguments
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.state_layout import Gaussian, StateLayout
from spinfilters.smoother.recursive_smoother import RecursiveSmoother

Message = dict[str, np.ndarray]
LENGTH = struct.Struct("<Q")
LARGEST = 1 << 30
MOST_WAITING = 1 << 26
"""Bytes that may wait to be sent: beyond it the other side does not read."""


class Channel:
    """One end of a connection.

    Parameters
    ----------
    connection : socket.socket
        a stream socket, made non-blocking.
    """

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        self._socket = connection
        self._out: deque[memoryview] = deque()
        self._in = bytearray()
        self.closed = False

    @property
    def waiting(self) -> int:
        """Bytes that are not sent yet."""
        return sum(len(part) for part in self._out)

    def send(self, message: Message) -> None:
        """Queue a message; `pump` sends what cannot be sent at once."""
        buffer = io.BytesIO()
        np.savez(buffer, **message)  # pyright: ignore[reportArgumentType]
        data = buffer.getvalue()
        self._out += [memoryview(LENGTH.pack(len(data))), memoryview(data)]
        self.pump()

    def pump(self) -> None:
        """Send what can be sent without waiting."""
        while self._out and not self.closed:
            try:
                sent = self._socket.send(self._out[0])
            except BlockingIOError:
                return
            except OSError:
                self.closed = True
                return
            self._out[0] = self._out[0][sent:]
            if not len(self._out[0]):
                self._out.popleft()

    def received(self) -> list[Message]:
        """Messages that have come."""
        while not self.closed:
            try:
                data = self._socket.recv(1 << 20)
            except BlockingIOError:
                break
            except OSError:
                data = b""
            if not data:
                self.closed = True
            self._in += data
        found = []
        while (message := self._message()) is not None:
            found.append(message)
        return found

    def close(self) -> None:
        """End the connection."""
        self.closed = True
        self._socket.close()

    def fileno(self) -> int:
        """File number of the socket, for select."""
        return self._socket.fileno()

    def _message(self) -> Message | None:
        if len(self._in) < LENGTH.size:
            return None
        (size,) = LENGTH.unpack_from(self._in)
        if size > LARGEST:
            self.closed = True
            self._in.clear()
            return None
        if len(self._in) < LENGTH.size + size:
            return None
        data = bytes(self._in[LENGTH.size : LENGTH.size + size])
        del self._in[: LENGTH.size + size]
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            return dict(arrays)


BROKEN_MESSAGE = (
    InputError,
    ShapeError,
    KeyError,
    ValueError,
    OSError,
    EOFError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What reading a damaged message raises."""
Build = Callable[[], RecursiveSmoother]
"""Makes the smoother, begun."""
AT_ONCE = 8
"""Epochs that are taken in together where the smoother has fallen behind, or half of those that wait: further ahead a guess may be
too poor, but one who is always late is of no use."""
LONGEST_SILENCE = 1.0
"""Seconds without a hand-over, about."""
MAP = ("ids", "points", "modes", "roots", "move")
"""Of a `LandmarkBelief`, in addition to mean and factor."""


@dataclass(frozen=True)
class SmootherTask:
    """Task of a smoother's process.

    Attributes
    ----------
    build : Build
        Makes the smoother.
    own_time, time : float
        At which it has begun, by its clock and by that of the measurements, s.
    landmarks : LandmarkOptions
        How the filter holds those that are handed over.
    memory : int
        Bytes of address space, 0 for no limit.
    """

    build: Build
    own_time: float
    time: float
    landmarks: LandmarkOptions
    memory: int = 0


def frame_message(frame: Epoch) -> Message:
    """An epoch as arrays; models by their sensor's name."""
    message: Message = {"time": np.array(frame.time)}
    for k, m in enumerate(frame.measurements):
        message |= {
            f"{k}.name": np.array(m.model.name),
            f"{k}.values": m.values,
            f"{k}.parameters": m.parameters,
        }
        if m.ids is not None:
            message[f"{k}.ids"] = m.ids
    return message


def frame_of(message: Message, models: dict[str, MeasurementModel]) -> Epoch:
    """The inverse of `frame_message`."""
    measurements = []
    for k in range(len(message)):
        if f"{k}.name" not in message:
            break
        model = models[str(message[f"{k}.name"])]
        measurements.append(
            Measurement(model, message[f"{k}.values"], message[f"{k}.parameters"], message.get(f"{k}.ids"))
        )
    return Epoch(float(message["time"]), tuple(measurements))


def work(connection: socket.socket, task: SmootherTask, models: dict[str, MeasurementModel]) -> None:
    """Smooth until the connection ends; hand over the latest epoch that measured something.

    That is done whenever no further epoch waits, and every `LONGEST_SILENCE` where some always do.
    """
    if task.memory:
        resource.setrlimit(resource.RLIMIT_AS, (task.memory, task.memory))
    channel, smoother = Channel(connection), task.build()
    handed = time.monotonic()
    shift, waiting, measured = task.own_time - task.time, list[Epoch](), task.time
    while not channel.closed:
        select.select([channel], [], [], 0.0 if waiting else None)
        waiting += [frame_of(message, models) for message in channel.received()]
        if not waiting:
            continue
        count = max(AT_ONCE, len(waiting) // 2)
        taken, waiting = waiting[:count], waiting[count:]
        smoother.update_epochs([Epoch(frame.time + shift, frame.measurements) for frame in taken])
        channel.send({})  # it is at work, however long a hand-over takes
        measured = next((frame.time for frame in reversed(taken) if frame.measurements), measured)
        if not waiting or time.monotonic() - handed > LONGEST_SILENCE:
            channel.send(hand_over_message(smoother, measured, task.landmarks))
            handed = time.monotonic()
            while channel.waiting and not channel.closed:
                select.select([], [channel], [])
                channel.pump()


def hand_over_message(smoother: RecursiveSmoother, time: float, options: LandmarkOptions) -> Message:
    """State and landmarks of the latest epoch that measured something (time s), frame g."""
    belief = smoother.sliding.joint_belief(options)
    message: Message = {"time": np.array(time), "mean": belief.mean, "factor": belief.factor}
    if belief.joint is not None:
        message |= {name: np.asarray(getattr(belief.joint, name)) for name in MAP}
    return message | {"verdict": np.array(str(smoother.status.verdict))}


def hand_over_of(message: Message, layout: StateLayout) -> HandOver:
    """The inverse of `hand_over_message`."""
    mean, factor = message["mean"], message["factor"]
    if "modes" not in message:
        return HandOver(float(message["time"]), Gaussian(layout, mean, factor), str(message["verdict"]))
    ids, points, modes, roots, move = (message[name] for name in MAP)
    belief = LandmarkBelief(layout, mean, ids, points, modes, roots, factor, move)
    return HandOver(float(message["time"]), belief, str(message["verdict"]))


FIRST_PATIENCE = 20.0
"""Seconds until the first hand-over: what the smoother computes with may have to be compiled."""
NICE = 5
"""By how much the smoother gives way to the filter."""


@dataclass(frozen=True)
class SupervisionOptions:
    """Limits at which a smoother is ended.

    Attributes
    ----------
    patience : float
        Seconds without a word, with epochs waiting, after which it is killed.
    pause : float
        s before it begins anew.
    """

    patience: float = LiveArguments.patience
    pause: float = 1.0


class SmootherSupervisor:
    """One process at a time.

    Attributes
    ----------
    events : Counter[str]
        How often what happened.
    trouble : str
        Why there is no smoother at present, empty where there is one.
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
        except BROKEN_MESSAGE as error:
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
        elif self._outstanding and time.monotonic() - self._last > self._allowed_seconds:
            self.end("smoother late", f"it said nothing for {self._allowed_seconds:g} s")
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
    def _allowed_seconds(self) -> float:
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
