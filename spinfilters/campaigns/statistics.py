"""Statistics over a campaign's rows with their 95 % intervals: by cell, by verdict, over time, and between estimators in pairs.

Rows of one seed that differ in the estimator alone are of the same recording. Its difficulty is in both errors and cancels in their
ratio, so that the interval of a mean ratio is much narrower than those of the errors. Means are of logarithms: a ratio and its
inverse count alike.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pyarrow as pa
from jaxtyping import Float, Int
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter
from scipy.special import ndtri, stdtrit

from spinfilters.campaigns.row_columns import TIMES
from spinfilters.campaigns.study import Study
from spinfilters.evaluation.consistency import chi_square_band
from spinfilters.evaluation.metrics import Metric, metrics
from spinfilters.models.status import CENTRE, QUANTITIES, Holds
from spinfilters.plots.style import estimator_lines, tidy

QUANTITY_OF: Final = {
    **{f"error_{name}": name for name in QUANTITIES},
    "error_moment": "moments",
    "error_k": "moments",
    "error_axis": "axes",
    "error_center_of_mass": CENTRE,
}
"""Quantity of a verdict by the beginning of the column of an error."""
MOST_UNDETERMINED: Final = 0.5
"""Share of a cell's runs that may leave a quantity open for it to count as determined."""
QUANTILE: Final = float(ndtri(0.975))


@dataclass(frozen=True)
class Interval:
    """Estimate with its 95 % interval; NaN of too few values."""

    value: float
    low: float
    high: float
    count: int


NOTHING: Final = Interval(np.nan, np.nan, np.nan, 0)


def share(hits: int, count: int) -> Interval:
    """Interval of a probability by Wilson's score (Wilson 1927), within 0 and 1."""
    if not count:
        return NOTHING
    p, z2 = hits / count, QUANTILE**2
    centre, width = p + z2 / (2 * count), QUANTILE * np.sqrt(p * (1 - p) / count + z2 / (4 * count**2))
    low, high = (centre - width) / (1 + z2 / count), (centre + width) / (1 + z2 / count)
    # none or all of the runs: the end is exact, and would differ from it by rounding
    return Interval(p, float(low) if hits else 0.0, float(high) if hits < count else 1.0, count)


def mean(values: Float[np.ndarray, " n"]) -> Interval:
    """Interval of a mean of independent values, by the central limit theorem."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return NOTHING
    value = float(finite.mean())
    if len(finite) < 2:
        return Interval(value, np.nan, np.nan, len(finite))
    width = QUANTILE * float(finite.std(ddof=1)) / np.sqrt(len(finite))
    return Interval(value, value - width, value + width, len(finite))


def positive_mean(values: Float[np.ndarray, " n"]) -> Interval:
    """Interval of a mean of independent values that are not negative, by that of its logarithm: it stays positive.

    The deviation of the logarithm is that of the mean over the mean; few values widen it as Student's t does.
    """
    found = mean(values)
    if not (found.value > 0 and np.isfinite(found.low)):
        return found
    quantile = float(stdtrit(found.count - 1, 0.975))
    factor = float(np.exp(quantile / QUANTILE * (found.high - found.value) / found.value))
    return Interval(found.value, found.value / factor, found.value * factor, found.count)


def root_mean_square(values: Float[np.ndarray, " n"]) -> Interval:
    """Interval of a root mean square, from that of the mean square."""
    return _root(mean(np.square(values)))


def ratio_of_squares(values: Float[np.ndarray, " n"], bounds: Float[np.ndarray, " n"]) -> Interval:
    """Ratio rms(values) / rms(bounds) of paired runs, with its interval.

    The mean of v^2 - r^2 b^2 is zero, its deviation that of r^2.
    """
    paired = np.isfinite(values) & np.isfinite(bounds)
    v, b = np.square(values[paired]), np.square(bounds[paired])
    if not len(v) or not b.mean() > 0:
        return NOTHING
    ratio = float(v.mean() / b.mean())
    if len(v) < 2:
        return Interval(float(np.sqrt(ratio)), np.nan, np.nan, len(v))
    width = QUANTILE * float((v - ratio * b).std(ddof=1)) / np.sqrt(len(v)) / float(b.mean())
    return _root(Interval(ratio, ratio - width, ratio + width, len(v)))


def _root(square: Interval) -> Interval:
    low, high = np.sqrt(max(square.low, 0.0)), np.sqrt(square.high)
    return Interval(float(np.sqrt(square.value)), float(low), float(high), square.count)


FEWEST_SHARE: Final = 0.5
"""Share of a cell's runs that must have an epoch for it to be drawn: initialisations are of different lengths."""


