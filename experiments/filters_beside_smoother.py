"""Tracks without a map: what filters say of the latest frame, beside what the smoother says of it when it comes.

    python -m experiments.filters_beside_smoother [--motion rich|thesis] [--seeds 24] [--force-psd 1e-6] [--wrong 0.3]
        [--case dropout] [--scale-q 1] [--scale-r 1] [-o runs/beside]

Simulates the workload disam115 without its map. All begin with the same smoothed first frames. Prints, over seeds, the rms error
of the frames after them over that of the smoother (median and largest), and mean NEES per degree of freedom by block, of one frame
in the middle of the rest and of the last, with its 95 % band; verdicts, and the largest error of a run in stated standard
deviations. Wrong associations and the faults of a case (`experiments.hard_cases`), of which a picture is written, are the filters'
alone: the smoother sees clean data. With --scale-q or --scale-r the filters believe in a wrong process or pixel noise, which the
band must show. A seed that has been run is read from the output folder.
"""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from experiments.hard_cases import CASES, FAR_OFF, case_figure
from experiments.landmark_runs import MOTIONS, NAMES
from spinfilters.data.atomic_write import make_folder
from spinfilters.data.dataset import Dataset
from spinfilters.estimators.history import EstimateHistory, GrowingHistory
from spinfilters.estimators.run import run
from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.evaluation.errors import Alignment
from spinfilters.evaluation.evaluation import Evaluation, evaluate
from spinfilters.models.process import ProcessNoise
from spinfilters.pipeline.estimation import compare_estimators
from spinfilters.pipeline.setup import Setup, prepare
from spinfilters.pipeline.smoother_run import NAME as SMOOTHER
from spinfilters.pipeline.smoother_run import begin_after_initialisation, sliding_smoother
from spinfilters.runs.npz_file import read_arrays, write_arrays
from spinfilters.settings.run_settings import ProcessSettings, SensorSettings, Settings
from spinfilters.simulation.faults import WrongAssociations, with_faults
from spinfilters.simulation.scenario import Scenario, simulate, without_map
from spinfilters.state.blocks import BLOCKS
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.layout import FULL_BLOCKS

ERRORS = ("position", "velocity", "attitude", "rate")
TORQUE_PSD = 1e-6


@dataclass(frozen=True)
class Study:
    """What is simulated, and what the filters believe.

    Attributes
    ----------
    force_psd: (m/s^2)^2/Hz.   wrong: share of wrong associations.   case: of `CASES`.
    scale_q, scale_r: of process noise and pixel variance.
    """

    motion: str = "rich"
    force_psd: float = 1e-6
    wrong: float = 0.0
    case: str = "usual"
    scale_q: float = 1.0
    scale_r: float = 1.0

    @property
    def label(self) -> str:
        """A name for files."""
        return "-".join(f"{value:g}" if isinstance(value, float) else value for value in vars(self).values())

    def recordings(self, seed: int) -> tuple[Dataset, Dataset]:
        """Clean and faulty."""
        noise = ProcessNoise(self.force_psd, TORQUE_PSD)
        case, usual = CASES[self.case], Scenario.common_workload(MOTIONS[self.motion], seed)
        clean = without_map(simulate(case.scenario(replace(usual, noise=noise))))
        faults = (*((WrongAssociations(self.wrong),) if self.wrong else ()), *case.faults)
        return clean, with_faults(clean, faults, seed) if faults else clean

    def settings(self, believed: bool) -> Settings:
        """The true noise, or what the filters believe."""
        q, r = (self.scale_q, self.scale_r) if believed else (1.0, 1.0)
        return Settings(
            estimators=NAMES,
            process=ProcessSettings(force_psd=q * self.force_psd, torque_psd=q * TORQUE_PSD),
            sensors=SensorSettings(pixel_std=float(np.sqrt(r))),
        )


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--motion", choices=tuple(MOTIONS), default="rich")
    parser.add_argument("--seeds", type=int, default=24)
    parser.add_argument("--case", choices=tuple(CASES), default="usual")
    for name in ("force-psd", "wrong", "scale-q", "scale-r"):
        parser.add_argument(f"--{name}", type=float, default=getattr(Study, name.replace("-", "_")))
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/beside"))
    given = vars(parser.parse_args())
    seeds, output = given.pop("seeds"), given.pop("output")
    study = Study(**given)
    make_folder(output)
    runs = [kept(study, seed, output) for seed in range(seeds)]
    for name in NAMES:
        print(described(name, runs))
    picture = case_figure(runs, NAMES, f"{study.motion} motion, {CASES[study.case].description}")
    picture.savefig(output / f"{study.label}.png", dpi=100)


def kept(study: Study, seed: int, folder: Path) -> dict[str, np.ndarray]:
    """Figures of a seed, see `figures`, from the folder where they are there."""
    path = folder / f"{study.label}-{seed}.npz"
    if not path.exists():
        write_arrays(path, figures(study, seed))
        print(f"seed {seed} of {study.label}", flush=True)
    return read_arrays(path)


def figures(study: Study, seed: int) -> dict[str, np.ndarray]:
    """By ``<estimator>/<what>`` of the frames after the start: rms errors (1,), NEES by block (n,), frames used (n,)."""
    clean, faulty = study.recordings(seed)
    believed = study.settings(believed=True)
    setup = prepare(faulty, believed)
    first, arrays = len(setup.initial.mean), {}
    for evaluation in compare_estimators(setup, believed, lambda *_: None).evaluations:
        arrays |= _figures(evaluation.name, evaluation, first)
    reference = prepare(clean, study.settings(believed=False))
    history, first = smoothed(reference, study.settings(believed=False))
    return arrays | _figures(SMOOTHER, evaluate(history, clean.truth, Alignment.FIRST_FRAME), first)


