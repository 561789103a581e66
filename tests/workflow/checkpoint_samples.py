"""A short run whose checkpoints are tested, and what of it must come out the same bit for bit."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from spinfilters.estimators.estimator import Estimator
from spinfilters.estimators.initialisation.options import StartOptions
from spinfilters.simulation.scenario import Scenario, simulate
from spinfilters.workflow.checkpointing import Pace, keep_in
from spinfilters.workflow.estimation import Comparison, Progress, build_estimator, compare_estimators
from spinfilters.workflow.preparation import Prepared, prepare
from spinfilters.workflow.run_folder import mark_run_folder, write_run
from spinfilters.workflow.run_identity import RunIdentity, identify_run
from spinfilters.workflow.settings import Settings

NAMES = ("mekf", "ukf")
SETTINGS = Settings(estimators=NAMES, start=StartOptions(frames=20))
EVERY_FRAME = Pace(0.0, np.inf)
SAME_FILES = ("trajectory.csv", "trajectory.tum", "map.ply")


def silent(*_: object) -> None:
    """Report no progress."""


@cache
def sample() -> Prepared:
    """70 frames of tracks with a known map, 20 of which the start smooths unless it wants more."""
    return prepare(simulate(Scenario(frames=70, landmarks=60)), SETTINGS)


@cache
def unmapped() -> Prepared:
    """The same tracks before the map is known: filters then hold the landmarks in their state."""
    return prepare(replace(sample().dataset, known_map=None), SETTINGS)


@cache
def frames_to_do() -> int:
    """How many frames every filter does."""
    return len(sample().timeline) - len(sample().start.mean)


def make_run(folder: Path, progress: Progress = silent, pace: Pace = EVERY_FRAME) -> Comparison:
    """What ``spinfilters compare`` does, without figures."""
    folder.mkdir(exist_ok=True)
    mark_run_folder(folder, SETTINGS)
    comparison = compare_estimators(sample(), SETTINGS, progress, keep_in(folder, sample(), SETTINGS, pace))
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


def fresh(name: str, prepared: Prepared | None = None) -> Estimator:
    """An estimator at the end of the start, of the sample where nothing else is given."""
    prepared = prepared or sample()
    estimator = build_estimator(name, prepared, SETTINGS)
    estimator.start(prepared.belief)  # pyright: ignore[reportArgumentType]
    return estimator


def identity(name: str, **settings: object) -> RunIdentity:
    """Of the sample's run, with some settings changed."""
    process = replace(SETTINGS.process, **settings)  # pyright: ignore[reportArgumentType]
    document = replace(SETTINGS, process=process).document
    return identify_run(name, sample().timeline, sample().belief, document)
