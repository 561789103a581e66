"""Which core types of OpenBLAS the numeric tests are run under."""

import os

import blas_core_types
import pytest

from spinfilters.core.c_library import processor


def test_each_is_run_once_or_left_out_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    every = set().union(*blas_core_types.NEEDED.values())
    monkeypatch.setattr(blas_core_types, "running", lambda core_type: {core_type or "Haswell"})
    assert dict(blas_core_types.left_out(every - {"avx512vl"})) == {
        "Haswell": "the whole suite runs under it here",
        "SkylakeX": "this processor lacks avx512vl",
        "Nehalem": None,
    }
    monkeypatch.setattr(blas_core_types, "running", lambda core_type: {"Zen"})
    assert set(dict(blas_core_types.left_out(every)).values()) == {"Zen runs in its place"}


def test_a_process_runs_the_core_type_that_it_is_asked_for() -> None:
    asked = os.environ.get("OPENBLAS_CORETYPE")
    if asked not in blas_core_types.NEEDED or blas_core_types.NEEDED[asked] - set(processor().split()):
        pytest.skip("OPENBLAS_CORETYPE asks for none of the core types that this processor can run")
    assert blas_core_types.running(None) == {asked}
