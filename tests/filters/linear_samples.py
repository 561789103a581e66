"""A linear process and linear sensors over the vector blocks v, w, c: there every Kalman filter is the textbook's."""

from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_expressions import Expression
from spinfilters.filters.estimator import Measurement
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.rotation_integrator import LinearisedStep, LinearisedSteps
from spinfilters.models.state_layout import Gaussian, StateLayout

LAYOUT = StateLayout(("v", "w", "c"))
N = LAYOUT.error_dim


@dataclass(frozen=True)
class LinearProcess:
    """x' = exp(A dt) x to first order in A, with noise of a fixed factor times sqrt(dt)."""

    A: Float[np.ndarray, "n n"]
    noise: Float[np.ndarray, "n k"]
    layout: StateLayout = field(default=LAYOUT)

    def transition(self, dt: float) -> Float[np.ndarray, "n n"]:
        return np.eye(N) + dt * self.A

    def step(self, x: Float[np.ndarray, "*batch n"], dt: float) -> Float[np.ndarray, "*batch n"]:
        return x @ self.transition(dt).T

    def linearise(self, x: Float[np.ndarray, " n"], dt: float) -> LinearisedStep:
        return LinearisedStep(self.step(x, dt), self.transition(dt), np.sqrt(dt) * self.noise)

    def linearised_loops(self) -> None:
        """No compiled loops."""

    @property
    def linearised_scan(self) -> None:
        """No compiled loops."""

    def steps_scan(self) -> None:
        """No compiled loops."""

    def step_loops(self) -> None:
        """No compiled loops."""

    def linearise_steps(
        self,
        here: Float[np.ndarray, "s n"],
        there: Float[np.ndarray, "s n"],
        dt: Float[np.ndarray, " s"],
        about: Float[np.ndarray, "s n"] | None = None,
    ) -> LinearisedSteps:
        every = [self.linearise(x, float(step)) for x, step in zip(here, dt, strict=True)]
        moved, transition, noise = (np.array(part) for part in zip(*every, strict=True))
        return LinearisedSteps(moved - there, transition, noise)


class LinearSensor(MeasurementModel):
    """z = H x + n with a noise factor that is not diagonal; no parameters but a factor of the noise."""

    name = "linear"
    parameter_dim = 1
    needs = ("v", "w", "c")

    def __init__(self, H: Float[np.ndarray, "k n"], noise: Float[np.ndarray, "k k"]) -> None:
        super().__init__(LAYOUT)
        self.H, self.noise = H, noise
        self.dim = self.value_dim = len(H)

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        return ca.DM(self.H) @ ca.vertcat(state["v"], state["w"], state["c"])

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        return parameters[0] * ca.DM(self.noise)

    def measurement(self, values: Float[np.ndarray, "k r"]) -> Measurement:
        return Measurement(self, values, np.ones((len(values), 1)))


def linear_process(generator: np.random.Generator) -> LinearProcess:
    """Slowly turning and decaying, disturbed in four directions."""
    A = 0.3 * generator.standard_normal((N, N))
    return LinearProcess(A - A.T - 0.1 * np.eye(N), 0.2 * generator.standard_normal((N, 4)))


def linear_sensor(size: int, generator: np.random.Generator) -> LinearSensor:
    """A sensor of this many correlated values."""
    noise = np.tril(0.1 * generator.standard_normal((size, size))) + 0.3 * np.eye(size)
    return LinearSensor(generator.standard_normal((size, N)), noise)


def linear_belief(generator: np.random.Generator) -> Gaussian:
    """A start with correlations."""
    root = generator.standard_normal((N, N))
    return Gaussian.from_covariance(LAYOUT, generator.standard_normal(N), root @ root.T + np.eye(N))


def log_density(innovation: Float[np.ndarray, " k"], covariance: Float[np.ndarray, "k k"]) -> float:
    """Logarithm of a normal density with mean zero."""
    log_determinant = np.linalg.slogdet(covariance)[1]
    square = innovation @ np.linalg.solve(covariance, innovation)
    return -0.5 * float(square + log_determinant + len(innovation) * np.log(2 * np.pi))