@dataclass(frozen=True)
class NeesOverTime:
    """Mean NEES per degree of freedom over runs at ``time_s`` (n,), with its consistency band."""

    time_s: Float[np.ndarray, " n"]
    mean: Float[np.ndarray, " n"]
    low: Float[np.ndarray, " n"]
    high: Float[np.ndarray, " n"]

    @property
    def inside(self) -> float:
        """Share of the epochs within the band."""
        return (
            float(np.mean((self.mean >= self.low) & (self.mean <= self.high))) if len(self.mean) else np.nan
        )


@dataclass(frozen=True)
class CellSummary:
    """Statistics of the runs of one cell.

    Attributes
    ----------
    levels : Mapping[str, str]
        Of the factors.
    runs : int
        Rows.
    outcomes : Mapping[str, int]
        How many of each.
    ok, right_of_ok : Interval
        Shares.
    numbers : Mapping[str, Interval]
        Of every metric with numbers, by its column: of errors that have a bound the root mean square over runs, of others the
        mean.
    over_bound : Mapping[str, Interval]
        Root mean square of errors over that of their bounds, by the column of the error.
    nees_median : float
        Over runs, of a run's mean per degree of freedom.
    band : tuple[float, float]
        In which the mean over runs of the last epoch's lies with probability 95 % for a consistent estimator.
    seconds : Interval
        Of processor time.
    undetermined : Mapping[str, float]
        Share of the runs whose measurements do not determine a quantity, by its name.
    """

    cell: int
    levels: Mapping[str, str]
    runs: int
    outcomes: Mapping[str, int]
    verdicts: Mapping[tuple[str, str], int]
    ok: Interval
    right_of_ok: Interval
    numbers: Mapping[str, Interval]
    over_bound: Mapping[str, Interval]
    nees_median: float
    band: tuple[float, float]
    seconds: Interval
    over_time: NeesOverTime
    undetermined: Mapping[str, float]

    def determines(self, metric: Metric) -> bool:
        """Whether at least half of the runs determine what an error is of."""
        name = next((each for start, each in QUANTITY_OF.items() if metric.column_name.startswith(start)), "")
        return self.undetermined.get(name, 0.0) <= MOST_UNDETERMINED

    @property
    def determines_all(self) -> bool:
        """Whether at least half of the runs determine every quantity."""
        return max(self.undetermined.values()) <= MOST_UNDETERMINED

    @property
    def nees(self) -> Interval:
        """Mean over runs of a run's mean NEES per degree of freedom."""
        return self.numbers["nees"]

    @property
    def last(self) -> Interval:
        """Mean over runs of the last epoch's NEES per degree of freedom."""
        return self.numbers["nees_last"]


def counted_metrics() -> list[Metric]:
    """Metrics whose columns are numbers."""
    return [metric for metric in metrics() if metric.column_name and metric.kind in (float, int)]


def cell_summaries(study: Study, table: pa.Table) -> Iterator[CellSummary]:
    """Statistics of every cell that has rows, in order."""
    cells = table["cell"].to_numpy()
    order = np.argsort(cells, kind="stable")
    found, begins = np.unique(cells[order], return_index=True)
    plain = table.drop_columns(["nees_time_s", "nees_over_time"]).to_pandas()
    series = NeesSeries(table)
    for cell, rows in zip(found.tolist(), np.split(order, begins[1:]), strict=True):
        yield _summary(cell, study.cells[cell].levels, plain.iloc[rows], series.over_time(rows))


