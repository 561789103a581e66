"""Report of simulation-based calibration: ranks, coverage, proper scores, non-credibility, and the verdict as a classifier.

It holds a folder's numbers, pictures and page, with the code and the day that they belong to.

Ranks of the truth are uniform where posteriors are right. Their empirical distribution is compared with a band that contains it at
all points at once with the probability 95 %: pointwise binomial intervals of a probability that simulation chooses (Saeilynoja,
Buerkner, Vehtari 2022).
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.special import ndtr, ndtri
from scipy.stats import binom

from spinfilters.campaigns.calibration_draws import CalibrationDraw, CalibrationStudy
from spinfilters.campaigns.statistics import Interval, mean, share
from spinfilters.io.output_files import write_json, write_text
from spinfilters.models.status import LABELS, MOMENTS
from spinfilters.plots.style import AXIS_COLOURS, BLACK, BLUE, GREEN, GREY, legend_below, save_figure, tidy
from spinfilters.run.provenance import git_commit

POINTS: Final = 50
"""Of the distribution of ranks, evenly spread."""
SIMULATIONS: Final = 4000
"""Of uniform ranks."""
FEWEST_DRAWS: Final = 10
"""Of which statistics are made."""
SMALLEST_RANK: Final = 1e-15
"""A rank nearer to 0 or 1 counts as this."""
LEVELS: Final = (0.5, 0.8, 0.95, 0.99, 0.9999)
"""Of central intervals whose coverage is counted."""


@dataclass(frozen=True)
class RankBand:
    """Simultaneous band of the empirical distribution of n uniform ranks.

    Attributes
    ----------
    at : ndarray of float, shape (p,)
        Points.
    low, high : ndarray of float, shape (p,)
        Between which the distribution lies at all points with the probability of the band.
    worst : ndarray of float, shape (s,)
        Smallest pointwise probability of simulated ranks, ascending.
    """

    at: Float[np.ndarray, " p"]
    low: Float[np.ndarray, " p"]
    high: Float[np.ndarray, " p"]
    worst: Float[np.ndarray, " s"]


@dataclass(frozen=True)
class ComponentCalibration:
    """Calibration of one component of a quantity.

    Attributes
    ----------
    ranks : ndarray of float, shape (n,)
        Of the truth.
    probability : float
        Of ranks as far from uniform, were the posterior right.
    inside : bool
        Whether their distribution is inside the band of 95 %.
    coverage : tuple of Interval
        Share of truths within the central intervals of `LEVELS`, each with its interval of 95 %.
    bias, squares : Interval
        Mean of errors in deviations, and of their squares: 0 and 1 of a right posterior.
    normal_squares : Interval
        Mean square of ranks as normal numbers: 1 if what is stated is right, also where that is no Gaussian.
    crps, log_score : Interval
        Mean continuous ranked probability score in the unit of the quantity, and mean negative log density; less is better.
    gaussian_crps : Interval
        The former of Gaussians of the stated deviations.
    inclination : float
        10 log10 of the mean square, dB: above zero deviations are too small, below too large.
    """

    ranks: Float[np.ndarray, " n"]
    probability: float
    inside: bool
    coverage: tuple[Interval, ...]
    bias: Interval
    squares: Interval
    normal_squares: Interval
    crps: Interval
    log_score: Interval
    gaussian_crps: Interval
    inclination: float


@cache
def rank_band(count: int, probability: float = 0.95) -> RankBand:
    """The band of so many ranks."""
    at = np.arange(1, POINTS) / POINTS
    generator = np.random.default_rng(count)
    ranks = generator.random((SIMULATIONS, count))
    worst = np.sort(_least_probability(_counts(ranks, at), count, at))
    level = float(np.quantile(worst, 1 - probability))
    low, high = binom.ppf(level / 2, count, at) / count, binom.ppf(1 - level / 2, count, at) / count
    return RankBand(at, low, high, worst)


def component_calibration(
    triples: Sequence[tuple[float, float, float]], scores: Sequence[tuple[float, float]] | None = None
) -> ComponentCalibration:
    """Calibration of one component from errors, deviations and ranks of its draws; those that are not finite are left out.

    Parameters
    ----------
    scores : sequence or None
        CRPS and negative log density of each draw; None for those of Gaussians.
    """
    every = np.array(triples, dtype=float).reshape(-1, 3)
    if scores is None:
        with np.errstate(all="ignore"):
            scores = gaussian_scores(every[:, 0], every[:, 1])
    every = np.concatenate([every, np.array(scores, dtype=float).reshape(-1, 2)], axis=1)
    every = every[np.isfinite(every).all(axis=1) & (every[:, 1] > 0)]
    error, std, ranks, crps, log_score = every.T
    z, count = error / std, len(every)
    band = rank_band(count)
    below = _counts(ranks[np.newaxis], band.at)
    least = float(_least_probability(below, count, band.at)[0])
    # as many simulated ranks are as far from uniform, these among them
    probability = (1 + float(np.searchsorted(band.worst, least, side="right"))) / (1 + len(band.worst))
    distribution = below[0] / count
    inside = bool(((distribution >= band.low) & (distribution <= band.high)).all())
    central = np.abs(2 * ranks - 1)
    return ComponentCalibration(
        ranks,
        probability,
        inside,
        tuple(share(int((central <= level).sum()), count) for level in LEVELS),
        mean(z),
        mean(z**2),
        mean(ndtri(np.clip(ranks, SMALLEST_RANK, 1 - SMALLEST_RANK)) ** 2),
        mean(crps),
        mean(log_score),
        mean(gaussian_crps(error, std)),
        10 * float(np.log10(np.mean(z**2))),
    )


def gaussian_crps(error: Float[np.ndarray, " n"], std: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Continuous ranked probability score of Gaussians (Gneiting, Raftery 2007, Eq. 21)."""
    z = error / std
    density = np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
    return std * (z * (2 * ndtr(z) - 1) + 2 * density - 1 / np.sqrt(np.pi))


