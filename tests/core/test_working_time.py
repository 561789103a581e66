"""The clock of estimators stands still while what they compute with is built."""

from collections.abc import Callable
from pathlib import Path

import casadi as ca
import pytest

from spinfilters.core import c_library, working_time
from spinfilters.core.compiled import Compiled, Loader
from spinfilters.core.working_time import building, working_seconds
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout


@pytest.fixture
def passes(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Lets seconds pass on a clock that nothing else moves."""
    now = [0.0]
    monkeypatch.setattr(working_time, "thread_time", lambda: now[0])
    monkeypatch.setattr(working_time._building, "seconds", 0.0)

    def wait(seconds: float) -> None:
        now[0] += seconds

    return wait


def test_it_goes_on_between_builds_and_counts_nested_ones_once(passes: Callable[[float], None]) -> None:
    passes(1)
    with building():
        passes(10)
        with building():
            passes(100)
        passes(1000)
    passes(2)
    assert working_seconds() == 3


def test_a_build_that_fails_does_not_stop_it(passes: Callable[[float], None]) -> None:
    @building()
    def fail() -> None:
        passes(5)
        raise OSError("disk")

    with pytest.raises(OSError, match="disk"):
        fail()
    passes(1)
    assert working_seconds() == 1


def test_the_compiler_s_seconds_are_not_counted(
    passes: Callable[[float], None], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def slow(*_: object) -> Path:
        passes(60)
        raise OSError("disk full")

    monkeypatch.setenv("SPINFILTERS_CACHE", str(tmp_path))
    monkeypatch.setattr(c_library, "_compile", slow)
    monkeypatch.setattr(c_library, "compiler", lambda: "cc")
    x = ca.SX.sym("x")
    assert not Compiled(ca.Function("slowly", [x], [x + 1])).is_c
    assert working_seconds() == 0
    passes(1)
    assert working_seconds() == 1


def test_writing_down_an_expression_is_not_counted(
    passes: Callable[[float], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    construct = Compiled.__init__

    def slow(self: Compiled, function: ca.Function, load: Loader = c_library.load_loop) -> None:
        passes(60)
        construct(self, function, load)

    monkeypatch.setattr(Compiled, "__init__", slow)
    layout = StateLayout(FULL_BLOCKS)
    layout.retract(layout.origin(), layout.origin()[: layout.error_dim] * 0)
    assert working_seconds() == 0
