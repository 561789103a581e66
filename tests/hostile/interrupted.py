"""Ctrl-C at drawn moments of every long command: one line, exit code 2, nothing half-written, and the command runs again.

    python -m tests.hostile.interrupted [--only compare] [--moments 3] [--seed 0] [--signal kill] [--verbose]

Every command runs once undisturbed in a process of its own, which tells how long it takes and which files it writes. Then it begins
again and again, and gets at a drawn moment what a terminal sends to it and to its children. Behind that the same command, with
``--resume`` where there is one, must write the same files. With ``--signal kill`` it is killed, and only the last is demanded.
"""

import argparse
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from spinfilters.cli.main import main as run_command
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.simulation.board_images import drawn_poses, write_board_images
from spinfilters.simulation.image_sequence import ImageScenario, Imaging, example_rig, render
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.vision.calibration_images import Board

LONGEST_S = 120.0
"""Of the clock, from Ctrl-C to the end."""
RESUMED = ("compare", "campaign")
"""Commands that go on with ``--resume``."""
MODEL = """
states = ["x", "v"]
parameters = ["k", "m", "d"]
[equations]
x = "v"
v = "-(k*x + d*v)/m"
[outputs]
y = "x"
"""
"""A damped spring."""
BOX = """
v -0.1 -0.08 -0.06
v 0.1 -0.08 -0.06
v -0.1 0.08 -0.06
v 0.1 0.08 -0.06
v -0.1 -0.08 0.06
v 0.1 -0.08 0.06
v -0.1 0.08 0.06
v 0.1 0.08 0.06
f 1 3 4 2
f 5 6 8 7
f 1 2 6 5
f 3 7 8 4
f 1 5 7 3
f 2 4 8 6
"""
STUDY = """
[study]
name = "interrupted"
seeds = 4
bound = "none"
[factors]
estimator = ["mekf", "ukf"]
[motion.base]
rate_rpm = [4.0, 9.0, 3.0]
epochs = 40
[sensor.base]
kind = "gyro"
"""
COMMANDS = (
    "compare ../in/gyro -o out --predict 1",
    "compare ../in/stereo -o out --estimators mekf,smoother",
    "compare ../in/unmapped -o out --estimators mekf,smoother --no-figures --json",
    "compare ../in/images -o out --estimators mekf",
    "compare ../in/tosses -o out --estimators mekf --segment auto",
    "estimate ../in/pose -o out",
    "segments ../in/tosses/1.csv",
    "live ../in/gyro --speed 1e6",
    "live ../in/unmapped --speed 4",
    "live ../in/gyro --speed 1e6 --no-smoother --summary out.json",
    "plot ../in/run -o out --format pdf --panels",
    "simulate -o out --kind stereo-tracks",
    "simulate -o out --kind stereo-images --frames 4",
    "simulate -o out --kind pose --beside gyro 0.01",
    "lidar scan cube -o out --rays 40 40 --scans 6",
    "lidar scan spacecraft -o out",
    "lidar needed ../in/scans -o out",
    "track ../in/images -o out --figures",
    "calibrate ../in/boards --corners 7x5 --square 0.03 --window 4 -o out --check",
    "checkout ../in/rig --images ../in/boards --corners 7x5 --square 0.03 --window 4 -o out",
    "depth ../in/boards/left00.png ../in/boards/right00.png --rig ../in/rig -o out",
    "reconstruct ../in/pictured --images ../in/images --voxels 64",
    "align ../in/dense ../in/box.obj",
    "observe --sensor stereo -o out",
    "observe --recording ../in/gyro -o out",
    "observe --sensor stereo --further -o out",
    "observe ../in/model.toml -o out",
    "fuse ../in/run ../in/other -o out",
    "fuse ../in/run ../in/other --json -o out",
    "calibration gyro --draws 4 -o out",
    "study motions --seeds 1 --workers 1 -o out",
    "study motions --seeds 1 --workers 2 -o out",
    "threshold --rate-rpm 1 -o out",
    "campaign ../in/study.toml -o out --workers 1",
    "campaign ../in/study.toml -o out --workers 2",
    "condition --time-step 0.5 -o out",
    "polhode --moments 3 2 1 -o out",
    "reproduce tweddle-table-1.1 decoust-figure-2.5 decoust-figure-2.6 tweddle-figure-2-6 -o out",
    "embed -o out",
    "doctor",
)


@dataclass(frozen=True)
class Ending:
    """How a process ended: exit code, its last and all lines on standard error, and the seconds from the signal to the end."""

    code: int
    said: tuple[str, ...]
    seconds: float
    left: tuple[str, ...]


