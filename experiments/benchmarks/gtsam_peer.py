"""GTSAM on the whole smoothing problem.

Levenberg-Marquardt and dogleg from the trial, and one linear system for each ordering.
One thread: the wheels of GTSAM 4.3 come without TBB. Times are those of GTSAM's calls alone; factors are built before.
GTSAM 4.3's newer solvers (MULTIFRONTAL_SOLVER, and SfmLevenbergMarquardtOptimizer with or without its Schur complement) take
1.6 to 3.5 times as long here as MULTIFRONTAL_CHOLESKY, so they are left out; METIS is as fast as COLAMD.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from experiments.benchmarks.gtsam_chart import (
    MASS,
    GtsamChart,
    constants_key,
    gtsam,
    landmark_key,
    landmarks,
    pose_key,
    rates_key,
)
from experiments.benchmarks.gtsam_graph import MotionFactors, whole_graph
from experiments.benchmarks.smoother_workload import PeerResult, Workload, whitened_cost
from experiments.benchmarks.stopwatch import now

RELATIVE_TOLERANCE: Final = 1e-6
"""Of the cost, by which an iteration must improve it: at costs of 70,000 the last step is then worth less than 0.07."""
ITERATIONS: Final = 200
ORDERINGS: Final = ("colamd", "metis", "landmarks first")


@dataclass(frozen=True)
class LinearTime:
    """Median seconds of linearising and solving in one ordering.

    The share in Python is counted apart; ``epochs`` is the size of the problem.
    """

    epochs: int
    ordering: str
    linearise: float
    python: float
    solve: float

    @property
    def total(self) -> float:
        """Time of one Gauss-Newton iteration, s."""
        return self.linearise + self.solve


def levenberg_marquardt(workload: Workload) -> PeerResult:
    """Batch solution from the trial with GTSAM's own defaults for the damping."""

    def make(graph: Any, start: Any) -> Any:
        """Make the optimiser of a graph."""
        parameters = _with_tolerances(gtsam.LevenbergMarquardtParams())
        return gtsam.LevenbergMarquardtOptimizer(graph, start, parameters)

    return _batch(workload, "GTSAM LM", make)


def ceres_like(workload: Workload) -> PeerResult:
    """Batch solution with the damping that Ceres has."""

    def make(graph: Any, start: Any) -> Any:
        """Make the optimiser of a graph."""
        parameters = _with_tolerances(gtsam.LevenbergMarquardtParams.CeresDefaults())
        return gtsam.LevenbergMarquardtOptimizer(graph, start, parameters)

    return _batch(workload, "GTSAM LM, Ceres' damping", make)


def dogleg(workload: Workload) -> PeerResult:
    """Batch solution by Powell's dogleg.

    It finds its way from a trial with a poor body where damping creeps.
    """

    def make(graph: Any, start: Any) -> Any:
        """Make the optimiser of a graph."""
        return gtsam.DoglegOptimizer(graph, start, _with_tolerances(gtsam.DoglegParams()))

    return _batch(workload, "GTSAM dogleg", make)


def linear_times(workload: Workload, epochs: Sequence[int], repeats: int = 5) -> list[LinearTime]:
    """Times of one linearisation and one Gauss-Newton step.

    About the trial, for each number of frames and each ordering.
    """
    return [time for count in epochs for time in GtsamLinearSystem(workload.first(count)).times(repeats)]


class GtsamLinearSystem:
    """The linear systems of a workload about its trial."""

    def __init__(self, workload: Workload) -> None:
        self._workload, self._chart = workload, chart_of(workload)
        self._factors = MotionFactors(workload, self._chart)
        self._graph = whole_graph(workload, self._factors)
        self._orderings: list[Any] = []
        self._nudge = 0.0

    def times(self, repeats: int) -> list[LinearTime]:
        """Medians in every ordering."""
        medians = np.median([self._once() for _ in range(repeats)], axis=0).tolist()
        epochs = len(self._workload.timeline)
        return [LinearTime(epochs, name, *row) for name, row in zip(ORDERINGS, medians, strict=True)]

    def _once(self) -> list[tuple[float, float, float]]:
        """Every time at another point, so that no row is kept from the last."""
        self._nudge += 1e-9
        trajectory = self._workload.trial.trajectory.copy()
        trajectory[:, 0] += self._nudge
        values = self._chart.values(trajectory, self._workload.trial.points)
        before, begin = self._factors.clock.seconds, now()
        linear = self._graph.linearize(values)
        linearise, python = now() - begin, self._factors.clock.seconds - before
        self._orderings = self._orderings or _orderings(self._workload, linear)
        rows = []
        for ordering in self._orderings:
            begin = now()
            linear.optimize(ordering)
            rows.append((linearise, python, now() - begin))
        return rows


def chart_of(workload: Workload) -> GtsamChart:
    """GTSAM chart about the body of the trial."""
    return GtsamChart(workload.layout, workload.trial.trajectory[0, MASS])


def _with_tolerances(parameters: Any) -> Any:
    parameters.setMaxIterations(ITERATIONS)
    parameters.setRelativeErrorTol(RELATIVE_TOLERANCE)
    return parameters


def _batch(workload: Workload, name: str, make: Callable[[Any, Any], Any]) -> PeerResult:
    chart = chart_of(workload)
    factors = MotionFactors(workload, chart)
    graph = whole_graph(workload, factors)
    start = chart.values(workload.trial.trajectory, workload.trial.points)
    begin = now()
    optimizer = make(graph, start)
    found = optimizer.optimize()
    seconds = now() - begin
    count, clock = len(workload.timeline), factors.clock
    trajectory, points = chart.trajectory(found, count), landmarks(found, len(workload.trial.ids))
    cost = whitened_cost(workload, trajectory, points)
    rounds = clock.linearisations / count
    return PeerResult(name, trajectory, points, cost, seconds, clock.seconds, optimizer.iterations(), rounds)


def _orderings(workload: Workload, linear: Any) -> list[Any]:
    """Orderings of `ORDERINGS`: two of GTSAM's, and landmarks first (the Schur complement)."""
    epochs = range(len(workload.timeline))
    schur = gtsam.Ordering()
    keys = [landmark_key(number) for number in range(len(workload.trial.ids))]
    keys += [rates_key(k) for k in epochs] + [pose_key(k) for k in epochs] + [constants_key()]
    for key in keys:
        schur.push_back(key)
    ordering = gtsam.Ordering
    return [ordering.ColamdGaussianFactorGraph(linear), ordering.MetisGaussianFactorGraph(linear), schur]
