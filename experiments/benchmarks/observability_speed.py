"""Times of the analyser.

Every rank of the table with its certificate, growth of the expression, many landmarks, the bound.
python -m experiments.benchmarks.observability_speed
"""

from collections.abc import Callable
from functools import partial
from statistics import median
from typing import Any, Final

from experiments.benchmarks.stopwatch import begin_benchmark, now
from experiments.benchmarks.symbolic_series import lie_derivatives
from experiments.command_line import run_study
from observability import system as sensors
from observability.body_model import body_rank
from observability.canonical_motions import CANONICAL_MOTIONS, CanonicalMotion, landmarks, point_of
from observability.cases import Case
from observability.certificate import STEADY_ORDERS, certify
from observability.coordinates import Chart, FilterChart, PrincipalChart, TensorChart
from observability.system import System

CHARTS: Final[tuple[Chart, ...]] = (PrincipalChart(), TensorChart(), FilterChart())
COUNTS: Final = (1, 2, 3, 4, 8)
RUNS: Final = 3
"""The least of so many runs is taken: whatever else runs on the machine only adds."""


def main() -> None:
    """Measure and print."""
    begin_benchmark("experiments.benchmarks.observability_speed")
    for chart in CHARTS:
        _print_chart(chart)
    case = Case(landmarks=18)
    reference = case.reference(116, 0.5)
    seconds, bound = timed(lambda: case.bound(reference))
    print(f"Cramer-Rao bound, {bound.std.shape[0]} frames, {bound.std.shape[1]} unknowns: {seconds:.2f} s")


def _print_chart(chart: Chart) -> None:
    cases = [(motion, count) for motion in CANONICAL_MOTIONS for count in COUNTS]
    exact = [timed(partial(_rank, chart, motion, count))[0] for motion, count in cases]
    proved = [timed(partial(_certificate, chart, motion, count)) for motion, count in cases]
    seconds, found = zip(*proved, strict=True)
    open_cases = sum(not each.certified for each in found)
    unnamed = sum(each.unnamed for each in found)
    change = max(x.change for each in found for x in each.explanations if x.finite)
    print(f"{chart.name}, {len(cases)} cases")
    print(f"  rank and null space {1e3 * median(exact):.0f} ms, at most {1e3 * max(exact):.0f} ms")
    print(
        f"  with names, finite moves and proof {1e3 * median(seconds):.0f} ms, at most {1e3 * max(seconds):.0f} ms"
    )
    print(
        f"  open {open_cases}, unnamed directions {unnamed}, largest change under finite symmetries {change:.1e}"
    )
    spent, derivatives = timed(lambda: lie_derivatives(_stereo(chart, 4), 0, 9))
    print(f"  order 8, any number of landmarks, as expressions: {derivatives.nodes} nodes, {spent:.2f} s")
    print(
        f"  100 landmarks, rank and null space: {timed(partial(_rank, chart, CANONICAL_MOTIONS[0], 100))[0]:.2f} s"
    )


def timed(run: Callable[[], Any]) -> tuple[float, Any]:
    """Least seconds of several runs, and a result."""
    times, result = [], None
    for _ in range(RUNS):
        begin = now()
        result = run()
        times.append(now() - begin)
    return min(times), result


def _stereo(chart: Chart, count: int) -> System:
    return System(chart, [sensors.watching("stereo", landmarks(count))])


def _rank(chart: Chart, motion: CanonicalMotion, count: int) -> Any:
    return body_rank(_stereo(chart, count), point_of(chart, motion), STEADY_ORDERS).null_space


def _certificate(chart: Chart, motion: CanonicalMotion, count: int) -> Any:
    return certify(_stereo(chart, count), point_of(chart, motion))


if __name__ == "__main__":
    run_study(main)