def make_inputs(folder: Path) -> None:
    """Recordings, images, a study and finished runs, all small."""
    kinds = {
        "gyro": ("gyro", 80),
        "pose": ("pose", 40),
        "stereo": ("stereo-tracks", 20),
        "unmapped": ("stereo-tracks", 20),
    }
    for name, (kind, epochs) in kinds.items():
        scenario = Scenario.simplified(kind=kind, rate_rpm=RICH_RPM, epochs=epochs, landmarks=60, seed=3)
        write_dataset(simulate(scenario), folder / name)
    (folder / "unmapped" / "landmarks.csv").unlink()
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    (folder / "model.toml").write_text(MODEL, encoding="utf-8")
    (folder / "box.obj").write_text(BOX, encoding="utf-8")
    (folder / "tosses").mkdir()
    for seed in range(2):
        rates = simulate(
            Scenario.simplified(kind="gyro", rate_rpm=RICH_RPM, epochs=80, interval=0.1, seed=seed)
        )
        (stream,) = rates.log.streams
        table = np.column_stack([stream.time, stream.values])
        path = folder / "tosses" / f"{seed + 1}.csv"
        np.savetxt(path, table, delimiter=",", header="time_s,wx,wy,wz", comments="")
    images = Scenario(radius_m=0.13, epochs=8, interval=0.25)
    imaging = Imaging(oversampling=1, stars=10)
    render(ImageScenario(images, shape="box", size=(320, 240), imaging=imaging), folder / "images")
    rig, board, generator = example_rig((320, 240)), Board(7, 5, 0.03), np.random.default_rng(3)
    poses = drawn_poses("good", 8, rig, board, generator)
    write_board_images(folder / "boards", poses, rig, board, generator)
    place = str(folder)
    for words in (
        f"calibrate {place}/boards --corners 7x5 --square 0.03 --window 4 -o {place}/rig",
        f"compare {place}/gyro -o {place}/run --estimators mekf --no-figures -q",
        f"compare {place}/gyro -o {place}/other --estimators smoother --no-figures -q",
        f"compare {place}/images -o {place}/pictured --estimators smoother --no-figures -q",
        f"lidar scan cube -o {place}/scans --rays 40 40 --scans 6",
    ):
        assert run_command(shlex.split(words)) == 0, words
    shutil.copytree(folder / "pictured", folder / "dense")
    words = f"reconstruct {place}/dense --images {place}/images --voxels 48 -q"
    assert run_command(shlex.split(words)) == 0, words


def ended(words: Sequence[str], place: Path, wait_s: float | None, number: int = signal.SIGINT) -> Ending:
    """Run a command in a folder, with a signal to it and its children after some seconds if any."""
    command = [sys.executable, "-m", "spinfilters", *words]
    with open(place / "said.txt", "w+b") as said, open(place / "printed.txt", "wb") as printed:
        running = subprocess.Popen(
            command, cwd=place, stdin=subprocess.DEVNULL, stdout=printed, stderr=said, start_new_session=True
        )
        begin = time.monotonic()
        if wait_s is not None:
            with suppress(subprocess.TimeoutExpired):
                running.wait(wait_s)
            begin = time.monotonic()
            with suppress(ProcessLookupError):
                os.killpg(running.pid, number)
        try:
            code = running.wait(LONGEST_S if wait_s is not None else None)
        except subprocess.TimeoutExpired:
            code = -signal.SIGKILL
        seconds = time.monotonic() - begin
        left = () if number == signal.SIGKILL else tuple(_processes_left(running.pid))
        with suppress(ProcessLookupError):
            os.killpg(running.pid, signal.SIGKILL)
        running.wait()
        said.seek(0)
        lines = said.read().decode("utf-8", "replace").replace("\r", "\n").splitlines()
    kept = tuple(line for line in lines if line.strip() and "compiling the models" not in line)
    return Ending(code, kept, seconds, left)


def _processes_left(group: int) -> Iterator[str]:
    """Command lines of processes that a command left behind in its group."""
    time.sleep(0.2)
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with suppress(OSError, ValueError):
                fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
                if int(fields[2]) == group and fields[0] != "Z":
                    yield (
                        (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode("utf-8", "replace")[:120]
                    )


def files_below(folder: Path) -> set[str]:
    """Names of all files of a command's folder, but for what its streams went into."""
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if not path.is_dir()}
    return {re.sub(r"part-[^/]*|[0-9a-f]{16,}", "*", name) for name in names - {"said.txt", "printed.txt"}}


