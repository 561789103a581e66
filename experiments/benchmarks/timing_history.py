"""History of the estimators' own times: what changed by a tenth since the last time on this machine?

    python -m experiments.benchmarks.timing_history [--history runs/benchmark/timings.jsonl] [--rounds 7]

Each time is the least processor time of some rounds in which all take turns, for whatever else a machine does only adds to it.
Every run appends a line of JSON to the history, and is compared with the last line of the same machine: processor, vectors,
compiler, Python.
"""

import argparse
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from time import process_time
from typing import Final

from experiments.benchmarks.own_smoother import OwnIterations, own_batch
from experiments.benchmarks.smoother_workload import disam115_workload
from experiments.benchmarks.stopwatch import begin_benchmark, machine
from experiments.command_line import run_study
from spinfilters.core.errors import InputError
from spinfilters.run.estimation import build_estimator
from spinfilters.run.preparation import prepare
from spinfilters.run.provenance import git_commit
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate

HISTORY: Final = Path("runs/benchmark/timings.jsonl")
CHANGE: Final = 0.1
"""Of a time, from which it is told."""
FILTERS: Final = ("mekf", "ukf")
FRAMES: Final = 24


@dataclass(frozen=True)
class Timings:
    """Times of one run on one machine.

    Attributes
    ----------
    when, commit : str
        Time of the run, UTC, and the commit that was measured.
    machine : str
        Processor, vector width, compiler and Python; see `stopwatch.machine`.
    milliseconds : Mapping[str, float]
        Least processor time by task, ms.
    """

    when: str
    commit: str
    machine: str
    milliseconds: Mapping[str, float]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, compare with the last run of this machine, and append to the history."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--history", type=Path, default=HISTORY)
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args(arguments)
    begin_benchmark("experiments.benchmarks.timing_history")
    before, now = read_history(options.history), measure(options.rounds)
    for line in compared(before, now):
        print(line)
    options.history.parent.mkdir(parents=True, exist_ok=True)
    with options.history.open("a") as file:
        file.write(json.dumps(asdict(now)) + "\n")


def read_history(path: Path) -> list[Timings]:
    """All runs so far, the earliest first.

    Raises
    ------
    InputError
        A line that is no run, by its number.
    """
    if not path.exists():
        return []
    found = []
    for number, line in enumerate(path.read_text().splitlines(), start=1):
        try:
            found.append(Timings(**json.loads(line)))
        except (ValueError, TypeError) as error:
            raise InputError(f"{path}, line {number} is no run of this benchmark; delete it") from error
    return found


def compared(history: Sequence[Timings], now: Timings) -> Iterator[str]:
    """A line for each task: its time, and its change since the last run of the same machine."""
    last = next((run for run in reversed(history) if run.machine == now.machine), None)
    yield f"commit {now.commit}, compared with {'nothing yet' if last is None else last.commit}"
    for task, time in now.milliseconds.items():
        old = None if last is None else last.milliseconds.get(task)
        yield f"{task:32} {time:9.3f} ms{'' if old is None else _change(time / old - 1)}"


def _change(share: float) -> str:
    verdict = "" if abs(share) < CHANGE else "  SLOWER" if share > 0 else "  faster"
    return f"  {100 * share:+6.1f} %{verdict}"


def measure(rounds: int) -> Timings:
    """Times of the smoother and of the filters, which take turns."""
    tasks = {**_smoother_tasks(), **_filter_tasks()}
    least = dict.fromkeys(tasks, float("inf"))
    for number in range(rounds):
        for name in list(tasks)[:: 1 if number % 2 == 0 else -1]:
            least[name] = min(least[name], tasks[name]())
    when = datetime.now(UTC).isoformat(timespec="seconds")
    return Timings(when, git_commit() or "unknown", machine(), {k: 1e3 * s for k, s in least.items()})


def _smoother_tasks() -> dict[str, Callable[[], float]]:
    workload = disam115_workload("rich", 0)
    whole, short = OwnIterations(workload), OwnIterations(workload.first(20))
    return {
        "batch, 115 epochs": lambda: own_batch(workload).seconds,
        "iteration, 115 epochs": lambda: whole.seconds(5),
        "iteration, 20 epochs": lambda: short.seconds(20),
    }


def _filter_tasks() -> dict[str, Callable[[], float]]:
    """Seconds of an epoch with a known map of about 215 landmarks."""
    setup = prepare(simulate(Scenario.simplified()), Settings())
    first = len(setup.initial.mean)
    steps = list(pairwise(setup.timeline[first - 1 : first + FRAMES]))

    def seconds(name: str) -> float:
        """One pass over the epochs."""
        estimator = build_estimator(name, setup, Settings())
        estimator.start(setup.initial.belief)
        begin = process_time()
        for before, after in steps:
            estimator.predict(after.time - before.time)
            for measurement in after.measurements:
                estimator.update(measurement)
        return (process_time() - begin) / len(steps)

    return {f"{name}, an epoch, known map": lambda name=name: seconds(name) for name in FILTERS}


if __name__ == "__main__":
    run_study(main)
