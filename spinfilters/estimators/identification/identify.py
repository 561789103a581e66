"""Noise levels of sensors and densities of disturbances by maximum marginal likelihood, from a smoothing problem.

Laplace's approximation of the marginal likelihood of theta = ln variances is maximised together with the states: each iteration
takes one Gauss-Newton step of the states and one of theta,

    theta += min(max(r / 2F, 0.1), 4) ln((r + slope) / S),

with r and S of `residuals` and F the average information F = u' (I - J P J') u / 2 of the working variables (Gilmour, Thompson and
Cullis 1995), which is exact at the optimum and grows with r far above it.
Prior: flat in ln variance for a sensor, whose noise every row tells; flat in the standard deviation (slope 1) for a disturbance.
One that is too small to be seen would otherwise drift to nothing, and the covariance with it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2

from spinfilters.estimators.identification.components import ComponentRows, VarianceComponent
from spinfilters.estimators.identification.residuals import Residuals, WhitenedRows, residuals_of
from spinfilters.estimators.robust.losses import Gate
from spinfilters.estimators.smoothing.problem.least_squares import (
    LinearizationPoint,
    NormalEquations,
    Problem,
    Stage,
)
from spinfilters.estimators.smoothing.solver.annealing import GATE
from spinfilters.estimators.smoothing.solver.iterations import advanced
from spinfilters.estimators.smoothing.solver.step_rules import GaussNewton
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess

POSE_ONLY_GATE: Final[float] = 6.3
"""As `GATE` for measurements of up to six components, whose whitened length is greater."""
STAGE: Final = Stage(Gate(GATE, GATE), pose_only_loss=Gate(POSE_ONLY_GATE, POSE_ONLY_GATE))
ITERATIONS: Final[int] = 15
SETTLED: Final[float] = 0.05
"""Share of its standard deviation that a component still moves by when the iteration ends."""
LONGEST_STEP: Final[float] = 3.0
"""Of ln variance, in one iteration."""
GAINS: Final[tuple[float, float]] = (0.1, 4.0)
PRIOR_SLOPE: Final[float] = 1.0
"""Of twice the log prior by ln density: flat in the standard deviation."""
SMALLEST_REDUNDANCY: Final[float] = 1e-3
TINY: Final[float] = float(np.finfo(float).tiny)
NEGLIGIBLE: Final[float] = 1e-3
"""Of ln variance: a change that nobody would see."""


@dataclass(frozen=True)
class Identified:
    """Noise identified from some epochs.

    Attributes
    ----------
    components: sensors' standard deviations, then densities.   converged: whether every component has settled.
    """

    components: tuple[VarianceComponent, ...]
    iterations: int
    converged: bool


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

    def first(self, here: LinearizationPoint) -> Float[np.ndarray, " c"]:
        """ln variances at which the median residual of every component is the expected one; those of disturbances as stated."""
        found = np.zeros(len(self.components) + len(self.densities))
        for k, each in enumerate(self.components):
            squares = [
                self.problem.motion.sensor_rows(self.problem.motion.sensors[s], here.trajectory)[0][
                    :, list(rows), -1
                ]
                for s, rows in each.sensors.items()
            ]
            ratio = [np.nanmedian(part**2) / chi2.median(1) for part in squares if part.size]
            if each.landmarks and here.linear is not None and self.problem.observations is not None:
                dim = max(group.model.dim for group in self.problem.observations.groups)
                ratio.append(float(np.median(here.linear.square)) / chi2.median(dim))
            good = [value for value in ratio if np.isfinite(value) and value > 0]
            found[k] = np.log(max(good)) if good else 0.0
        return found

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


def identify(
    model: NoiseModel, trajectory: Float[np.ndarray, "k m"], points: Float[np.ndarray, "L 3"]
) -> Identified | None:
    """Noise levels, from states near the most probable ones; None where the problem has no solution.

    Parameters
    ----------
    trajectory, points: about which the first linear problem is made, m in frame g.
    """
    theta = model.first(model.problem.at(trajectory, points))
    slope = np.concatenate([np.zeros(len(model.components)), np.full(len(model.densities), PRIOR_SLOPE)])
    rule = GaussNewton()
    for iteration in range(1, ITERATIONS + 1):
        problem = model.scaled(theta)
        here = problem.at(trajectory, points, STAGE.pose_only_loss)
        normal = problem.normal(here, STAGE)
        if not normal.solved:
            return None
        residuals = residuals_of(problem, here, normal, model.components, model.densities)
        by, settled = _step(problem, here, normal, residuals, slope)
        if settled or iteration == ITERATIONS:
            information = average_information(problem, here, normal, residuals.sources)
            return Identified(_components(model, theta, information + np.diag(slope / 2)), iteration, settled)
        there, _, _ = advanced(problem, here, normal, (rule, rule.first))
        if there is None:
            return None
        theta, trajectory, points = theta + by, there.trajectory, there.points
    return None


def _components(
    model: NoiseModel, theta: Float[np.ndarray, " c"], information: Float[np.ndarray, "c c"]
) -> tuple[VarianceComponent, ...]:
    """Levels at ln variances, with deviations from the information that there is of these."""
    log_std = np.sqrt(np.diag(np.linalg.pinv(information)))
    names = (*(each.name for each in model.components), *model.densities)
    return tuple(map(VarianceComponent, names, model.values(theta), log_std.tolist()))


def average_information(
    problem: Problem, here: LinearizationPoint, normal: NormalEquations, sources: Sequence[WhitenedRows]
) -> Float[np.ndarray, "c c"]:
    """F_ij = u_i' (I - J P J') u_j / 2.

    By how much the cost of the right-hand side u falls in the linear problem is u' J P J' u.
    """
    count = len(sources)
    fallen = [_fall(problem, here, normal, each) for each in sources]
    F = np.empty((count, count))
    for i in range(count):
        F[i, i] = sources[i].dot(sources[i]) - fallen[i]
        for j in range(i):
            both = _fall(problem, here, normal, sources[i].plus(sources[j]))
            F[i, j] = F[j, i] = sources[i].dot(sources[j]) - (both - fallen[i] - fallen[j]) / 2
    return F / 2


def _fall(problem: Problem, here: LinearizationPoint, normal: NormalEquations, right: WhitenedRows) -> float:
    """Of the cost, in the linear problem about a point with another right-hand side."""
    rows = here.dynamics.rows.copy()
    rows[:, :, -1] = right.steps
    dynamics = replace(here.dynamics, steps=np.swapaxes(rows, 1, 2) @ rows)
    epochs, gradient = here.sensors.epochs.copy(), np.zeros(here.sensors.epochs.shape[:2])
    for sensor, u in zip(problem.motion.sensors, right.sensors, strict=True):
        J = problem.motion.sensor_rows(sensor, here.trajectory, here.pose_only_loss)[0][:, :, :-1]
        columns = problem.motion.sensor_columns(sensor)[:-1]
        np.add.at(gradient, (sensor.epoch[:, None], columns), np.einsum("ric,ri->rc", J, u))
    epochs[:, :, -1] = epochs[:, -1, :] = gradient
    linear = here.linear
    if linear is not None and right.observations is not None:
        seen = linear.rows.copy()
        seen[:, :, -1] = right.observations
        linear = replace(linear, rows=seen)
    other = replace(here, dynamics=dynamics, sensors=replace(here.sensors, epochs=epochs), linear=linear)
    return problem.normal(other, normal.stage).predicted_reduction


def _step(
    problem: Problem,
    here: LinearizationPoint,
    normal: NormalEquations,
    residuals: Residuals,
    slope: Float[np.ndarray, " c"],
) -> tuple[Float[np.ndarray, " c"], bool]:
    """Of ln variances, and whether it is negligible."""
    lengths = np.array([u.dot(u) - _fall(problem, here, normal, u) for u in residuals.sources])
    information = np.maximum(lengths / 2, TINY)
    gain = np.clip(residuals.squares / (2 * information), *GAINS)
    ratio = (residuals.squares + slope) / np.maximum(residuals.redundancy, SMALLEST_REDUNDANCY)
    by = np.clip(gain * np.log(np.maximum(ratio, TINY)), -LONGEST_STEP, LONGEST_STEP)
    return by, bool(np.all(np.abs(by) <= SETTLED / np.sqrt(information) + NEGLIGIBLE))
