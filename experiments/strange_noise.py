"""Search for wrong estimates with verdict ok under unusual noise.

Noise that nobody states is not white and normal, or one measurement is gross.
    python -m experiments.strange_noise [--seeds 10] [--kinds gyro pose tracks] [--noise quantised gross] [--epochs 115]
        [--motion rich] [--first 0]

Simulates motions, adds noise of every kind to exact gyro rates, poses or tracks without a map, states nothing and estimates with
MEKF and smoother.
Printed are verdicts, the largest error of an ``ok`` estimate in stated standard deviations (beyond 4 is a defect), NEES of the
``ok`` ones; of one gross error also the errors over those without it, geometric mean and 95 % quantile.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float

from experiments.command_line import run_study
from spinfilters.campaigns.row_columns import result_columns
from spinfilters.core.errors import InputError
from spinfilters.evaluation.metrics import MOTIONS
from spinfilters.evaluation.recording_bound import without_bounds
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.models.process import ProcessNoise
from spinfilters.models.sensor_registry import sensor_of
from spinfilters.models.state_layout import StateLayout
from spinfilters.run.estimation import ComparisonExtent, compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.measurement_faults import with_gauss_markov_errors, with_stream
from spinfilters.simulation.scenario import (
    RICH_RPM,
    THESIS_RPM,
    Scenario,
    simulate,
    without_map,
    without_noise,
)

Added = Callable[[Float[np.ndarray, "n k"], np.random.Generator], Float[np.ndarray, "n k"]]
"""Errors in standard deviations, from those of white noise."""
SETTINGS = Settings(estimators=("mekf", "smoother"))
PSD = 1e-6
STD = {"gyro": np.full(3, 0.005), "pose": np.repeat([0.005, 0.01], 3), "tracks": np.ones(3)}
"""rad/s; m and rad; px."""
OF_TRACKS = ("correlated 0.5", "correlated 0.8", "correlated", "correlated 0.97", "slow part")
"""Noise that tracks are tried with: errors of each landmark are correlated in time."""
EXACT = 1e-9
"""Of the simulated noise, that all others are added to."""
RESOLUTION = {"gyro": 4.36 / 128, "pose": 0.02}
"""Of a gyro of 8 bit and 250 deg/s, rad/s; of poses, m and rad."""
GROSS = (20.0, 300.0)
"""Standard deviations of one gross error."""
TRACKED = 400
"""Landmarks of tracks."""
CORRELATION = 0.9
"""From sample to sample, where the name says no other."""


@dataclass(frozen=True)
class Recorded:
    """Motion and length of a recording."""

    rate_rpm: tuple[float, float, float] = RICH_RPM
    epochs: int = 115


@dataclass(frozen=True)
class NoiseRow:
    """One estimate: its metrics, or why there is none."""

    estimator: str
    found: dict[str, float | str]


def main() -> None:
    """Print a line for every sensor, noise and estimator."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="seed")
    parser.add_argument("--kinds", nargs="+", choices=list(STD), default=list(STD))
    parser.add_argument("--noise", nargs="+", choices=list(NOISE), default=list(NOISE))
    parser.add_argument("--epochs", type=int, default=Recorded.epochs)
    parser.add_argument("--motion", choices=("rich", "thesis"), default="rich")
    options = parser.parse_args()
    recorded = Recorded(RICH_RPM if options.motion == "rich" else THESIS_RPM, options.epochs)
    for kind in options.kinds:
        for name in options.noise:
            if kind == "tracks" and name not in OF_TRACKS:
                continue
            seeds = range(options.first, options.first + options.seeds)
            for line in lines_of(kind, name, seeds, recorded):
                print(line, flush=True)


def lines_of(kind: str, name: str, seeds: range, recorded: Recorded) -> Iterator[str]:
    """A line for every estimator, and one for every estimate that is ok and wrong."""
    found = [(seed, row) for seed in seeds for row in rows_of(kind, name, seed, recorded)]
    refused = sum(row.estimator == "" for _, row in found)
    for estimator in SETTINGS.estimators:
        own = [(seed, row.found) for seed, row in found if row.estimator == estimator]
        ok = [(seed, each) for seed, each in own if each["verdict"] == "ok"]
        worst = max((float(each["worst_error"]) for _, each in ok), default=np.nan)
        nees = np.mean([float(each["nees"]) for _, each in ok]) if ok else np.nan
        ratios = [float(each["ratio"]) for _, each in own if "ratio" in each]
        over = (
            f", errors {np.exp(np.mean(np.log(ratios))):.3f}, {np.quantile(ratios, 0.95):.2f}"
            if ratios
            else ""
        )
        yield (
            f"{kind:5s} {name:11s} {estimator:9s} ok {len(ok):3d} of {len(seeds):3d} ({refused} refused), worst {worst:6.2f}, "
            f"NEES {nees:5.2f}{over}"
        )
        yield from (
            f"    seed {s}: ok and wrong, {each['worst_quantity']}" for s, each in ok if not each["right"]
        )


def rows_of(kind: str, name: str, seed: int, recorded: Recorded) -> list[NoiseRow]:
    """Estimates of one recording."""
    rows = _estimated(recording(kind, name, seed, recorded))
    if name != "gross":
        return rows
    without = {row.estimator: row.found for row in _estimated(recording(kind, "white", seed, recorded))}
    return [NoiseRow(r.estimator, r.found | _ratio(r.found, without.get(r.estimator, {}))) for r in rows]


