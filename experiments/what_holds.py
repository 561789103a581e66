"""What is said to hold of mixed recordings, right and faulty, compared with the truth.

    python -m experiments.what_holds [--runs 300] [--first 0] [--quick] [--kind NAME] [--report] [-o runs/what-holds]

Draws recordings of a gyro, of poses and of tracks with and without a map: steady spins, flips, rich and fast motions of 40 to 50
epochs, their noise stated or not. Half of them have a fault: a wrong model of any size, gross errors, or a wrong stated noise.
MEKF and smoother estimate each; of every quantity their run says whether it holds. Rows go to ``rows.jsonl`` of the folder, which
later calls go on with; ``--first`` begins at a later draw, for a sample that nothing was tuned to.

Printed are, of the quantities that are said to hold,

- the share of (epoch, quantity) beyond 4 stated deviations, which the verdict promises at any one epoch;
- the share of (run, quantity) beyond 4 in the last epoch, and at any of the run's own epochs, where some are by chance;

of the quantities that are wrong (beyond 4 in the last epoch, or in more than a tenth of the epochs) how many are said to hold;
of the estimates that are ok and have no fault how many have an epoch beyond 4, beside what chance explains;
and of the degraded runs how often each quantity is said to hold among those in which it does (beyond 4 at no epoch).
"""

import argparse
import json
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import erfc
from pathlib import Path
from time import process_time
from typing import Any, Final

import numpy as np

from experiments.command_line import rows_of_seeds, run_study
from spinfilters.core.errors import SpinfiltersError
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR, quantity_errors
from spinfilters.io.dataset import Dataset
from spinfilters.io.output_files import make_folder
from spinfilters.models.process import ProcessNoise
from spinfilters.models.status import QUANTITIES
from spinfilters.run.estimation import ComparisonExtent, compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.measurement_faults import GrossError, Outliers, with_faults
from spinfilters.simulation.model_faults import faulty_recording, model_faults
from spinfilters.simulation.scenario import (
    RICH_RPM,
    THESIS_RPM,
    Scenario,
    simulate,
    without_map,
    without_noise,
)

MANY: Final = 0.1
"""Share of a run's epochs beyond it from which a quantity is wrong."""
NO_MAP: Final = "tracks without map"
KINDS: Final = {"gyro": 0.32, "pose": 0.34, "stereo-tracks": 0.32, NO_MAP: 0.02}
"""Shares; tracks without a map take ten times as long as others."""
UNITS: Final = ("clock-unit", "length-unit", "gyro-unit")
"""Wrong models of which no residual tells: free motion has no scale of its own (see docs/how-to/model-errors.md)."""
MOTIONS: Final = {
    "rich": (RICH_RPM, 0.5),
    "flip": (THESIS_RPM, 0.5),
    "slow": ((1.6, 3.6, 1.2), 0.5),
    "steady, major": ((9.0, 0.0, 0.0), 0.5),
    "steady, minor": ((0.0, 0.0, 9.0), 0.5),
    "throw": ((80.0, 180.0, 60.0), 0.02),
}
"""Rate about the principal axes, rpm, and interval, s."""
ESTIMATORS: Final = ("mekf", "smoother")


@dataclass(frozen=True)
class DrawnRecording:
    """One recording of the sample, and what is wrong with it."""

    dataset: Dataset
    kind: str
    motion: str
    fault: str
    size: float
    stated: bool


