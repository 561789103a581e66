"""Small recordings for smoothers: epochs, truth and map of a tumbling body, and where to set out from."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float
from swapped_ids import swapped

from spinfilters.core.robust_losses import LeastSquares, RobustLoss
from spinfilters.evaluation.consistency import true_states
from spinfilters.filters.timeline import CameraView, SensorNoise, Timeline, build_timeline
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.sensor_tables import KnownMap
from spinfilters.models.feature_tracks import RIG
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.smoother.problem import InitialGuess, Problem, Stage, problem_of
from spinfilters.smoother.sliding_smoother import SlidingSmoother, SmootherOptions
from spinfilters.smoother.solver import ConstantSchedule, GaussNewton, Solved, SolverOptions, StepRule, solve
from spinfilters.smoother.window import WindowPolicy

LAYOUT = StateLayout(FULL_BLOCKS)
PROCESS = TorqueFreeProcess(LAYOUT, ProcessNoise())
STD = np.repeat([1e-6, 1.0, 1.0, 0.5], [6, 6, 3, 5])
"""Of the first state, whose pose defines g."""
SMALL = Scenario.simplified(rate_rpm=RICH_RPM, epochs=5, landmarks=40)
MIDDLE = Scenario.simplified(rate_rpm=RICH_RPM, epochs=12, landmarks=150)
LONG = Scenario.simplified(rate_rpm=RICH_RPM, epochs=30, landmarks=120)
PLAIN = Stage(LeastSquares())
SOON = 0.2
"""Standard deviation of the mass distribution that these short recordings reach: with it epochs leave a window."""


@dataclass(frozen=True)
class Sample:
    """Epochs of observations, true states (k, m) and the true map; frame g is the simulator's."""

    epochs: Timeline
    truth: Float[np.ndarray, "k m"]
    known: KnownMap

    @property
    def prior(self) -> FirstStatePrior:
        """About the true first state."""
        return FirstStatePrior(self.truth[0], STD)

    @property
    def problem(self) -> Problem:
        """Of all epochs and landmarks."""
        return problem_of(PROCESS, self.epochs, self.known.ids, self.prior, 2)


@cache
def sample(scenario: Scenario, wrong: float = 0.0, pixel_std: float = 1.0) -> Sample:
    """A simulated recording as seen by a model with this pixel noise, in every epoch a share of the ids swapped."""
    dataset = simulate(scenario)
    assert dataset.truth is not None
    assert dataset.known_map is not None
    tracks = swapped(dataset.log.stream("stereo"), wrong, np.random.default_rng(scenario.seed))
    view = CameraView(None, RIG.calibration)
    epochs = build_timeline(MeasurementLog((tracks,)), LAYOUT, SensorNoise(pixel_std=pixel_std), view)
    return Sample(epochs, true_states(dataset.truth, LAYOUT), dataset.known_map)


def perturbed(here: Sample, seed: int, scale: float = 1.0) -> InitialGuess:
    """Off the truth by what perception and a poor start are off; the first pose defines g."""
    generator = np.random.default_rng(seed)
    std = scale * np.repeat([0.003, 0.01, 0.02, 0.05, 0.005, 0.3], [3, 3, 3, 3, 3, 5])
    errors = std * generator.standard_normal((len(here.truth), 20))
    errors[0, :6] = 0.0
    errors[:, 12:] = errors[0, 12:]
    points = here.known.points + 0.003 * scale * generator.standard_normal(here.known.points.shape)
    return InitialGuess(LAYOUT.retract(here.truth, errors), here.known.ids, points)


def solved(
    here: Sample, trial: InitialGuess, rule: StepRule | None = None, loss: RobustLoss | None = None
) -> Solved:
    """The problem of a sample solved from a trial."""
    whole = here.problem
    options = SolverOptions(80, settled=1e-6, rule=rule or GaussNewton())
    return solve(
        whole, whole.at(trial.trajectory, trial.points), options, ConstantSchedule(loss or LeastSquares())
    )


@cache
def optimum(scenario: Scenario) -> Solved:
    """The clean least-squares solution of a sample."""
    here = sample(scenario)
    return solved(here, InitialGuess(here.truth, here.known.ids, here.known.points))


def smoother(
    here: Sample, mode: WindowPolicy, std: Float[np.ndarray, " n"] = STD, rule: StepRule | None = None
) -> SlidingSmoother:
    """A sliding smoother that has seen nothing yet; its prior's mean is the truth."""
    options = SmootherOptions(mode, step_rule=rule or GaussNewton())
    return SlidingSmoother(PROCESS, FirstStatePrior(here.truth[0], std), options, has_landmarks=True)


def run(sliding: SlidingSmoother, epochs: Timeline) -> SlidingSmoother:
    """The smoother after these epochs."""
    for epoch in epochs:
        sliding.add(epoch)
    return sliding


def whitened(factor: Float[np.ndarray, "n n"], error: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """An error in standard deviations, direction by direction."""
    return np.linalg.solve(factor, error)
