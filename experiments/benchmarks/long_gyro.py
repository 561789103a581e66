"""A long gyro recording: time of the MEKF, and time and memory of the whole command.

    python -m experiments.benchmarks.long_gyro [--samples 1000000]

A flip at 100 Hz is simulated, which takes three minutes of its own (the command `simulate` makes at most 100,000 epochs), and
`spinfilters compare --estimators mekf --no-figures` estimates it.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from experiments.benchmarks.stopwatch import CommandCost, begin_benchmark, cost_of_command
from experiments.command_line import run_study
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.simulation.scenario import Scenario, simulate


class GyroCost(NamedTuple):
    """Processor time of the filter's own epochs, s, and what the command took."""

    filter: float
    command: CommandCost


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--samples", type=int, default=1_000_000)
    samples = parser.parse_args().samples
    begin_benchmark("experiments.benchmarks.long_gyro")
    cost = gyro_cost(samples)
    print(
        f"{samples} samples: filter {cost.filter:.1f} s, command {cost.command.processor:.1f} s, "
        f"peak memory {cost.command.peak_mb:.0f} MB"
    )


def gyro_cost(samples: int) -> GyroCost:
    """Cost of a simulated recording of so many samples."""
    with tempfile.TemporaryDirectory() as name:
        data, run = Path(name) / "data", Path(name) / "run"
        data.mkdir()
        write_dataset(simulate(Scenario(kind="gyro", epochs=samples, interval=0.01)), data)
        command = [sys.executable, "-m", "spinfilters", "compare", str(data)]
        whole = cost_of_command([*command, "--estimators", "mekf", "--no-figures", "-q", "-o", str(run)])
        summary = json.loads((run / "summary.json").read_text())
        return GyroCost(summary["estimators"]["mekf"]["runtime_s"]["total"], whole)


if __name__ == "__main__":
    run_study(main)
