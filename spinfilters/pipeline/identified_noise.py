"""Noise that nobody states, identified on the initialisation's own epochs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from spinfilters.data.sensor_format import sensor_format
from spinfilters.estimators.identification.components import DISTURBANCES, ComponentRows, VarianceComponent
from spinfilters.estimators.identification.identify import NoiseModel, identify
from spinfilters.estimators.initialisation.initial_estimate import InitialEstimate
from spinfilters.estimators.smoothing.factors.landmark_observations import OBSERVATIONS_NEEDED
from spinfilters.estimators.smoothing.problem.least_squares import problem_of
from spinfilters.estimators.timeline import SensorNoise, Timeline
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess

ROUNDS: Final[int] = 3
"""Initialisations at most: each linearises about what the noise of the one before made of the epochs."""
ALIKE: Final[float] = 0.2
"""Change of every ln variance below which the initialisation just made is the last."""


@dataclass(frozen=True)
class NoisyModels:
    """What estimators are told of noise, and the initialisation with it."""

    process: TorqueFreeProcess
    noise: SensorNoise
    timeline: Timeline
    start: InitialEstimate


Initialise = Callable[[TorqueFreeProcess, SensorNoise], NoisyModels]
"""Binds a data set to noise and makes its initialisation."""


@dataclass(frozen=True)
class Unstated:
    """Noise that neither settings nor data set state.

    Attributes
    ----------
    options: by option, the components of the innovation that it scales, by sensor.   densities: of the disturbances.
    """

    options: Mapping[str, Mapping[str, tuple[int, ...]]]
    densities: tuple[str, ...]

    def __bool__(self) -> bool:
        return bool(self.options or self.densities)


def with_identified_noise(
    make: Initialise, process: TorqueFreeProcess, noise: SensorNoise, unstated: Unstated
) -> tuple[NoisyModels, tuple[VarianceComponent, ...]]:
    """The initialisation with the noise that its own epochs identify; without it where they identify none.

    The density of a disturbance is raised by what is not known of it: exp(var ln density), which leaves one that the data tell.
    """
    made, found = make(process, noise), ()
    if not unstated:
        return made, found
    for _ in range(ROUNDS - 1):
        components = _identified(made, unstated)
        if components is None:
            break
        before, found = _levels(made, unstated), components
        process = made.process.with_noise(_densities(made.process.noise, components))
        made = make(process, _sensor_noise(made.noise, components))
        after = _levels(made, unstated)
        if all(abs(np.log(after[name] / before[name])) < ALIKE for name in after):
            break
    return made, found


def _identified(made: NoisyModels, unstated: Unstated) -> tuple[VarianceComponent, ...] | None:
    start, process = made.start, made.process
    if start.has_failed or not np.isfinite(start.mean).all():
        return None
    epochs = made.timeline[: len(start.mean)]
    problem = problem_of(process, epochs, start.ids, start.prior, OBSERVATIONS_NEEDED)
    seen = (
        set() if problem.observations is None else {group.model.name for group in problem.observations.groups}
    )
    components = []
    for option, by_sensor in unstated.options.items():
        rows = {
            k: _rows(sensor.model, by_sensor[sensor.model.name])
            for k, sensor in enumerate(problem.motion.sensors)
            if sensor.model.name in by_sensor
        }
        if rows or seen & set(by_sensor):
            value = getattr(made.noise, option)
            components.append(ComponentRows(option, value, rows, bool(seen & set(by_sensor))))
    densities = tuple(name for name in unstated.densities if process.layout.translates or name != "force_psd")
    found = identify(NoiseModel(problem, tuple(components), densities), start.mean, start.points)
    return None if found is None or not found.converged else found.components


def _rows(model: MeasurementModel, components: tuple[int, ...]) -> tuple[int, ...]:
    """Components of the innovation: of a camera all are pixels."""
    return tuple(range(model.dim)) if sensor_format(model.name).has_landmarks else components


def _levels(made: NoisyModels, unstated: Unstated) -> dict[str, float]:
    """Variances and densities that the initialisation was made with."""
    levels = {name: getattr(made.noise, name) ** 2 for name in unstated.options}
    return levels | {name: getattr(made.process.noise, name) for name in unstated.densities}


def _densities(noise: ProcessNoise, components: tuple[VarianceComponent, ...]) -> ProcessNoise:
    found = [each for each in components if each.name in DISTURBANCES]
    return replace(noise, **{each.name: each.value * float(np.exp(each.log_std**2)) for each in found})


def _sensor_noise(noise: SensorNoise, components: tuple[VarianceComponent, ...]) -> SensorNoise:
    return replace(noise, **{each.name: each.value for each in components if each.name not in DISTURBANCES})
