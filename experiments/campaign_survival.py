"""Campaigns through interruptions and cluster failures, compared with an undisturbed one.

    python -m experiments.campaign_survival [interruptions] [cluster] [--moments 20] [--seeds 60]

Makes the same study again with Ctrl-C and kill -9 in turn at random moments and --resume after each; and on a Dask cluster of two
workers, one of which is killed twice, and whose scheduler is restarted once. Prints for each whether the rows are those of a serial
campaign bit for bit, columns of time and place aside, with none missing and none twice.
"""

import argparse
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from experiments.command_line import run_study
from spinfilters.campaigns.row_columns import is_volatile
from spinfilters.campaigns.rows_folder import ROWS, part_files, read_rows

STUDY = """
[study]
name = "survival"
seeds = {seeds}
bound = "none"
[factors]
estimator = ["mekf", "ukf"]
motion = ["rich", "short"]
[motion.base]
rate_rpm = [4.0, 9.0, 3.0]
epochs = 40
[motion.rich]
[motion.short]
epochs = 30
[sensor.base]
kind = "gyro"
"""
FACTORS = ("motion", "body", "sensor", "noise", "fault", "belief", "settings", "estimator")
COMMAND = (sys.executable, "-c", "import sys; from spinfilters.cli.main import main; sys.exit(main())")


def main() -> None:
    """Run what is asked for, all by default."""
    kinds: dict[str, Callable[[Path, argparse.Namespace], str]]
    kinds = {"interruptions": _interruptions, "cluster": _cluster}
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", nargs="*", choices=[*kinds, []], default=[])
    parser.add_argument("--moments", type=int, default=20, help="of interruption")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--seeds", type=int, default=60, help="of the study, four runs each")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="spinfilters-survival-") as place:
        folder = Path(place)
        (folder / "study.toml").write_text(STUDY.format(seeds=given.seeds))
        _begun(folder, "serial", "--workers", "1").wait()
        for name in given.what or kinds:
            told = kinds[name](folder, given)
            print(f"{name}: {told}: {_difference(folder / 'serial', folder / name)}", flush=True)


def _begun(folder: Path, out: str, *options: str) -> "subprocess.Popen[bytes]":
    """A campaign that has been started."""
    command = [*COMMAND, "campaign", str(folder / "study.toml"), "-o", str(folder / out), *options]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _interruptions(folder: Path, given: argparse.Namespace) -> str:
    """Ctrl-C and kill -9 in turn at random moments."""
    generator, count = np.random.default_rng(given.seed), 0
    total = len(_fixed(folder / "serial"))
    while count < given.moments:
        rows = _held(folder / "interruptions")
        wanted = rows + int(generator.integers(0, max(2 * (total - rows) // (given.moments - count), 2)))
        running = _begun(folder, "interruptions", "--workers", "2", "--resume")
        while _held(folder / "interruptions") < wanted and running.poll() is None:
            time.sleep(0.005)
        time.sleep(float(generator.uniform(0.0, 0.05)))
        if running.poll() is None:
            running.send_signal((signal.SIGINT, signal.SIGKILL)[count % 2])
            count += 1
        elif _held(folder / "interruptions") >= total:
            break
        running.wait()
    _begun(folder, "interruptions", "--resume").wait()
    return f"{count} of {given.moments} moments"


def _cluster(folder: Path, _given: argparse.Namespace) -> str:
    """Two workers: one is killed at a quarter and at three quarters, the scheduler between."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address, total, running = f"tcp://127.0.0.1:{port}", len(_fixed(folder / "serial")), []
    scheduler = _dask("scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
    workers = [_worker(address) for _ in range(2)]
    try:
        running = [_begun(folder, "cluster", "--scheduler", address)]
        for share, victim in ((0.25, "worker"), (0.5, "scheduler"), (0.75, "worker")):
            while _held(folder / "cluster") < share * total and running[0].poll() is None:
                time.sleep(0.02)
            if running[0].poll() is not None:
                return f"ended before its {victim} was killed"
            if victim == "worker":
                _kill(workers.pop(0))
                workers.append(_worker(address))
            else:
                _kill(scheduler)
                scheduler = _dask("scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
                for each in workers:  # which end when their scheduler does
                    _kill(each)
                workers = [_worker(address) for _ in range(2)]
        code = running[0].wait()
        return f"a worker killed twice, the scheduler restarted once, exit code {code}"
    finally:
        for each in (*running, *workers, scheduler):
            _kill(each)


def _worker(address: str) -> "subprocess.Popen[bytes]":
    return _dask("worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard")


def _dask(*options: str) -> "subprocess.Popen[bytes]":
    program = f"import sys; from distributed.cli.dask_{options[0]} import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", program, *options[1:]],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def _kill(process: "subprocess.Popen[bytes]") -> None:
    if process.poll() is None:
        process.kill()
    process.wait()


def _held(out: Path) -> int:
    """Rows that a campaign's folder holds, about."""
    rows = out / ROWS
    parts = sum(pq.ParquetFile(path).metadata.num_rows for path in part_files(rows)) if rows.is_dir() else 0
    return parts + sum(
        path.read_bytes().count(b"\n") for path in rows.glob("*.jsonl") if os.path.exists(path)
    )


def _fixed(out: Path) -> list[str]:
    """Rows as text in which every bit shows."""
    table = read_rows(out, FACTORS)
    kept = [name for name in table.column_names if not is_volatile(name)]
    return [repr(row) for row in table.select(kept).to_pylist()]


def _difference(serial: Path, other: Path) -> str:
    """Difference of two campaigns' rows, repeated ones included."""
    wanted, found = _fixed(serial), _fixed(other)
    every = [
        run
        for path in part_files(other / ROWS)
        for run in pq.read_table(path, columns=["run"])["run"].to_pylist()
    ]
    unlike, twice = sum(a != b for a, b in zip(wanted, found, strict=False)), len(every) - len(set(every))
    return f"{len(found)} of {len(wanted)} rows, {unlike} differ, {twice} stand twice"


if __name__ == "__main__":
    run_study(main)