def gaussian_scores(
    error: Float[np.ndarray, " n"], std: Float[np.ndarray, " n"]
) -> list[tuple[float, float]]:
    """CRPS and negative log density of Gaussians."""
    logs = 0.5 * (error / std) ** 2 + np.log(std) + 0.5 * np.log(2 * np.pi)
    return list(zip(gaussian_crps(error, std).tolist(), logs.tolist(), strict=True))


def quantity_calibration(
    draws: Sequence[CalibrationDraw], chosen: Callable[[CalibrationDraw], bool]
) -> dict[str, list[ComponentCalibration]]:
    """Calibration of every component by quantity, over the draws that are chosen; none of fewer than ten."""
    own = [draw for draw in draws if chosen(draw)]
    names = dict.fromkeys(name for draw in own for name in draw.quantities)
    found: dict[str, list[ComponentCalibration]] = {}
    for name in names:
        held = [draw for draw in own if name in draw.quantities]
        if len(held) >= FEWEST_DRAWS:
            columns = zip(*(draw.quantities[name] for draw in held), strict=True)
            scores = zip(*(_scores(draw, name) for draw in held), strict=True)
            found[name] = [component_calibration(*each) for each in zip(columns, scores, strict=True)]
    return found


def _scores(draw: CalibrationDraw, name: str) -> list[tuple[float, float]]:
    """Scores of a quantity's components; of a draw without, which an earlier version made, those of Gaussians."""
    if name in draw.scores:
        return draw.scores[name]
    error, std, _ = np.array(draw.quantities[name]).T
    with np.errstate(all="ignore"):
        return gaussian_scores(error, std)


def nees_calibration(
    draws: Sequence[CalibrationDraw], chosen: Callable[[CalibrationDraw], bool]
) -> dict[str, dict[str, Interval]]:
    """Mean NEES per degree of freedom by block over the draws that are chosen, by stated covariances and by what is stated.

    "stated" is by the covariances alone, "mixture" by the mixtures where there are any; none of fewer than ten draws.
    """
    own = [draw for draw in draws if chosen(draw)]
    found: dict[str, dict[str, Interval]] = {}
    for name in dict.fromkeys(name for draw in own for name in draw.nees):
        held = [draw for draw in own if name in draw.nees]
        if len(held) >= FEWEST_DRAWS:
            found[name] = {
                "stated": mean(np.array([draw.nees[name] for draw in held])),
                "mixture": mean(np.array([draw.mixture_nees.get(name, draw.nees[name]) for draw in held])),
            }
    return found


