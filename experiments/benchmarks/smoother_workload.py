"""The smoothing problem of the benchmark.

115 frames of a tumbling body with some 2450 landmarks that nobody knows.
Simulated, so that anyone can run it: `Scenario.common_workload` from a seed, with about 24,700 stereo observations of 1 px.
Priors are the
thesis' with 0.5 for the logarithm of second moments, and the first pose is held where frame g is defined. The initial guess comes
from poses fitted one by one and the closed form of the angular momentum, over all frames.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.filters.timeline import CameraView, SensorNoise, Timeline, build_timeline
from spinfilters.inference.initial_estimate import defining_g, guessed_trajectory, wide_prior
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.sensor import pose_samples
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.models.tracks.map_building import poses_without_map
from spinfilters.settings.run_settings import InitialisationOptions
from spinfilters.simulation.scenario import RICH_RPM, THESIS_RPM, Scenario, simulate
from spinfilters.smoother.closed_form import initial_motion, initial_state
from spinfilters.smoother.landmark_factors import (
    OBSERVATIONS_NEEDED,
    LandmarkObservations,
    collect_observations,
)
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.smoother.problem import InitialGuess, Problem, problem_of

MOTIONS: Final = {"thesis": THESIS_RPM, "rich": RICH_RPM}
NOISE: Final = ProcessNoise(force_psd=1e-6, torque_psd=1e-6)
OPTIONS: Final = InitialisationOptions(mass_std=0.5)
"""Priors of the thesis; with a mass_std of 2 and more, solvers end in wrong minima."""
PIXEL_STD: Final = 1.0


@dataclass(frozen=True)
class Workload:
    """One problem and where every solver sets out from.

    Attributes
    ----------
    calibration: of the rig (fx, fy, cx, cy px, baseline m).
    trial: its landmarks are those that are seen at least twice, ids ascending.
    observations: N of them; their landmarks count the trial's.
    """

    process: TorqueFreeProcess
    timeline: Timeline
    calibration: Float[np.ndarray, " 5"]
    prior: FirstStatePrior
    trial: InitialGuess
    observations: LandmarkObservations

    @property
    def layout(self) -> StateLayout:
        """Blocks t, a, v, w, c, s."""
        return self.process.layout

    @property
    def values(self) -> Float[np.ndarray, "N 3"]:
        """Measured pixels (u_left, v_left, u_right) of the observations."""
        return np.concatenate([group.values for group in self.observations.groups])

    def problem(self) -> Problem:
        """Problem as the project's own smoother has it."""
        return problem_of(self.process, self.timeline, self.trial.ids, self.prior, OBSERVATIONS_NEEDED)

    def nearer_to_a_sphere(self, share: float) -> "Workload":
        """The same problem from a trial nearer to a sphere.

        It keeps only a share of the closed form's departure from one.
        On the thesis' motion the closed form's body is poor, and damped solvers creep for 20 to 60 iterations from all of it.
        """
        trajectory = self.trial.trajectory.copy()
        trajectory[:, self.layout.mean_slice("s")] *= share
        return replace(self, trial=InitialGuess(trajectory, self.trial.ids, self.trial.points))

    def first(self, epochs: int) -> "Workload":
        """The same problem with the first frames alone, from the same trial."""
        trial = InitialGuess(self.trial.trajectory[:epochs], self.trial.ids, self.trial.points)
        return _joined(self.process, self.timeline[:epochs], self.calibration, self.prior, trial)


@dataclass(frozen=True)
class PeerResult:
    """Result of a peer solver, and its cost.

    Attributes
    ----------
    cost: `whitened_cost` there.
    seconds: in the solver, by the clock of `stopwatch`.
    python: of these, inside the project's own Python, which a solver calls for rows of the motion, s.
    iterations, linearisations: of the whole problem; 0 where a solver has no such number.
    """

    name: str
    trajectory: Float[np.ndarray, "k m"]
    points: Float[np.ndarray, "L 3"]
    cost: float
    seconds: float
    python: float
    iterations: int = 0
    linearisations: float = 0.0


def simulated_workload(scenario: Scenario) -> Workload:
    """The problem of a simulated recording of stereo tracks."""
    dataset = simulate(scenario)
    assert dataset.rig is not None
    calibration, layout = dataset.rig.calibration, StateLayout(FULL_BLOCKS)
    timeline = build_timeline(
        dataset.log, layout, SensorNoise(pixel_std=PIXEL_STD), CameraView(None, calibration)
    )
    poses, known, _ = poses_without_map(dataset.log.stream("stereo"), calibration, PIXEL_STD)
    evidence = initial_motion(pose_samples(poses), len(timeline))
    first, _ = initial_state(layout, evidence)
    trajectory = guessed_trajectory(layout, timeline, first, evidence)
    prior = defining_g(layout, wide_prior(layout, first, OPTIONS, evidence), trajectory[0])
    trial = InitialGuess(trajectory, known.ids, known.points)
    return _joined(TorqueFreeProcess(layout, NOISE), timeline, calibration, prior, trial)


def disam115_workload(motion: str, seed: int) -> Workload:
    """The problem of the issue: motion "thesis" or "rich"."""
    return simulated_workload(Scenario.common_workload(MOTIONS[motion], seed))


def whitened_cost(
    workload: Workload, trajectory: Float[np.ndarray, "k m"], points: Float[np.ndarray, "L 3"]
) -> float:
    """Sum of all whitened squares.

    Prior, steps, observations; by this number all optima are compared.
    It is infinite where a point lies behind a camera that saw it.

    Parameters
    ----------
    trajectory: constants the same in every frame.   points: of the trial's landmarks, m, frame g.
    """
    here = workload.problem().at(trajectory, points)
    assert here.linear is not None
    return here.sensors.cost + here.dynamics.cost + float(here.linear.square.sum())


def _joined(
    process: TorqueFreeProcess,
    timeline: Timeline,
    calibration: Float[np.ndarray, " 5"],
    prior: FirstStatePrior,
    trial: InitialGuess,
) -> Workload:
    """Problem with the trial's landmarks that are seen at least twice."""
    every = collect_observations(timeline, trial.ids, OBSERVATIONS_NEEDED)
    kept = np.unique(every.landmark)
    trial = InitialGuess(trial.trajectory, trial.ids[kept], trial.points[kept])
    observations = collect_observations(timeline, trial.ids, OBSERVATIONS_NEEDED)
    return Workload(process, timeline, calibration, prior, trial, observations)
