"""A program that compares data sets in threads, in one after the other, and prints what differs.

It prints too who writes down an expression without the lock of building: only luck would keep that from crashing.
"""

import sys
import threading
import traceback
from pathlib import Path
from typing import Any

import casadi.casadi
import numpy as np

import spinfilters
from spinfilters.core.working_time import is_building
from spinfilters.smoother import mass_posterior

EVALUATION = ("FunctionBuffer_", "_function_buffer_eval")
"""Calls of CasADi's library that need no lock: each works on memory that one thread holds."""
PACKAGES = (Path(spinfilters.__file__).parent, Path(spinfilters.__file__).parents[1] / "observability")
THREADS = 2
FEW = 12
"""Samples of a mass distribution: each is one more solve of what one alone builds and locks already."""
without_lock: set[str] = set()


class Watched:
    """CasADi's library; who calls it without the lock is noted."""

    def __init__(self, library: Any) -> None:
        self._library = library

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._library, name)
        if not callable(found) or isinstance(found, type) or name.startswith(EVALUATION):
            return found

        def call(*arguments: Any, **named: Any) -> Any:
            """The call itself, after a look at the lock."""
            if not is_building():
                note(name)
            return found(*arguments, **named)

        return call


def note(name: str) -> None:
    """Remember the innermost line of the packages."""
    own = [
        frame
        for frame in traceback.extract_stack()
        if any(Path(frame.filename).is_relative_to(each) for each in PACKAGES)
    ]
    if own:
        without_lock.add(f"{name} from {Path(own[-1].filename).name}:{own[-1].lineno}")


def numbers_of(dataset: spinfilters.Dataset) -> list[bytes]:
    """Everything that estimators say of a data set."""
    run, found = spinfilters.compare(dataset, "mekf,ukf,smoother"), list[bytes]()
    for result in run.values():
        arrays = (*vars(result.trajectory).values(), *vars(result.body).values())
        found += [np.ascontiguousarray(array).tobytes() for array in arrays if isinstance(array, np.ndarray)]
        found.append(f"{result.status} {result.reasons}".encode())
    return found


def main(kinds: list[str]) -> None:
    """Compare in threads first: what they compute with is not built yet."""
    mass_posterior.SAMPLES, mass_posterior.TRIED, mass_posterior.MOST_NODES = FEW, FEW, 2
    sets = [spinfilters.simulate(kind, frames=10, seed=number) for number, kind in enumerate(kinds)]
    interface: Any = casadi.casadi
    interface._casadi = Watched(interface._casadi)
    found: list[tuple[int, list[bytes]]] = []
    together = threading.Barrier(THREADS)

    def work(first: int) -> None:
        """All data sets, each thread beginning with another."""
        together.wait()
        for turn in range(len(sets)):
            at = (first + turn) % len(sets)
            found.append((at, numbers_of(sets[at])))

    threads = [threading.Thread(target=work, args=(number,)) for number in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    spinfilters.observe("gyro", frames=3)
    alone = [numbers_of(dataset) for dataset in sets]
    same = sum(numbers == alone[at] for at, numbers in found)
    print(f"{same} of {len(found)} alike; without the lock: {', '.join(sorted(without_lock)) or 'nobody'}")


main(sys.argv[1:])
