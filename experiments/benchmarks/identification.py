"""Time to identify noise and gravity that nobody states, in batch solves.

    python -m experiments.benchmarks.identification [--rounds 5] [--cases "pose hard steady, major" "gyro thesis" tracks]

Prepares each recording with nothing stated, and with all stated that this has found, and smooths it once: medians of processor
times of interleaved rounds. Printed are the difference of the preparations in batch solves (bar: 8; a batch solve is one of the
whole recording from where the filter passes, of tracks without a map one of the initialisation), and the time of a MEKF that
learns noise over that of one whose noise is stated (bar: 1.1).
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float

from experiments.benchmarks.stopwatch import begin_benchmark, now
from experiments.command_line import run_study
from experiments.honest_cases import CASES, recordings
from spinfilters.core.robust_losses import LeastSquares
from spinfilters.filters.timeline import run
from spinfilters.inference.initial_estimate import SmoothingOptions, smooth_first_epochs
from spinfilters.inference.setup import NOTHING_SOUGHT, Setup
from spinfilters.io.dataset import Dataset
from spinfilters.io.sensor_format import sensor_format
from spinfilters.models.state_blocks import ACCELERATION
from spinfilters.run.estimators import estimator_entries
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate, without_map, without_noise
from spinfilters.smoother.batch_smoother import smooth_recording

TRACKS: Final = "tracks"
CHOSEN: Final = (
    "pose rich",
    "pose thesis",
    "pose hard steady, major",
    "gyro thesis",
    "gyro hard steady, major",
    TRACKS,
)
"""Of `experiments.honest_cases`, and tracks of the common workload."""
NOTHING_STATED: Final = Settings(estimators=("mekf", "smoother"))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--cases", nargs="+", default=CHOSEN)
    options = parser.parse_args()
    begin_benchmark("experiments.benchmarks.identification")
    for name in options.cases:
        print(line_of(name, recording(name), options.rounds), flush=True)


def recording(name: str) -> Dataset:
    """The recording of a case, with nothing stated."""
    if name == TRACKS:
        return without_noise(without_map(simulate(Scenario.common_workload(seed=0))))
    (case,) = (case for case in CASES if case.name == name)
    return without_noise(recordings(case, 1)[0].dataset)


def line_of(name: str, dataset: Dataset, rounds: int) -> str:
    """Medians of one recording; the first round builds models and does not count."""
    found = prepare(dataset, NOTHING_STATED)
    known = with_levels_stated(found)
    times: dict[str, list[float]] = {}
    for index in range(rounds + 1):
        for what, seconds in measured(dataset, found, known):
            times.setdefault(what, []).extend([seconds] if index else [])
    t = {what: float(np.median(every)) for what, every in times.items()}
    share = (t["prepare"] - t["prepare stated"]) / t["solve"]
    return (
        f"{name:28s} {len(found.timeline):4d} epochs: preparation {t['prepare']:.2f} s, stated {t['prepare stated']:.2f} s; "
        f"identification {share:.1f} batch solves of {t['solve']:.3f} s; MEKF {t['mekf'] / t['mekf stated']:.2f}"
    )


def with_levels_stated(found: Setup) -> Settings:
    """Settings that state what a setup has found."""
    noise = found.process.noise
    gravity = found.process.layout.has(ACCELERATION)
    process = replace(
        NOTHING_STATED.process, force_psd=noise.force_psd, torque_psd=noise.torque_psd, gravity=gravity
    )
    own = {option.name for name in found.log.sensors for option in sensor_format(name).noise}
    sensors = {name: value for name in sorted(own) if (value := getattr(found.noise, name, None)) is not None}
    return replace(NOTHING_STATED, process=process, sensors=replace(NOTHING_STATED.sensors, **sensors))


def measured(dataset: Dataset, found: Setup, known: Settings) -> Iterator[tuple[str, float]]:
    """Processor times of one round, s."""
    yield "prepare", _seconds(lambda: prepare(dataset, NOTHING_STATED))
    yield "prepare stated", _seconds(lambda: prepare(dataset, known))
    stated = replace(found, identified=(), sought=NOTHING_SOUGHT, unstated=frozenset())
    for what, setup in (("mekf", found), ("mekf stated", stated)):
        yield what, _seconds(lambda setup=setup: _filtered(setup))
    trajectory = _filtered(found)
    yield "solve", _seconds(lambda: _solved(found, trajectory))


def _filtered(setup: Setup) -> Float[np.ndarray, "k m"]:
    """Trajectory of the initialisation and of the MEKF that goes on from it."""
    entry, first = estimator_entries()["mekf"], len(setup.initial.mean)
    estimator = entry.build(setup, NOTHING_STATED)
    entry.begin(estimator, setup)
    passed = run(estimator, setup.end_of_initialisation, setup.timeline[first:])
    return np.concatenate([setup.initial.mean, passed.mean])


def _solved(setup: Setup, trajectory: Float[np.ndarray, "k m"]) -> None:
    """The smoother's solution of the recording; with landmarks of the initialisation, from its guess."""
    start = setup.initial
    if start.guess is not None and start.has_landmarks:
        epochs = setup.timeline[: len(start.mean)]
        smooth_first_epochs(setup.process, epochs, start.guess, start.prior, SmoothingOptions())
    else:
        smooth_recording(setup.process, setup.timeline, trajectory, start.prior, LeastSquares())


def _seconds(work: Callable[[], object]) -> float:
    begin = now()
    work()
    return now() - begin


if __name__ == "__main__":
    run_study(main)