@dataclass(frozen=True)
class VerdictRates:
    """The verdict as a classifier of "every published quantity is within four deviations".

    Attributes
    ----------
    ok : Interval
        Share of draws that are ``ok``.
    ok_of_determined : Interval
        Of those whose moments are determined.
    wrong_of_ok : Interval
        Share of ``ok`` draws that are beyond four deviations.
    ok_of_right, ok_of_wrong : Interval
        True and false positive rate: the point of its receiver operating characteristic.
    """

    ok: Interval
    ok_of_determined: Interval
    wrong_of_ok: Interval
    ok_of_right: Interval
    ok_of_wrong: Interval


def verdict_rates(draws: Sequence[CalibrationDraw]) -> VerdictRates:
    """Rates of a list of draws of one estimator."""
    ok = [draw for draw in draws if draw.is_ok]
    determined = [draw for draw in draws if draw.determined]
    right, wrong = ([draw for draw in draws if draw.is_right is is_right] for is_right in (True, False))

    def of(which: Sequence[CalibrationDraw]) -> Interval:
        """Share of ok."""
        return share(sum(draw.is_ok for draw in which), len(which))

    return VerdictRates(
        of(draws),
        of(determined),
        share(sum(not draw.is_right for draw in ok), len(ok)),
        of(right),
        of(wrong),
    )


