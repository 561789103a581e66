"""Do filters gain information about the frame g, which nothing observes? Every gauge rule, over seeds.

    python -m experiments.gauge_information [--seeds 8] [--motion rich|thesis] [--estimators mekf ukf] [-o runs/gauge]

Where g lies in the body is a definition. A filter that starts with a covariance P_c + sigma^2 N N' (N: the six gauge directions
at its first mean) may never know more along N than it did: with N_k the directions at its mean of frame k, landmarks included,
the largest eigenvalue of the information N_k' P_k^-1 N_k relative to that of the start, minus 1, is its growth. Process noise
may make it negative. Prints the largest growth over frames and seeds of every rule, beside mean NEES and errors in the second
half that do not depend on g; draws growth over frames. The first error is drawn from the whole prior, so that NEES has 20
degrees of freedom.
"""

import argparse
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.linalg import eigh, solve_triangular

from spinfilters.attitude.conversions import rotate
from spinfilters.dynamics.mass_distribution import inertia_matrix
from spinfilters.estimators.landmarks.approximation import FirstOrder
from spinfilters.estimators.landmarks.gauge_rules import GAUGE_RULES, Point
from spinfilters.estimators.landmarks.landmark_filter import LandmarkFilter
from spinfilters.estimators.landmarks.landmark_map import LandmarkOptions
from spinfilters.estimators.landmarks.unscented import Unscented
from spinfilters.estimators.timeline import SensorNoise, StereoView, Timeline, build_timeline
from spinfilters.evaluation.consistency import chi_square_band, true_states
from spinfilters.logs.atomic_write import make_folder
from spinfilters.models.gauge import gauge_directions
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.plots.style import BLUE, GREEN, ORANGE, RED, save_figure, tidy
from spinfilters.simulation.scenario import RICH_RPM, THESIS_RPM, Scenario, simulate, without_map
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import FULL_BLOCKS, StateLayout

LAYOUT = StateLayout(FULL_BLOCKS)
PROCESS = TorqueFreeProcess(LAYOUT, ProcessNoise(force_psd=1e-6, torque_psd=1e-6), 1e-8)
START_STD = np.repeat([1e-6, 1e-6, 0.002, 0.003, 0.002, 0.01], [3, 3, 3, 3, 3, 5])
"""Of P_c, in which g is the true one."""
SIGMAS = (1e-6, 1e-3, 1e-2)
"""Of the prior along N, rad and m."""
LARGEST_GROWTH = 1e-6
"""Beyond it a filter has taken something for information about g."""
ERRORS = {"position [mm]": 1e3, "velocity [mm/s]": 1e3, "rate [mrad/s]": 1e3, "moments [1e-3]": 1e3}
"""Errors in frame i of the centre of mass, and of the principal moments (largest 1); their scales."""
MOTIONS = {"rich": RICH_RPM, "thesis": THESIS_RPM}
APPROXIMATIONS = {"mekf": FirstOrder, "ukf": Unscented}
STYLES = dict(zip(GAUGE_RULES, ((RED, 1.5), (BLUE, 6.0), (GREEN, 3.5), (ORANGE, 1.3)), strict=True))
"""Colour and width of every rule's line: those that coincide all show."""
FLOOR = 1e-17
"""Where no growth, or a loss, stands on the logarithmic axis."""


@dataclass(frozen=True)
class GaugeCase:
    """An estimator by name, its gauge rule, and the prior's sigma along N."""

    estimator: str
    rule: str
    sigma: float


@dataclass(frozen=True)
class GaugeRun:
    """Of every frame: growth (n,), NEES (n,), errors (n, 4) in the order of `ERRORS`."""

    growth: Float[np.ndarray, " n"]
    nees: Float[np.ndarray, " n"]
    errors: Float[np.ndarray, "n 4"]


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--motion", choices=MOTIONS, default="rich")
    parser.add_argument("--estimators", nargs="+", choices=APPROXIMATIONS, default=["mekf"])
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/gauge"))
    options = parser.parse_args()
    make_folder(options.output)
    low, high = chi_square_band(20, options.seeds)
    print(
        f"{options.motion} motion, {options.seeds} seeds; NEES of one frame in {float(low):.1f} .. {float(high):.1f}"
    )
    for estimator in options.estimators:
        cases = [GaugeCase(estimator, rule, sigma) for sigma in SIGMAS for rule in GAUGE_RULES]
        runs: dict[GaugeCase, list[GaugeRun]] = {}
        for case in cases:
            runs[case] = [
                gauge_run(case, *recording(options.motion, seed), seed) for seed in range(options.seeds)
            ]
            print(described(case, runs[case]), flush=True)
        path = options.output / f"growth-{estimator}-{options.motion}.png"
        save_figure(figure(runs), path)
        print(f"picture: {path}")


@cache
def recording(motion: str, seed: int, frames: int = 115) -> tuple[Float[np.ndarray, "n m"], Timeline]:
    """True states, and frames of sightings whose landmarks nobody knows."""
    dataset = without_map(simulate(Scenario.disam115(MOTIONS[motion], seed)))
    assert dataset.truth is not None
    assert dataset.rig is not None
    timeline = build_timeline(dataset.log, LAYOUT, SensorNoise(), StereoView(None, dataset.rig.calibration))
    return true_states(dataset.truth, LAYOUT)[:frames], timeline[:frames]


