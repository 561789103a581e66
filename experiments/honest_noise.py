"""NEES where nobody states any noise.

And identified levels, and what not knowing the noise costs.
    spinfilters campaign experiments/studies/honest-noise-tracks.toml -o runs/honest-noise-tracks [--resume]
    python -m experiments.honest_noise runs/honest-noise-tracks [runs/honest-noise-poses runs/honest-noise-gyro]

Every seed draws its sensor's noise and the densities of its disturbances, log-uniform over decades, and is estimated twice: with
nothing stated and with the true noise stated (``noise = ["silent", "stated"]``). Printed are, of each motion and estimator,

    ok            verdicts (with the noise stated),
    determined    of the runs whose moments the smoother determines with the noise stated, as the bound does, those ``ok``,
    NEES          per degree of freedom over its own epochs: mean over the ``ok`` runs, worst, share below 2; of all runs; by block,
    levels right  share of identified levels within three standard deviations of the true ones (of bounds: not below them),
    pixel noise   its largest error,
    errors        over those with the noise stated: geometric mean over position, attitude, velocity, rate and runs; 95 % quantile.

Below stand the doubts about determined runs that are not ``ok``, by the words before their first number, with seeds.
"""

import argparse
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float

from experiments.command_line import run_study
from spinfilters.campaigns.row_columns import noise_levels
from spinfilters.campaigns.rows_folder import read_folder, read_rows
from spinfilters.evaluation.metrics import MOTIONS
from spinfilters.filters.noise_levels import TOLD_LOG_STD
from spinfilters.io.disturbances import DENSITIES
from spinfilters.models.state_blocks import RIGID_BODY
from spinfilters.verdict.checks import LARGEST_MOMENT_STD

FAR = 3.0
"""Standard deviations of a level's logarithm from the truth, at most."""
LARGEST_NEES = 2.0
"""Per degree of freedom, of a run that is called ``ok``."""
CELL = ("motion", "estimator")
HEAD = (
    "motion, estimator",
    "ok (noise stated)",
    "of determined",
    "NEES of ok: mean, worst, below 2",
    "all; noise stated",
    "by block",
    "levels right",
    "pixel noise off by",
    "errors over noise stated: mean, 95 %",
)


def main() -> None:
    """Print the rows of all folders."""
    print_tables(__doc__, HEAD, lambda table: (*rows_of(table), "", *doubts_of(table)))


def print_tables(
    description: str | None, head: Sequence[str], lines_of: Callable[[pd.DataFrame], Iterable[str]]
) -> None:
    """Print a table of Markdown of every campaign folder that the command line names.

    Parameters
    ----------
    description: of the command.   head: of the columns.   lines_of: lines by a folder's rows.
    """
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", type=Path, nargs="+")
    for folder in parser.parse_args().folders:
        study, _ = read_folder(folder)
        print(f"{study.name}\n\n| {' | '.join(head)} |\n|{'---|' * len(head)}")
        for line in lines_of(read_rows(folder, study.columns).to_pandas()):
            print(line)


def rows_of(table: pd.DataFrame) -> Iterator[str]:
    """A row of Markdown for every motion and estimator.

    Seeds of which not all runs were made are left out.
    """
    whole = table.groupby("seed")["run"].transform("size")
    table = table.loc[whole == whole.max()]
    for levels, both in table.groupby(list(CELL), sort=False):
        assert isinstance(levels, tuple)
        silent, stated = (both[both["noise"] == kind].set_index("seed") for kind in ("silent", "stated"))
        seeds = determined(table.loc[table["motion"] == levels[0]])
        yield f"| {' | '.join((', '.join(map(str, levels)), *_numbers(silent, stated, seeds)))} |"