def recording(kind: str, name: str, seed: int, recorded: Recorded) -> Dataset:
    """A motion under one kind of noise, which is not stated."""
    scenario = Scenario.simplified(
        kind="stereo-tracks" if kind == "tracks" else kind,
        rate_rpm=recorded.rate_rpm,
        epochs=recorded.epochs,
        landmarks=TRACKED,
        seed=seed,
        noise=ProcessNoise(PSD, PSD),
        gyro_std=EXACT,
        position_std=EXACT,
        rotation_std=EXACT,
        pixel_std=EXACT,
    )
    dataset, generator = without_noise(simulate(scenario)), np.random.default_rng([seed, 5])
    if kind == "tracks":
        return without_map(_correlated(dataset, generator, name))
    if name in OF_TRACKS:
        return _correlated(dataset, generator, name)
    return with_stream(dataset, NOISE[name](dataset.log.stream(kind), generator))


def _estimated(dataset: Dataset) -> list[NoiseRow]:
    try:
        setup = prepare(dataset, SETTINGS)
        comparison = compare_estimators(
            setup, SETTINGS, lambda *_: None, extent=ComparisonExtent(without_bounds)
        )
    except InputError as error:
        return [NoiseRow("", {"reason": str(error)})]
    return [NoiseRow(each.name, result_columns(each)) for each in comparison.evaluations]


def _ratio(found: dict[str, float | str], without: dict[str, float | str]) -> dict[str, float | str]:
    """Geometric mean of the errors over those without."""
    names = [f"error_{field}" for _, field, *_ in MOTIONS]
    both = [(found.get(name), without.get(name)) for name in names]
    ratios = [float(a) / float(b) for a, b in both if a is not None and b]
    return {"ratio": float(np.exp(np.mean(np.log(ratios))))} if ratios else {}


def _with(stream: MeasurementStream, errors: Float[np.ndarray, "n k"]) -> MeasurementStream:
    """With errors in standard deviations."""
    scaled = errors * STD[stream.sensor]
    if sensor_of(stream.sensor).measured_rates(stream) is not None:
        return replace(stream, values=stream.values + scaled)
    return replace(stream, values=StateLayout(("t", "a")).retract(stream.values, scaled))


def _added(stream: MeasurementStream, generator: np.random.Generator, added: Added) -> MeasurementStream:
    white = generator.standard_normal((len(stream), len(STD[stream.sensor])))
    return _with(stream, added(white, generator))


def _white(white: np.ndarray, _: np.random.Generator) -> np.ndarray:
    return white


def _heavy(white: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """Student's t of three degrees of freedom."""
    return generator.standard_t(3.0, white.shape)


def _two_levels(white: np.ndarray, _: np.random.Generator) -> np.ndarray:
    """Five times as large in the second half."""
    return white * np.where(np.arange(len(white)) < len(white) / 2, 1.0, 5.0)[:, np.newaxis]


def _correlated(dataset: Dataset, generator: np.random.Generator, name: str) -> Dataset:
    """With correlated errors; a slow part stands beside white ones of the same size."""
    (stream,) = dataset.log.streams
    std = STD.get(stream.sensor, STD["tracks"])
    words = name.split()
    correlation = float(words[-1]) if words[0] == "correlated" and len(words) > 1 else CORRELATION
    found = with_gauss_markov_errors(dataset, std, correlation, generator)
    return with_gauss_markov_errors(found, std, 0.0, generator) if name == "slow part" else found


def _as_it_is(stream: MeasurementStream, _: np.random.Generator) -> MeasurementStream:
    return stream


def _gross(white: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """White, but for one epoch: in every third recording one of the first three."""
    last = 3 if generator.random() < 1 / 3 else len(white)
    direction = generator.standard_normal(white.shape[1])
    errors = white.copy()
    errors[generator.integers(last)] += (
        direction / np.linalg.norm(direction) * np.exp(generator.uniform(*np.log(GROSS)))
    )
    return errors


def _dropouts(stream: MeasurementStream, generator: np.random.Generator) -> MeasurementStream:
    """White noise, of which bursts of up to eight samples are lost, 40 % in all."""
    noisy = _added(stream, generator, _white)
    kept = np.ones(len(stream), dtype=bool)
    while kept.mean() > 0.6:
        first = generator.integers(1, len(stream))
        kept[first : first + generator.integers(1, 9)] = False
    return replace(noisy, time=noisy.time[kept], values=noisy.values[kept])


def _quantised(stream: MeasurementStream, _: np.random.Generator) -> MeasurementStream:
    """Without other noise."""
    step = RESOLUTION[stream.sensor]
    if sensor_of(stream.sensor).measured_rates(stream) is not None:
        return replace(stream, values=step * np.round(stream.values / step))
    rounded = step * np.round(stream.values / step)
    rounded[:, 3:] /= np.linalg.norm(rounded[:, 3:], axis=1, keepdims=True)
    return replace(stream, values=rounded)


def _constant(stream: MeasurementStream, _: np.random.Generator) -> MeasurementStream:
    """The first value for ever."""
    return replace(stream, values=np.tile(stream.values[0], (len(stream), 1)))


NOISE: dict[str, Callable[[MeasurementStream, np.random.Generator], MeasurementStream]] = {
    **{
        name: partial(_added, added=added)
        for name, added in {
            "white": _white,
            "heavy": _heavy,
            "two levels": _two_levels,
            "gross": _gross,
        }.items()
    },
    "exact": _as_it_is,
    "dropouts": _dropouts,
    "quantised": _quantised,
    "constant": _constant,
    **dict.fromkeys(OF_TRACKS, _as_it_is),
}
"""Measurements with one kind of noise, from exact ones."""

if __name__ == "__main__":
    run_study(main)
