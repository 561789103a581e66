"""Noise that nobody states, identified on the initialisation's own epochs, or on a smoother's."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np

from spinfilters.data.measurement_log import MeasurementLog
from spinfilters.data.sensor_format import noise_options, sensor_format
from spinfilters.estimators.identification.components import (
    DISTURBANCES,
    FORCE_PSD,
    ComponentRows,
    VarianceComponent,
)
from spinfilters.estimators.identification.identify import Identified, identify
from spinfilters.estimators.identification.noise_model import NoiseModel
from spinfilters.estimators.initialisation.initial_estimate import InitialEstimate
from spinfilters.estimators.smoothing.factors.landmark_observations import OBSERVATIONS_NEEDED
from spinfilters.estimators.smoothing.problem.least_squares import Problem, problem_of
from spinfilters.estimators.timeline import SensorNoise, Timeline
from spinfilters.linear_algebra.normalised_square import normalised_square
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess

ROUNDS: Final[int] = 3
"""Initialisations at most: each linearises about what the noise of the one before made of the epochs."""
ALIKE: Final[float] = 0.2
"""Change of every ln variance below which the initialisation just made is the last."""
SAME_STATES: Final[float] = 0.3
"""Standard deviations of an epoch's whole state, within which two solutions are one."""
LONGER_ROUNDS: Final[int] = 2
"""Initialisations at most of more epochs than the share."""
SMALLEST_SHARE_OF_DEFAULT: Final[float] = 1e-4
"""Of a noise option's default, the least level that is identified: no such sensor is better. Less is a simulation without
noise, whose residuals are those of rounding and of integration (1e-9 of a step) and tell no level."""


@dataclass(frozen=True)
class NoisyModels:
    """Models with identified noise, and the initialisation with them."""

    process: TorqueFreeProcess
    noise: SensorNoise
    timeline: Timeline
    start: InitialEstimate


class Initialise(Protocol):
    """Binds a data set to noise and makes its initialisation."""

    def __call__(
        self, process: TorqueFreeProcess, noise: SensorNoise, before: InitialEstimate | None
    ) -> NoisyModels:
        """The initialisation at this noise, from that at other noise where there is one."""
        ...

    def beyond_share(self, made: NoisyModels) -> NoisyModels | None:
        """The models with a longer initialisation; None where filters need or get none."""
        ...


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

    @classmethod
    def of_all(cls, log: MeasurementLog, noise: ProcessNoise) -> "Unstated":
        """All levels that a recording has, as if nobody stated them."""
        options: dict[str, dict[str, tuple[int, ...]]] = {}
        for stream in log.streams:
            for option in sensor_format(stream.sensor).noise:
                if option.components is not None:
                    options.setdefault(option.name, {})[stream.sensor] = option.components
        return cls(options, tuple(name for name in DISTURBANCES if getattr(noise, name) > 0))


def with_identified_noise(
    make: Initialise,
    process: TorqueFreeProcess,
    noise: SensorNoise,
    unstated: Unstated,
    rounds: int = ROUNDS,
) -> tuple[NoisyModels, tuple[VarianceComponent, ...]]:
    """The initialisation with the noise that its own epochs identify; without it where they identify none.

    The density of a disturbance is taken for its mean (`VarianceComponent.expected`), and covariances widen by what is not known of
    the levels (`Identified`).

    Parameters
    ----------
    rounds: initialisations at most; 2 where noise is nearly known before the first.
    """
    made, found = _with_levels(make, make(process, noise, None), unstated, rounds)
    longer = make.beyond_share(made)
    if longer is not None:
        made, found = _with_levels(make, longer, unstated, LONGER_ROUNDS)
    return (
        (made, ()) if found is None else (replace(made, start=_widened(made.start, found)), found.components)
    )


