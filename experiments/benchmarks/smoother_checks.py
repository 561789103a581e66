"""Benchmark results beside their required values."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from experiments.benchmarks.smoother_workload import PeerResult


@dataclass(frozen=True)
class BenchmarkCheck:
    """A line of the table; ``passed`` is None where nothing is demanded."""

    what: str
    measured: str
    bar: str = ""
    passed: bool | None = None
    note: str = ""

    def __str__(self) -> str:
        verdict = {None: "", True: "pass", False: "FAIL"}[self.passed]
        return f"{self.what:42} {self.measured:72} {self.bar:>14} {verdict:5} {self.note}".rstrip()


@dataclass(frozen=True)
class Ratio:
    """Ratio of two solvers' times.

    It is of medians over all rounds, with the least and greatest of one round.

    Attributes
    ----------
    own_code: the ratio without the time that the other spends in the project's Python, from which it has rows of the motion.
    """

    theirs: float
    ours: float
    value: float
    least: float
    greatest: float
    own_code: float

    def check(self, what: str, bar: float, note: str = "") -> BenchmarkCheck:
        """Whether it is at least as large as demanded."""
        return BenchmarkCheck(what, str(self), f"at least {bar:g}x", self.value >= bar, note)

    def __str__(self) -> str:
        return (
            f"{1e3 * self.ours:8.2f} ms, peer {1e3 * self.theirs:9.1f} ms: {self.value:5.1f}x "
            f"({self.least:.1f} .. {self.greatest:.1f}; bare {self.own_code:.1f}x)"
        )


def ratio(
    theirs: Sequence[float], ours: Sequence[float], in_our_python: Sequence[float] | None = None
) -> Ratio:
    """Ratio of seconds, round by round."""
    t, o = np.array(theirs), np.array(ours)
    own = t if in_our_python is None else t - np.array(in_our_python)
    by_round: Float[np.ndarray, " r"] = t / o
    t_mid, o_mid = float(np.median(t)), float(np.median(o))
    least, greatest = float(by_round.min()), float(by_round.max())
    return Ratio(t_mid, o_mid, t_mid / o_mid, least, greatest, float(np.median(own)) / o_mid)


Solver = Callable[[], PeerResult]


def in_turn(solvers: Mapping[str, Solver], rounds: int) -> dict[str, list[PeerResult]]:
    """Every solver once in each round, alternately forwards and backwards.

    What a machine does besides hits all alike.
    """
    results: dict[str, list[PeerResult]] = {name: [] for name in solvers}
    for number in range(rounds):
        for name in list(solvers)[:: 1 if number % 2 == 0 else -1]:
            results[name].append(solvers[name]())
    return results


def ratio_of(theirs: Sequence[PeerResult], ours: Sequence[PeerResult]) -> Ratio:
    """Ratio of the results of `in_turn`."""
    return ratio([r.seconds for r in theirs], [r.seconds for r in ours], [r.python for r in theirs])
