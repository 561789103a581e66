"""The smoother's own process: epochs in, its latest state and map out."""

import resource
import select
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spinfilters.estimators.estimator import Measurement
from spinfilters.estimators.landmarks.belief import LandmarkBelief
from spinfilters.estimators.landmarks.landmark_options import LandmarkOptions
from spinfilters.estimators.smoothing.window.recursive_smoother import RecursiveSmoother
from spinfilters.estimators.timeline import Epoch
from spinfilters.live.messages import Channel, Message
from spinfilters.live.rebase import HandOver
from spinfilters.models.measurement import MeasurementModel
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import StateLayout

Build = Callable[[], RecursiveSmoother]
"""Makes the smoother, begun."""
AT_ONCE = 8
"""Epochs that are taken in together where the smoother has fallen behind, or half of those that wait: further ahead a guess may be
too poor, but one who is always late is of no use."""
LONGEST_SILENCE = 1.0
"""Seconds without a hand-over, about."""
MAP = ("ids", "points", "modes", "roots", "move")
"""Of a `LandmarkBelief`, beside mean and factor."""


@dataclass(frozen=True)
class SmootherTask:
    """Task of a smoother's process.

    Attributes
    ----------
    build: makes the smoother.   own_time, time: at which it has begun, by its clock and by that of the measurements, s.
    landmarks: how the filter holds those that are handed over.   memory: bytes of address space, 0 for no limit.
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
