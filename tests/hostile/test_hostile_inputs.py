"""A seeded sample of the hostile inputs; all of them are ``python -m tests.hostile.malformed``, ``.attacks`` and ``.fuzz``."""

from pathlib import Path

import numpy as np
import pytest
from pictures import unrendered_pictures

from .attacks import attack_cases
from .case import COMPARE, Case
from .fuzz import fuzzed_cases
from .malformed import malformed_cases
from .originals import make_originals
from .trial import tried

SEED = 10
MALFORMED, FUZZED, ATTACKS = 40, 15, 50
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
    return [
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


@pytest.mark.parametrize("case", sample(), ids=lambda case: case.name)
def test_a_hostile_input_ends_in_one_line_or_a_status(case: Case, folders: Path, tmp_path: Path) -> None:
    assert tried(case, folders, tmp_path).violations == []


def test_every_hostile_input_has_its_name() -> None:
    names = [case.name for case in (*malformed_cases(), *fuzzed_cases(300, 0), *attack_cases())]
    assert len(set(names)) == len(names) >= 1200


def test_a_violation_is_seen(folders: Path, tmp_path: Path) -> None:
    case = Case("writes into the input", "gyro", arguments=(*COMPARE[:2], "-o", "{in}/run", *COMPARE[4:]))
    assert "changed the user's run/summary.json" in tried(case, folders, tmp_path).violations
