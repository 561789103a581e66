"""Many recordings of one scenario at once, each with generators of its own, to the numbers of recordings made one by one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.io.sensor_format import dataset_kinds
from spinfilters.io.truth import Truth
from spinfilters.models.feature_tracks import ball
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
    sensors: dict[str, list[MeasurementStream]] = {}
    for k, generator in enumerate(measurement_generators):
        motion = Motion(layout, time, states[k])
        surface = ball(scenario.landmarks, scenario.radius_m, generator)
        for kind, own in scenario.times.items():
            seen = motion if not scenario.beside else motion.at(own)
            made = simulated_stream(scenario, kind, seen, surface, generator).stream
            sensors.setdefault(made.sensor, []).append(made)
    every = _shift_times(time, len(states), period)
    motion = Motion(layout, every, states.reshape(len(every), -1))
    log = MeasurementLog(tuple(_join_runs(streams, period) for streams in sensors.values()))
    return SimulatedRuns(log, truth_of(scenario, motion), len(time), period)


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


def _join_runs(streams: Sequence[MeasurementStream], period: float) -> MeasurementStream:
    """One sensor's measurements, one run after the other."""
    first = streams[0]
    covariances = [each.covariance for each in streams if each.covariance is not None]
    return MeasurementStream(
        first.sensor,
        _shift_times(first.time, len(streams), period),
        np.concatenate([each.values for each in streams]),
        None,
        np.concatenate(covariances) if covariances else None,
    )


def _shift_times(time: Float[np.ndarray, " n"], runs: int, period: float) -> Float[np.ndarray, " k"]:
    """Times of all runs, s."""
    return (time + period * np.arange(runs)[:, np.newaxis]).ravel()
