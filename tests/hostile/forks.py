"""A process without threads that has the package loaded, and forks itself for every command of the tests.

A process of a test runner may have threads, of Dask for one, which a forked child waits for in vain; a new process for each command
would load the package each time. This one is asked over its standard input, and answers over its standard output.
"""

import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from resource import struct_rusage
from typing import Self

from .case import Case

TESTS = Path(__file__).parents[1]
ROOMS = tuple(
    f"spinfilters.{room}" for room in ("lidar", "vision", "simulation", "plots", "embedded", "live")
)
"""What commands import when they are run, and children have already."""


class Forks:
    """Runs commands in forked children of one process, with the checks and the small samples of the tests.

    Parameters
    ----------
    warm : sequence of sequence of str
        Commands that it runs first, once: what they build, children have.
    """

    def __init__(self, warm: Sequence[Sequence[str]]) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "hostile.forks"],
            cwd=TESTS,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self._ask([list(command) for command in warm])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

    def run(self, case: Case, place: Path) -> tuple[int, struct_rusage]:
        """Exit status and resources of the command of a case; see `Runner` in `hostile.trial`."""
        limits = (case.pictures, case.installs, case.file_bytes)
        return self._ask((case.arguments, *limits, place))

    def _ask(self, question: object) -> tuple[int, struct_rusage]:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        pickle.dump(question, self._process.stdin)
        self._process.stdin.flush()
        return pickle.load(self._process.stdout)


def _serve() -> None:
    """Answer until the input ends."""
    import conftest  # first: it checks the shapes of what is imported from here on
    from pictures import unrendered_pictures

    from spinfilters.cli.main import main

    from .trial import run_forked

    asked, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)  # what commands read and write there
    os.dup2(nothing, 1)
    for room in ROOMS:
        for module in iter_modules(import_module(room).__path__, f"{room}."):
            import_module(module.name)
    with conftest.few_samples():
        with unrendered_pictures():
            for command in pickle.load(asked):
                main(command)
        pickle.dump((0, None), answers)
        while True:
            answers.flush()
            try:
                arguments, pictures, installs, file_bytes, place = pickle.load(asked)
            except EOFError:
                return
            case = Case(
                "", "", arguments=arguments, pictures=pictures, installs=installs, file_bytes=file_bytes
            )
            pickle.dump(run_forked(case, place), answers)


if __name__ == "__main__":
    _serve()
