"""Speed of a campaign, and what its engine adds to the runs.

    python -m experiments.benchmarks.campaign experiments/studies/known-map-drawn.toml --seeds 2000 --workers 1 2

With `--batch` the runs are made as by `spinfilters campaign --batch`, for a study such as `experiments/studies/poses-drawn.toml`.

Wall time means something on quiet cores alone; processor time (own and children's, start of the workers included) on any. The
engine's share is the whole processor time over that of simulating, initialising, estimating and evaluating, less one.
"""

import argparse
import resource
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from experiments.benchmarks.stopwatch import begin_benchmark
from experiments.command_line import run_study
from spinfilters.campaigns.batch import ROWS_TOGETHER, Batches
from spinfilters.campaigns.dask_cluster import DaskCluster
from spinfilters.campaigns.engine import run_campaign
from spinfilters.campaigns.row_columns import TIMES
from spinfilters.campaigns.rows_folder import read_rows
from spinfilters.campaigns.study import study_from
from spinfilters.io.input_file import read_toml


def main() -> None:
    """Print a line for each number of workers."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("study", type=Path)
    parser.add_argument("--seeds", type=int, required=True)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--batch", action="store_true")
    given = parser.parse_args()
    begin_benchmark("experiments.benchmarks.campaign", "wall and processor", "workers of one thread")
    for workers in given.workers:
        cost = campaign_cost(given.study, given.seeds, workers, given.batch)
        print(f"{workers} worker(s): {cost}", flush=True)


@dataclass(frozen=True)
class CampaignCost:
    """What a campaign took, s.

    Attributes
    ----------
    wall, processor: of the whole, start of the workers included.
    own: of simulating, initialising, estimating and evaluating, processor time.
    """

    runs: int
    wall: float
    processor: float
    own: float

    def __str__(self) -> str:
        more = self.processor / self.own - 1
        return (
            f"{self.runs} runs in {self.wall:.1f} s, {self.runs / self.wall:.1f} a second; "
            f"{1e3 * self.processor / self.runs:.1f} ms of processor a run, {more:.1%} more than the runs' own"
        )


def campaign_cost(path: Path, seeds: int, workers: int, batch: bool) -> CampaignCost:
    """Cost of a study with so many seeds."""
    document = dict(read_toml(path))
    document["study"] = {**document["study"], "seeds": seeds}
    study = study_from(document, str(path))
    begin, before = time.perf_counter(), _processor_time()
    with tempfile.TemporaryDirectory(prefix="spinfilters-campaign-") as place:
        folder = Path(place) / "rows"
        executor = Batches(workers) if batch else DaskCluster(processes=workers)
        run_campaign(study, folder, executor, together=ROWS_TOGETHER if batch else 1)
        wall, spent = time.perf_counter() - begin, _processor_time() - before
        rows = read_rows(folder, study.columns)
    own = sum(value or 0.0 for name in TIMES for value in rows[f"time_{name}_s"].to_pylist())
    return CampaignCost(len(rows), wall, spent, own)


def _processor_time() -> float:
    """Processor time of this process and of children that have ended, s."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


if __name__ == "__main__":
    run_study(main)
