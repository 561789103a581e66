"""Are estimates honest where nobody states any noise? NEES, identified levels, and what not knowing the noise costs.

    python -m experiments.honest_noise [--seeds 20] [--first 0] [--cases tracks] [--plain] [-o runs/honest-noise]

Every run draws its sensor's noise and the densities of its disturbances, log-uniform over decades, and is estimated twice: with
nothing stated and (but for ``--plain``) with the true noise stated. A line per run and estimator goes to ``runs.csv``; printed are,
of each case and estimator, the share of verdicts ``ok``, the NEES per degree of freedom over its own epochs, the share of
identified levels within three standard deviations of the true ones (of bounds: not below them), the pixel noise's error, and
errors relative to those with the noise stated (geometric mean over position, attitude, velocity, rate and runs).
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from csv import DictWriter
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from spinfilters.data.atomic_write import make_folder
from spinfilters.data.dataset import Dataset
from spinfilters.data.measurement_log import MeasurementLog
from spinfilters.data.truth import Truth
from spinfilters.errors import InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.consistency import normalised_square, true_states
from spinfilters.evaluation.evaluation import Evaluation
from spinfilters.evaluation.span import span_errors
from spinfilters.models.process import ProcessNoise
from spinfilters.pipeline.estimation import compare_estimators
from spinfilters.pipeline.setup import prepare
from spinfilters.runs.run_summary import summary
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, THESIS_RPM, Scenario, simulate, without_map

NAMES = ("mekf", "ukf", "smoother")
FAR = 3.0
"""Standard deviations of a level's logarithm from the truth, at most."""
LEVELS = {"pixel_std", "pose_position_std", "pose_rotation_std", "gyro_noise_std", "force_psd", "torque_psd"}
ROTATION_PER_POSITION = 2.0
"""Noise of a pose's rotation over that of its position, rad/m."""


@dataclass(frozen=True)
class Case:
    """Recordings of one kind.

    Attributes
    ----------
    force, torque: limits of their densities, (m/s^2)^2/Hz and (rad/s^2)^2/Hz.
    noise: limits of the sensor's standard deviation: px, m (a pose's rotation has `ROTATION_PER_POSITION` rad/m of it), rad/s.
    """

    name: str
    kind: str
    rate_rpm: tuple[float, float, float]
    force: tuple[float, float]
    torque: tuple[float, float]
    noise: tuple[float, float]


WIDE_FORCE, WIDE_TORQUE, DECADES = (1e-10, 1e-5), (1e-8, 2e-5), (1e-7, 1e-5)
CASES = (
    Case("tracks rich", "stereo-tracks", RICH_RPM, WIDE_FORCE, WIDE_TORQUE, (0.2, 4.0)),
    Case("tracks thesis", "stereo-tracks", THESIS_RPM, WIDE_FORCE, WIDE_TORQUE, (0.2, 4.0)),
    Case("poses rich", "pose", RICH_RPM, DECADES, DECADES, (0.001, 0.1)),
    Case("poses thesis", "pose", THESIS_RPM, DECADES, DECADES, (0.001, 0.1)),
    Case("gyro rich", "gyro", RICH_RPM, DECADES, DECADES, (2e-4, 2e-2)),
    Case("gyro thesis", "gyro", THESIS_RPM, DECADES, DECADES, (2e-4, 2e-2)),
)


@dataclass(frozen=True)
class Line:
    """What one estimator made of one recording.

    Attributes
    ----------
    nees: per degree of freedom, mean over its own epochs.   ratio: of its errors to those with the noise stated.
    within: share of the levels that are right (see the module).   pixel_error: of ln pixel noise.
    """

    case: str
    seed: int
    estimator: str
    verdict: str
    nees: float = np.nan
    ratio: float = np.nan
    within: float = np.nan
    pixel_error: float = np.nan
    levels: str = ""
    reasons: str = ""


