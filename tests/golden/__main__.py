"""Record the golden runs, or compare two recordings bit by bit.

    python -m tests.golden record FOLDER [NAME ...]
    python -m tests.golden compare BEFORE AFTER

Record before a change that is meant to change no number, record again behind it, and compare. All runs take one thread and one
core type of OpenBLAS, so that the same code gives the same bits on one machine.
"""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from tests.golden.comparison import differences
from tests.golden.runs import GOLDEN_RUNS, GoldenRun

ARITHMETIC: Final = {"OPENBLAS_CORETYPE": "Haswell", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
SHOWN: Final = 60
OUTPUT_FILE: Final = "output.txt"


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit code: 0 where all is the same, 1 where something differs or a run fails, 2 for bad arguments."""
    parser = argparse.ArgumentParser(prog="python -m tests.golden", description=__doc__)
    actions = parser.add_subparsers(dest="action", required=True)
    record = actions.add_parser("record")
    record.add_argument("folder", type=Path)
    record.add_argument("names", nargs="*", metavar="NAME", help="runs to record (default: all)")
    compare = actions.add_parser("compare")
    compare.add_argument("before", type=Path)
    compare.add_argument("after", type=Path)
    asked = parser.parse_args(arguments)
    if asked.action == "compare":
        return _compare(asked.before, asked.after)
    unknown = set(asked.names) - {run.name for run in GOLDEN_RUNS}
    if unknown:
        parser.error(
            f"{', '.join(sorted(unknown))}: no golden run; use {', '.join(r.name for r in GOLDEN_RUNS)}"
        )
    chosen = [run for run in GOLDEN_RUNS if not asked.names or run.name in asked.names]
    return max([_record(run, asked.folder) for run in chosen])


def _record(run: GoldenRun, folder: Path) -> int:
    place, begin = folder / run.name, time.monotonic()
    if place.exists():
        print(f"{place} exists: give another folder", file=sys.stderr)
        return 2
    place.mkdir(parents=True)
    for name, text in run.files.items():
        (place / name).write_text(text, encoding="utf-8")
    done = None
    for words in run.commands:
        command = [sys.executable, "-m", "spinfilters", *words.split()]
        done = subprocess.run(command, cwd=place, env=os.environ | ARITHMETIC, capture_output=True, text=True)
        if done.returncode:
            print(f"{run.name}: {words}\n{done.stdout[-500:]}{done.stderr[-1000:]}", file=sys.stderr)
            return 1
    if run.keeps_output and done is not None:
        (place / OUTPUT_FILE).write_text(done.stdout, encoding="utf-8")
    print(f"{run.name}: {time.monotonic() - begin:.0f} s", flush=True)
    return 0


def _compare(before: Path, after: Path) -> int:
    for folder in (before, after):
        if not folder.is_dir():
            print(f"{folder} is no folder of golden runs; make it with record", file=sys.stderr)
            return 2
    found = list(differences(before, after))
    for line in found[:SHOWN]:
        print(line)
    if len(found) > SHOWN:
        print(f"and {len(found) - SHOWN} more")
    print("bit for bit the same" if not found else f"{len(found)} differences")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
