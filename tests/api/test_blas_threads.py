"""Calls of the Python interface on one thread of BLAS."""

import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from spinfilters.api import blas_threads as blas_threads_module
from spinfilters.api.blas_threads import ASKED_FOR, on_one_blas_thread
from spinfilters.api.comparison import compare


def blas_threads() -> set[int]:
    """How many every BLAS that is loaded has now, but for those that are built without threads."""
    return {
        each["num_threads"]
        for each in threadpool_info()
        if each["user_api"] == "blas" and each.get("threading_layer") != "disabled"
    }


@pytest.fixture(autouse=True)
def two_threads(monkeypatch: pytest.MonkeyPatch):
    for name in ASKED_FOR:
        monkeypatch.delenv(name, raising=False)
    with threadpool_limits(2, user_api="blas"):
        yield


def test_a_call_has_one_thread_and_leaves_as_many_as_there_were():
    assert on_one_blas_thread(blas_threads)() == {1}
    assert blas_threads() == {2}


def test_threads_are_given_back_after_an_error():
    with pytest.raises(ZeroDivisionError):
        on_one_blas_thread(lambda: 1 / 0)()
    assert blas_threads() == {2}


def in_another_thread(call: Callable[[], set[int]]) -> set[int]:
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(call).result()


def test_a_call_in_another_thread_has_one_thread_after_one_in_this():
    assert on_one_blas_thread(blas_threads)() == {1}
    assert in_another_thread(on_one_blas_thread(blas_threads)) == {1}
    assert blas_threads() == {2}


def test_a_call_in_another_thread_has_one_thread_where_this_has_set_a_number():
    with threadpool_limits(2, user_api="blas"):
        assert in_another_thread(on_one_blas_thread(blas_threads)) == {1}
    assert blas_threads() == {2}


def test_threads_are_given_back_when_the_call_that_began_first_ends_first():
    inner_may_end = threading.Event()

    @on_one_blas_thread
    def outlast() -> set[int]:
        begun.set()
        inner_may_end.wait()
        return blas_threads()

    @on_one_blas_thread
    def begin_another(pool: ThreadPoolExecutor) -> Future[set[int]]:
        future = pool.submit(outlast)
        begun.wait()
        return future

    begun = threading.Event()
    with ThreadPoolExecutor(1) as pool:
        future = begin_another(pool)
        inner_may_end.set()
        assert future.result() == {1}
    assert blas_threads() == {2}


def test_a_number_that_the_environment_asks_for_holds(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    assert on_one_blas_thread(blas_threads)() == {2}


def test_estimators_are_compared_on_one_thread(tmp_path):
    seen = []
    path = tmp_path / "gyro.csv"
    rows = "\n".join(f"{0.02 * k},{0.1},{0.5},{0.02 * (k % 7)}" for k in range(60))
    path.write_text("t_s,wx,wy,wz\n" + rows + "\n")
    compare(path, "mekf", progress=lambda *_: seen.append(blas_threads()))
    assert seen
    assert all(each == {1} for each in seen)


def test_the_last_of_several_calls_at_once_puts_the_number_back(monkeypatch: pytest.MonkeyPatch):
    number = [2]  # of a BLAS that counts for the whole process

    class Limits:
        def __init__(self, count: int, user_api: str) -> None:
            self._before, number[0] = number[0], count

        def restore_original_limits(self) -> None:
            number[0] = self._before

    monkeypatch.setattr(blas_threads_module, "threadpool_limits", Limits)
    begun, may_end = threading.Event(), threading.Event()

    @on_one_blas_thread
    def wait() -> None:
        begun.set()
        may_end.wait()

    @on_one_blas_thread
    def outlast_the_other() -> int:
        may_end.set()
        other.join()
        return number[0]

    other = threading.Thread(target=wait)
    other.start()
    begun.wait()
    assert outlast_the_other() == 1
    assert number == [2]
