"""A sealed trial: are estimates called ok right, on recordings whose truths were fixed before anything was estimated?

    python -m experiments.sealed_trial seal [--each 5] [--brick FILE] [--seal experiments/sealed-trial.json]
    python -m experiments.sealed_trial run [--brick FILE] [--seal experiments/sealed-trial.json] [-o runs/sealed-trial]

``seal`` makes the recordings of every family and writes the SHA-256 of each truth, which is to be committed before ``run``. That
makes the recordings again, refuses any whose truth has another digest, and estimates with MEKF and smoother. It goes on with the
rows that are there. Printed are by family how many are ``ok``, how many of these have a published quantity beyond 4 stated
deviations, and how many of those whose moments are determined (stated deviations up to a tenth) are ``ok``. Six of the families
come from simulators that are not ours (`experiments.other_simulators`). In the last families something is wrong that a verdict
should doubt, so that their ``ok`` are no aim: only that none of them is beyond 4.
"""

import argparse
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from experiments.command_line import Row, rows_of_seeds, run_study
from experiments.named_causes import drawn as drawn_cause
from experiments.named_causes import recorded
from experiments.other_simulators import brick_recording, drake_recording, mujoco_recording
from spinfilters.campaigns.calibration_draws import CalibrationDraw, calibration_draw, drawn_scenario
from spinfilters.campaigns.statistics import share
from spinfilters.core.errors import InputError
from spinfilters.evaluation.recording_bound import without_bounds
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR
from spinfilters.io.dataset import Dataset
from spinfilters.io.output_files import make_folder, write_json
from spinfilters.models.status import Verdict
from spinfilters.plots.style import legend_below, save_figure
from spinfilters.run.estimation import Comparison, ComparisonExtent, compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.measurement_faults import GrossError, with_faults, with_gauss_markov_errors
from spinfilters.simulation.scenario import Scenario, simulate, without_map, without_noise

ESTIMATORS: Final = ("mekf", "smoother")
FIRST_SEED: Final = 6_000_000
"""Of the trial; seeds up to here were used in the making of the estimators and in former trials."""
OWN_PRIOR: Final = ("gyro", "pose", "stereo-tracks")
"""Kinds whose scenarios are drawn from their own prior; all others have that of poses."""
MOST_OF_FAMILY: Final = 10_000
"""Recordings, so that each family has seeds of its own."""
DIGITS: Final = 6
"""Decimals of a truth that its digest is of: those behind them are rounding, which differs by machine."""
COLOURS: Final = {"ok": "tab:blue", "degraded": "tab:orange", "failed": "tab:red"}


@dataclass(frozen=True)
class Family:
    """Recordings of one kind.

    Attributes
    ----------
    name : str
        With the simulator, where it is not ours.
    make : Callable[[int], Dataset]
        The recording of a seed.
    is_faulty : bool
        Whether something is wrong with it that a verdict should doubt.
    """

    name: str
    make: Callable[[int], Dataset]
    is_faulty: bool = False


def drawn(sensor: str, seed: int) -> Dataset:
    """From the prior of the calibration, noise stated."""
    return simulate(drawn_scenario(sensor, seed))


def other_sensor(kind: str, seed: int) -> Dataset:
    """Body and motion from the prior of poses, measured by a sensor that has no prior of its own."""
    return simulate(replace(drawn_scenario("pose", seed), kind=kind))


def with_lasting_errors(sensor: str, seed: int) -> Dataset:
    """With Gauss-Markov errors beside the white ones, as large, a correlation of 0.9 from epoch to epoch."""
    scenario = drawn_scenario(sensor, seed)
    std = {
        "gyro": np.full(3, scenario.gyro_std),
        "pose": np.repeat([scenario.position_std, scenario.rotation_std], 3),
    }[sensor]
    return with_gauss_markov_errors(simulate(scenario), std, 0.9, np.random.default_rng(seed))


def with_wrong_poses(seed: int) -> Dataset:
    """Poses of which three of 100 are wrong altogether."""
    wrong = [GrossError("turned", 20), GrossError("outlier", 50), GrossError("turned", 80)]
    return with_faults(drawn("pose", seed), wrong, seed)


def faulty(sensor: str, cause: str, seed: int) -> Dataset:
    """Body, motion and size of a cause as `experiments.named_causes` draws them."""
    scenario, fault, size, _ = drawn_cause(sensor, cause, seed)
    return recorded(scenario, fault, size, stated=False)


