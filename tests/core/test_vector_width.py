"""Loops written for vectors are as wide as the machine's."""

import re
from importlib.resources import files
from pathlib import Path

import casadi as ca
import pytest

from spinfilters.core import c_library
from spinfilters.core.errors import InputError
from spinfilters.core.vectorised import simd_text

X = ca.SX.sym("x", 2)


@pytest.mark.parametrize(("flags", "wide"), [("flags: fpu avx2 avx512f", True), ("flags: fpu avx2", False)])
def test_wide_vectors_are_used_where_the_processor_names_them(
    monkeypatch: pytest.MonkeyPatch, flags: str, wide: bool
) -> None:
    monkeypatch.setattr(c_library, "processor", lambda: flags)
    assert c_library.has_wide_vectors() is wide


@pytest.mark.parametrize("stated", ["x", "0", "-4", "3", "16", "4.0", " 8", "8\n", "9" * 10_000])
def test_a_width_that_no_loop_has_is_refused_in_one_line(
    monkeypatch: pytest.MonkeyPatch, stated: str
) -> None:
    monkeypatch.setenv("SPINFILTERS_LANES", stated)
    with pytest.raises(InputError, match=r"SPINFILTERS_LANES is '.*'; give 4 or 8, or unset it") as refused:
        c_library.vector_width()
    assert len(str(refused.value).splitlines()) == 1
    assert len(str(refused.value)) < 150


@pytest.mark.parametrize("stated", ["4", "8"])
def test_the_environment_states_the_width(monkeypatch: pytest.MonkeyPatch, stated: str) -> None:
    monkeypatch.setenv("SPINFILTERS_LANES", stated)
    assert c_library.vector_width() == int(stated)


def test_generated_loops_are_as_wide_as_the_machine() -> None:
    text = simd_text(ca.Function("f", [X], [X * X]))
    assert text is not None
    assert {int(n) for n in re.findall(r"first \+= (\d+)", text)} == {c_library.LANES}


def test_no_loop_over_time_is_wider_than_the_machine() -> None:
    """A vector type of a fixed width stands where a row has that many columns, never for items side by side."""
    for room in ("smoother", "filters"):
        for source in Path(str(files(f"spinfilters.{room}"))).glob("*.[ch]"):
            for size in re.findall(r"vector_size\(([^)]*)\)", source.read_text()):
                assert size in {"8 * LANES", "ALIGNMENT", "32", "16"}, (source.name, size)
