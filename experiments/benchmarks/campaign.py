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
from pathlib import Path

from experiments.command_line import run_study
from spinfilters.campaigns.batch import Batches
from spinfilters.campaigns.dask_cluster import DaskCluster
from spinfilters.campaigns.engine import run_campaign
from spinfilters.campaigns.row_columns import TIMES
from spinfilters.campaigns.rows_folder import read_rows
from spinfilters.campaigns.study import Study, study_from
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
    document = dict(read_toml(given.study))
    document["study"] = {**document["study"], "seeds": given.seeds}
    for workers in given.workers:
        print(_line(study_from(document, str(given.study)), workers, given.batch), flush=True)


def _line(study: Study, workers: int, batch: bool) -> str:
    begin, before = time.perf_counter(), _processor_time()
    with tempfile.TemporaryDirectory(prefix="spinfilters-campaign-") as place:
        folder = Path(place) / "rows"
        run_campaign(study, folder, Batches(workers) if batch else DaskCluster(processes=workers))
        wall, spent = time.perf_counter() - begin, _processor_time() - before
        rows = read_rows(folder, study.columns)
    parts = sum(value or 0.0 for name in TIMES for value in rows[f"time_{name}_s"].to_pylist())
    return (
        f"{workers} worker(s): {len(rows)} runs in {wall:.1f} s, {len(rows) / wall:.1f} a second; "
        f"{1e3 * spent / len(rows):.1f} ms of processor a run, {spent / parts - 1:.1%} more than the runs' own"
    )


def _processor_time() -> float:
    """Processor time of this process and of children that have ended, s."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


if __name__ == "__main__":
    run_study(main)
