"""A seeded sample of the hostile inputs; whole lists: ``python -m tests.hostile.malformed``, ``.attacks``, ``.plugins``."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pictures import unrendered_pictures

from .attacks import attack_cases
from .case import COMPARE, Case
from .containers import container_cases
from .equations import equation_cases
from .forks import Forks
from .full_disks import full_disk_cases
from .fuzz import fuzzed_cases
from .malformed import malformed_cases
from .originals import make_originals
from .plugins import plugin_cases
from .trial import tried

SEED = 10
MALFORMED, FUZZED, ATTACKS = 40, 15, 50
CONTAINERS, EQUATIONS = 40, 40
PLUGINS, FULL_DISKS = 25, 6
CRASHES = (
    "npz: corrupt deflate",
    "npz: an array of 2^70 numbers",
    "npz: an array of a shape nested without end",
    "npz: encrypted",
    "npz: an array of 1e15 numbers",
    "mat: numbers of a type that is none",
    "mat: cells within one another",
    "mat: a variable twice",
    "parquet: a column twice",
    "json: columns of lists that differ",
    "ulg: fields of 3e7 numbers",
    "reference: a cell of 200 kB",
    "model: a point of 1e999999999",
    "model: only an output",
    "model: tables nested without end",
    "plug-in: figures: an exit",
    "plug-in: sensors: an error whose text fails",
    "plug-in: entry point 'mine'",
    "plug-in: read: nothing",
    "plug-in: metric: a KeyError",
    "plug-in: metric: a text",
    "plug-in: figure with name = '../../../../x'",
)
"""Cases that ended otherwise once."""
READ_ONLY = (
    "stereo/",
    "gyro/",
    "pose/",
    "cam0",
    "cam1",
    "arguments",
    "truth.toml",
    "dataset.toml: ",
    "phone/",
)
"""Beginnings of the names of cases that are mostly refused when read, within milliseconds."""


def sample() -> list[Case]:
    """Some of those, some mutations, and some attacks."""
    quick = [case for case in malformed_cases() if case.name.startswith(READ_ONLY)]
    chosen = np.random.default_rng(SEED).choice(len(quick), MALFORMED, replace=False)
    attacks = attack_cases()
    attacked = np.random.default_rng(SEED).choice(len(attacks), ATTACKS, replace=False)
    containers, equations = list(container_cases()), list(equation_cases())
    plugins, full_disks = list(plugin_cases()), list(full_disk_cases())
    generator = np.random.default_rng(SEED)
    newer = {
        *generator.choice([case.name for case in containers], CONTAINERS, replace=False),
        *generator.choice([case.name for case in equations], EQUATIONS, replace=False),
        *generator.choice([case.name for case in plugins], PLUGINS, replace=False),
        *generator.choice([case.name for case in full_disks], FULL_DISKS, replace=False),
        *CRASHES,
    }
    return [
        *(case for case in (*containers, *equations, *plugins, *full_disks) if case.name in newer),
        *(quick[k] for k in chosen),
        *fuzzed_cases(FUZZED, SEED),
        *(attacks[k] for k in sorted(attacked)),
    ]


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The valid inputs."""
    folder = tmp_path_factory.mktemp("valid")
    with unrendered_pictures():
        make_originals(folder)
    return folder


@pytest.fixture(scope="module")
def forks(folders: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Forks]:
    """A process with the models of the valid inputs, whose children run the commands."""
    place = tmp_path_factory.mktemp("warm")
    kinds = ("gyro", "pose", "stereo", "unmapped")
    commands = [[*COMPARE[:1], str(folders / kind), "-o", str(place / kind), *COMPARE[4:]] for kind in kinds]
    with Forks([*commands, ["embed", "-o", str(place / "filter")]]) as started:
        yield started


@pytest.mark.parametrize("case", sample(), ids=lambda case: case.name)
def test_a_hostile_input_ends_in_one_line_or_a_status(
    case: Case, folders: Path, tmp_path: Path, forks: Forks
) -> None:
    assert tried(case, folders, tmp_path, forks.run).violations == []


def test_every_hostile_input_has_its_name() -> None:
    every = (
        *malformed_cases(),
        *fuzzed_cases(300, 0),
        *attack_cases(),
        *container_cases(),
        *equation_cases(),
        *plugin_cases(),
        *full_disk_cases(),
    )
    names = [case.name for case in every]
    assert len(set(names)) == len(names) >= 1600
    assert set(CRASHES) <= set(names)


def test_a_violation_is_seen(folders: Path, tmp_path: Path, forks: Forks) -> None:
    case = Case("writes into the input", "gyro", arguments=(*COMPARE[:2], "-o", "{in}/run", *COMPARE[4:]))
    assert "changed the user's run/summary.json" in tried(case, folders, tmp_path, forks.run).violations
