"""The project's own smoother on the benchmark's problem.

Whole, one iteration of it, and frame after frame.
Times hold everything from frames and models to the result, the collecting of observations among it.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from experiments.benchmarks.gtsam_chart import CENTRE
from experiments.benchmarks.smoother_workload import PeerResult, Workload, whitened_cost
from experiments.benchmarks.stopwatch import now
from spinfilters.core.robust_losses import LeastSquares
from spinfilters.smoother.problem import Stage, with_common_constants
from spinfilters.smoother.sliding_smoother import SlidingSmoother, SmootherOptions
from spinfilters.smoother.solver import GaussNewton, Solved, SolverOptions, solve
from spinfilters.smoother.window import FixedLag, FullSmoothing

NO_GATE: Final = 1e6
"""Standard deviations: every observation is believed, as the peers do."""
RUNS: Final = 3
"""Of a turn: as short as they are, one alone would measure what another solver left in the processor's caches."""


def own_batch(workload: Workload) -> PeerResult:
    """Gauss-Newton from the trial to the optimum; the median time of some runs."""
    runs = [_solved(workload) for _ in range(RUNS)]
    solved, seconds = runs[-1][0], float(np.median([seconds for _, seconds in runs]))
    trajectory, points = solved.point.trajectory, solved.point.points
    cost = whitened_cost(workload, trajectory, points)
    rounds = float(solved.linearisations)
    return PeerResult("spinfilters", trajectory, points, cost, seconds, 0.0, solved.iterations, rounds)


def _solved(workload: Workload) -> tuple[Solved, float]:
    """And how many seconds it took."""
    start = with_common_constants(workload.layout, workload.trial.trajectory)
    begin = now()
    problem = workload.problem()
    solved = solve(problem, problem.at(start, workload.trial.points), SolverOptions())
    return solved, now() - begin


class OwnIterations:
    """Single Gauss-Newton iterations about the trial of a workload: linearise, eliminate, solve, substitute back."""

    def __init__(self, workload: Workload) -> None:
        self._problem, self._points = workload.problem(), workload.trial.points
        self._start = with_common_constants(workload.layout, workload.trial.trajectory)

    def seconds(self, runs: int) -> float:
        """Median of some runs after one more."""
        return float(np.median([self._once(1e-9 * k) for k in range(runs + 1)][1:]))

    def _once(self, nudge: float) -> float:
        trajectory = self._start.copy()
        trajectory[:, 0] += nudge
        begin = now()
        normal = self._problem.normal(self._problem.at(trajectory, self._points), Stage(LeastSquares()))
        step = GaussNewton().propose(lambda _: normal, self._problem.layout, 1.0)
        seconds = now() - begin
        assert step is not None
        return seconds


def own_resolved(workload: Workload) -> PeerResult:
    """Own smoother with everything solved again after every epoch."""
    return _through(workload, SmootherOptions(FullSmoothing(), gate=NO_GATE), "spinfilters, full")


def own_window(workload: Workload, lag: int, marginalized: bool = False) -> PeerResult:
    """The own smoother with a window of so many frames.

    At least, for some leave together; its cost says nothing, see `gtsam_incremental.fixed_lag`.

    Parameters
    ----------
    marginalized: whether every frame that leaves is given its covariance, which the peer does not do.
    """
    options = SmootherOptions(FixedLag(lag), gate=NO_GATE, marginalized=marginalized)
    runs = [_through(workload, options, f"spinfilters, fixed lag of {lag}") for _ in range(RUNS)]
    return replace(runs[-1], seconds=float(np.median([run.seconds for run in runs])))


def _through(workload: Workload, options: SmootherOptions, name: str) -> PeerResult:
    """Every frame through the sliding smoother, without a guess."""
    smoother = SlidingSmoother(workload.process, workload.prior, options, has_landmarks=True)
    trajectory, points = (
        np.tile(workload.prior.mean, (len(workload.timeline), 1)),
        workload.trial.points.copy(),
    )
    seconds, rounds = 0.0, 0
    for number, frame in enumerate(workload.timeline, start=1):
        begin = now()
        rounds += smoother.add(frame).linearisations
        seconds += now() - begin
        states = smoother.window.trajectory
        trajectory[number - len(states) : number] = states
    trajectory[:, CENTRE.start :] = trajectory[-1, CENTRE.start :]
    points[np.searchsorted(workload.trial.ids, smoother.window.ids)] = smoother.window.points
    cost = whitened_cost(workload, trajectory, points)
    return PeerResult(name, trajectory, points, cost, seconds, 0.0, len(trajectory), float(rounds))