def main() -> None:
    """Run, print as cases end, write every run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="seed of the first run")
    parser.add_argument("--cases", default="", help="only cases whose name holds this")
    parser.add_argument("--plain", action="store_true", help="do not run with the noise stated")
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/honest-noise"))
    options = parser.parse_args()
    make_folder(options.output)
    with (options.output / "runs.csv").open("w", newline="", encoding="utf-8") as file:
        writer = DictWriter(file, list(Line.__dataclass_fields__))
        writer.writeheader()
        for case in (case for case in CASES if options.cases in case.name):
            lines = []
            for seed in range(options.first, options.first + options.seeds):
                lines += lines_of(case, seed, options.plain)
                writer.writerows(map(asdict, lines[-len(NAMES) :]))
                file.flush()
            print(table_of(case, lines), flush=True)


def drawn(case: Case, seed: int) -> tuple[Dataset, dict[str, float]]:
    """A recording that states all of its noise, and the true levels."""
    generator = np.random.default_rng([seed, *case.name.encode()])
    force, torque, noise = (
        float(np.exp(generator.uniform(*np.log(limits)))) for limits in (case.force, case.torque, case.noise)
    )
    scenario = replace(
        Scenario.common_workload(case.rate_rpm, seed),
        kind=case.kind,
        noise=ProcessNoise(force, torque),
        pixel_std=noise,
        position_std=noise,
        rotation_std=ROTATION_PER_POSITION * noise,
        gyro_std=noise,
    )
    dataset = simulate(scenario)
    levels = {"force_psd": force, "torque_psd": torque, "pixel_std": noise, "gyro_noise_std": noise}
    levels |= {"pose_position_std": noise, "pose_rotation_std": ROTATION_PER_POSITION * noise}
    return (without_map(dataset) if dataset.known_map is not None else dataset), levels


def silent(dataset: Dataset) -> Dataset:
    """The data set without anything that it says of noise."""
    streams = tuple(replace(stream, covariance=None) for stream in dataset.log.streams)
    options = replace(dataset.options, force_psd=None, torque_psd=None, sensor_noise={})
    return replace(dataset, log=MeasurementLog(streams), options=options)


def lines_of(case: Case, seed: int, plain: bool) -> list[Line]:
    """One recording by every estimator."""
    dataset, true = drawn(case, seed)
    stated = {} if plain else {e.name: e for e in _evaluated(dataset)[0]}
    try:
        evaluations, noise = _evaluated(silent(dataset))
    except InputError as error:
        return [Line(case.name, seed, name, "refused", reasons=str(error)) for name in NAMES]
    assert dataset.truth is not None
    return [
        _line(case, seed, _Pair(e, stated.get(e.name), dataset.truth), _Levels(noise[e.name], true))
        for e in evaluations
    ]


@dataclass(frozen=True)
class _Pair:
    """One estimator with nothing stated, with the true noise stated, and the truth."""

    found: Evaluation
    stated: Evaluation | None
    truth: Truth


@dataclass(frozen=True)
class _Levels:
    """Levels that one estimator was run with, as in summary.json, and the true ones."""

    found: Mapping[str, Mapping[str, float | str | None]]
    true: Mapping[str, float]

    def __str__(self) -> str:
        words = []
        for name in LEVELS & self.found.keys():
            value, std, upper = (self.found[name].get(key) for key in ("value", "std", "upper"))
            words.append(f"{name} {value:.3g} +- {std} <= {upper} ({self.true[name]:.3g})")
        return "; ".join(words)

    @property
    def right(self) -> list[bool]:
        """Of each level."""
        return [self._is_right(name) for name in self.found if name in LEVELS]

    def _is_right(self, name: str) -> bool:
        found, true = self.found[name], self.true[name]
        value, std, upper = (found.get(key) for key in ("value", "std", "upper"))
        assert isinstance(value, float)
        if isinstance(upper, float):
            return true <= upper
        return isinstance(std, float) and abs(np.log(value / true)) <= FAR * std / value

    @property
    def pixel_error(self) -> float:
        """Of ln pixel noise; nan without any."""
        value = self.found.get("pixel_std", {}).get("value")
        return float(np.log(value / self.true["pixel_std"])) if isinstance(value, float) else np.nan


def _evaluated(
    dataset: Dataset,
) -> tuple[tuple[Evaluation, ...], dict[str, Mapping[str, Mapping[str, float | str | None]]]]:
    settings = Settings(estimators=NAMES)
    comparison = compare_estimators(prepare(dataset, settings), settings, lambda *_: None)
    document = summary(comparison)["estimators"]
    return comparison.evaluations, {name: document[name]["noise"] for name in document}


def _line(case: Case, seed: int, pair: _Pair, levels: _Levels) -> Line:
    found, stated, truth = pair.found, pair.stated, pair.truth
    nees, errors = _errors(found, truth)
    _, reference = (np.nan, {}) if stated is None else _errors(stated, truth)
    ratios = [np.log(errors[key] / reference[key]) for key in errors if key in reference]
    status = found.history.status
    return Line(
        case.name,
        seed,
        found.name,
        str(status.verdict),
        nees,
        float(np.exp(np.mean(ratios))) if ratios else np.nan,
        float(np.mean(levels.right)) if levels.right else np.nan,
        levels.pixel_error,
        str(levels),
        "; ".join(status.reasons),
    )


def _errors(evaluation: Evaluation, truth: Truth) -> tuple[float, dict[str, float]]:
    """NEES per degree of freedom, and rms errors by quantity, over its own epochs."""
    own = None if evaluation.own_begin is None else span_errors(evaluation, evaluation.own_begin)
    if own is None:
        return np.nan, {}
    rms = {name: value for name, value in vars(own.rms).items() if value}
    return (body_nees(evaluation.history, truth) if own.nees is None else own.nees), rms


def body_nees(history: EstimateHistory, truth: Truth) -> float:
    """Per degree of freedom of rate and mass distribution, which need no frame i: of a gyro, whose axes are g."""
    layout = history.layout
    blocks = [*range(*layout.slice("w").indices(99)), *range(*layout.slice("s").indices(99))]
    error = layout.local(history.mean, true_states(truth, layout)[: len(history.mean)])
    nees = normalised_square(error[history.own][:, blocks], history.factor[history.own][:, blocks])
    return float(np.mean(nees)) / len(blocks)


def table_of(case: Case, lines: Sequence[Line]) -> str:
    """A row for every estimator."""
    return "\n".join(_rows(case, lines))


def _rows(case: Case, lines: Sequence[Line]) -> Iterator[str]:
    for name in NAMES:
        own = [line for line in lines if line.estimator == name]
        ok = [line for line in own if line.verdict == "ok"]
        nees = np.array([line.nees for line in ok] or [np.nan])
        ratio, pixel = (np.array([getattr(line, key) for line in own]) for key in ("ratio", "pixel_error"))
        within = np.array([line.within for line in own])
        yield (
            f"{case.name if name == NAMES[0] else '':14s} {name:9s} {len(ok):3d} of {len(own):3d} ok, NEES {np.mean(nees):6.2f} "
            f"(worst {np.max(nees):6.2f}, below 2: {np.mean(nees < 2):4.0%}), levels right {_mean(within):4.0%}, "
            f"pixel noise off by {_largest(pixel):5.1%} at most, errors x {np.exp(_mean(np.log(ratio))):5.3f}"
        )


def _mean(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else np.nan


def _largest(values: np.ndarray) -> float:
    return float(np.abs(values[np.isfinite(values)]).max(initial=0.0))


if __name__ == "__main__":
    main()
