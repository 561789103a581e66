"""Model errors by kind and size: verdict, effect on the estimates, and which errors the verdict names.

python -m experiments.model_errors [--kinds pose,gyro,stereo-tracks] [--seeds 2] [--clean 20] [--unstated]
"""

import argparse
from dataclasses import dataclass, replace

import numpy as np

from experiments.faulty_models import FAULTS, Fault, faulty
from spinfilters.data.dataset import Dataset
from spinfilters.data.measurement_log import MeasurementLog
from spinfilters.errors import InputError
from spinfilters.pipeline.estimation import compare_estimators
from spinfilters.pipeline.model_errors import tested_models
from spinfilters.pipeline.setup import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario

SETTINGS = Settings(estimators=("smoother",), process={"gravity": False})  # pyright: ignore[reportArgumentType]


@dataclass(frozen=True)
class Outcome:
    """Of one recording: effect in stated deviations of the moments, names by merit, largest probability of the named."""

    verdict: str
    effect: float
    names: tuple[str, ...]
    first: float


def scenario(kind: str, seed: int) -> Scenario:
    """A rich motion of a body with three moments."""
    return Scenario(
        kind=kind,
        principal_moments=(1.0, 0.8, 0.55),
        rate_rpm=RICH_RPM,
        epochs=80,
        interval=0.4,
        landmarks=120,
        seed=seed,
    )


def unstated(dataset: Dataset) -> Dataset:
    """The same, with noise that nobody states."""
    streams = tuple(replace(stream, covariance=None) for stream in dataset.log.streams)
    options = replace(dataset.options, force_psd=None, torque_psd=None, sensor_noise={})
    return replace(dataset, log=MeasurementLog(streams), options=options)


def outcome_of(dataset: Dataset) -> Outcome:
    """Of the smoother."""
    try:
        setup = prepare(dataset, SETTINGS)
        (evaluation,) = compare_estimators(setup, SETTINGS, lambda *_: None).evaluations
    except InputError as error:
        return Outcome("refused", np.inf, (str(error)[:40],), 0.0)
    body, truth = evaluation.body, dataset.truth
    assert truth is not None
    assert truth.principal_moments is not None
    away = np.abs(body.principal_moments - truth.principal_moments)[:2] / body.principal_moments_std[:2]
    found = tested_models(setup, [evaluation])
    named = tuple(each.error.name for each in found.named)
    least = min((each.p_value for each in found.tests), default=np.nan)
    return Outcome(str(evaluation.history.status.verdict), float(away.max()), named, least)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kinds", default="pose,gyro,stereo-tracks")
    parser.add_argument("--faults", default="")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--clean", type=int, default=20)
    parser.add_argument("--unstated", action="store_true")
    options = parser.parse_args()
    for kind in options.kinds.split(","):
        least = [_outcome(kind, None, 0.0, 100 + seed, options.unstated) for seed in range(options.clean)]
        alarms = sum(bool(each.names) for each in least)
        smallest = [f"{each.first:.1g}" for each in least]
        print(f"{kind}: clean, {alarms} of {len(least)} alarms, least p {' '.join(smallest)}", flush=True)
        for fault in FAULTS[kind]:
            if options.faults in fault.name:
                _print(kind, fault, options)


def _print(kind: str, fault: Fault, options: argparse.Namespace) -> None:
    for size in fault.sizes:
        for seed in range(options.seeds):
            found = _outcome(kind, fault, size, seed, options.unstated)
            hit = "HIT" if fault.name in found.names else "other" if found.names else "silent"
            print(
                f"{kind} {fault.name:20s} {size:8.3g} {found.verdict:9s} effect {found.effect:8.1f} {hit:6s} {found.names}",
                flush=True,
            )


def _outcome(kind: str, fault: Fault | None, size: float, seed: int, silent: bool) -> Outcome:
    dataset = faulty(scenario(kind, seed), fault, size)
    return outcome_of(unstated(dataset) if silent else dataset)


if __name__ == "__main__":
    main()