def doubts_of(table: pd.DataFrame) -> Iterator[str]:
    """First doubts about determined runs that are not ``ok``, a line for each kind.

    Of a run without a verdict it is what stopped it.
    """
    kinds: dict[str, list[int]] = {}
    for motion, runs in table.groupby("motion", sort=False):
        told = runs.loc[runs["seed"].isin(determined(runs).tolist()) & (runs["verdict"] != "ok")]
        told = told.assign(reasons=told["verdict_reasons"].fillna(told["reason"]))
        columns = (told[name].tolist() for name in ("estimator", "noise", "reasons", "seed"))
        for estimator, noise, reasons, seed in zip(*columns, strict=True):
            words = re.split(r"[\d(:;]", reasons, maxsplit=1)[0].strip(" ,")
            kinds.setdefault(f"{motion}, {estimator}, {noise}: {words}", []).append(seed)
    for kind, seeds in kinds.items():
        yield f"{kind}: {len(seeds)} ({', '.join(map(str, sorted(seeds)))})"


def determined(table: pd.DataFrame) -> pd.Index:
    """Seeds whose moments the smoother knows where the noise is stated."""
    smoothed = table[(table["estimator"] == "smoother") & (table["noise"] == "stated")].set_index("seed")
    return smoothed.index[smoothed[["std_moment_1", "std_moment_2"]].max(axis=1) <= LARGEST_MOMENT_STD]


def _numbers(silent: pd.DataFrame, stated: pd.DataFrame, seeds: pd.Index) -> Iterator[str]:
    ok = silent[silent["verdict"] == "ok"]
    yield f"{len(ok)} of {len(silent)} ({(stated['verdict'] == 'ok').sum()})"
    told = silent.index.intersection(seeds)
    yield f"{ok.index.isin(told).sum() / max(len(told), 1):.0%} of {len(told)}"
    nees = np.asarray(ok["nees"], dtype=float)
    nees = nees[np.isfinite(nees)]
    yield f"{nees.mean():.2f}, {nees.max():.2f}, {(nees < LARGEST_NEES).mean():.0%}" if len(nees) else "-"
    yield f"{silent['nees'].mean():.2f}; {stated['nees'].mean():.2f}"
    blocks = {block.name: ok[f"nees_{block.name}"].mean() for block in RIGID_BODY}
    yield " ".join(f"{block} {value:.2f}" for block, value in blocks.items() if np.isfinite(value))
    right = levels_right(silent)
    yield f"{right.mean():.0%} of {len(right)}" if len(right) else "-"
    pixels = np.abs(silent["found_pixel_std"] / silent["true_pixel_std"] - 1).max()
    yield f"{pixels:.1%}" if np.isfinite(pixels) else "-"
    ratio = error_ratios(silent, stated)
    yield f"{np.exp(np.log(ratio).mean()):.3f}, {np.quantile(ratio, 0.95):.2f}" if len(ratio) else "-"


def levels_right(rows: pd.DataFrame) -> Bool[np.ndarray, " n"]:
    """Of every identified level, whether the true one lies within its deviations or below its bound."""
    found = []
    for name in noise_levels():
        true, value, log_std = (rows[f"{what}_{name}"].to_numpy() for what in ("true", "found", "log_std"))
        half = 1.0 if name in DENSITIES else 0.5
        away = np.log(true / value) / half / log_std
        right = (away < FAR) & ((log_std >= TOLD_LOG_STD) | (away > -FAR))
        found.append(right[np.isfinite(away)])
    return np.concatenate(found)


def error_ratios(silent: pd.DataFrame, stated: pd.DataFrame) -> Float[np.ndarray, " n"]:
    """Geometric mean ratio of errors to those with stated noise.

    Of every run of both.
    """
    columns = [f"error_{field}" for _, field, *_ in MOTIONS]
    both = silent.index.intersection(stated.index)
    logs = np.log(silent.loc[both, columns].to_numpy() / stated.loc[both, columns].to_numpy())
    means = np.nanmean(logs[np.isfinite(logs).any(axis=1)], axis=1)
    return np.exp(means)


if __name__ == "__main__":
    run_study(main)