def _with_levels(
    make: Initialise, made: NoisyModels, unstated: Unstated, rounds: int
) -> tuple[NoisyModels, Identified | None]:
    """An initialisation made again with the levels that its epochs identify.

    None beside it where they identify none.
    """
    found = None
    for _ in range(rounds - 1 if unstated else 0):
        identified = _identified(made, unstated, found is None)
        if identified is None:
            break
        before, found = _levels(made, unstated), identified
        made = make(*_expected(made, identified), replace(made.start, mean=found.trajectory))
        after = _levels(made, unstated)
        if _agree(made.start, found) or all(
            abs(np.log(after[name] / before[name])) < ALIKE for name in after
        ):
            break
    return made, found


def _agree(start: InitialEstimate, found: Identified) -> bool:
    """Whether an initialisation has kept the states with which its levels are the likeliest."""
    if found.trajectory.shape != start.mean.shape or not np.isfinite(start.factor).all():
        return False
    away = start.layout.local(start.mean, found.trajectory)
    return bool(normalised_square(away, start.factor).max() < SAME_STATES**2)


def smallest_level(option: str) -> float:
    """Level of a noise option below which none is identified, in its unit."""
    return SMALLEST_SHARE_OF_DEFAULT * noise_options()[option].default


def noise_model(problem: Problem, noise: SensorNoise, unstated: Unstated) -> NoiseModel | None:
    """The problem of some epochs with its unknown levels; None where it has none."""
    seen = (
        set() if problem.observations is None else {group.model.name for group in problem.observations.groups}
    )
    components = []
    for option, by_sensor in unstated.options.items():
        rows = {
            k: innovation_rows(sensor.model, by_sensor[sensor.model.name])
            for k, sensor in enumerate(problem.motion.sensors)
            if sensor.model.name in by_sensor
        }
        rows = {k: own for k, own in rows.items() if own}
        if rows or seen & set(by_sensor):
            value = getattr(noise, option)
            tracks = bool(seen & set(by_sensor))
            components.append(ComponentRows(option, value, rows, tracks, smallest_level(option)))
    densities = tuple(name for name in unstated.densities if problem.layout.translates or name != FORCE_PSD)
    return NoiseModel(problem, tuple(components), densities) if components or densities else None


def _identified(made: NoisyModels, unstated: Unstated, from_residuals: bool) -> Identified | None:
    """Levels identified from the median residuals, or from those of the initialisation."""
    start = made.start
    if start.has_failed or not np.isfinite(start.mean).all():
        return None
    epochs = made.timeline[: len(start.mean)]
    problem = problem_of(made.process, epochs, start.ids, start.prior, OBSERVATIONS_NEEDED)
    model = noise_model(problem, made.noise, unstated)
    if model is None:
        return None
    first = None if from_residuals else np.zeros(len(model.components) + len(model.densities))
    found = identify(model, start.mean, start.points, first)
    return found if found is not None and found.converged else None


def _expected(made: NoisyModels, found: Identified) -> tuple[TorqueFreeProcess, SensorNoise]:
    """Process and sensor noise at the expected levels."""
    densities = {each.name: each.expected for each in found.components if each.is_density}
    stds = {each.name: each.expected for each in found.components if not each.is_density}
    process = made.process.with_noise(replace(made.process.noise, **densities))
    return process, replace(made.noise, **stds)


def _widened(start: InitialEstimate, found: Identified) -> InitialEstimate:
    """The belief widened by the uncertainty of the noise levels.

    It stays as it is where it has got other epochs with them.
    """
    if found.sensitivity.shape[1] != len(start.factor):
        return start
    return replace(start, factor=found.widened(start.factor))


def innovation_rows(model: MeasurementModel, components: tuple[int, ...]) -> tuple[int, ...]:
    """Components of the innovation that a noise reaches.

    All of a camera are pixels; a row with more noises than innovations has the first.
    """
    every = tuple(range(model.dim))
    return every if sensor_format(model.name).has_landmarks else tuple(k for k in components if k in every)


def _levels(made: NoisyModels, unstated: Unstated) -> dict[str, float]:
    """Variances and densities that the initialisation was made with."""
    levels = {name: getattr(made.noise, name) ** 2 for name in unstated.options}
    return levels | {name: getattr(made.process.noise, name) for name in unstated.densities}
