"""The table of errors that models may have."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from spinfilters.verdict.model_errors.alternatives import ALTERNATIVES, table
from spinfilters.verdict.model_errors.smoothed_motion import SmoothedMotion


def test_names_of_alternatives_stand_once() -> None:
    assert len(table()) == len(ALTERNATIVES)


def test_every_alternative_says_what_it_is_and_what_to_do() -> None:
    for name, each in table().items():
        assert name == each.name
        assert each.phrase
        assert each.unit
        assert 10 < len(each.cure) < 120
        assert (each.block is None) == (not each.held_by)


@pytest.mark.parametrize(
    ("name", "size", "possible"),
    [
        ("clock-jitter", 0.3, True),
        ("clock-jitter", 0.5, False),
        ("clock-drift", 0.9, True),
        ("clock-drift", -1.1, False),
        ("drag", 9.0, True),
    ],
)
def test_a_clock_keeps_its_stamps_in_order(name: str, size: float, possible: bool) -> None:
    motion = cast(SmoothedMotion, SimpleNamespace(time=0.4 * np.arange(11)))
    assert table()[name].is_possible(np.array([size]), motion) == possible
