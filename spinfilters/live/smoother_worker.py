"""The smoother's own process: epochs in, its latest state and map out."""

import resource
import select
import socket
from collections.abc import Callable

import numpy as np

from spinfilters.estimators.estimator import Measurement
from spinfilters.estimators.smoothing.window.recursive_smoother import RecursiveSmoother
from spinfilters.estimators.timeline import Epoch
from spinfilters.live.messages import Channel, Message
from spinfilters.models.measurement import MeasurementModel

Build = Callable[[], RecursiveSmoother]
"""Makes the smoother, begun."""


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


def work(
    connection: socket.socket,
    build: Build,
    origin: tuple[float, float],
    models: dict[str, MeasurementModel],
    memory: int,
) -> None:
    """Smooth until the connection ends. It hands over whenever it has no further epoch waiting.

    Parameters
    ----------
    origin: the smoother's time at which it has begun, and the time of the measurements then, s.
    memory: bytes of address space that it may have; 0 for no limit.
    """
    if memory:
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    channel, smoother = Channel(connection), build()
    shift = origin[0] - origin[1]
    now = origin[0]
    while not channel.closed:
        select.select([channel], [], [])
        epochs = [frame_of(message, models) for message in channel.received()]
        for frame in epochs:
            if frame.time + shift > now:
                smoother.predict(frame.time + shift - now)
                now = frame.time + shift
            smoother.update_all(frame.measurements)
        if epochs:
            channel.send(hand_over(smoother, now - shift))
            while channel.waiting and not channel.closed:
                select.select([], [channel], [])
                channel.pump()


def hand_over(smoother: RecursiveSmoother, time: float) -> Message:
    """State of the latest epoch (time s) and the landmarks, frame g."""
    belief, window = smoother.belief, smoother.sliding.window
    return {
        "time": np.array(time),
        "mean": belief.mean,
        "factor": belief.factor,
        "ids": np.asarray(window.ids),
        "points": np.asarray(window.points),
        "verdict": np.array(str(smoother.status.verdict)),
    }
