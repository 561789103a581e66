"""Normal equations of a motion over the first frames: its dynamics, its prior, and every sensor that sees no landmark.

Unknowns are the errors about a trial trajectory x_0 .. x_K-1: of each frame's moving blocks (t, a, v, w: 12 numbers), frame after
frame, then once of the blocks that are constant (c, s and d). With the defect b_k by which the trial misses its own dynamics

    e_k+1 = Phi e_k + b_k + G n,     (e_0 about x_0) = (prior mean [-] x_0) + std n,

each line divided by its noise is a row of a least-squares problem (Bell 1994).
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import solve_triangular

from spinfilters.errors import InputError
from spinfilters.estimators.estimator import Measurement, ProcessModel
from spinfilters.estimators.first_frames import FirstStatePrior
from spinfilters.estimators.gain import triangular_factor
from spinfilters.estimators.multiplicative_filter import usable
from spinfilters.estimators.timeline import Frame, Timeline
from spinfilters.state.layout import StateLayout

MOVING = 12
"""Error components of t, a, v, w, which lead every layout that has a place."""
POSE = 6
"""Of them, t and a."""
NOISE_FLOOR = 1e-8
"""Of every moving component per step (m, rad, m/s, rad/s): far below any sensor, it stands in where a disturbance is zero."""


@dataclass(frozen=True)
class Unknowns:
    """Where the errors of ``frames`` frames over a layout stand in one vector."""

    layout: StateLayout
    frames: int

    def __post_init__(self) -> None:
        if self.layout.blocks[:4] != ("t", "a", "v", "w"):
            raise InputError(
                f"landmarks need a state with blocks t, a, v, w, the layout has {self.layout.blocks}"
            )

    @property
    def size(self) -> int:
        """Number of unknowns: 12 per frame and the constants."""
        return MOVING * self.frames + self.layout.error_dim - MOVING

    @property
    def poses(self) -> Int[np.ndarray, " p"]:
        """Of t and a of every frame, frame after frame."""
        return (MOVING * np.arange(self.frames)[:, None] + np.arange(POSE)).reshape(-1)

    def state(self, frame: int) -> Int[np.ndarray, " n"]:
        """Of the whole error of one frame's state; frame -1 is the last."""
        first = MOVING * (frame % self.frames)
        return np.r_[first : first + MOVING, MOVING * self.frames : self.size]

    def errors(self, step: Float[np.ndarray, " N"]) -> Float[np.ndarray, "k n"]:
        """Each frame's error."""
        moving = step[: MOVING * self.frames].reshape(self.frames, MOVING)
        constant = np.tile(step[MOVING * self.frames :], (self.frames, 1))
        return np.concatenate([moving, constant], axis=1)


@dataclass
class NormalEquations:
    """Sums over whitened rows J e = y: J'J, J'y, y'y, and how many scalar measurements of sensors were among them."""

    information: Float[np.ndarray, "N N"]
    gradient: Float[np.ndarray, " N"]
    cost: float
    measured: int

    @classmethod
    def none(cls, size: int) -> "NormalEquations":
        """No row yet."""
        return cls(np.zeros((size, size)), np.zeros(size), 0.0, 0)

    def plus(self, other: "NormalEquations", weight: float) -> "NormalEquations":
        """With the rows of another, whose squares count with this weight."""
        return NormalEquations(
            self.information + weight * other.information,
            self.gradient + weight * other.gradient,
            self.cost + weight * other.cost,
            self.measured + other.measured,
        )

    def add(
        self, where: Int[np.ndarray, " c"], J: Float[np.ndarray, "r c"], y: Float[np.ndarray, " r"]
    ) -> None:
        """More rows, over the unknowns ``where``."""
        self.information[np.ix_(where, where)] += J.T @ J
        self.gradient[where] += J.T @ y
        self.cost += float(y @ y)


def sensor_equations(
    process: ProcessModel, frames: Timeline, trajectory: Float[np.ndarray, "k m"], prior: FirstStatePrior
) -> NormalEquations:
    """The prior, and every sensor that sees no landmark."""
    unknowns = Unknowns(process.layout, len(frames))
    equations = NormalEquations.none(unknowns.size)
    equations.add(unknowns.state(0), *_prior_rows(process.layout, trajectory[0], prior))
    for k, frame in enumerate(frames):
        _add_sensors(equations, unknowns.state(k), frame, trajectory[k])
    return equations


def dynamics_equations(
    process: ProcessModel, frames: Timeline, trajectory: Float[np.ndarray, "k m"]
) -> NormalEquations:
    """The steps from frame to frame, about a trajectory whose constants are the same in every frame."""
    unknowns = Unknowns(process.layout, len(frames))
    equations = NormalEquations.none(unknowns.size)
    for k, (here, there) in enumerate(pairwise(frames)):
        both = np.concatenate([unknowns.state(k), unknowns.state(k + 1)[:MOVING]])
        equations.add(both, *_step_rows(process, trajectory[k], trajectory[k + 1], there.time - here.time))
    return equations


def _prior_rows(
    layout: StateLayout, first: Float[np.ndarray, " m"], prior: FirstStatePrior
) -> tuple[np.ndarray, np.ndarray]:
    """The error about the prior's mean, where the prior is Gaussian, by the error about the trial."""
    away = layout.local(prior.mean, first)
    by_trial = np.linalg.inv(layout.reset_jacobian(away))
    return by_trial / prior.std[:, None], -away / prior.std


def _step_rows(
    process: ProcessModel, here: Float[np.ndarray, " m"], there: Float[np.ndarray, " m"], dt: float
) -> tuple[np.ndarray, np.ndarray]:
    layout = process.layout
    moved, transition, noise = process.linearise(here, dt)
    defect = layout.local(there, moved)
    turn = np.linalg.inv(layout.reset_jacobian(defect))[:MOVING]
    root = triangular_factor(np.concatenate([(turn @ noise).T, NOISE_FLOOR * np.eye(MOVING)]))
    rows = np.concatenate([-turn @ transition, np.eye(MOVING), defect[:MOVING, None]], axis=1)
    rows = solve_triangular(root, rows, lower=True, check_finite=False)
    return rows[:, :-1], rows[:, -1]


def _add_sensors(
    equations: NormalEquations, where: Int[np.ndarray, " n"], frame: Frame, x: Float[np.ndarray, " m"]
) -> None:
    for measurement in frame.measurements:
        if measurement.ids is None:
            innovation, jacobian = _sensor_rows(measurement, x)
            equations.add(where[measurement.model.columns], jacobian, innovation)
            equations.measured += len(innovation)


def _sensor_rows(measurement: Measurement, x: Float[np.ndarray, " m"]) -> tuple[np.ndarray, np.ndarray]:
    model = measurement.model
    innovation, jacobian, valid, _ = model.linearise(x, measurement.parameters, measurement.values)
    keep = usable(innovation, valid)
    return innovation[keep].reshape(-1), jacobian[keep].reshape(-1, len(model.columns))
