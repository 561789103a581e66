"""The table of docs/which-to-fly.md.

What filter on a microcontroller, filter in Python and smoother cost and give.
    python -m experiments.which_to_fly [--seed 0] [--estimators embedded,embedded-double,mekf,smoother]

On the bundled example, every estimator in a process of its own: rms errors and mean NEES per degree of freedom of the epochs after
the initialisation, median processor time of an epoch, and by how much the process grew. Then what the C filter takes of a
Cortex-M4F, where its compiler and QEMU are installed.
"""

import argparse
import multiprocessing
import re
import resource
import shutil
import subprocess
import tempfile
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from experiments.command_line import run_study
from spinfilters.embedded.embedded_options import EmbedOptions
from spinfilters.embedded.folder import write_library
from spinfilters.inference.setup import Setup
from spinfilters.run.estimation import compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate, without_map

ERRORS = {"position": (1e3, "mm"), "attitude": (float(np.degrees(1.0)), "deg"), "velocity": (1e3, "mm/s")}
TOOLS = ("make", "arm-none-eabi-gcc", "qemu-system-arm")


def row(setup: Setup, name: str) -> dict[str, float]:
    """Figures of one estimator by name."""
    before = _megabytes()
    (found,) = compare_estimators(setup, replace(Settings(), estimators=(name,)), lambda *_: None).evaluations
    assert found.errors is not None
    assert found.nees is not None
    first, figures = len(setup.initial.mean), {}
    for what, (scale, unit) in ERRORS.items():
        errors = getattr(found.errors, what)[first:]
        figures[f"{what}, {unit}"] = scale * float(np.sqrt(np.square(errors).sum(axis=1).mean()))
    figures["NEES per degree of freedom"] = float(found.nees.total[first:].mean()) / found.nees.dof
    figures["ms per epoch"] = found.milliseconds_per_frame or np.nan
    figures["growth of the process, MB"] = _megabytes() - before
    return figures


def apart(setup: Setup, name: str) -> dict[str, float]:
    """`row` in a process of its own."""
    ours, theirs = multiprocessing.Pipe()

    def work(connection: Connection) -> None:
        """Work of a child process."""
        connection.send(row(setup, name))

    process = multiprocessing.get_context("fork").Process(target=work, args=(theirs,))
    process.start()
    theirs.close()
    figures = ours.recv()
    process.join()
    return figures


def on_the_target() -> str:
    """Instructions, stack and flash of a stereo filter with a map of 2,000."""
    if not all(map(shutil.which, TOOLS)):
        return f"not measured: {', '.join(tool for tool in TOOLS if not shutil.which(tool))} not installed"
    with tempfile.TemporaryDirectory() as folder:
        write_library(EmbedOptions(landmarks=2000), Path(folder))
        done = [
            subprocess.run(["make", "-s", what], cwd=folder, capture_output=True, text=True, check=True)
            for what in ("emulate", "budget")
        ]
    emulated, budget = (each.stdout + each.stderr for each in done)
    sizes = re.findall(r"^\s*(\d+)\s.*\(TOTALS\)$", budget, re.MULTILINE)
    return "\n".join([*re.findall(r"^\w+ \d+$", emulated, re.MULTILINE)[1:6], f"flash_bytes {sizes[0]}"])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--estimators", default="embedded,embedded-double,mekf,smoother")
    options = parser.parse_args()
    names = options.estimators.split(",")
    setup = prepare(without_map(simulate(Scenario.common_workload(seed=options.seed))), Settings())
    rows = [apart(setup, name) for name in names]
    print(f"| | {' | '.join(names)} |\n|{'---|' * (len(names) + 1)}")
    for what in rows[0]:
        print(f"| {what} | {' | '.join(f'{each[what]:.3g}' for each in rows)} |")
    print(f"\nThe C filter in float on a Cortex-M4F:\n{on_the_target()}")


def _megabytes() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    run_study(main)