def families(brick: Path | None) -> list[Family]:
    """All; that of the check case only where its file is given."""

    def identified(make: Callable[[int], Dataset]) -> Callable[[int], Dataset]:
        return lambda seed: without_noise(make(seed))

    def of_other(program: Callable[[Scenario], Dataset], kind: str) -> Callable[[int], Dataset]:
        def make(seed: int) -> Dataset:
            scenario = drawn_scenario(kind, seed) if kind in OWN_PRIOR else drawn_scenario("pose", seed)
            return without_noise(without_map(program(replace(scenario, kind=kind))))

        return make

    def of_brick(file: Path) -> Callable[[int], Dataset]:
        # 100 of 301 epochs, from five beginnings in turn
        return lambda seed: without_noise(brick_recording(file, 50 * (seed % 5), 100, 0.002, seed))

    found = [
        Family("gyro", identified(partial(drawn, "gyro"))),
        Family("gyro, noise stated", partial(drawn, "gyro")),
        Family("poses", identified(partial(drawn, "pose"))),
        Family("poses, noise stated", partial(drawn, "pose")),
        Family("attitudes", identified(partial(other_sensor, "attitude"))),
        Family("tracks", identified(lambda seed: without_map(drawn("stereo-tracks", seed)))),
        Family("tracks, known body", identified(partial(drawn, "stereo-tracks"))),
        Family("lidar points, known body", identified(partial(other_sensor, "lidar-points"))),
        Family("gyro with lasting errors", identified(partial(with_lasting_errors, "gyro"))),
        Family("poses with lasting errors", identified(partial(with_lasting_errors, "pose"))),
        Family("poses, 3 of 100 wrong", identified(with_wrong_poses)),
        Family("gyro (MuJoCo)", of_other(mujoco_recording, "gyro")),
        Family("poses (MuJoCo)", of_other(mujoco_recording, "pose")),
        Family("attitudes (MuJoCo)", of_other(mujoco_recording, "attitude")),
        Family("gyro (Drake)", of_other(drake_recording, "gyro")),
        Family("poses (Drake)", of_other(drake_recording, "pose")),
        Family("gyro with a flywheel inside", partial(faulty, "gyro", "rotor"), True),
        Family("poses, touched amid", partial(faulty, "pose", "contact-amid"), True),
        Family("poses, clock drifts", partial(faulty, "pose", "clock-drift"), True),
    ]
    if brick is not None:
        found.insert(-3, Family("gyro (NASA check case)", of_brick(brick)))
    return found


def truth_digest(dataset: Dataset) -> str:
    """SHA-256 of motion and body, rounded to `DIGITS` decimals."""
    truth = dataset.truth
    assert truth is not None
    digest = hashlib.sha256()
    body = [truth.body[name] for name in sorted(truth.body)]
    for each in (truth.time, truth.center_of_mass, truth.q_ig, truth.velocity, truth.rate_i, *body):
        digest.update((np.round(each, DIGITS) + 0.0).astype("<f8").tobytes())  # + 0: no negative zero
    return digest.hexdigest()


def sealed(chosen: Sequence[Family], each: int) -> dict[str, dict[str, str]]:
    """Digest of every truth by family and seed."""
    found: dict[str, dict[str, str]] = {}
    for number, family in enumerate(chosen):
        first = FIRST_SEED + MOST_OF_FAMILY * (number + 1)
        seeds = range(first, first + each)
        found[family.name] = {str(seed): truth_digest(family.make(seed)) for seed in seeds}
    return found


def unsealed(family: Family, seed: int, digest: str) -> Dataset:
    """A recording whose truth is the sealed one.

    Raises
    ------
    InputError
        It is another.
    """
    dataset = family.make(seed)
    if truth_digest(dataset) != digest:
        raise InputError(
            f"the truth of {family.name}, seed {seed}, is not the sealed one; seal again, and commit it before the run"
        )
    return dataset


def compared(dataset: Dataset) -> Comparison | None:
    """All estimators on a recording; None where it is refused."""
    settings = Settings(estimators=ESTIMATORS)
    try:
        setup = prepare(dataset, settings)
        extent = ComparisonExtent(bounding=without_bounds)
        return compare_estimators(setup, settings, lambda name, done, every: None, extent=extent)
    except InputError:
        return None


def draws_of(dataset: Dataset, seed: int) -> list[CalibrationDraw]:
    """What every estimator says; empty where the recording is refused."""
    found = compared(dataset)
    return [] if found is None else [calibration_draw(each, seed) for each in found.evaluations]


