"""Estimators of a campaign compared in pairs: ratios of errors and of processor time on the same recordings, with intervals.

Rows of one seed that differ in the estimator alone are of the same recording. Its difficulty is in both errors and cancels in their
ratio, so that the interval of a mean ratio is much narrower than those of the errors. Means are of logarithms: a ratio and its
inverse count alike.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pyarrow as pa
from jaxtyping import Float
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

from spinfilters.campaigns.statistics import QUANTILE, Interval
from spinfilters.campaigns.study import Study
from spinfilters.evaluation.metrics import Metric, metrics
from spinfilters.plots.style import estimator_lines, tidy

ESTIMATOR: Final = "estimator"
SECONDS: Final = "processor time"
MARKERS: Final = "osD^vPXp<>hd"
"""Of estimators in turn: there are more of them than colours."""
FEWEST_PAIRS: Final = 3
"""Recordings that both estimators have, below which no interval is given."""
MOST_TICKS: Final = 40.0
"""Range of a logarithmic axis, highest over lowest, up to which it has ticks within a decade."""
PREFERRED: Final = ("smoother", "mekf")
"""Estimators that the others are compared with, the first that a study has."""


@dataclass(frozen=True)
class PairedRatio:
    """Geometric mean of the ratios of one quantity of an estimator over that of the reference.

    Attributes
    ----------
    levels : tuple[str, ...]
        Of the factors that vary, without the estimator.
    estimator, quantity : str
        Whose, and of what.
    ratio : Interval
        With its 95 % interval and the number of recordings that both have.
    """

    levels: tuple[str, ...]
    estimator: str
    quantity: str
    ratio: Interval


def geometric_ratio(values: Float[np.ndarray, " n"], reference: Float[np.ndarray, " n"]) -> Interval:
    """Geometric mean of paired ratios, with the interval of the mean of their logarithms.

    Pairs with a number that is not finite and positive are left out.
    """
    good = np.isfinite(values) & np.isfinite(reference) & (values > 0) & (reference > 0)
    logs = np.log(values[good] / reference[good])
    if len(logs) < FEWEST_PAIRS:
        return Interval(float(np.exp(logs.mean())) if len(logs) else np.nan, np.nan, np.nan, len(logs))
    mean, width = float(logs.mean()), QUANTILE * float(logs.std(ddof=1)) / np.sqrt(len(logs))
    value, low, high = np.exp([mean, mean - width, mean + width]).tolist()
    return Interval(value, low, high, len(logs))


def reference_of(estimators: Sequence[str]) -> str | None:
    """The estimator that the others are compared with; None of a single one."""
    if len(estimators) < 2:
        return None
    return next((name for name in PREFERRED if name in estimators), estimators[0])


def paired_ratios(study: Study, table: pa.Table) -> list[PairedRatio]:
    """Ratios of every estimator of a study over the reference, by the levels of the other factors that vary."""
    estimators = list(dict.fromkeys(cell.levels[ESTIMATOR] for cell in study.cells))
    reference = reference_of(estimators)
    if reference is None:
        return []
    others = [name for name in study.varied if name != ESTIMATOR]
    plain = table.drop_columns(["nees_time_s", "nees_over_time"]).to_pandas()
    quantities = {metric.title: metric.column_name for metric in _errors()} | {SECONDS: "time_estimate_s"}
    return list(
        _ratios(plain, others, [name for name in estimators if name != reference], reference, quantities)
    )


def _errors() -> list[Metric]:
    """Errors of the motion and of the body that have a bound and a column."""
    return [each for each in metrics() if each.bound is not None and each.column_name and each.kind is float]


def _ratios(
    plain: Any, others: list[str], estimators: list[str], reference: str, quantities: dict[str, str]
) -> Iterator[PairedRatio]:
    groups = plain.groupby(others, sort=False, observed=True) if others else [((), plain)]
    for levels, rows in groups:
        by_seed = {name: own.set_index("seed") for name, own in rows.groupby(ESTIMATOR, observed=True)}
        if reference not in by_seed:
            continue
        for name in estimators:
            if name not in by_seed:
                continue
            seeds = by_seed[name].index.intersection(by_seed[reference].index)
            for title, column in quantities.items():
                one, other = (by_seed[each].loc[seeds, column].to_numpy(float) for each in (name, reference))
                found = geometric_ratio(np.abs(one), np.abs(other))
                if found.count:
                    yield PairedRatio(tuple(map(str, levels)), name, title, found)


def label_logarithms(axis: Axis) -> None:
    """Ticks of a logarithmic axis, so few that their labels have room; within a decade where it is narrow."""
    low, high = axis.get_view_interval()
    axis.set_major_locator(
        LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0) if high / low < MOST_TICKS else (1.0,))
    )
    axis.set_major_formatter(FormatStrFormatter("%.3g"))
    axis.set_minor_formatter(NullFormatter())


def pareto_figure(ratios: Sequence[PairedRatio]) -> Figure | None:
    """Ratio of the rate's error against that of processor time, a point an estimator and cell; None without both."""
    titles = [each.quantity for each in ratios if each.quantity != SECONDS]
    quantity = next((title for title in titles if title.startswith("rate")), titles[0] if titles else "")
    by_key = {(each.levels, each.estimator, each.quantity): each.ratio for each in ratios}
    points = [
        (levels, name, by_key[levels, name, SECONDS], ratio)
        for (levels, name, title), ratio in by_key.items()
        if title == quantity and (levels, name, SECONDS) in by_key
    ]
    points = [each for each in points if np.isfinite([each[2].low, each[3].low]).all()]
    if not points:
        return None
    figure = Figure(figsize=(7.6, 4.2), layout="constrained")
    axes = figure.add_subplot()
    names = list(dict.fromkeys(name for _, name, _, _ in points))
    lines, named = dict(zip(names, estimator_lines(names), strict=True)), set[str]()
    for _, name, seconds, error in points:
        axes.errorbar(
            seconds.value,
            error.value,
            xerr=[[seconds.value - seconds.low], [seconds.high - seconds.value]],
            yerr=[[error.value - error.low], [error.high - error.value]],
            fmt=MARKERS[names.index(name) % len(MARKERS)],
            color=lines[name].color,
            label=None if name in named else name,
        )
        named.add(name)
    axes.axhline(1.0, color="0.6", linewidth=0.8)
    axes.axvline(1.0, color="0.6", linewidth=0.8)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel=f"{SECONDS} over the reference",
        ylabel=f"{quantity.partition(' [')[0]} over the reference",
    )
    for axis in (axes.xaxis, axes.yaxis):
        label_logarithms(axis)
    figure.legend(loc="outside right upper", fontsize="small")
    tidy(axes)
    return figure
