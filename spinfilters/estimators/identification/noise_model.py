"""Smoothing problem with unknown noise levels: its variance components, and the same problem at other levels."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.identification.components import ComponentRows
from spinfilters.estimators.smoothing.factors.sensor_rows import SensorRows
from spinfilters.estimators.smoothing.problem.least_squares import LinearizationPoint, Problem
from spinfilters.linear_algebra.chi_square import chi_square_median
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess


@dataclass(frozen=True)
class NoiseModel:
    """A problem whose noise levels are unknown.

    Attributes
    ----------
    problem: with the levels that it was stated with.   components, densities: those to be identified.
    """

    problem: Problem
    components: tuple[ComponentRows, ...]
    densities: tuple[str, ...]

    def scaled(self, log_variance: Float[np.ndarray, " c"]) -> Problem:
        """The problem with variances of exp(log_variance) times those stated."""
        motion, observations = self.problem.motion, self.problem.observations
        scales: list[Float[np.ndarray, " i"] | None] = [each.scale for each in motion.sensors]
        for each, scale in zip(self.components, np.exp(0.5 * log_variance).tolist(), strict=False):
            for k, rows in each.sensors.items():
                stated = scales[k]
                changed = np.ones(motion.sensors[k].model.dim) if stated is None else stated.copy()
                changed[list(rows)] *= scale
                scales[k] = changed
            if each.landmarks and observations is not None:
                observations = replace(observations, scale=observations.scale * scale)
        sensors = tuple(replace(s, scale=scale) for s, scale in zip(motion.sensors, scales, strict=True))
        motion = replace(motion, sensors=sensors, process=self._process(log_variance))
        return replace(self.problem, motion=motion, observations=observations)

    def without(self, sensor: int, row: int) -> "tuple[NoiseModel, SensorRows]":
        """The model without one measurement of a sensor, and the measurement."""
        sensors = list(self.problem.motion.sensors)
        every = np.arange(len(sensors[sensor].epoch))
        alone = sensors[sensor].chosen(every == row)
        sensors[sensor] = sensors[sensor].chosen(every != row)
        motion = replace(self.problem.motion, sensors=tuple(sensors))
        return replace(self, problem=replace(self.problem, motion=motion)), alone

    def at(self, log_variance: Float[np.ndarray, " c"]) -> "NoiseModel":
        """The model whose problem is stated with these levels."""
        values = self.values(log_variance)
        components = tuple(
            replace(each, value=value) for each, value in zip(self.components, values, strict=False)
        )
        return NoiseModel(self.scaled(log_variance), components, self.densities)

    def first(self, here: LinearizationPoint) -> Float[np.ndarray, " c"]:
        """Initial ln variances, from the median residual of every component.

        Those of disturbances are as stated.
        """
        found = np.zeros(len(self.components) + len(self.densities))
        for k, each in enumerate(self.components):
            squares = [
                self.problem.motion.sensor_rows(self.problem.motion.sensors[s], here.trajectory)[0][
                    :, list(rows), -1
                ]
                for s, rows in each.sensors.items()
            ]
            ratio = [np.nanmedian(part**2) / chi_square_median(1) for part in squares if part.size]
            if each.landmarks and here.linear is not None and self.problem.observations is not None:
                dim = max(group.model.dim for group in self.problem.observations.groups)
                ratio.append(float(np.median(here.linear.square)) / chi_square_median(dim))
            good = [value for value in ratio if np.isfinite(value) and value > 0]
            found[k] = np.log(max(good)) if good else 0.0
        return found

    @property
    def lowest(self) -> Float[np.ndarray, " c"]:
        """Least ln variances, of the components' smallest levels; densities have none."""
        bounds = [2 * np.log(c.smallest / c.value) if c.smallest > 0 else -np.inf for c in self.components]
        return np.array([*bounds, *(-np.inf for _ in self.densities)])

    def values(self, log_variance: Float[np.ndarray, " c"]) -> tuple[float, ...]:
        """Standard deviations and densities."""
        noise, factor = self._noise, np.exp(log_variance)
        stds = [c.value * float(np.sqrt(f)) for c, f in zip(self.components, factor, strict=False)]
        rest = factor[len(self.components) :]
        return (*stds, *(float(getattr(noise, n) * f) for n, f in zip(self.densities, rest, strict=True)))

    @property
    def _noise(self) -> ProcessNoise:
        process = self.problem.motion.process
        assert isinstance(process, TorqueFreeProcess)
        return process.noise

    def _process(self, log_variance: Float[np.ndarray, " c"]) -> TorqueFreeProcess:
        process = self.problem.motion.process
        assert isinstance(process, TorqueFreeProcess)
        psd = dict(zip(self.densities, self.values(log_variance)[len(self.components) :], strict=True))
        return process.with_noise(replace(process.noise, **psd))