def violations(ending: Ending, place: Path, is_live: bool) -> list[str]:
    """What must not be behind Ctrl-C."""
    found = []
    own = [line for line in ending.said if line.startswith("spinfilters: ")]
    if any("Traceback" in line or "Error" in line or "unexpected" in line for line in ending.said):
        found.append(f"traceback: {ending.said[-3:]}")
    if ending.code == -signal.SIGINT and not ending.said:
        return found  # while Python itself begins or ends: all that was written is whole, or there is none
    if ending.code < 0:
        found.append(f"ended by signal {-ending.code} after {ending.seconds:.1f} s")
    elif ending.code not in ((0, 1, 2) if is_live else (0, 2)):
        found.append(f"exit code {ending.code}")
    elif ending.code == 2 and (len(own) != 1 or "interrupted" not in own[0]):
        found.append(f"said {ending.said[-3:]}")
    if ending.code == 2 and not is_live and len(ending.said) > 1:
        found.append(f"{len(ending.said)} lines: {ending.said[:3]}")
    if ending.seconds > 20:
        found.append(f"took {ending.seconds:.1f} s to end")
    found += [f"left the process {line}" for line in ending.left]
    half = [path for path in place.rglob("*") if path.name.endswith((".part", ".lock", ".tmp"))]
    return found + [f"left {path.relative_to(place)}" for path in half]


def tried(words: str, moments: int, seed: int, number: int, place: Path, verbose: bool) -> tuple[int, int]:
    """Interrupt a command at drawn moments; the counts of moments and of those with a violation."""
    generator = np.random.default_rng([seed, *words.encode()])
    arguments, is_live = shlex.split(words), words.startswith("live")
    makes_in = words.split()[1] if words.startswith(("reconstruct", "align")) else None
    case = _emptied(place, makes_in)
    whole = ended(arguments, case, None)
    files, wrong = files_below(case), 0
    if whole.code not in (0, 1):
        print(f"VIOLATION {words}: ended with {whole.code}: {whole.said[-2:]}", flush=True)
        return 0, 1
    for share in np.sort(generator.uniform(0.02, 1.0, moments)):
        case = _emptied(place, makes_in)
        ending = ended(arguments, case, share * whole.seconds, number)
        found = [] if number == signal.SIGKILL else violations(ending, case, is_live)
        resumed = (
            [*arguments, "--resume"] if arguments[0] in RESUMED and (case / "out").exists() else arguments
        )
        again = ended(resumed, case, None)
        if again.code != whole.code:
            found.append(f"again: {again.code}, {again.said[-2:]}")
        elif files_below(case) != files:
            found.append(f"again: other files, {sorted(files_below(case) ^ files)[:4]}")
        wrong += bool(found)
        if verbose:
            when = f"{share:.2f} of {whole.seconds:.1f} s"
            print(
                f"{ending.code} after {when}, ends in {ending.seconds:.1f} s: {words}: {ending.said[-1:]}",
                flush=True,
            )
        for each in found:
            print(f"VIOLATION {words} at {share:.2f} of {whole.seconds:.1f} s: {each}", flush=True)
    return moments, wrong


def _emptied(place: Path, makes_in: str | None) -> Path:
    """A new folder beside the inputs; a command that writes into a run gets a fresh copy of it."""
    case = place / "case"
    shutil.rmtree(case, ignore_errors=True)
    case.mkdir()
    if makes_in is not None:
        source = place / "in" / Path(makes_in).name
        kept = place / "kept" / source.name
        if not kept.exists():
            shutil.copytree(source, kept)
        shutil.rmtree(source)
        shutil.copytree(kept, source)
    return case


def main(arguments: Sequence[str] | None = None) -> int:
    """Interrupt them all; exit code 1 where one did what it must not."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", metavar="PATTERN", default="", help="commands in which this is found")
    parser.add_argument("--moments", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--signal", choices=["ctrl-c", "kill"], default="ctrl-c")
    parser.add_argument("--verbose", action="store_true", help="a line for every moment")
    options = parser.parse_args(arguments)
    number = signal.SIGKILL if options.signal == "kill" else signal.SIGINT
    signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # a shell's background ignores it, and so would the commands
    with TemporaryDirectory(prefix="interrupted-") as scratch:
        place = Path(scratch)
        make_inputs(place / "in")
        counts = [
            tried(words, options.moments, options.seed, number, place, options.verbose)
            for words in COMMANDS
            if re.search(options.only, words)
        ]
    moments, wrong = (sum(each) for each in zip(*counts, strict=True))
    print(f"{len(counts)} commands, {moments} moments, {wrong} with violations")
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