def main() -> None:
    """Run what is missing, and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--first", type=int, default=0, help="number of the first draw")
    parser.add_argument(
        "--quick", action="store_true", help="leaves out tracks without a map, which take longest"
    )
    parser.add_argument("--kind", choices=tuple(KINDS), default=None, help="leaves out all others")
    parser.add_argument("--report", action="store_true", help="of the rows that are there")
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/what-holds"))
    options = parser.parse_args()
    make_folder(options.output)
    path = options.output / "rows.jsonl"
    rows = _read(path)
    asked = range(options.first, options.first + options.runs)
    if not options.report:
        known = {row["run"] for row in rows}
        missing = (each for each in asked if each not in known)
        left_out = {NO_MAP} if options.quick else set()
        kinds = ({options.kind} if options.kind else set(KINDS)) - left_out
        rows += rows_of_seeds(lambda number: _rows(number, kinds), missing, path)
    for line in lines_of([row for row in rows if row["run"] in asked]):
        print(line)


def _rows(number: int, kinds: set[str]) -> Iterator[dict[str, Any]]:
    recording = drawn(number)
    if recording.kind in kinds:
        yield from rows_of(number, recording)


def _read(path: Path) -> list[dict[str, Any]]:
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def drawn(number: int) -> DrawnRecording:
    """The recording of a number; a fault in every second."""
    generator = np.random.default_rng([number, 1115])
    kind = str(generator.choice(list(KINDS), p=list(KINDS.values())))
    motion = list(MOTIONS)[int(generator.integers(len(MOTIONS)))]
    rate, interval = MOTIONS[motion]
    moments = ((1.0, 0.8, 0.55), (1.0322, 1.0, 0.8596), (1.0, 0.6, 0.5))[int(generator.integers(3))]
    scenario = Scenario.simplified(
        kind="stereo-tracks" if kind.startswith("tracks") else kind,
        principal_moments=moments,
        rate_rpm=rate,
        epochs=int(generator.integers(40, 51)),
        interval=interval,
        landmarks=60,
        noise=ProcessNoise(4e-8, 1e-6),
        seed=number,
    )
    stated, size = bool(generator.random() < 0.5), float(10 ** generator.uniform(-1, 1))
    possible = sorted(
        name for name, fault in model_faults().items() if scenario.kind in fault.kinds and name not in UNITS
    )
    name, which = possible[int(generator.integers(len(possible)))], float(generator.random())
    if number % 2 == 0:
        dataset, fault = simulate(scenario), ""
    elif which < 0.6:
        wrong = model_faults()[name]
        seeds = tuple(np.random.SeedSequence([number, 1115]).spawn(3))
        dataset, fault = faulty_recording(scenario, wrong, size * wrong.size, seeds), name
        dataset = replace(dataset, options=replace(dataset.options, calibration={}))  # not said to be exact
    elif which < 0.75:
        gross = which < 0.67
        fault = "gross error" if gross else "outliers"
        epoch = int(generator.integers(scenario.epochs))
        made = GrossError("outlier", epoch) if gross else Outliers(0.02 * size)
        dataset = with_faults(simulate(scenario), [made], number)
    else:
        dataset, fault, stated = _wrong_noise(simulate(scenario), size, generator), "stated noise", True
    if not stated:
        dataset = without_noise(dataset)
    if kind.startswith("tracks"):
        dataset = without_map(dataset)
    return DrawnRecording(dataset, kind, motion, fault, size, stated)


def _wrong_noise(dataset: Dataset, times: float, generator: np.random.Generator) -> Dataset:
    """One of the stated levels is so many times the true one, or of a density the square of that."""
    options = dataset.options
    names = sorted(options.sensor_noise)
    chosen = ["torque_psd", *names][int(generator.integers(1 + len(names)))]
    if chosen == "torque_psd":
        assert options.torque_psd is not None
        return replace(dataset, options=replace(options, torque_psd=times**2 * options.torque_psd))
    noise = {**options.sensor_noise, chosen: times * options.sensor_noise[chosen]}
    return replace(dataset, options=replace(options, sensor_noise=noise))


def rows_of(number: int, recording: DrawnRecording) -> Iterator[dict[str, Any]]:
    """A row per estimator of one recording; one without results where it is refused."""
    told = {
        "run": number,
        "kind": recording.kind,
        "motion": recording.motion,
        "fault": recording.fault,
        "size": round(recording.size, 3),
        "stated": recording.stated,
    }
    settings, begin = Settings(estimators=ESTIMATORS), process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            setup = prepare(recording.dataset, settings)
            extent = ComparisonExtent(bounding=lambda found, _: list(found))
            found = compare_estimators(setup, settings, lambda *_: None, extent=extent)
    except SpinfiltersError as error:
        yield {**told, "estimator": "", "verdict": "refused", "reason": str(error)}
        return
    for evaluation in found.evaluations:
        status = evaluation.history.status
        quantities = {}
        for name, errors in quantity_errors(evaluation).items():
            finite = np.minimum(errors, 1e9)
            quantities[name] = {
                "holds": str(status.holds[name]),
                "epochs": len(errors),
                "beyond": int(np.count_nonzero(errors > LARGEST_STATED_ERROR)),
                "largest": round(float(finite.max()), 3),
                "last": round(float(finite[-1]), 3),
                "rms": round(float(np.sqrt(np.mean(finite**2))), 3),
            }
        yield {
            **told,
            "estimator": evaluation.name,
            "verdict": str(status.verdict),
            "checks": [each.check for each in status.findings],
            "seconds": round(process_time() - begin, 2),
            "quantities": quantities,
        }


@dataclass(frozen=True)
class JudgedQuantity:
    """One quantity of one estimate."""

    row: dict[str, Any]
    name: str

    @property
    def numbers(self) -> dict[str, Any]:
        """Its entry in the row."""
        return self.row["quantities"][self.name]

    @property
    def is_held(self) -> bool:
        """Whether it is said to hold."""
        return self.numbers["holds"] == "ok"

    @property
    def is_wrong(self) -> bool:
        """Whether it is beyond what is promised, and not by chance at one epoch."""
        own = self.numbers
        return own["last"] > LARGEST_STATED_ERROR or own["beyond"] > MANY * own["epochs"]

    @property
    def text(self) -> str:
        """For a list of what is said to hold and is wrong."""
        row, own = self.row, self.numbers
        what = f"{row['fault'] or 'right'} x {row['size']:g}" if row["fault"] else "right"
        return (
            f"run {row['run']}, {row['estimator']}, {row['kind']}, {row['motion']}, {what}, "
            f"{'stated' if row['stated'] else 'unstated'}: {self.name} last {own['last']:.1f}, largest {own['largest']:.1f}, "
            f"{own['beyond']} of {own['epochs']}; {row['verdict']} {' '.join(row['checks'])}"
        )


def lines_of(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Lines of the report."""
    verdicts = Counter(row["verdict"] for row in rows)
    yield f"{len({row['run'] for row in rows})} recordings, estimates: {dict(verdicts)}"
    every = [JudgedQuantity(row, name) for row in rows for name in row.get("quantities", ())]
    for title, some in {
        "all": every,
        "degraded": [each for each in every if each.row["verdict"] == "degraded"],
        "ok": [each for each in every if each.row["verdict"] == "ok"],
    }.items():
        yield from _held_lines(title, some)
    yield from _chance_lines([row for row in rows if row["verdict"] == "ok" and not row["fault"]])
    wrong = [each for each in every if each.is_wrong]
    yield f"wrong: {len(wrong)} of {len(every)}, of these said to hold {sum(each.is_held for each in wrong)}"
    yield from (f"  {each.text}" for each in wrong if each.is_held)
    far = [
        each
        for each in every
        if each.is_held and not each.is_wrong and each.numbers["largest"] > LARGEST_STATED_ERROR
    ]
    yield f"said to hold and beyond {LARGEST_STATED_ERROR:g} at some epochs, not counted as wrong: {len(far)}"
    yield from (f"  {each.text}" for each in far)
    degraded = [row for row in rows if row["verdict"] == "degraded"]
    for name in QUANTITIES:
        own = [JudgedQuantity(row, name) for row in degraded if name in row["quantities"]]
        right = [each for each in own if each.numbers["largest"] <= LARGEST_STATED_ERROR]
        held = sum(each.is_held for each in right)
        yield f"  degraded, {name:15s} {len(own):4d} runs, right in {len(right):4d}, of these said to hold {held:4d}"
    right = [row for row in rows if not row["fault"]]
    alarms = Counter(c.split(":")[0] for row in right for c in row.get("checks", ()))
    yield f"of {len(right)} estimates of right recordings, checks that failed: {dict(alarms.most_common())}"
    yield f"of all degraded estimates: {dict(Counter(c.split(':')[0] for row in degraded for c in row['checks']).most_common())}"


