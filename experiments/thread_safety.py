"""Comparisons in two and four threads give the numbers of one after the other, bit for bit.

    python -m experiments.thread_safety [--runs 50] [--processes 5] [--compile on off] [--threads 2 4]

A run is that many threads that begin to compare a small recording at the same moment: of a gyro, of poses or of stereo tracks,
in every other run all threads the same one. The runs are shared out among fresh processes, because functions are built in the
first run of each. Later the process compares every recording alone, which gives the numbers that are due. The environment does
not limit the threads of BLAS there: to do so is the library's part.

Printed are, for compiled code and for CasADi's virtual machine, the runs whose every number, status and reason is that of the
comparison alone, the runs that differ, and those that are missing because their process ended early. Exit code 1 for any of these.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import threading
from dataclasses import dataclass
from typing import Final

import spinfilters
from experiments.command_line import run_study
from spinfilters.api.blas_threads import ASKED_FOR

KINDS: Final = ("gyro", "pose", "stereo-tracks")
FRAMES: Final = 6
ESTIMATORS: Final = "mekf,smoother"


@dataclass(frozen=True)
class ThreadedRuns:
    """How many runs of some threads were alike, and which were not.

    Attributes
    ----------
    alike: runs with the numbers of one after the other.
    different: a line for every comparison that differs, with its digest or the error that ended it.
    missing: runs that were never finished.
    ended: last lines of processes that ended early.
    """

    alike: int = 0
    different: tuple[str, ...] = ()
    missing: int = 0
    ended: tuple[str, ...] = ()

    def __add__(self, other: "ThreadedRuns") -> "ThreadedRuns":
        return ThreadedRuns(
            self.alike + other.alike,
            self.different + other.different,
            self.missing + other.missing,
            self.ended + other.ended,
        )

    @property
    def is_clean(self) -> bool:
        """Whether every run was alike."""
        return not self.missing and not self.different


def recording_of(run: int, thread: int) -> int:
    """Which recording a thread compares: another than its neighbours in odd runs, the same in even ones."""
    return (run + (thread if run % 2 else 0)) % len(KINDS)


def runs_of(found: list[list[str]], alone: list[str]) -> ThreadedRuns:
    """Counts of runs, (runs, threads) digests, compared with the digest of each recording alone."""
    alike, different = 0, list[str]()
    for run, digests in enumerate(found):
        wrong = [
            f"run {run}, thread {thread}, {KINDS[recording_of(run, thread)]}: {digest}"
            for thread, digest in enumerate(digests)
            if digest != alone[recording_of(run, thread)]
        ]
        alike += not wrong
        different += wrong
    return ThreadedRuns(alike, tuple(different))


def runs_in_a_process(runs: int, threads: int, compiling: str) -> ThreadedRuns:
    """Counts of runs in a fresh process; all are missing where it ends early."""
    command = [sys.executable, "-m", "experiments.thread_safety", "--worker", str(runs), str(threads)]
    unlimited = {name: value for name, value in os.environ.items() if name not in ASKED_FOR}
    environment = unlimited | {"SPINFILTERS_COMPILE": compiling}
    ended = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if ended.returncode:
        last = (ended.stderr.strip().splitlines() or [""])[-1]
        return ThreadedRuns(missing=runs, ended=(f"exit code {ended.returncode}: {last}",))
    answer = json.loads(ended.stdout.splitlines()[-1])
    return runs_of(answer["found"], answer["alone"])


def work(runs: int, threads: int) -> None:
    """Compare in threads first, so that they build what they compute with; then every recording alone."""
    recordings = [spinfilters.simulate(kind, frames=FRAMES, seed=number) for number, kind in enumerate(KINDS)]
    found: list[list[str]] = [["never finished"] * threads for _ in range(runs)]
    together = threading.Barrier(threads)

    def compare(thread: int) -> None:
        """All runs of a thread, each begun together with the others."""
        for run in range(runs):
            together.wait()
            found[run][thread] = digest_of(recordings[recording_of(run, thread)])

    started = [threading.Thread(target=compare, args=(thread,)) for thread in range(threads)]
    for each in started:
        each.start()
    for each in started:
        each.join()
    print(json.dumps({"found": found, "alone": [digest_of(each) for each in recordings]}))


def digest_of(recording: spinfilters.Dataset) -> str:
    """Digest of everything that the estimators say of a recording; the error that ended a comparison, if one did."""
    try:
        run = spinfilters.compare(recording, ESTIMATORS)
    except Exception as error:  # to be counted; the other threads go on
        return repr(error)
    digest = hashlib.sha256()
    for name, result in run.items():
        digest.update(f"{name} {result.status} {result.reasons}".encode())
        for value in (*vars(result.trajectory).values(), *vars(result.body).values()):
            digest.update(getattr(value, "tobytes", bytes)())  # of arrays; the rest is settings
    return digest.hexdigest()


def main() -> None:
    """Run all processes one after another and print a line for each way of running."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=50, help="runs of each kind (default 50)")
    parser.add_argument("--processes", type=int, default=5, help="fresh processes for them (default 5)")
    parser.add_argument("--threads", type=int, nargs="+", default=[2, 4])
    parser.add_argument("--compile", nargs="+", default=["on", "off"], choices=["on", "off"])
    parser.add_argument("--worker", type=int, nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        work(*options.worker)
        return
    clean = True
    for compiling in options.compile:
        for threads in options.threads:
            found = ThreadedRuns()
            for process in range(options.processes):
                first, end = (options.runs * k // options.processes for k in (process, process + 1))
                found += runs_in_a_process(end - first, threads, compiling) if end > first else ThreadedRuns()
            clean = clean and found.is_clean
            print(
                f"compiled {compiling}, {threads} threads: {found.alike} of {options.runs} runs alike, "
                f"{found.missing} missing",
                *found.different,
                *found.ended,
                sep="\n  ",
                flush=True,
            )
    raise SystemExit(0 if clean else 1)


if __name__ == "__main__":
    run_study(main)
