"""Many recordings of one scenario at once, each with generators of its own, to the numbers of recordings made one by one but for
rounding."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.sensor_format import dataset_kinds
from spinfilters.io.truth import Truth
from spinfilters.models.feature_tracks import Surface, pass_ball
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.simulation.inspector import STATIC
from spinfilters.simulation.scenario import KICKS, Motion, first_state, simulated_stream, truth_of
from spinfilters.simulation.scenario_record import Scenario


@dataclass(frozen=True)
class SimulatedRuns:
    """Recordings of one scenario, one after the other in time.

    Attributes
    ----------
    log : MeasurementLog
        Measurements of all runs; each run has as many rows of a sensor as any other.
    truth : Truth
        Motion of all runs.
    epochs : int
        Epochs of the truth of each run.
    period : float
        Time from a stamp of one run to that of the next, s.
    """

    log: MeasurementLog
    truth: Truth
    epochs: int
    period: float


def simulate_runs(
    scenario: Scenario,
    motion_generators: Sequence[np.random.Generator],
    measurement_generators: Sequence[np.random.Generator],
) -> SimulatedRuns:
    """Recordings as `motion_in_view` and `measured` make them of each pair of generators.

    Raises
    ------
    InputError
        A kind with landmarks, or a moving inspector: these recordings are made one by one.
    """
    require_simulated_together(scenario)
    layout = StateLayout(FULL_BLOCKS)
    time = scenario.interval * np.arange(scenario.epochs)
    states = _motions(scenario, layout, motion_generators)
    period = float(time[-1]) + scenario.interval
    every = _shift_times(time, len(states), period)
    motion = Motion(layout, every, states.reshape(len(every), -1))
    room = np.empty(4 * scenario.landmarks)
    for generator in measurement_generators:  # as `measured`, which needs the landmarks
        pass_ball(room, generator)
    surface = Surface(np.zeros((0, 3)), np.zeros((0, 3)))
    joint = cast(np.random.Generator, JointGenerators(measurement_generators))
    streams = []
    for kind, own in scenario.times.items():
        seen = motion if not scenario.beside else motion.at(_shift_times(own, len(states), period))
        streams.append(simulated_stream(scenario, kind, seen, surface, joint).stream)
    return SimulatedRuns(MeasurementLog(tuple(streams)), truth_of(scenario, motion), len(time), period)


class JointGenerators:
    """Generators of many runs as one: of the rows of an array, each run has an equal share, drawn by its own generator."""

    def __init__(self, generators: Sequence[np.random.Generator]) -> None:
        self._generators = generators

    def standard_normal(self, size: tuple[int, ...]) -> np.ndarray:
        """Standard normals of this shape."""
        return self._draw(size, lambda generator, part: generator.standard_normal(part))

    def uniform(self, low: float, high: float, size: tuple[int, ...]) -> np.ndarray:
        """Numbers of this shape, uniform from low to high."""
        return self._draw(size, lambda generator, part: generator.uniform(low, high, part))

    def _draw(
        self,
        size: tuple[int, ...],
        draw: Callable[[np.random.Generator, tuple[int, ...]], np.ndarray],
    ) -> np.ndarray:
        part = (size[0] // len(self._generators), *size[1:])
        return np.concatenate([draw(generator, part) for generator in self._generators])


def require_simulated_together(scenario: Scenario) -> None:
    """InputError: a scenario whose recordings can only be made one by one."""
    if any(dataset_kinds()[kind].has_landmarks for kind in scenario.kinds) or scenario.inspector != STATIC:
        raise InputError(
            "recordings with landmarks, or of a moving inspector, are made one by one; choose a kind without, or leave --batch out"
        )


def _motions(
    scenario: Scenario, layout: StateLayout, generators: Sequence[np.random.Generator]
) -> Float[np.ndarray, "r n m"]:
    """True states of every run; the pushes of the centre of mass are drawn before those of the rotation."""
    shape, start = (scenario.epochs - 1, KICKS, 2, 3), first_state(scenario, layout)
    normal = np.empty((len(generators), *shape[:-1], 6))
    for k, generator in enumerate(generators):
        normal[k, ..., 3:] = generator.standard_normal(shape)
        normal[k, ..., :3] = generator.standard_normal(shape)
    process = TorqueFreeProcess(layout, scenario.noise)
    return process.disturbed_paths(np.tile(start, (len(normal), 1)), scenario.interval, normal)


def _shift_times(time: Float[np.ndarray, " n"], runs: int, period: float) -> Float[np.ndarray, " k"]:
    """Times of all runs, s."""
    return (time + period * np.arange(runs)[:, np.newaxis]).ravel()
