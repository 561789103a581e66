"""Monte Carlo of the filters that hold landmarks in their state: are they as good as the bound allows, and do they know it?

    python -m experiments.landmark_consistency [--motion rich|thesis] [--seeds 24] [--wrong 0.3] [-o runs/landmarks]

Simulates the workload disam115 without its map (`Scenario.common_workload`). Prints errors of position and velocity in the
second half
and of the moments at the end beside the Cramer-Rao bound of the measurements that the filter used, and mean NEES over runs (20
degrees of freedom) from the second revolution on, with its 95 % band, in all and by block; draws NEES over time. With --scale-q or
--scale-r the filters believe in a wrong process or pixel noise, which the band must show. A seed that has been run is read from the
output folder, so that an interrupted study goes on where it was.
"""

import argparse
import os
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.progress import track

from experiments.landmark_runs import NAMES, SETTINGS, Case, run_case
from spinfilters.data.atomic_write import make_folder
from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.plots.style import save_figure
from spinfilters.runs.npz_file import read_arrays, write_arrays
from spinfilters.settings.run_settings import Settings
from spinfilters.state.blocks import BLOCKS
from spinfilters.state.layout import FULL_BLOCKS, StateLayout

SECOND_REVOLUTION = 12
"""First frame of the second revolution, at 10 rpm and 0.5 s."""
DOF = StateLayout(FULL_BLOCKS).error_dim

Runs = list[dict[str, np.ndarray]]


def main() -> None:
    """Run the study."""
    options = _options()
    make_folder(options.output)
    settings = scaled(SETTINGS, options.scale_q, options.scale_r)
    cases = [Case(options.motion, seed, options.wrong) for seed in range(options.seeds)]
    label = f"q{options.scale_q:g}-r{options.scale_r:g}"
    runs = list(
        track(
            run_all(cases, settings, options.output / label, options.jobs),
            total=len(cases),
            description="runs",
        )
    )
    for name in NAMES:
        print(accuracy(name, runs))
    for name in NAMES:
        print(consistency(name, runs))
    path = options.output / f"nees-{options.motion}-{options.wrong:g}-{label}.png"
    save_figure(figure(runs), path)
    print(f"picture: {path}")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--motion", choices=("rich", "thesis"), default="rich")
    parser.add_argument("--seeds", type=int, default=24)
    parser.add_argument("--wrong", type=float, default=0.0, help="share of wrong associations")
    parser.add_argument(
        "--scale-q", type=float, default=1.0, help="factor of the process noise that the filters believe in"
    )
    parser.add_argument(
        "--scale-r",
        type=float,
        default=1.0,
        help="factor of the pixels' variance that the filters believe in",
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/landmarks"))
    return parser.parse_args()


def scaled(settings: Settings, q: float, r: float) -> Settings:
    """Settings with process noise and pixel variance times these factors."""
    process = replace(
        settings.process,
        force_psd=q * float(settings.process.force_psd),
        torque_psd=q * float(settings.process.torque_psd),
    )
    return replace(settings, process=process, sensors=replace(settings.sensors, pixel_std=float(np.sqrt(r))))


def run_all(
    cases: list[Case], settings: Settings, folder: Path, jobs: int
) -> Iterable[dict[str, np.ndarray]]:
    """Every case's arrays, in order; each is kept in a file of its own."""
    make_folder(folder)
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(partial(_kept, settings=settings, folder=folder), cases)


def _kept(case: Case, settings: Settings, folder: Path) -> dict[str, np.ndarray]:
    path = folder / f"{case.label}.npz"
    if not path.exists():
        write_arrays(path, run_case(case, settings))
    return read_arrays(path)


def accuracy(name: str, runs: Runs) -> str:
    """Errors of an estimator beside their bounds."""
    lines = [f"{name}: {len(runs)} runs"]
    for what, unit in (("position", "mm"), ("velocity", "mm/s")):
        error, bound = (_rms([run[f"{name}/{key}"] for run in runs], runs) for key in (what, f"{what}_bound"))
        lines.append(
            f"  {what}, second half: rms {1e3 * error:.3f} {unit}, bound {1e3 * bound:.3f} {unit}, ratio {error / bound:.2f}"
        )
    error, bound = (
        np.sqrt(np.mean([run[f"{name}/{key}"][-1, :2] ** 2 for run in runs]))
        for key in ("moments", "moments_bound")
    )
    lines.append(f"  moments, last frame: rms {error:.5f}, bound {bound:.5f}, ratio {error / bound:.2f}")
    return "\n".join(lines)


def _rms(arrays: list[np.ndarray], runs: Runs) -> float:
    """Over the frames of the second half."""
    half = len(runs[0][f"{NAMES[0]}/nees"]) // 2
    return float(np.sqrt(np.mean([np.square(array[-half:]).sum(axis=1).mean() for array in arrays])))


def consistency(name: str, runs: Runs) -> str:
    """Mean NEES over runs and frames from the second revolution on."""
    totals = np.array([run[f"{name}/nees"][SECOND_REVOLUTION:] for run in runs])
    low, high = chi_square_band(DOF, len(runs))
    over_runs = totals.mean(axis=0)
    inside = np.mean((over_runs >= low) & (over_runs <= high))
    lines = [
        f"{name}: mean NEES {totals.mean():.2f}, last frame {over_runs[-1]:.2f}; 95 % band of {len(runs)} runs {float(low):.2f} .. "
        f"{float(high):.2f}, {100 * inside:.0f} % of frames inside; median {np.median(totals):.1f}"
    ]
    for block in FULL_BLOCKS:
        values = np.array([run[f"{name}/nees_{block}"][SECOND_REVOLUTION:] for run in runs])
        low, high = chi_square_band(BLOCKS[block].dimension, len(runs))
        lines.append(f"  {block}: {values.mean():.2f} (band {float(low):.2f} .. {float(high):.2f})")
    return "\n".join(lines)


def figure(runs: Runs) -> Figure:
    """Mean NEES over runs against the frame, with its band."""
    drawn = Figure(figsize=(8.0, 4.5), layout="constrained")
    axes = drawn.add_subplot()
    low, high = chi_square_band(DOF, len(runs))
    axes.axhspan(float(low), float(high), color="0.88", label="95 % band of a consistent filter")
    for name, width in zip(NAMES, (2.6, 1.2), strict=True):
        axes.plot(np.mean([run[f"{name}/nees"] for run in runs], axis=0), linewidth=width, label=name.upper())
    axes.axvline(SECOND_REVOLUTION, color="0.6", linewidth=0.8)
    axes.set(xlabel="frame [-]", ylabel=f"NEES, {DOF} degrees of freedom, mean over runs [-]", ylim=(0, None))
    axes.legend()
    return drawn


if __name__ == "__main__":
    main()
