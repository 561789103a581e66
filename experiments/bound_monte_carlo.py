"""Monte Carlo of the smoother against the Cramer-Rao bound.

The whole problem, landmarks and process noise included.
    python -m experiments.bound_monte_carlo [--runs 200] [--frames 40] [--landmarks 100] [--motion rich]

Every run draws a motion with its disturbances, landmarks, pixels and the mean of the prior, smooths all frames at once, and sets
the errors beside the standard deviations that the same problem has at the truth. Of each block of the state the ratio is the root
of the mean over runs, frames and components of (error / bound)^2; beside it its standard error over runs. The bar is 1 +- 0.1.
"""

import argparse
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float
from rich.console import Console
from rich.progress import track
from rich.table import Table

from experiments.benchmarks.smoother_workload import MOTIONS
from experiments.command_line import run_study
from spinfilters.core.robust_losses import LeastSquares
from spinfilters.evaluation.consistency import true_states
from spinfilters.filters.timeline import CameraView, SensorNoise, Timeline, build_timeline
from spinfilters.io.dataset import Dataset
from spinfilters.io.sensor_tables import KnownMap
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.models.state_blocks import BLOCKS
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.simulation.scenario import Scenario, simulate
from spinfilters.smoother.landmark_factors import OBSERVATIONS_NEEDED
from spinfilters.smoother.linear_system import Marginals
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.smoother.problem import Problem, Stage, problem_of
from spinfilters.smoother.solver import SolverOptions, solve

LAYOUT: Final = StateLayout(FULL_BLOCKS)
PRIOR_STD: Final = {"t": 1e-6, "a": 1e-6, "v": 0.05, "w": 0.2, "c": 0.1, "s": 0.5}
"""Of the first state, from which the prior's mean is drawn about the truth; the pose defines frame g."""
BAR: Final = 0.1
OPTIONS: Final = SolverOptions(settled=1e-3)

Squares = Mapping[str, Float[np.ndarray, " runs"]]
"""Of each block, every run's mean of (error / bound)^2."""


@dataclass(frozen=True)
class MonteCarloRecording:
    """One simulated recording: its frames with unknown landmarks, and what is true of them."""

    process: TorqueFreeProcess
    timeline: Timeline
    states: Float[np.ndarray, "k m"]
    known_map: KnownMap

    def problem(self, mean: Float[np.ndarray, " m"]) -> Problem:
        """Smoothing problem with a prior about this mean."""
        prior = FirstStatePrior(mean, prior_deviations())
        return problem_of(self.process, self.timeline, self.known_map.ids, prior, OBSERVATIONS_NEEDED)


def main() -> None:
    """Run and print."""
    options = _options()
    scenario = Scenario.simplified(
        rate_rpm=MOTIONS[options.motion], epochs=options.frames, landmarks=options.landmarks
    )
    if options.runs < 2:
        raise SystemExit(f"--runs {options.runs}: give at least 2, the scatter is what is asked for")
    squares = monte_carlo(scenario, range(options.runs), lambda seeds: track(seeds, "runs", transient=True))
    Console(width=100).print(ratio_table(squares, f"{options.motion} motion, {options.frames} frames"))


def monte_carlo(
    scenario: Scenario, seeds: Iterable[int], follow: Callable[[Iterable[int]], Iterable[int]] = iter
) -> Squares:
    """Squares of every seed's run."""
    runs = [normalised_squares(replace(scenario, seed=seed)) for seed in follow(seeds)]
    return {block: np.array([run[block] for run in runs]) for block in LAYOUT.blocks}


def normalised_squares(scenario: Scenario) -> dict[str, float]:
    """One run's mean of (error / bound)^2 of each block.

    Poses from the second frame on, as the first defines g.
    """
    recording = recorded(simulate(scenario), scenario)
    generator = np.random.default_rng([scenario.seed, 1])
    drawn = LAYOUT.retract(
        recording.states[0], prior_deviations() * generator.standard_normal(LAYOUT.error_dim)
    )
    bound = bound_at_truth(recording)
    square = (smoothed_errors(recording, drawn) / bound) ** 2
    return {b: float(square[1 if b in "ta" else 0 :, LAYOUT.slice(b)].mean()) for b in LAYOUT.blocks}


def recorded(dataset: Dataset, scenario: Scenario) -> MonteCarloRecording:
    """Smoother's input from a data set, with the truth."""
    assert dataset.truth is not None
    assert dataset.known_map is not None
    assert dataset.rig is not None
    noise, view = SensorNoise(pixel_std=scenario.pixel_std), CameraView(None, dataset.rig.calibration)
    return MonteCarloRecording(
        TorqueFreeProcess(LAYOUT, scenario.noise),
        build_timeline(dataset.log, LAYOUT, noise, view),
        true_states(dataset.truth, LAYOUT),
        dataset.known_map,
    )


def bound_at_truth(recording: MonteCarloRecording) -> Float[np.ndarray, "k n"]:
    """Standard deviation of every error component of every frame, given all measurements."""
    problem = recording.problem(recording.states[0])
    normal = problem.normal(problem.at(recording.states, recording.known_map.points), Stage(LeastSquares()))
    return np.linalg.norm(Marginals(normal.system, normal.eliminated).factors, axis=2)


def smoothed_errors(
    recording: MonteCarloRecording, prior_mean: Float[np.ndarray, " m"]
) -> Float[np.ndarray, "k n"]:
    """Errors of the smoother from the truth.

    It sets out from there so that no other minimum is in question.
    """
    problem = recording.problem(prior_mean)
    solved = solve(problem, problem.at(recording.states, recording.known_map.points), OPTIONS)
    assert solved.converged
    return LAYOUT.local(recording.states, solved.point.trajectory)


def prior_deviations() -> Float[np.ndarray, " n"]:
    """`PRIOR_STD` of every error component."""
    std = np.empty(LAYOUT.error_dim)
    for block, value in PRIOR_STD.items():
        std[LAYOUT.slice(block)] = value
    return std


def ratio(squares: Float[np.ndarray, " runs"]) -> tuple[float, float]:
    """Root of the mean, and its standard error over runs."""
    root = float(np.sqrt(squares.mean()))
    return root, float(squares.std(ddof=1) / np.sqrt(len(squares)) / (2 * root))


def ratio_table(squares: Squares, title: str) -> Table:
    """A row per block."""
    runs = len(next(iter(squares.values())))
    table = Table(title=f"Errors of the smoother over the Cramer-Rao bound, {runs} runs, {title}")
    for heading in ("block", "ratio", "standard error", f"bar 1 +- {BAR:g}"):
        table.add_column(heading, justify="left" if heading == "block" else "right")
    for block, values in squares.items():
        root, error = ratio(values)
        verdict = "met" if abs(root - 1) <= BAR else "not met"
        table.add_row(BLOCKS[block].label, f"{root:.3f}", f"{error:.3f}", verdict)
    return table


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--landmarks", type=int, default=100)
    parser.add_argument("--motion", choices=MOTIONS, default="rich")
    return parser.parse_args()


if __name__ == "__main__":
    run_study(main)
