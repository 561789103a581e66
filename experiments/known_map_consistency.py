"""Is the filters' covariance honest? NEES of the bundled example with its known map, over seeds.

    python -m experiments.known_map_consistency [--seeds 20] [-o runs/consistency]

Prints mean NEES over runs (20 degrees of freedom) and over the filters' own epochs with its 95 % band, and draws it over time.
"""

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.evaluation.evaluation import Evaluation
from spinfilters.logs.atomic_write import make_folder
from spinfilters.plots.style import save_figure
from spinfilters.simulation.scenario import Scenario, simulate
from spinfilters.workflow.estimation import compare_estimators
from spinfilters.workflow.preparation import prepare
from spinfilters.workflow.settings import Settings

NAMES = ("mekf", "ukf")


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/consistency"))
    options = parser.parse_args()
    make_folder(options.output)
    runs = [evaluate_seed(seed) for seed in range(options.seeds)]
    totals = {name: np.array([nees(run[name]) for run in runs]) for name in NAMES}
    low, high = chi_square_band(20, options.seeds)
    band = (float(low), float(high))
    for name in NAMES:
        over_runs = totals[name].mean(axis=0)
        inside = np.mean((over_runs >= band[0]) & (over_runs <= band[1]))
        print(
            f"{name}: mean NEES {totals[name].mean():.2f}, last epoch {over_runs[-1]:.2f}, band of {options.seeds} runs "
            f"{band[0]:.2f} .. {band[1]:.2f}, epochs inside {100 * inside:.0f} %"
        )
    time = runs[0]["mekf"].history.time[runs[0]["mekf"].history.own]
    save_figure(figure(time, totals, band), options.output / "nees.png")
    print(f"picture: {options.output / 'nees.png'}")


def evaluate_seed(seed: int) -> dict[str, Evaluation]:
    """Both filters on one seed of the bundled example, by name."""
    settings = Settings(estimators=NAMES)
    comparison = compare_estimators(
        prepare(simulate(Scenario.disam115(seed=seed)), settings), settings, lambda *_: None
    )
    for evaluation in comparison.evaluations:
        assert np.isfinite(evaluation.history.factor).all(), (
            f"{evaluation.name} is not finite with seed {seed}"
        )
        smallest = np.linalg.eigvalsh(evaluation.history.covariance).min()
        assert smallest >= -1e-18, f"{evaluation.name}: covariance has eigenvalue {smallest} with seed {seed}"
    return {evaluation.name: evaluation for evaluation in comparison.evaluations}


def nees(evaluation: Evaluation) -> np.ndarray:
    """NEES of every epoch behind the initialisation; the bundled example knows its whole state."""
    assert evaluation.nees is not None
    return evaluation.nees.total[evaluation.history.own]


def figure(time: np.ndarray, totals: dict[str, np.ndarray], band: tuple[float, float]) -> Figure:
    """Mean NEES over runs against time, with its band."""
    drawn = Figure(figsize=(8.0, 4.5), layout="constrained")
    axes = drawn.add_subplot()
    axes.axhspan(*band, color="0.88", label="95 % band of a consistent filter")
    for (name, values), width in zip(totals.items(), (2.6, 1.2), strict=True):
        axes.plot(time, values.mean(axis=0), linewidth=width, label=name.upper())
    axes.set(xlabel="time [s]", ylabel="NEES, 20 degrees of freedom, mean over runs [-]", ylim=(0, None))
    axes.legend()
    return drawn


if __name__ == "__main__":
    main()