def _chance_lines(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Estimates that are ok and have no fault: how many have an epoch beyond the limit, and how many chance explains at most.

    The limit is exceeded by each of a quantity's three components with the probability of a normal error. Errors of neighbouring
    epochs are correlated, so that fewer estimates have an epoch beyond it than with independent ones.
    """
    if not rows:
        return
    values = np.array([3 * sum(own["epochs"] for own in row["quantities"].values()) for row in rows])
    beyond = [any(own["beyond"] for own in row["quantities"].values()) for row in rows]
    expected = values * erfc(LARGEST_STATED_ERROR / np.sqrt(2))
    yield (
        f"ok without fault: {sum(beyond)} of {len(rows)} estimates have an epoch beyond {LARGEST_STATED_ERROR:g} "
        f"{np.mean(beyond):.1%}; of normal errors {np.mean(expected):.3f} values each and "
        f"at most {np.mean(-np.expm1(-expected)):.1%} of the estimates, {np.mean(values):.0f} values each"
    )


def _held_lines(title: str, every: Sequence[JudgedQuantity]) -> Iterator[str]:
    held = [each for each in every if each.is_held]
    epochs, beyond = (sum(each.numbers[key] for each in held) for key in ("epochs", "beyond"))
    last = sum(each.numbers["last"] > LARGEST_STATED_ERROR for each in held)
    largest = sum(each.numbers["largest"] > LARGEST_STATED_ERROR for each in held)
    yield (
        f"{title}: {len(held)} of {len(every)} (run, quantity) said to hold; "
        f"beyond {LARGEST_STATED_ERROR:g}: {beyond} of {epochs} (epoch, "
        f"quantity) {beyond / max(epochs, 1):.2%}, {last} in the last epoch {last / max(len(held), 1):.2%}, {largest} at any epoch "
        f"{largest / max(len(held), 1):.2%}"
    )


if __name__ == "__main__":
    run_study(main)