def _summary(cell: int, levels: Mapping[str, str], rows: Any, over_time: NeesOverTime) -> CellSummary:
    verdicts = confusion(rows)
    right = verdicts.get(("ok", "right"), 0)
    ok = right + verdicts.get(("ok", "wrong"), 0)
    all_ok = int((rows["verdict"] == "ok").sum())
    dof = _numbers(rows, "dof")
    numbers, over_bound = {}, {}
    for metric in counted_metrics():
        values, statistic = _numbers(rows, metric.column_name), mean
        if metric.bound is not None:
            statistic = root_mean_square
            over_bound[metric.column_name] = ratio_of_squares(values, _numbers(rows, metric.bound_column))
        numbers[metric.column_name] = statistic(values)
    return CellSummary(
        cell,
        levels,
        len(rows),
        rows["outcome"].value_counts().to_dict(),
        verdicts,
        share(all_ok, len(rows)),
        share(right, ok),
        numbers,
        over_bound,
        float(np.nanmedian(values)) if (values := _finite(rows, "nees")).size else np.nan,
        _band(int(np.nanmax(dof)) if np.isfinite(dof).any() else 0, numbers["nees_last"].count),
        mean(np.sum([_numbers(rows, f"time_{part}_s") for part in TIMES], axis=0)),
        over_time,
        {name: float((rows[f"holds_{name}"] == str(Holds.NOT_DETERMINED)).mean()) for name in QUANTITIES},
    )


def confusion(rows: Any) -> dict[tuple[str, str], int]:
    """Counts of rows by verdict and by "right", "wrong" or "unknown"."""
    said = rows["verdict"].fillna("no result")
    was = rows["right"].map({True: "right", False: "wrong"}).fillna("unknown")
    return {(str(a), str(b)): int(n) for (a, b), n in rows.groupby([said, was]).size().items()}


class NeesSeries:
    """NEES over time of every row, as flat arrays."""

    def __init__(self, table: pa.Table) -> None:
        self._time, self._offsets = _flat(table["nees_time_s"])
        self._nees, _ = _flat(table["nees_over_time"])
        dof = table["dof"].to_numpy(zero_copy_only=False).astype(float)
        self._dof = int(np.nanmax(dof)) if np.isfinite(dof).any() else 1

    def over_time(self, rows: Int[np.ndarray, " k"]) -> NeesOverTime:
        """Mean NEES over time of some rows."""
        lengths = np.diff(self._offsets)[rows]
        begins = np.repeat(self._offsets[rows] - np.concatenate([[0], np.cumsum(lengths)[:-1]]), lengths)
        at = begins + np.arange(lengths.sum())
        value = self._nees[at]
        finite = np.isfinite(value)
        time, index = np.unique(self._time[at][finite], return_inverse=True)
        count = np.bincount(index, minlength=len(time))
        often = count >= FEWEST_SHARE * np.count_nonzero(lengths)
        sums = np.bincount(index, weights=value[finite], minlength=len(time))
        n = np.maximum(count[often], 1)
        low, high = chi_square_band(self._dof * n, 1)
        return NeesOverTime(time[often], sums[often] / n, low / (self._dof * n), high / (self._dof * n))


def _flat(column: pa.ChunkedArray) -> tuple[Float[np.ndarray, " m"], Int[np.ndarray, " n_plus_1"]]:
    """Concatenated values of a column of lists and the offset of each row; a row without a list is empty."""
    values = column.combine_chunks()
    if isinstance(values, pa.ChunkedArray):
        values = pa.concat_arrays(values.chunks) if values.num_chunks else pa.array([], column.type)
    lengths = np.nan_to_num(values.value_lengths().to_numpy(zero_copy_only=False).astype(float))
    flat = values.flatten().to_numpy(zero_copy_only=False).astype(float)
    return flat, np.concatenate([[0], np.cumsum(lengths.astype(int))])


def _band(dof: int, runs: int) -> tuple[float, float]:
    if not dof or not runs:
        return np.nan, np.nan
    low, high = chi_square_band(dof, runs)
    return float(low) / dof, float(high) / dof


def _numbers(rows: Any, column: str) -> Float[np.ndarray, " n"]:
    return rows[column].to_numpy(dtype=float, na_value=np.nan)


def _finite(rows: Any, column: str) -> Float[np.ndarray, " n"]:
    values = _numbers(rows, column)
    return values[np.isfinite(values)]


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