def gauge_run(case: GaugeCase, states: Float[np.ndarray, "n m"], timeline: Timeline, seed: int) -> GaugeRun:
    """One run of a filter that starts near the truth and without a map."""
    options = LandmarkOptions(gauge=case.rule)
    estimator = LandmarkFilter(PROCESS, APPROXIMATIONS[case.estimator](), options)
    estimator.start(first_belief(states[0], case.sigma, seed))
    first = information(estimator, case.rule)
    growth, nees, errors = [], [], []
    for k, frame in enumerate(timeline):
        if k:
            estimator.predict(frame.time - timeline[k - 1].time)
        for measurement in frame.measurements:
            estimator.update(measurement)
        growth.append(eigh(information(estimator, case.rule), first, eigvals_only=True)[-1] - 1)
        belief = estimator.belief
        nees.append(np.sum(np.linalg.solve(belief.factor, LAYOUT.local(belief.mean, states[k])) ** 2))
        errors.append(
            [np.linalg.norm(a - b) for a, b in zip(seen(belief.mean), seen(states[k]), strict=True)]
        )
    return GaugeRun(np.array(growth), np.array(nees), np.array(errors))


def first_belief(state: Float[np.ndarray, " m"], sigma: float, seed: int) -> Gaussian:
    """Covariance P_c + sigma^2 N N', the error drawn from it."""
    generator = np.random.default_rng(1000 + seed)
    error = START_STD * generator.standard_normal(20)
    error += sigma * gauge_directions(LAYOUT, state) @ generator.standard_normal(6)
    mean = LAYOUT.retract(state, error)
    rows = np.concatenate([np.diag(START_STD), sigma * gauge_directions(LAYOUT, mean)], axis=1)
    return Gaussian(LAYOUT, mean, np.transpose(np.linalg.qr(rows.T, mode="r")))


def information(estimator: LandmarkFilter, rule: str) -> Float[np.ndarray, "6 6"]:
    """N' P^-1 N, N the gauge directions of state and landmarks where the rule differentiates."""
    held = estimator.snapshot()
    coordinates = GAUGE_RULES[rule].linearised_at(held["map.coordinates"], held["map.first"])
    landmarks = Point(held["mean"], held["map.anchors"], coordinates).landmark_directions()
    directions = np.concatenate([gauge_directions(LAYOUT, held["mean"]), landmarks])
    whitened = solve_triangular(held["factor"], directions, lower=True)
    return whitened.T @ whitened


def seen(state: Float[np.ndarray, " m"]) -> tuple[np.ndarray, ...]:
    """What does not depend on g: place, velocity and rate of the body in i, its principal moments (largest 1)."""
    t, q, v, w, c, s = (state[LAYOUT.mean_slice(block)] for block in FULL_BLOCKS)
    moments = np.linalg.eigvalsh(inertia_matrix(s))
    return t + rotate(q, c), v, rotate(q, w), moments / moments[-1]


def described(case: GaugeCase, runs: list[GaugeRun]) -> str:
    """A row of the table."""
    growth = max(run.growth.max() for run in runs)
    half = len(runs[0].nees) // 2
    squares = np.mean([run.errors[half:] ** 2 for run in runs], axis=(0, 1))
    errors = ", ".join(
        f"{name} {scale * rms:.3f}"
        for (name, scale), rms in zip(ERRORS.items(), np.sqrt(squares), strict=True)
    )
    verdict = "no information gained" if growth < LARGEST_GROWTH else "GAINS INFORMATION"
    nees = np.mean([run.nees for run in runs])
    return (
        f"{case.estimator} {case.rule:>15}, sigma {case.sigma:g}: growth {growth:9.2e} ({verdict}), "
        f"mean NEES {nees:.2f}, rms {errors}"
    )


def figure(runs: dict[GaugeCase, list[GaugeRun]]) -> Figure:
    """Largest growth over seeds against the frame, a panel for every sigma, a line for every rule."""
    drawn = Figure(figsize=(11.0, 4.4), layout="constrained")
    panels = drawn.subplots(1, len(SIGMAS), sharey=True)
    for axes, sigma in zip(panels, SIGMAS, strict=True):
        for case, those in runs.items():
            if case.sigma == sigma:
                worst = np.max([run.growth for run in those], axis=0)
                color, width = STYLES[case.rule]
                axes.plot(np.maximum(worst, FLOOR), color=color, linewidth=width, label=case.rule)
        axes.axhline(LARGEST_GROWTH, color="0.3", linewidth=0.9, linestyle="--", label="allowed")
        axes.set(yscale="log", xlabel="frame [-]", title=f"gauge prior {sigma:g} rad and m")
        tidy(axes)
    panels[0].set_ylabel("information gained about g, relative [-]")
    drawn.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False)
    return drawn


if __name__ == "__main__":
    main()
