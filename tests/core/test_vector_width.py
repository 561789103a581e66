"""Loops written for vectors are as wide as the machine's."""

import re
from importlib.resources import files
from pathlib import Path

import casadi as ca
import pytest

from spinfilters.core import c_library
from spinfilters.core.vectorised import simd_text

X = ca.SX.sym("x", 2)


@pytest.mark.parametrize(("flags", "wide"), [("flags: fpu avx2 avx512f", True), ("flags: fpu avx2", False)])
def test_wide_vectors_are_used_where_the_processor_names_them(
    monkeypatch: pytest.MonkeyPatch, flags: str, wide: bool
) -> None:
    monkeypatch.setattr(c_library, "processor", lambda: flags)
    assert c_library.has_wide_vectors() is wide


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