def smoothed(setup: Setup, settings: Settings) -> tuple[EstimateHistory, int]:
    """What the smoother said of every frame when it came."""
    smoother, rows = sliding_smoother(setup, settings), _start_rows(setup)
    begin_after_initialisation(smoother, setup)
    first = len(rows)
    return run(smoother, rows.time, setup.timeline[first:], rows=rows), first


def _start_rows(setup: Setup) -> GrowingHistory:
    start, layout = setup.initial, setup.process.layout
    rows = GrowingHistory(layout, setup.timeline[0].time)
    for frame, mean, factor in zip(setup.timeline, start.mean, start.factor, strict=False):
        rows.append(frame.time, Gaussian(layout, mean, factor), [], 0.0)
    return rows


def _figures(name: str, evaluation: Evaluation, first: int) -> dict[str, np.ndarray]:
    history = evaluation.history
    assert evaluation.errors is not None
    assert evaluation.errors.position is not None
    assert evaluation.nees is not None
    result = {}
    for what in ERRORS:
        rows = getattr(evaluation.errors, what)[first:]
        result[f"{name}/{what}"] = np.array([np.sqrt(np.square(rows).sum(axis=1).mean())])
    result[f"{name}/time"] = history.time[first:]
    result[f"{name}/position_error"] = np.linalg.norm(evaluation.errors.position[first:], axis=1)
    result[f"{name}/position_std"] = np.linalg.norm(evaluation.trajectory.std_position[first:], axis=1)
    scaled = [values / BLOCKS[block].dimension for block, values in evaluation.nees.blocks.items()]
    result[f"{name}/deviations"] = np.sqrt(np.max(scaled, axis=0)[first:])
    result[f"{name}/verdict"] = np.array([history.status.verdict.value, *history.status.reasons])
    for block, values in evaluation.nees.blocks.items():
        result[f"{name}/nees_{block}"] = values[first:]
    used, runtime = history.accepted[first:].astype(float), history.runtime[first:]
    moments = evaluation.body_errors
    assert moments is not None
    covariance = evaluation.body.principal_moments_cov[:2, :2]
    off = moments.principal_moments[:2] if moments.principal_moments is not None else np.full(2, np.nan)
    result[f"{name}/nees_moments"] = np.array([off @ np.linalg.solve(covariance, off)])
    return result | {f"{name}/used": used, f"{name}/seconds": runtime}


def described(name: str, runs: list[dict[str, np.ndarray]]) -> str:
    """The report of one filter."""
    lines = [f"{name}, {len(runs)} runs; error over the smoother's, median (largest):"]
    for what in ERRORS:
        ratios = [run[f"{name}/{what}"][0] / run[f"{SMOOTHER}/{what}"][0] for run in runs]
        lines.append(f"  {what}: {np.median(ratios):.3f} ({max(ratios):.3f})")
    used = np.mean([run[f"{name}/used"].mean() for run in runs])
    times = [np.median(np.concatenate([run[f"{each}/seconds"] for run in runs])) for each in (name, SMOOTHER)]
    lines.append(
        f"  landmarks used per frame {used:.0f}; ms per frame {1e3 * times[0]:.2f}, the smoother {1e3 * times[1]:.1f}"
    )
    lines += _verdicts(name, runs)
    lines.append(
        "  NEES per degree of freedom: mean; in the middle, at the end; 95 % band; the smoother's mean"
    )
    for block in (*FULL_BLOCKS, "moments"):
        dof = BLOCKS[block].dimension if block in BLOCKS else 2
        values = [run[f"{name}/nees_{block}"] / dof for run in runs]
        others = np.mean([run[f"{SMOOTHER}/nees_{block}"].mean() / dof for run in runs])
        low, high = (float(limit) / dof for limit in chi_square_band(dof, len(runs)))
        mean = np.mean([value.mean() for value in values])
        middle, last = (np.mean([value[at] for value in values]) for at in (len(values[0]) // 2, -1))
        lines.append(
            f"  {block}: {mean:.2f}; {middle:.2f}, {last:.2f}; {low:.2f} .. {high:.2f}; {others:.2f}"
        )
    return "\n".join(lines)


def _verdicts(name: str, runs: list[dict[str, np.ndarray]]) -> list[str]:
    """How many runs ended how, and how far off they were at worst."""
    verdicts = [str(run[f"{name}/verdict"][0]) for run in runs]
    worst = np.array([run[f"{name}/deviations"].max() for run in runs])
    silent = sum(verdict == "ok" and far > FAR_OFF for verdict, far in zip(verdicts, worst, strict=True))
    counts = ", ".join(f"{verdicts.count(each)} {each}" for each in sorted(set(verdicts)))
    reasons = sorted({str(reason) for run in runs for reason in run[f"{name}/verdict"][1:]})
    lines = [
        f"  {counts}; largest error of a block in standard deviations {np.median(worst):.1f} ({worst.max():.1f}), "
        f"{silent} ok beyond {FAR_OFF:g}"
    ]
    return [*lines, *(f"    {reason}" for reason in reasons)]


if __name__ == "__main__":
    main()
