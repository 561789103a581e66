"""Causes that verdicts name first, of motions, bodies and sizes that are drawn.

    python -m experiments.named_causes [--sensors pose,gyro,tracks] [--causes rotor,hinge,...] [--seeds 20] [--first 0] [-o FILE]
        [--evidence]

Every seed draws its own body, motion, interval, length, noise and size of a cause, and whether the noise is stated. Printed are of
each sensor and cause the runs, those that are doubted, in how many the right cause is first or among the first two, and what was
named instead; of ``none`` the false alarms. A run that is ``ok`` with an error beyond 4 stated deviations is a defect. ``-o`` keeps
a line of JSON for each run. ``--evidence`` prints the largest 2 ln likelihood ratio by which the right cause explains residuals,
over its sizes and over densities of disturbances down to a sixteenth of the identified ones, and with which probability noise gives
as much. No test of these residuals finds a cause that noise explains so often.
"""

import argparse
import json
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from experiments.command_line import run_study
from spinfilters.campaigns.row_columns import result_columns
from spinfilters.core.errors import SpinfiltersError
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR
from spinfilters.filters.history import EstimateHistory
from spinfilters.filters.timeline import times_of
from spinfilters.inference.identified_noise import Unstated, noise_model
from spinfilters.inference.setup import Setup
from spinfilters.io.dataset import Dataset
from spinfilters.models.process import ProcessNoise
from spinfilters.run.estimation import compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.model_faults import ModelFault, faulty_recording, model_faults
from spinfilters.simulation.scenario import Scenario, without_map, without_noise
from spinfilters.verdict.model_errors.alternatives import table
from spinfilters.verdict.model_errors.hypotheses import (
    KnownLevels,
    among_inliers,
    minus_twice_log_likelihood,
    noise_of,
    solved_near,
)
from spinfilters.verdict.model_errors.score_tests import likelier, score_tests
from spinfilters.verdict.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.verdict.model_tests import landmarks_placed, linear_problem, stated_levels

KINDS: Final = {"pose": "pose", "gyro": "gyro", "tracks": "stereo-tracks"}
CAUSES: Final = (
    "rotor",
    "hinge",
    "slip",
    "contact-at-begin",
    "contact-amid",
    "contact-at-end",
    "clock-drift",
    "clock-jitter",
)
SIZES: Final = (0.5, 5.0)
"""Between which multiples of a plain size are drawn, evenly in their logarithm."""
AXES: Final = {"rotor": "rotor"}
"""Physics whose direction is drawn, too, by cause."""
ALIKE: Final = {"contact-at-begin": "contact", "contact-amid": "contact", "contact-at-end": "contact"}
"""Names that are one cause."""
NONE: Final = "none"


@dataclass(frozen=True)
class CauseOutcome:
    """Of one run: its cause, verdict, largest error in stated deviations, and named classes of causes."""

    sensor: str
    cause: str
    seed: int
    size: float
    verdict: str
    error: float
    named: tuple[tuple[str, ...], ...]
    reasons: tuple[str, ...]
    seconds: float

    def is_among(self, count: int) -> bool:
        """Whether the right cause is among so many that are named first."""
        right = _class_of(self.cause)
        return any(right in map(_class_of, own) for own in self.named[:count])


def _class_of(name: str) -> str:
    return ALIKE.get(name, name)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sensors", default="pose,gyro,tracks")
    parser.add_argument("--causes", default=",".join(CAUSES))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, default=None)
    parser.add_argument("--evidence", action="store_true", help="of the right cause, in each recording")
    options = parser.parse_args()
    for sensor in options.sensors.split(","):
        for cause in options.causes.split(","):
            if cause != NONE and KINDS[sensor] not in model_faults()[cause].kinds:
                continue
            runs = []
            for seed in range(options.first, options.first + options.seeds):
                runs.append(outcome(sensor, cause, seed, options.evidence))
                if options.output is not None:
                    with options.output.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(_document(runs[-1])) + "\n")
            print(line_of(sensor, cause, runs), flush=True)


def outcome(sensor: str, cause: str, seed: int, has_evidence: bool = False) -> CauseOutcome:
    """One run of the smoother, with the evidence of its cause printed."""
    begin = time.perf_counter()
    scenario, fault, size, stated = drawn(sensor, cause, seed)
    dataset = recorded(scenario, fault, size, stated)
    settings = Settings(estimators=("smoother",))
    try:
        comparison = compare_estimators(prepare(dataset, settings), settings, lambda *_: None)
        (evaluation,) = comparison.evaluations
        if has_evidence:
            print(evidence_line(seed, cause, comparison.setup, evaluation.history))
        status, names = evaluation.history.status, comparison.models.names
        error = result_columns(evaluation).get("worst_error")
        verdict, reasons = str(status.verdict), tuple(status.reasons)
    except SpinfiltersError as refusal:
        verdict, reasons, names, error = "refused", (str(refusal),), (), None
    return CauseOutcome(
        sensor,
        cause,
        seed,
        size,
        verdict,
        np.nan if error is None else float(error),
        tuple(tuple(each.split("/")) for each in names),
        reasons,
        time.perf_counter() - begin,
    )


SHARES: Final = (1 / 2, 1 / 4, 1 / 8, 1 / 16)
"""Of the identified densities."""


