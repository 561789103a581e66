"""A linear process and sensor on vector blocks, on which every filter must be the textbook Kalman filter."""

import casadi as ca
import numpy as np

from spinfilters.models.measurement import MeasurementModel
from spinfilters.state.layout import StateLayout

LAYOUT = StateLayout(("v", "w", "c"))
DIM = LAYOUT.error_dim


class LinearProcess:
    """x' = F x + G noise; F is I + dt A with a fixed A."""

    def __init__(self, generator):
        self.layout = LAYOUT
        self.rate = 0.3 * generator.standard_normal((DIM, DIM))
        self.noise = 0.1 * generator.standard_normal((DIM, 4))

    def matrix(self, dt):
        return np.eye(DIM) + dt * self.rate

    def step(self, x, dt):
        return x @ self.matrix(dt).T

    def linearise(self, x, dt):
        return self.step(x, dt), self.matrix(dt), np.sqrt(dt) * self.noise


class LinearSensor(MeasurementModel):
    """z = (v + 2 w, c_x, p) with the parameters p = (offset, standard deviation)."""

    name = "linear"
    dim = 4
    value_dim = 4
    parameter_dim = 2
    needs = ("v", "w", "c")

    def symbolic(self, state, parameters):
        return ca.vertcat(state["v"] + 2 * state["w"], state["c"][0] + parameters[0])

    def noise_factor(self, state, parameters):
        return parameters[1] * ca.DM([[1, 0, 0, 0], [0.2, 1, 0, 0], [0, 0, 2, 0], [0, 0.1, 0, 1]])


MATRIX = np.zeros((4, DIM))
MATRIX[:3, :3], MATRIX[:3, 3:6], MATRIX[3, 6] = np.eye(3), 2 * np.eye(3), 1.0
NOISE_FACTOR = np.array([[1, 0, 0, 0], [0.2, 1, 0, 0], [0, 0, 2, 0], [0, 0.1, 0, 1]])
