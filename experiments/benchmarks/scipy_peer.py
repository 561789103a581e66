"""SciPy's `least_squares` on the smoothing problem.

With an analytic sparse Jacobian: the same whitened rows from the same trial.
Unknowns are errors about the trial: of every frame's moving blocks, of the constants, of every landmark. `least_squares` adds them
up, so the derivative of the error about the present point by that about the trial stands between its rows and its unknowns.
"""

from itertools import pairwise
from typing import Any, Final, cast

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import least_squares
from scipy.sparse import csr_matrix

from experiments.benchmarks.motion_rows import MOVING, POSE, prior_rows, step_rows
from experiments.benchmarks.smoother_workload import PeerResult, Workload, whitened_cost
from experiments.benchmarks.stacked_errors import StackedErrors
from experiments.benchmarks.stopwatch import now
from spinfilters.smoother.landmark_factors import linearise_observations

OPTIONS: Final[dict[str, Any]] = {
    "method": "trf",
    "tr_solver": "lsmr",
    "tr_options": {"atol": 1e-7, "btol": 1e-7},
    "x_scale": "jac",
    "ftol": 1e-6,
    "max_nfev": 200,
}
"""The one method for large sparse problems ("lm" and "exact" are dense), unknowns scaled by their columns of the Jacobian. With
LSMR's default tolerances, 1e-6, it is no faster and ends 0.35 above the optimum."""


def scipy_least_squares(workload: Workload) -> PeerResult:
    """Batch solution from the trial."""
    problem = WhitenedProblem(workload)
    begin = now()
    start, solve = np.zeros(problem.size), cast(Any, least_squares)
    found = solve(problem.residuals, start, problem.jacobian, **OPTIONS)
    seconds = now() - begin
    states, points = problem.point(found.x)
    cost = whitened_cost(workload, states, points)
    return PeerResult(
        "SciPy least_squares", states, points, cost, seconds, problem.seconds, found.nfev, float(found.njev)
    )


class WhitenedProblem:
    """Residuals and sparse derivative about the trial.

    They are at a vector of errors; ``seconds`` counts the time that they take.
    """

    def __init__(self, workload: Workload) -> None:
        self.seconds = 0.0
        self.workload = workload
        self._unknowns = StackedErrors(workload.layout, len(workload.timeline))
        self.size = self._unknowns.size + 3 * len(workload.trial.ids)
        self._indices, self._indptr = self._pattern()
        self._trial = workload.trial.trajectory.copy()
        constants = slice(workload.layout.mean_slice("w").stop, None)
        self._trial[:, constants] = self._trial[0, constants]
        self._where = np.full(self.size, np.nan)
        self._rows = (np.zeros(0), csr_matrix((0, 0)))

    def residuals(self, errors: Float[np.ndarray, " N"]) -> Float[np.ndarray, " r"]:
        """Residuals of prior, steps and observations, whitened."""
        return self._at(errors)[0]

    def jacobian(self, errors: Float[np.ndarray, " N"]) -> csr_matrix:
        """Jacobian of the residuals by the errors about the trial."""
        return self._at(errors)[1]

    def point(
        self, errors: Float[np.ndarray, " N"]
    ) -> tuple[Float[np.ndarray, "k m"], Float[np.ndarray, "L 3"]]:
        """Trajectory and landmarks (m, frame g) at these errors about the trial."""
        states, of_points = np.split(errors, [self._unknowns.size])
        trajectory = self.workload.layout.retract(self._trial, self._unknowns.errors(states))
        return trajectory, self.workload.trial.points + of_points.reshape(-1, 3)

    def _at(self, errors: Float[np.ndarray, " N"]) -> tuple[Float[np.ndarray, " r"], csr_matrix]:
        """Residuals and derivative, kept for the next call.

        A solver asks for the derivative where it has seen the residuals.
        """
        if not np.array_equal(errors, self._where):
            begin = now()
            trajectory, points = self.point(errors)
            own = self._unknowns.errors(errors[: self._unknowns.size])
            resets = np.array([self.workload.layout.reset_jacobian(error) for error in own])
            motion, observations = (
                self._motion(trajectory, resets),
                self._observations(trajectory, points, resets),
            )
            residuals = np.concatenate([part[0] for part in (*motion, observations)])
            data = np.concatenate([part[1].reshape(-1) for part in (*motion, observations)])
            shape = (len(residuals), self.size)
            self._rows = (residuals, csr_matrix((data, self._indices, self._indptr), shape=shape))
            self._where = errors.copy()
            self.seconds += now() - begin
        return self._rows

    def _motion(
        self, trajectory: Float[np.ndarray, "k m"], resets: Float[np.ndarray, "k n n"]
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        process, epochs = self.workload.process, self.workload.timeline
        residual, by_error = prior_rows(process.layout, trajectory[0], self.workload.prior)
        parts = [(residual, by_error @ resets[0])]
        n = process.layout.error_dim
        for k, (here, there) in enumerate(pairwise(epochs)):
            residual, by_error = step_rows(process, trajectory[k], trajectory[k + 1], there.time - here.time)
            by_there = by_error[:, n:] @ resets[k + 1, :MOVING, :MOVING]
            parts.append((residual, np.concatenate([by_error[:, :n] @ resets[k], by_there], axis=1)))
        return parts

    def _observations(
        self,
        trajectory: Float[np.ndarray, "k m"],
        points: Float[np.ndarray, "L 3"],
        resets: Float[np.ndarray, "k n n"],
    ) -> tuple[Float[np.ndarray, " r"], Float[np.ndarray, "N 3 9"]]:
        linear = linearise_observations(self.workload.observations, trajectory, points)
        by_pose = linear.rows[:, :, :POSE] @ resets[self.workload.observations.epoch, :POSE, :POSE]
        by_both = np.concatenate([by_pose, linear.rows[:, :, POSE:-1]], axis=2)
        return -linear.innovation.reshape(-1), by_both

    def _pattern(self) -> tuple[Int[np.ndarray, " e"], Int[np.ndarray, " r"]]:
        """Columns of every row in the order of the data, and where rows begin in it."""
        ordering, seen = self._unknowns, self.workload.observations
        first = ordering.state(0)
        columns, lengths = [np.tile(first, len(first))], [np.full(len(first), len(first))]
        for k in range(ordering.epochs - 1):
            both = np.concatenate([ordering.state(k), ordering.state(k + 1)[:MOVING]])
            columns.append(np.tile(both, MOVING))
            lengths.append(np.full(MOVING, len(both)))
        poses = MOVING * seen.epoch[:, None] + np.arange(POSE)
        landmarks = ordering.size + 3 * seen.landmark[:, None] + np.arange(3)
        columns.append(np.repeat(np.concatenate([poses, landmarks], axis=1), 3, axis=0).reshape(-1))
        lengths.append(np.full(3 * len(seen.epoch), POSE + 3))
        return np.concatenate(columns), np.concatenate([[0], np.cumsum(np.concatenate(lengths))])