def evidence_line(seed: int, cause: str, setup: Setup, history: EstimateHistory) -> str:
    """The most that a cause explains of a recording, as a line of text."""
    epochs = setup.timeline[: len(history.mean)]
    problem, error = linear_problem(setup, epochs), table()[cause]
    rows = solved_near(problem, history.mean, landmarks_placed(problem, history.mean))
    model = noise_model(problem, setup.noise, Unstated.of_all(setup.log, setup.process.noise))
    if rows is None or model is None:
        return f"  seed {seed}: no evidence can be computed"
    known, motion = KnownLevels(stated_levels(setup)), SmoothedMotion(times_of(epochs), rows)
    best = score_tests(motion, noise_of(model, rows, known), [error])
    free = np.array([name not in known.stated for name in model.densities])
    for share in SHARES if free.any() else ():
        lower = model.at(np.concatenate([np.zeros(len(model.components)), np.log(share) * free]))
        beside = among_inliers(lower.problem, rows)
        if beside is None:
            continue
        advantage = minus_twice_log_likelihood(beside) - minus_twice_log_likelihood(rows)
        own = score_tests(replace(motion, rows=beside), noise_of(lower, beside, known), [error])
        best = likelier(best, own, max(advantage, 0.0))
    if not best:
        return f"  seed {seed}: the states leave nothing of the {cause}"
    found = best[0]
    numbers = f"{found.gain:.1f} ({found.dof:.0f} numbers), by chance {found.p_value:.2g}"
    return f"  seed {seed}: {cause}, 2 ln likelihood ratio {numbers}"


def drawn(sensor: str, cause: str, seed: int) -> tuple[Scenario, ModelFault | None, float, bool]:
    """Scenario, fault, its size and whether noise is stated, of a seed."""
    draws = np.random.default_rng([seed, *cause.encode()])
    second = np.sort(draws.uniform(0.15, 1.0, 3))[::-1]  # second moments: every such body is possible
    moments = np.array([second[1] + second[0], second[0] + second[2], second[1] + second[2]])
    while True:  # a spin near a principal axis tells no cause from another
        direction = draws.standard_normal(3)
        direction /= np.linalg.norm(direction)
        if np.sort(np.abs(direction))[1] > 0.25:
            break
    rate = float(np.exp(draws.uniform(np.log(0.4), np.log(2.0))))  # rad/s
    interval = float(draws.uniform(0.15, 0.4) / rate)
    scenario = Scenario.simplified(
        kind=KINDS[sensor],
        principal_moments=tuple(moments / moments.max()),
        rate_rpm=tuple(direction * rate * 30 / np.pi),
        epochs=int(draws.integers(60, 121)),
        interval=interval,
        landmarks=120,
        gyro_std=float(np.exp(draws.uniform(np.log(0.001), np.log(0.01)))),
        noise=ProcessNoise(4e-8, 1e-6 * 10.0 ** draws.uniform(-2, 0)),
        seed=seed,
    )
    size, stated = (
        1.0 if cause == "slip" else float(np.exp(draws.uniform(*np.log(SIZES)))),
        bool(draws.random() < 0.5),
    )
    if cause == NONE:
        return scenario, None, 0.0, stated
    fault = model_faults()[cause]
    if cause in AXES:
        axis = draws.standard_normal(3)
        fault = replace(fault, physics={AXES[cause]: axis / np.linalg.norm(axis)})
    return scenario, fault, size, stated


def recorded(scenario: Scenario, fault: ModelFault | None, size: float, stated: bool) -> Dataset:
    """The recording of a scenario with a fault of a size, its calibration not stated."""
    own = ModelFault("", 0.0, (scenario.kind,)) if fault is None else fault
    seeds = tuple(np.random.SeedSequence(scenario.seed).spawn(3))
    dataset = without_map(faulty_recording(scenario, own, size * own.size, seeds))
    dataset = dataset if stated else without_noise(dataset)
    return replace(dataset, options=replace(dataset.options, calibration={}))


def line_of(sensor: str, cause: str, runs: Sequence[CauseOutcome]) -> str:
    """The runs of a sensor and a cause in one line."""
    silent = sum(each.verdict == "ok" and each.error > LARGEST_STATED_ERROR for each in runs)
    head = f"{sensor:6s} {cause:16s} {len(runs):3d} runs, {sum(e.verdict == 'ok' for e in runs):3d} ok, {silent} ok and wrong"
    if cause == NONE:
        return f"{head}, {sum(bool(each.named) for each in runs)} named: {dict(Counter(_names(runs)))}"
    doubted = [each for each in runs if each.verdict != "ok"]
    first, two = (sum(each.is_among(count) for each in doubted) for count in (1, 2))
    instead = Counter(_names([each for each in doubted if not each.is_among(2)]))
    seconds = np.mean([each.seconds for each in runs])
    return f"{head}; of {len(doubted)} doubted {first} first, {two} among two; else {dict(instead)}; {seconds:.1f} s each"


def _names(runs: Sequence[CauseOutcome]) -> Iterator[str]:
    for each in runs:
        yield from ("/".join(own) for own in each.named) if each.named else ("nothing",)


def _document(run: CauseOutcome) -> dict[str, Any]:
    return {**run.__dict__, "error": None if np.isnan(run.error) else run.error}


if __name__ == "__main__":
    run_study(main)
