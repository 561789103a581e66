"""A short run whose checkpoints are tested, and what of it must come out the same bit for bit."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from spinfilters.evaluation.recording_bound import without_bounds
from spinfilters.filters.estimator import Estimator
from spinfilters.inference.setup import Setup
from spinfilters.run.checkpoints import CheckpointInterval, RunFingerprint, checkpoint_stores, fingerprint_of
from spinfilters.run.estimation import (
    Comparison,
    ComparisonExtent,
    Progress,
    build_estimator,
    compare_estimators,
)
from spinfilters.run.preparation import prepare
from spinfilters.run.run_folder import mark_run_folder, write_run
from spinfilters.settings.run_settings import FILTER, InitialisationOptions, Settings
from spinfilters.simulation.scenario import Scenario, simulate

NAMES = ("mekf", "ukf")
FIRST = InitialisationOptions(epochs=20, share=0.45)
SETTINGS = Settings(estimators=NAMES, initialisation=FIRST, verdict=FILTER)
EVERY_FRAME = CheckpointInterval(0.0, np.inf)
UNBOUNDED = ComparisonExtent(bounding=without_bounds, rehearsing=None)
SAME_FILES = ("trajectory.csv", "trajectory.tum", "map.ply")


def silent(*_: object) -> None:
    """Report no progress."""


@cache
def sample() -> Setup:
    """70 epochs of tracks with a known map, 20 of which the start smooths unless it wants more."""
    return prepare(simulate(Scenario.simplified(epochs=70, landmarks=60)), SETTINGS)


@cache
def unmapped() -> Setup:
    """The same tracks before the map is known: filters then hold the landmarks in their state."""
    return prepare(replace(sample().dataset, known_map=None), SETTINGS)


@cache
def epochs_to_do() -> int:
    """How many epochs every filter does."""
    return len(sample().timeline) - len(sample().initial.mean)


def make_run(
    folder: Path, progress: Progress = silent, interval: CheckpointInterval = EVERY_FRAME
) -> Comparison:
    """What ``spinfilters compare`` does, without figures and bounds."""
    folder.mkdir(exist_ok=True)
    mark_run_folder(folder, SETTINGS)
    comparison = compare_estimators(
        sample(), SETTINGS, progress, checkpoint_stores(folder, sample(), SETTINGS, interval), UNBOUNDED
    )
    write_run(folder, comparison, SETTINGS)
    return comparison


def results(folder: Path) -> dict[str, object]:
    """Everything in a run folder that does not tell how long it took."""
    found: dict[str, object] = {}
    for name in NAMES:
        for file in SAME_FILES:
            found[f"{name}/{file}"] = (folder / name / file).read_bytes()
        with np.load(folder / name / "history.npz") as arrays:
            found |= {f"{name}/{key}": arrays[key].tobytes() for key in arrays if key != "runtime"}
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    for estimate in summary["estimators"].values():
        del estimate["runtime_s"]
    return found | {"summary": summary}


def fresh(name: str, setup: Setup | None = None) -> Estimator:
    """An estimator at the end of the start, of the sample where nothing else is given."""
    setup = setup or sample()
    estimator = build_estimator(name, setup, SETTINGS)
    estimator.start(setup.belief)  # pyright: ignore[reportArgumentType]
    return estimator


def fingerprint(name: str, **settings: object) -> RunFingerprint:
    """Of the sample's run, with some settings changed."""
    process = replace(SETTINGS.process, **settings)  # pyright: ignore[reportArgumentType]
    document = replace(SETTINGS, process=process).document
    return fingerprint_of(name, sample().timeline, sample().belief, document)
