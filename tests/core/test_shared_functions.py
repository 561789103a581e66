"""Functions that several threads build and call at once."""

import multiprocessing
import threading
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from spinfilters.core.compiled import Compiled
from spinfilters.core.large_arrays import LARGE, pooled_array
from spinfilters.core.working_time import building, built_property

THREADS, CALLS = 4, 200


def in_threads(work: Callable[[int], None]) -> None:
    """Do it in several threads that begin together; what one of them raises is raised."""
    together, raised = threading.Barrier(THREADS), []

    def run(number: int) -> None:
        together.wait()
        try:
            work(number)
        except BaseException as error:
            raised.append(error)

    threads = [threading.Thread(target=run, args=(number,)) for number in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if raised:
        raise raised[0]


@pytest.mark.parametrize("make", [Compiled, Compiled.interpreted], ids=["compiled", "interpreted"])
@pytest.mark.parametrize("items", [None, 3])
def test_each_thread_gets_the_numbers_of_its_own_arguments(
    make: Callable[[ca.Function], Compiled], items: int | None
) -> None:
    x = ca.SX.sym("x", 40)
    function = make(ca.Function("shared", [x], [ca.cumsum(x), ca.sum1(x)]))

    def call(number: int) -> None:
        shape = (40,) if items is None else (items, 40)
        for turn in range(CALLS):
            value = float(number * CALLS + turn)
            sums, total = function(np.full(shape, value))
            np.testing.assert_array_equal(sums, np.broadcast_to(value * np.arange(1.0, 41.0), shape))
            np.testing.assert_array_equal(total[..., 0], 40 * value)

    in_threads(call)


def test_a_built_property_is_built_once_whoever_asks() -> None:
    built: list[int] = []

    class Model:
        @built_property
        def symbol(self) -> ca.SX:
            """Its own symbol."""
            built.append(threading.get_ident())
            return ca.SX.sym("x")

    model, found = Model(), list[int]()
    in_threads(lambda _: found.append(id(model.symbol)))
    assert len(built) == 1
    assert set(found) == {id(model.symbol)}


def test_expressions_are_built_by_one_thread_at_a_time() -> None:
    inside, most = [0], [0]

    @building()
    def build() -> None:
        inside[0] += 1
        most[0] = max(most[0], inside[0])
        x = ca.SX.sym("x", 6)
        ca.Function("f", [x], [ca.jacobian(ca.sin(x) * ca.sum1(x), x)])
        inside[0] -= 1

    def build_often(_: int) -> None:
        for _ in range(20):
            build()

    in_threads(build_often)
    assert most == [1]


def test_no_two_threads_hold_the_same_pooled_array() -> None:
    def fill(number: int) -> None:
        for turn in range(50):
            array = pooled_array(LARGE)
            array[...] = value = float(number * 50 + turn)
            assert (array == value).all()

    in_threads(fill)


@pytest.mark.filterwarnings(
    "ignore:.*multi-threaded:DeprecationWarning"
)  # of Python 3.12 at any fork beside threads
def test_a_process_that_is_forked_while_a_thread_builds_can_build() -> None:
    inside, ended = threading.Event(), threading.Event()

    def build() -> None:
        """Hold the lock for a while that is longer than the fork takes."""
        with building():
            inside.set()
            ended.wait(0.2)

    thread = threading.Thread(target=build)
    thread.start()
    inside.wait()

    def build_in_child() -> None:
        """Take the lock in the forked process."""
        with building():
            pass

    child = multiprocessing.get_context("fork").Process(target=build_in_child, daemon=True)
    child.start()
    ended.set()
    thread.join()
    child.join(20)
    waits_for_ever = child.is_alive()
    child.kill()
    assert not waits_for_ever
