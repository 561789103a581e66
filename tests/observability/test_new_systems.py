"""Ten systems of textbooks, as a user would write them, have the unobservable unknowns and bounds that their physics says."""

from pathlib import Path

import numpy as np
import pytest

from observability import analyse
from observability.bound_section import stated_bound
from observability.model_analysis import read_model

SYSTEMS = Path(__file__).parent / "systems"
UNOBSERVABLE = {
    "quadrotor": (),
    "bicycle": ("cf", "cr", "m", "jz"),
    "sir": ("beta", "share", "N", "S", "I", "R"),
    "dcmotor": ("R", "L", "K", "J", "b", "i"),
    "cstr": (),
    "cart": (),
    "leverarm": (),
    "radar": (),
    "battery": ("Q", "e0", "e1", "soc"),
    "drug": (),
}
"""By system: a common factor of masses and stiffnesses, a share of the cases, the motor's current, the charge's scale and zero."""


@pytest.mark.parametrize("name", UNOBSERVABLE)
def test_what_cannot_be_told_is_what_physics_says(name: str) -> None:
    found = analyse(read_model(SYSTEMS / f"{name}.toml"))
    assert found.unobservable == UNOBSERVABLE[name]
    assert found.certified


@pytest.mark.parametrize("name", ["bicycle", "battery", "drug", "cstr"])
def test_the_bound_agrees_with_the_exact_rank(name: str) -> None:
    document = read_model(SYSTEMS / f"{name}.toml")
    stated = stated_bound(document, name, SYSTEMS)
    assert stated is not None
    named = {unknown for direction in stated.last.prior_only for unknown in direction}
    assert named == set(UNOBSERVABLE[name])
    assert np.isfinite(list(stated.last.final.values())).all()
    # The reactor ignites: its temperature bends within any move that rounding does not swallow, and the text says so.
    assert ("Finite moves disagree" in str(stated.last)) == (name == "cstr")