def width_characteristic(
    draws: Sequence[CalibrationDraw],
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """False and true positive rates of a classifier by the moments' stated deviation alone, with which the verdict is compared."""
    held = [draw for draw in draws if MOMENTS in draw.quantities]
    width = np.array([max(std for _, std, _ in draw.quantities[MOMENTS][:2]) for draw in held])
    right = np.array([draw.is_right for draw in held], dtype=bool)[np.argsort(width)]
    true = np.cumsum(right) / max(int(right.sum()), 1)
    false = np.cumsum(~right) / max(int((~right).sum()), 1)
    return np.concatenate([[0.0], false]), np.concatenate([[0.0], true])


def _counts(ranks: Float[np.ndarray, "s n"], at: Float[np.ndarray, " p"]) -> Int[np.ndarray, "s p"]:
    """How many of each row are at most each point."""
    return np.array([np.searchsorted(np.sort(row), at, side="right") for row in ranks])


def _least_probability(
    below: Int[np.ndarray, "s p"], count: int, at: Float[np.ndarray, " p"]
) -> Float[np.ndarray, " s"]:
    """Smallest over the points of twice the smaller binomial tail."""
    table = binom.cdf(
        np.arange(-1, count + 1)[:, np.newaxis], count, at
    )  # row j: probability of at most j - 1
    points = np.arange(len(at))
    low, high = table[below + 1, points], 1 - table[below, points]
    return 2 * np.minimum(low, high).min(axis=1)


RESULT_FILE: Final = "calibration.json"
PAGE_FILE: Final = "calibration.md"
DESCRIBED: Final = ("models", "filters", "smoother", "inference", "verdict")
"""Packages whose code decides what estimates state."""
COMPONENTS: Final = {
    "moments": ("J smallest", "J middle", "k1", "k2"),
    "axes": ("minor axis", "intermediate axis", "major axis"),
    "rate": ("x", "y", "z"),
    "center_of_mass": ("x", "y", "z"),
}
"""Names of components by quantity; of a principal axis, of the rotation about it."""
COLOURS: Final = (*AXIS_COLOURS, BLACK)
LARGEST_AGE: Final = timedelta(days=183)
"""By which a result may be older than the code that it describes."""
SIGNIFICANT: Final = 0.01
"""Probability below which ranks are not uniform."""


def source_hash() -> str:
    """SHA-256 over the sources of `DESCRIBED`, by which a result is known to be of this code."""
    package, digest = Path(__file__).parents[1], hashlib.sha256()
    for name in DESCRIBED:
        for path in sorted((package / name).rglob("*.py")):
            digest.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def is_outdated(result: Mapping[str, Any], code: date) -> bool:
    """Whether a stored result is older by half a year than the code that it describes, which was last changed that day."""
    return code - date.fromisoformat(result["date"]) > LARGEST_AGE


def write_report(
    folder: Path, study: CalibrationStudy, draws: Mapping[int, Sequence[CalibrationDraw]], asked: int
) -> list[Path]:
    """Numbers, page and pictures of a folder's draws; the paths of the pictures.

    Parameters
    ----------
    draws : mapping
        By seed, as `read_draws`.
    asked : int
        Draws of a finished study; a report of fewer says so.
    """
    without = sum(not each for each in draws.values())
    document: dict[str, Any] = {
        "study": study.document(),
        "draws": {"asked": asked, "made": len(draws), "without_estimate": without},
        "date": datetime.now(UTC).date().isoformat(),
        "commit": git_commit(),
        "source_sha256": source_hash(),
        "estimators": {},
    }
    lines, pictures = [f"# Calibration: {study.sensor}, noise {study.noise}", ""], []
    if len(draws) < asked:
        lines += [
            f"**Unfinished: {len(draws)} of {asked} draws are made. Run the command again for the rest.**",
            "",
        ]
    if without:
        lines += [f"No estimator could start on {without} of the {len(draws)} drawn recordings.", ""]
    for name in study.estimators:
        own = [draw for each in draws.values() for draw in each if draw.estimator == name]
        if not own:
            continue
        every = quantity_calibration(own, lambda draw: True)
        given_ok = quantity_calibration(own, lambda draw: draw.is_ok)
        rates = verdict_rates(own)
        squares = {
            "all": nees_calibration(own, lambda draw: True),
            "ok": nees_calibration(own, lambda draw: draw.is_ok),
        }
        document["estimators"][name] = {
            "draws": len(own),
            "verdict": {key: _interval(value) for key, value in vars(rates).items()},
            "all": _document(every),
            "ok": _document(given_ok),
            "nees": {
                group: {
                    block: {kind: _interval(each) for kind, each in kinds.items()}
                    for block, kinds in of.items()
                }
                for group, of in squares.items()
            },
        }
        title = f"{name}, {len(own)} draws" if len(own) == asked else f"{name}, {len(own)} of {asked} draws"
        lines += _page(title, every, given_ok, rates) + _nees_lines(squares)
        picture = folder / f"ranks-{name}.png"
        save_figure(rank_figure(title, {"all draws": every, "given ok": given_ok}, own), picture)
        pictures.append(picture)
    lines += [f"Code {document['commit']}, sources {document['source_sha256'][:12]}, {document['date']}.", ""]
    write_json(folder / RESULT_FILE, document)
    write_text(folder / PAGE_FILE, "\n".join(lines))
    return pictures


def rank_figure(
    title: str,
    groups: Mapping[str, Mapping[str, Sequence[ComponentCalibration]]],
    draws: Sequence[CalibrationDraw],
) -> Figure:
    """Distributions of ranks minus the uniform one with their bands, coverage, and the verdict as a classifier."""
    quantities = list(dict.fromkeys(name for draw in draws for name in draw.quantities))
    across = max(len(quantities), 2)
    figure = Figure(figsize=(3.1 * across + 0.5, 8.4), layout="constrained")
    panels = figure.subplots(len(groups) + 1, across, squeeze=False)
    for row, (group, found) in zip(panels, groups.items(), strict=False):
        for axes, quantity in zip(row, quantities, strict=False):
            _draw_ranks(axes, quantity, found.get(quantity, ()))
            axes.set_title(f"{LABELS[quantity]}, {group}", fontsize="small")
        row[0].set_ylabel("distribution minus uniform [-]")
        for axes in row[len(quantities) :]:
            axes.set_visible(False)
    _draw_coverage(panels[-1][0], next(iter(groups.values())))
    _draw_characteristic(panels[-1][1], draws)
    for axes in panels[-1][2:]:
        axes.set_visible(False)
    figure.suptitle(f"{title}: ranks of the truth in the stated posterior", fontsize="medium")
    names = (
        "component 1 (J smallest, minor, x)",
        "2 (J middle, intermediate, y)",
        "3 (k1, major, z)",
        "4 (k2)",
    )
    handles = [Line2D([], [], color=c, label=text) for c, text in zip(COLOURS, names, strict=True)]
    legend_below(figure, [*handles, Patch(color=GREEN, alpha=0.25, label="simultaneous 95 % band")])
    return figure


def _draw_ranks(axes: Axes, quantity: str, components: Sequence[ComponentCalibration]) -> None:
    for colour, each in zip(COLOURS, components, strict=False):
        band = rank_band(len(each.ranks))
        below = np.searchsorted(np.sort(each.ranks), band.at, side="right") / len(each.ranks)
        axes.plot(band.at, below - band.at, color=colour, linewidth=1.1)
    if components:
        band = rank_band(max(len(each.ranks) for each in components))
        axes.fill_between(
            band.at, band.low - band.at, band.high - band.at, color=GREEN, alpha=0.25, linewidth=0
        )
    else:
        _say_too_few(axes)
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    axes.set_xlabel("rank of the truth [-]")
    tidy(axes)


def _draw_coverage(axes: Axes, found: Mapping[str, Sequence[ComponentCalibration]]) -> None:
    """Mean coverage over the components of each quantity, with the widest interval of one."""
    places = np.arange(len(LEVELS))
    for number, (quantity, components) in enumerate(found.items()):
        coverage = np.array([[each.value for each in one.coverage] for one in components])
        low = np.array([[each.low for each in one.coverage] for one in components]).min(axis=0)
        high = np.array([[each.high for each in one.coverage] for one in components]).max(axis=0)
        middle, at = coverage.mean(axis=0), places + 0.16 * (number - (len(found) - 1) / 2)
        ends = np.abs(np.stack([low, high]) - middle)
        axes.errorbar(
            at, middle, ends, fmt="o", ms=3.5, color=COLOURS[number], label=LABELS[quantity], elinewidth=0.9
        )
    for place, level in zip(places, LEVELS, strict=True):
        axes.plot([place - 0.4, place + 0.4], [level, level], color=GREY, linewidth=1.2)
    axes.set_xticks(places, [f"{100 * level:g}" for level in LEVELS])
    axes.set_xlabel("stated interval [%]")
    axes.set_ylabel("share of truths within [-]")
    if found:
        axes.legend(fontsize="x-small", frameon=False, loc="lower right")
    else:
        _say_too_few(axes)
    axes.set_title("coverage, all draws", fontsize="small")
    tidy(axes)


def _say_too_few(axes: Axes) -> None:
    axes.text(0.5, 0.5, "fewer than 10 draws", ha="center", transform=axes.transAxes, fontsize="small")


def _draw_characteristic(axes: Axes, draws: Sequence[CalibrationDraw]) -> None:
    rates = verdict_rates(draws)
    false, true = width_characteristic(draws)
    axes.plot(false, true, color=GREY, linewidth=1.1, label="by the moments' width alone")
    if rates.ok_of_wrong.count:
        axes.plot([rates.ok_of_wrong.value], [rates.ok_of_right.value], "o", color=BLUE, label="verdict ok")
    else:
        axes.axhline(rates.ok_of_right.value, color=BLUE, label="verdict ok (no draw beyond 4 deviations)")
    axes.set_xlabel("ok among those beyond 4 std [-]")
    axes.set_ylabel("ok among the others [-]")
    axes.set_xlim(-0.02, 1.02)
    axes.set_ylim(-0.02, 1.02)
    axes.legend(fontsize="x-small", frameon=False, loc="lower right")
    axes.set_title("verdict as a classifier", fontsize="small")
    tidy(axes)


def _page(
    title: str,
    every: Mapping[str, Sequence[ComponentCalibration]],
    given_ok: Mapping[str, Sequence[ComponentCalibration]],
    rates: VerdictRates,
) -> list[str]:
    lines = [f"## {title}", ""]
    lines += [
        f"`ok` in {_share(rates.ok)}, of determined ones in {_share(rates.ok_of_determined)}. Beyond 4 deviations of `ok` ones: "
        f"{_share(rates.wrong_of_ok)}. `ok` of the right ones {_share(rates.ok_of_right)}, of the wrong ones "
        f"{_share(rates.ok_of_wrong)}.",
        "",
    ]
    for group, found in (("all draws", every), ("given `ok`", given_ok)):
        if not found:
            lines += [f"No statistics of {group}: fewer than 10.", ""]
            continue
        heads = [f"{100 * level:g} %" for level in LEVELS]
        lines += [
            f"| {group} | rank test p | in band | {' | '.join(heads)} | mean square of ranks | of errors | inclination [dB] | "
            "CRPS | of Gaussians | log score |",
            f"|{'---|' * (9 + len(LEVELS))}",
        ]
        for quantity, components in found.items():
            for label, each in zip(COMPONENTS[quantity], components, strict=True):
                cells = [
                    f"{LABELS[quantity]}: {label}",
                    f"{each.probability:.2g}{' (!)' if each.probability < SIGNIFICANT else ''}",
                    "yes" if each.inside else "no",
                    *(f"{100 * c.value:.1f} [{100 * c.low:.0f}, {100 * c.high:.0f}]" for c in each.coverage),
                    *(
                        f"{c.value:.2f} [{c.low:.2f}, {c.high:.2f}]"
                        for c in (each.normal_squares, each.squares)
                    ),
                    f"{each.inclination:+.1f}",
                    f"{each.crps.value:.3g}",
                    f"{each.gaussian_crps.value:.3g}",
                    f"{each.log_score.value:.2f}",
                ]
                lines.append(f"| {' | '.join(cells)} |")
        lines.append("")
    return lines


BLOCKS: Final = {"w": "rate", "s": "mass distribution", "c": "centre of mass"}
"""Names of the blocks whose NEES is kept."""


def _nees_lines(squares: Mapping[str, Mapping[str, Mapping[str, Interval]]]) -> list[str]:
    """Table of the NEES by block."""
    rows = [
        f"| {BLOCKS.get(block, block)} | {group} | "
        + " | ".join(
            f"{kinds[kind].value:.2f} [{kinds[kind].low:.2f}, {kinds[kind].high:.2f}]" for kind in kinds
        )
        + " |"
        for group, of in squares.items()
        for block, kinds in of.items()
    ]
    head = [
        "| NEES per dof | draws | of stated covariances | of what is stated, mixtures too |",
        "|---|---|---|---|",
    ]
    return [*head, *rows, ""] if rows else []


def _share(interval: Interval) -> str:
    if not interval.count:
        return "none of 0"
    return f"{100 * interval.value:.1f} % [{100 * interval.low:.1f}, {100 * interval.high:.1f}] of {interval.count}"


def _interval(interval: Interval) -> dict[str, float | int]:
    return {"value": interval.value, "low": interval.low, "high": interval.high, "count": interval.count}


def _document(found: Mapping[str, Sequence[ComponentCalibration]]) -> dict[str, Any]:
    return {
        quantity: {
            label: {
                "count": len(each.ranks),
                "rank_probability": each.probability,
                "inside_band": each.inside,
                "coverage": {
                    f"{level:g}": _interval(c) for level, c in zip(LEVELS, each.coverage, strict=True)
                },
                "bias": _interval(each.bias),
                "mean_square": _interval(each.squares),
                "rank_mean_square": _interval(each.normal_squares),
                "inclination_db": each.inclination,
                "crps": _interval(each.crps),
                "gaussian_crps": _interval(each.gaussian_crps),
                "log_score": _interval(each.log_score),
            }
            for label, each in zip(COMPONENTS[quantity], components, strict=True)
        }
        for quantity, components in found.items()
    }