def rows_of(family: Family, seals: Mapping[str, str], seed: int) -> Iterator[Row]:
    """A row an estimator."""
    dataset = unsealed(family, seed, seals[str(seed)])
    found = draws_of(dataset, seed)
    for name in ESTIMATORS:
        draw = next((each for each in found if each.estimator == name), None)
        yield {
            "family": family.name,
            "seed": seed,
            "estimator": name,
            "verdict": "refused" if draw is None else draw.verdict,
            "determined": draw is not None and draw.determined,
            "worst": None if draw is None else draw.worst,
        }


def counts_of(rows: Sequence[Row]) -> str:
    """Cells of a table: ok, of these wrong, largest error of these, ok of the determined."""
    ok = [row for row in rows if row["verdict"] == str(Verdict.OK)]
    wrong = [row for row in ok if not row["worst"] <= LARGEST_STATED_ERROR]
    determined = [row for row in rows if row["determined"]]
    right = sum(row["verdict"] == str(Verdict.OK) for row in determined)
    largest = max((row["worst"] for row in ok), default=0.0)
    return f"{len(ok)} of {len(rows)} | {len(wrong)} | {largest:.1f} | {right} of {len(determined)}"


def figure_of(rows: Sequence[Row]) -> Figure:
    """Largest error of every recording, by family and verdict."""
    names = list(dict.fromkeys(row["family"] for row in rows))
    figure = Figure(figsize=(9, 1.2 + 0.42 * len(names)), layout="constrained")
    axes = figure.subplots(1, len(ESTIMATORS), sharey=True, sharex=True)
    for axis, estimator in zip(axes, ESTIMATORS, strict=True):
        for verdict, colour in COLOURS.items():
            own = [
                row
                for row in rows
                if row["estimator"] == estimator and row["verdict"] == verdict and row["worst"] is not None
            ]
            places = [names.index(row["family"]) for row in own]
            axis.plot([row["worst"] for row in own], places, "o", color=colour, alpha=0.7, label=verdict)
        axis.axvline(LARGEST_STATED_ERROR, color="black", linewidth=0.8)
        axis.set(title=estimator, xscale="log", xlabel="largest error, stated deviations")
    axes[0].set_yticks(range(len(names)), names)
    axes[0].invert_yaxis()
    legend_below(figure, [line for line in axes[0].lines if not str(line.get_label()).startswith("_")])
    return figure


def run_trial(chosen: Sequence[Family], seals: Mapping[str, Mapping[str, str]], output: Path) -> None:
    """Estimate what is missing, print, draw."""
    make_folder(output)
    path = output / "rows.jsonl"
    done = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    held, rows = {(row["family"], row["seed"]) for row in done}, list(done)
    for family in chosen:
        own = seals.get(family.name, {})
        missing = [int(seed) for seed in own if (family.name, int(seed)) not in held]
        rows += rows_of_seeds(partial(rows_of, family, own), missing, path)
    print("| family | estimator | ok | of these beyond 4 | largest of these | ok of determined |")
    for name in dict.fromkeys(row["family"] for row in rows):
        for estimator in ESTIMATORS:
            own = [row for row in rows if row["family"] == name and row["estimator"] == estimator]
            print(f"| {name} | {estimator} | {counts_of(own)} |")
    sound = {family.name for family in chosen if not family.is_faulty}
    for estimator in ESTIMATORS:
        every = [row for row in rows if row["estimator"] == estimator]
        print(f"| all sound | {estimator} | {counts_of([row for row in every if row['family'] in sound])} |")
        ok = [row for row in every if row["verdict"] == str(Verdict.OK)]
        wrong = share(sum(not row["worst"] <= LARGEST_STATED_ERROR for row in ok), len(ok))
        print(f"| all | {estimator} | {counts_of(every)} |, beyond 4: {wrong.low:.1%} to {wrong.high:.1%}")
    save_figure(figure_of(rows), output / "sealed-trial.png")
    print(f"look at {output / 'sealed-trial.png'}")


def main() -> None:
    """Seal or run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("step", choices=("seal", "run"))
    parser.add_argument("--each", type=int, default=5, help="recordings of a family")
    parser.add_argument("--brick", type=Path, default=None, help="rates of the check case")
    parser.add_argument("--seal", type=Path, default=Path("experiments/sealed-trial.json"))
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/sealed-trial"))
    options = parser.parse_args()
    chosen = families(options.brick)
    if options.step == "seal":
        write_json(options.seal, sealed(chosen, options.each))
        print(f"written to {options.seal}; commit it before the run")
    else:
        run_trial(chosen, json.loads(options.seal.read_text(encoding="utf-8")), options.output)


if __name__ == "__main__":
    run_study(main)
