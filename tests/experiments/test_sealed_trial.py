"""A sealed trial: recordings whose truths were fixed before anything was estimated."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.sealed_trial import Family, counts_of, drawn, sealed, truth_digest, unsealed
from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset

FAMILY = Family("gyro", lambda seed: drawn("gyro", seed))


def moved(dataset: Dataset, by: float) -> Dataset:
    """With another true velocity."""
    assert dataset.truth is not None
    return replace(dataset, truth=replace(dataset.truth, velocity=dataset.truth.velocity + by))


def test_a_truth_has_its_digest_again_and_another_has_another() -> None:
    here = truth_digest(FAMILY.make(3))
    assert truth_digest(FAMILY.make(3)) == here
    assert truth_digest(FAMILY.make(4)) != here
    assert truth_digest(moved(FAMILY.make(3), 1e-5)) != here


def test_rounding_has_no_say_in_a_digest() -> None:
    dataset = FAMILY.make(3)
    assert dataset.truth is not None
    even = np.round(dataset.truth.velocity, 4)
    one, other = (
        replace(dataset, truth=replace(dataset.truth, velocity=even + by)) for by in (1e-12, -1e-12)
    )
    assert truth_digest(one) == truth_digest(other)


def test_a_recording_with_another_truth_than_the_sealed_one_is_refused() -> None:
    (seed, digest), *_ = sealed([FAMILY], 2)["gyro"].items()
    assert truth_digest(unsealed(FAMILY, int(seed), digest)) == digest
    with pytest.raises(InputError, match="is not the sealed one"):
        unsealed(Family("gyro", lambda seed: moved(FAMILY.make(seed), 0.1)), int(seed), digest)


def test_estimates_called_ok_and_wrong_are_counted() -> None:
    rows = [
        {"verdict": "ok", "worst": 5.0, "determined": True},
        {"verdict": "ok", "worst": 2.0, "determined": True},
        {"verdict": "degraded", "worst": 9.0, "determined": True},
        {"verdict": "refused", "worst": None, "determined": False},
    ]
    assert counts_of(rows) == "2 of 4 | 1 | 5.0 | 2 of 3"


def test_families_of_a_seal_share_no_seed() -> None:
    found = sealed([FAMILY, Family("again", FAMILY.make)], 2)
    assert not found["gyro"].keys() & found["again"].keys()
