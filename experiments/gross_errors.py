"""Estimates of recordings with one gross error, over those without.

    python -m experiments.gross_errors [--sensors pose,gyro,tracks] [--seeds 20] [-o runs/gross-errors]

Runs the campaigns ``experiments/studies/gross-errors-*.toml``, or goes on with their rows in the folder. One measurement of one
epoch is wrong altogether. Printed are of each estimator and error the root mean square over all seeds of the errors of position,
attitude, velocity, rate (over the estimator's own epochs) and moments (in the end), over the same without the gross error, in
brackets the 95 % quantile of this ratio of single seeds (moments have none: the two numbers of one run may be nearly zero); how
many runs are called ``ok`` with it and without; how many of these are wrong by more than 4 stated deviations, with it and without.
A ratio beyond 1.1 is marked. Further lines join all errors of an estimator by epoch. Errors called ``missing`` are none: that
measurement is left out, which is all that a perfect refusal can do (an epoch of a single measurement goes, and its estimates
count no more). The last line of a sensor says whether all joined ratios are within 1.1, and which is the largest.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from experiments.command_line import run_study
from spinfilters.api.arguments import CampaignArguments
from spinfilters.api.campaign_frames import campaign_rows
from spinfilters.campaigns.rows_folder import read_rows
from spinfilters.campaigns.study import read_study, study_from
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR
from spinfilters.io.output_files import make_folder
from spinfilters.simulation.measurement_faults import MISSING

STUDIES: Final = Path(__file__).parent / "studies"
NONE: Final = "none"
"""Level of the factor ``fault`` without an error."""
WORST_RATIO: Final = 1.1
QUANTILE: Final = 0.95
QUANTITIES: Final = {
    "t": ("error_position_m",),
    "a": ("error_attitude_rad",),
    "v": ("error_velocity_m_s",),
    "w": ("error_rate_rad_s",),
    "moments": ("error_moment_1", "error_moment_2"),
}
"""Columns of which there is a ratio, by what they are called in print."""
Row = Mapping[str, Any]


def main() -> None:
    """Run what is missing and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sensors", default="pose,gyro,tracks")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--workers", type=int, default=None)
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/gross-errors"))
    options = parser.parse_args()
    make_folder(options.output)
    for sensor in options.sensors.split(","):
        rows = _rows(sensor, options.seeds, options.output, options.workers)
        for line in lines_of(sensor, rows):
            print(line, flush=True)


def _rows(sensor: str, seeds: int, output: Path, workers: int | None) -> list[Row]:
    """Of a campaign with so many seeds; those that its folder has are not made again."""
    name = f"gross-errors-{sensor}"
    document = dict(read_study(STUDIES / f"{name}.toml").document)
    document["study"] = {**document["study"], "seeds": seeds}
    folder = output / name
    campaign_rows(document, folder, CampaignArguments(workers=workers, resume=folder.exists()))
    rows = read_rows(folder, study_from(document, name).columns).to_pylist()
    return [row for row in rows if row["seed"] < seeds]


def lines_of(sensor: str, rows: Sequence[Row]) -> Iterator[str]:
    """Lines of errors by estimator, by kind and by epoch.

    The last says whether all errors of an epoch joined are within the bar.
    """
    joined: dict[str, tuple[float, float]] = {}
    for estimator in dict.fromkeys(row["estimator"] for row in rows):
        own = [row for row in rows if row["estimator"] == estimator]
        right = [row for row in own if row["fault"] == NONE]
        faults = dict.fromkeys(row["fault"] for row in own if row["fault"] != NONE)
        for fault in faults:
            wrong = [row for row in own if row["fault"] == fault]
            text = _text(ratios(wrong, right), quantiles(wrong, right))
            yield f"{sensor} {estimator:9s} {fault:15s} {text}; {_verdicts(wrong, right)}"
        for epoch in dict.fromkeys(fault.split("-")[-1] for fault in faults):
            wrong, missing = _of_epoch(own, epoch)
            found, least = ratios(wrong, right), ratios(missing, right) if missing else {}
            text = _text(found, quantiles(wrong, right))
            yield f"{sensor} {estimator:9s} any, {epoch:10s} {text}; {_verdicts(wrong, right)}"
            joined |= {f"{estimator}, {epoch}, {q}": (found[q], least.get(q, np.nan)) for q in found}
    yield f"{sensor}: {_conclusion(joined)}"


def _of_epoch(own: Sequence[Row], epoch: str) -> tuple[list[Row], list[Row]]:
    """Rows with any error at an epoch, and those without its measurement."""
    both = [row for row in own if row["fault"].split("-")[-1] == epoch and row["fault"] != NONE]
    missing = [row for row in both if row["fault"].startswith(MISSING)]
    return [row for row in both if not row["fault"].startswith(MISSING)], missing


def _conclusion(joined: Mapping[str, tuple[float, float]]) -> str:
    """Whether every joined ratio is within the bar; the largest, beside that without the measurement."""
    where, (largest, least) = max(joined.items(), key=lambda each: each[1][0])
    met = "met" if largest <= WORST_RATIO else "not met"
    return f"{WORST_RATIO} {met}; largest joined ratio {largest:.3f} ({where}; without the measurement {least:.3f})"


def quantiles(wrong: Sequence[Row], right: Sequence[Row]) -> dict[str, float]:
    """95 % quantiles of the ratios of single seeds.

    Of quantities that have a mean over epochs.
    """
    without = {row["seed"]: row for row in right}
    found: dict[str, float] = {}
    for name, columns in QUANTITIES.items():
        pairs = [(_rms([row], columns), _rms([without[row["seed"]]], columns)) for row in wrong]
        if len(columns) == 1 and np.isfinite([one for _, one in pairs]).all():
            found[name] = float(np.quantile([each / one for each, one in pairs], QUANTILE))
    return found


def ratios(wrong: Sequence[Row], right: Sequence[Row]) -> dict[str, float]:
    """Root mean square errors with over without; infinite where a run has none."""
    found = {}
    for name, columns in QUANTITIES.items():
        without = _rms(right, columns)
        if np.isfinite(without):
            found[name] = _rms(wrong, columns) / without
    return found


def _rms(rows: Sequence[Row], columns: Sequence[str]) -> float:
    """Over runs and columns; infinite where a value is missing or not finite."""
    values = [np.inf if row[column] is None else float(row[column]) for row in rows for column in columns]
    return float(np.sqrt(np.mean(np.square(values)))) if np.isfinite(values).all() else np.inf


def _text(found: Mapping[str, float], single: Mapping[str, float]) -> str:
    each = (
        f"{name} {value:.3f}{'*' * (value > WORST_RATIO)}"
        + (f" ({single[name]:.2f})" if name in single else "")
        for name, value in found.items()
    )
    return ", ".join(each)


def _verdicts(wrong: Sequence[Row], right: Sequence[Row]) -> str:
    ok = [[row for row in rows if row["verdict"] == "ok"] for rows in (wrong, right)]
    bad = [sum(not row["worst_error"] <= LARGEST_STATED_ERROR for row in rows) for rows in ok]
    counts = f"ok {len(ok[0])} of {len(wrong)} and {len(ok[1])} of {len(right)}"
    return f"{counts}, of these wrong {bad[0]} and {bad[1]}"


if __name__ == "__main__":
    run_study(main)
