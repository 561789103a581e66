"""Comparison of every free flight of a recording, and one inertia of several flights or runs of one body.

Without common axes only the moments can be weighed. Where the axes g of all recordings are the body's own, as those of a gyro that
stayed mounted, all five numbers of the mass distribution are (`spinfilters.evaluation.fused_inertia`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from jaxtyping import Float
from rich.table import Table

from spinfilters.core.chi_square import chi_square_tail
from spinfilters.core.errors import InputError
from spinfilters.evaluation.estimator_evaluation import REPORTED
from spinfilters.evaluation.fused_inertia import fuse_inertias, mass_belief
from spinfilters.inference.setup import knows_frames
from spinfilters.io.dataset import Dataset
from spinfilters.io.input_file import path_text, read_toml
from spinfilters.io.output_files import write_json, write_toml
from spinfilters.models.body import BodyEstimate, body_estimate
from spinfilters.models.state_blocks import ACCELERATION, MASS_DISTRIBUTION
from spinfilters.models.state_layout import Gaussian
from spinfilters.models.status import Verdict
from spinfilters.plots.style import draw_figure
from spinfilters.plots.throws import Throw, throws_figure
from spinfilters.run.array_files import finite_document
from spinfilters.run.estimation import compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.run.readers import read_dataset
from spinfilters.run.run_folder import (
    CONFIG_FILE,
    DATASET_FOLDER,
    SEGMENTS_FOLDER,
    finished_run,
    last_belief,
    refuse_foreign_run,
    write_configuration,
    write_run,
)
from spinfilters.run.run_summary import read_summary
from spinfilters.settings.run_settings import Settings

DISAGREEMENT: Final = 0.01
"""Probability of a chi-square as large, below which segments disagree and deviations are widened by its root per degree."""


@dataclass(frozen=True, eq=False)
class PooledMoments:
    """Weighted mean of J1/J3 and J2/J3.

    Attributes
    ----------
    ratios : ndarray of float, shape (2,)
        Jmin / Jmax and Jmid / Jmax.
    covariance : ndarray of float, shape (2, 2)
        Of them, as the segments' covariances say.
    chi_square : float
        Of the segments about them, of ``degrees`` degrees of freedom.
    segments : int
        That are ok, of ``total``.
    """

    ratios: Float[np.ndarray, " 2"]
    covariance: Float[np.ndarray, "2 2"]
    chi_square: float
    degrees: int
    segments: int
    total: int

    @property
    def probability(self) -> float:
        """Probability of a chi-square as large, 1 for a single segment."""
        return _agreement(self.chi_square, self.degrees)

    @property
    def widening(self) -> float:
        """Factor on the deviations: 1 where the segments agree."""
        return _widening(self.chi_square, self.degrees)

    @property
    def std(self) -> Float[np.ndarray, " 2"]:
        """Standard deviations, widened where the segments disagree."""
        return self.widening * np.sqrt(np.diag(self.covariance))

    @property
    def sentence(self) -> str:
        """The pooled ratios in words."""
        (first, second), (first_std, second_std) = self.ratios, self.std
        words = f"pooled J1/J3 {first:.4f} ± {first_std:.4f}, J2/J3 {second:.4f} ± {second_std:.4f}"
        if not self.degrees:
            return words
        words += f", chi-square {self.chi_square:.1f} of {self.degrees} (p {self.probability:.2g})"
        if self.widening > 1:
            words += f"; the segments disagree beyond their deviations, which are widened {self.widening:.1f} times"
        return words

    @property
    def document(self) -> dict[str, Any]:
        """The pooled ratios as segments.json holds them."""
        return {
            "ratios": self.ratios.tolist(),
            "std": self.std.tolist(),
            "covariance": self.covariance.tolist(),
            "chi_square": self.chi_square,
            "degrees_of_freedom": self.degrees,
            "probability": self.probability,
            "widening": self.widening,
            "segments_ok": self.segments,
            "segments": self.total,
        }


def pooled_moments(estimates: Sequence[Mapping[str, Any]], total: int) -> PooledMoments | None:
    """Pool an estimator's entries of summaries that are ``ok`` and have finite covariances; None of none.

    Parameters
    ----------
    total : int
        How many segments there are, those without a result among them.
    """
    ratios, information = [], []
    for estimate in estimates:
        moments = np.array(estimate["principal_moments"], dtype=float)[:2]
        covariance = np.array(estimate["principal_moments_cov"], dtype=float)[:2, :2]
        is_finite = np.isfinite(moments).all() and np.isfinite(covariance).all()
        if estimate["status"] != "ok" or not is_finite or not np.linalg.eigvalsh(covariance)[0] > 0:
            continue
        ratios.append(moments)
        information.append(np.linalg.inv(covariance))
    if not ratios:
        return None
    together = np.linalg.inv(np.sum(information, axis=0))
    mean = together @ np.sum([each @ r for each, r in zip(information, ratios, strict=True)], axis=0)
    distance = sum(float((r - mean) @ each @ (r - mean)) for each, r in zip(information, ratios, strict=True))
    return PooledMoments(mean, together, distance, 2 * (len(ratios) - 1), len(ratios), total)


FARTHEST: Final = 4.0
"""Deviations from the median of all segments, beyond which one is left out: a bounce that is no flight."""


@dataclass(frozen=True)
class Strength:
    """Length of an estimated acceleration with both parts of its standard deviation, m/s^2."""

    value: float
    random: float
    calibration: float

    @property
    def std(self) -> float:
        """Whole standard deviation."""
        return float(np.hypot(self.random, self.calibration))


@dataclass(frozen=True)
class PooledAcceleration:
    """Weighted mean of the strengths.

    The errors of the calibration are in all of them and are not averaged away.

    Attributes
    ----------
    strength : Strength
        The mean, its random part widened where the segments disagree.
    chi_square : float
        Of the segments about it, of ``degrees`` degrees of freedom.
    left_out : int
        Segments too far from their median.
    """

    strength: Strength
    chi_square: float
    degrees: int
    left_out: int = 0

    @property
    def probability(self) -> float:
        """Probability of a chi-square as large, 1 for a single segment."""
        return _agreement(self.chi_square, self.degrees)

    @property
    def sentence(self) -> str:
        """The pooled acceleration in words."""
        mean = self.strength
        words = f"pooled acceleration {mean.value:.3f} ± {mean.std:.3f} m/s^2 (± {mean.calibration:.2g} of it of lengths and clock)"
        if not self.degrees:
            return words
        words += f", chi-square {self.chi_square:.1f} of {self.degrees} (p {self.probability:.2g})"
        return f"{words}; left out as far off: {self.left_out}" if self.left_out else words

    @property
    def document(self) -> dict[str, Any]:
        """The pooled acceleration as segments.json holds it."""
        return {
            "strength": self.strength.value,
            "random_std": self.strength.random,
            "calibration_std": self.strength.calibration,
            "chi_square": self.chi_square,
            "degrees_of_freedom": self.degrees,
            "probability": self.probability,
            "left_out": self.left_out,
        }


def strength_of(estimate: Mapping[str, Any]) -> Strength | None:
    """Strength in an estimator's entry of a summary, or None.

    None where the estimator failed or has no acceleration. Errors of components are taken for independent.
    """
    key = REPORTED[ACCELERATION.name].value_key
    parts = (estimate.get("deviation_parts") or {}).get(key)
    if estimate["status"] == Verdict.FAILED or estimate.get(key) is None or parts is None:
        return None
    value = np.array(estimate[key], dtype=float)
    length = float(np.linalg.norm(value))
    along = value / max(length, np.finfo(float).tiny)
    found = Strength(length, _along(along, parts["random"]), _along(along, parts["calibration"]))
    return found if np.isfinite([found.value, found.std]).all() and found.random > 0 else None


def pooled_acceleration(estimates: Sequence[Mapping[str, Any]]) -> PooledAcceleration | None:
    """Pooled acceleration of an estimator's summaries; None without any."""
    found = [each for each in map(strength_of, estimates) if each is not None]
    if not found:
        return None
    median = float(np.median([each.value for each in found]))
    near = [each for each in found if abs(each.value - median) <= FARTHEST * each.random]
    kept = near if 2 * len(near) > len(found) else found
    values, random = np.array([each.value for each in kept]), np.array([each.random for each in kept])
    weights = random**-2 / np.sum(random**-2)
    mean, degrees = float(weights @ values), len(kept) - 1
    distance = float(np.sum(((values - mean) / random) ** 2))
    common = float(weights @ [each.calibration for each in kept])
    std = _widening(distance, degrees) * float(np.sum(random**-2)) ** -0.5
    return PooledAcceleration(Strength(mean, std, common), distance, degrees, len(found) - len(kept))


def _agreement(chi_square: float, degrees: int) -> float:
    """Probability of a chi-square as large of segments about their mean, 1 for a single segment."""
    return float(chi_square_tail(chi_square, degrees)) if degrees else 1.0


def _widening(chi_square: float, degrees: int) -> float:
    """Factor on the standard deviations of a mean of segments: 1 where they agree."""
    agree = _agreement(chi_square, degrees) >= DISAGREEMENT
    return 1.0 if agree else float(np.sqrt(chi_square / degrees))


def _along(direction: Float[np.ndarray, " 3"], std: list[float | None]) -> float:
    return float(np.linalg.norm(direction * np.array(std, dtype=float)))


@dataclass(frozen=True)
class SegmentResult:
    """One segment: its number, its summary.json, or why there is none."""

    number: int
    summary: dict[str, Any] | None
    failure: str | None = None


def run_segments(
    datasets: Sequence[Dataset],
    folder: Path,
    settings: Settings,
    on_segment: Callable[[int, int], None],
) -> list[SegmentResult]:
    """A run folder per segment.

    One that was already made with the same settings is not made again.
    Ctrl-C ends the loop; what is done is returned.
    """
    write_configuration(folder, settings)
    results: list[SegmentResult] = []
    try:
        for index, dataset in enumerate(datasets):
            on_segment(index, len(datasets))
            results.append(_run_segment(dataset, folder, settings))
        on_segment(len(datasets), len(datasets))
    except KeyboardInterrupt:
        pass
    return results


def _run_segment(dataset: Dataset, folder: Path, settings: Settings) -> SegmentResult:
    number = 0 if dataset.segment is None else dataset.segment.number or 0
    place = folder / SEGMENTS_FOLDER / f"{number:03d}"
    if (done := finished_run(place, dataset, settings)) is not None:
        return SegmentResult(number, done)
    try:
        refuse_foreign_run(place)
        comparison = compare_estimators(prepare(dataset, settings), settings, lambda *_: None)
    except InputError as error:
        return SegmentResult(number, None, str(error))
    if comparison.interrupted:
        raise KeyboardInterrupt
    write_run(place, comparison, settings)
    return SegmentResult(number, read_summary(place))


def write_segments(
    folder: Path, results: Sequence[SegmentResult], settings: Settings, figures: bool = True
) -> dict[str, Any]:
    """segments.json, which is returned, and with ``figures`` throws-<estimator>.png of every estimator that has a result."""
    document = {
        str(r.number): {"failure": r.failure} if r.summary is None else r.summary["estimators"]
        for r in results
    }
    pooled = {
        name: None if found is None else found.document for name, found in pool(results, settings).items()
    }
    accelerations = {
        name: None if found is None else found.document
        for name, found in pool_accelerations(results, settings).items()
    }
    written = {
        "schema": 1,
        "segments": document,
        "pooled": pooled,
        "pooled_acceleration": accelerations,
    }
    write_json(folder / "segments.json", written)
    for name in settings.estimators if figures else ():
        throws: list[Throw] = []
        for result in results:
            if result.summary is not None:
                estimate = result.summary["estimators"][name]
                ratios = _numbers(estimate["principal_moments"])[:2]
                covariance = _numbers(estimate["principal_moments_cov"])[:2, :2]
                if np.isfinite(ratios).all() and np.isfinite(covariance).all():
                    throws.append(Throw(result.number, ratios, covariance, estimate["status"] != "ok"))
        if throws:
            draw_figure(partial(throws_figure, throws), folder / throws_picture(name))
    return written


def throws_picture(estimator: str) -> str:
    """File of the picture of all segments; there is none where no segment has finite moments."""
    return f"throws-{estimator}.png"


def _numbers(listed: list[Any]) -> Float[np.ndarray, "..."]:
    """Numbers of a summary, where `null` is not a number."""
    return np.array(listed, dtype=float)


def segment_table(results: Sequence[SegmentResult], settings: Settings) -> Table:
    """A row per segment and estimator: moments and acceleration, their deviations, drag, status and why."""
    table = Table(title="Fitted inertia of every segment", title_justify="left")
    for heading in ("segment", "estimator", "J1/J3", "J2/J3", "drag 1/rad", "m/s^2", "status", "reason"):
        table.add_column(heading)
    for result in results:
        if result.summary is None:
            table.add_row(str(result.number), *5 * ("-",), "failed", result.failure or "")
            continue
        for name in settings.estimators:
            table.add_row(str(result.number), name, *_cells(result.summary["estimators"][name]))
    return table


def _cells(estimate: dict[str, Any]) -> tuple[str, ...]:
    moments, std = _numbers(estimate["principal_moments"]), _numbers(estimate["principal_moments_std"])
    drag, linear, strength = (
        estimate["drag_per_rad"],
        estimate.get("linear_drag_per_s"),
        strength_of(estimate),
    )
    first, second = (
        f"{value:.4f} ± {spread:.4f}" if np.isfinite(value) else "-"
        for value, spread in zip(moments[:2], std[:2], strict=True)
    )
    return (
        first,
        second,
        (f"{drag:.4f}" if linear is None else f"{linear:.4f} 1/s")
        if drag is not None or linear is not None
        else "-",
        "-" if strength is None else f"{strength.value:.2f} ± {strength.std:.2f}",
        estimate["status"],
        "; ".join(estimate["reasons"]),
    )


def pool(results: Sequence[SegmentResult], settings: Settings) -> dict[str, PooledMoments | None]:
    """Pooled ratios per estimator over its ``ok`` segments, None without any."""
    summaries = [result.summary for result in results if result.summary is not None]
    return {
        name: pooled_moments([summary["estimators"][name] for summary in summaries], len(results))
        for name in settings.estimators
    }


def pool_accelerations(
    results: Sequence[SegmentResult], settings: Settings
) -> dict[str, PooledAcceleration | None]:
    """Pooled acceleration per estimator over all segments, None without any."""
    summaries = [result.summary for result in results if result.summary is not None]
    return {
        name: pooled_acceleration([summary["estimators"][name] for summary in summaries])
        for name in settings.estimators
    }


class SegmentMedians(NamedTuple):
    """Medians of J1/J3 and J2/J3 over the ``ok`` segments.

    How many those are, and of how many; NaN where none is.
    """

    smallest_ratio: float
    middle_ratio: float
    good: int
    total: int


def segment_medians(results: Sequence[SegmentResult], settings: Settings) -> dict[str, SegmentMedians]:
    """Median inertia ratios of the segments that are ``ok``, per estimator."""
    medians = {}
    for name in settings.estimators:
        estimates = [r.summary["estimators"][name] for r in results if r.summary is not None]
        good = np.array([e["principal_moments"][:2] for e in estimates if e["status"] == "ok"]).reshape(-1, 2)
        middle = np.median(good, axis=0) if len(good) else np.full(2, np.nan)
        medians[name] = SegmentMedians(float(middle[0]), float(middle[1]), len(good), len(results))
    return medians


SCHEMA: Final = 1
FUSED_FILE, INERTIA_FILE = "fused.json", "inertia.toml"
UNDETERMINED: Final = "moments-undetermined"
"""The check of an estimate whose motion leaves moments open."""


@dataclass(frozen=True, eq=False)
class RunInertia:
    """Inertia that one run found.

    Attributes
    ----------
    name : str
        Folder and estimator.
    run : Path
        The run's folder.
    entry : dict
        Of the estimator in summary.json.
    belief : Gaussian
        About the mass distribution after the last epoch.
    """

    name: str
    run: Path
    entry: dict[str, Any]
    belief: Gaussian

    @property
    def body(self) -> BodyEstimate:
        """Moments and axes."""
        return body_estimate(self.belief)


def fuse_runs(folders: Sequence[Path], same_axes: bool) -> dict[str, Any]:
    """Content of `FUSED_FILE`.

    Parameters
    ----------
    folders : sequence of Path
        Runs, whose first estimator counts, or folders of estimators in runs; at least two.
    same_axes : bool
        Whether axes g are fixed to the body alike in all recordings.

    Raises
    ------
    InputError
        Fewer than two runs, the same twice, one that is damaged; none whose estimate is ``ok``; with common axes, a run whose g is
        defined by its first frame, or that began from a stated belief.
    """
    if len(folders) < 2:
        raise InputError("one run is nothing to fuse; give two or more runs of one body")
    runs = [_read_run(folder) for folder in folders]
    repeated = [each for k, each in enumerate(runs) if each.run in [other.run for other in runs[:k]]]
    if repeated:
        raise InputError(f"{path_text(repeated[0].run)}: stands twice; its measurements would count twice")
    prior_std = _common_prior(runs) if same_axes else None
    good = [each for each in runs if _is_usable(each.entry, same_axes)]
    left_out = {each.name: str(each.entry["status"]) for each in runs if each not in good}
    if not good:
        raise InputError("the moments of none of the runs are ok; look at their verdicts")
    found = _fuse_moments(good, len(runs)) if prior_std is None else _fuse_in_common_axes(good, prior_std)
    return {
        "schema": SCHEMA,
        "same_axes": same_axes,
        "runs": {each.name: _describe_body(each.body) for each in good},
        "left_out": left_out,
        **found,
    }


def write_fused(folder: Path, document: dict[str, Any]) -> None:
    """`FUSED_FILE`, and the inertia as ``compare --race`` takes it."""
    write_json(folder / FUSED_FILE, finite_document(document))
    keys = ("principal_moments", "principal_axes_g")
    write_toml(folder / INERTIA_FILE, {key: document[key] for key in keys if key in document})


def _is_usable(entry: dict[str, Any], same_axes: bool) -> bool:
    """Whether an estimate is ok; in common axes also one of which nothing is wrong but that its motion shows a part only."""
    failed = {each["name"] for each in entry["checks"]}
    return entry["status"] == "ok" or (same_axes and failed == {UNDETERMINED})


def _read_run(folder: Path) -> RunInertia:
    last = last_belief(folder)
    entry = read_summary(last.run)["estimators"][last.estimator]
    try:
        belief = mass_belief(last.belief)
    except InputError as error:
        raise InputError(f"{path_text(folder)}: {error}") from None
    return RunInertia(f"{last.run.name}/{last.estimator}", last.run, entry, belief)


def _describe_body(body: BodyEstimate) -> dict[str, Any]:
    return {
        "principal_moments": body.principal_moments.tolist(),
        "principal_moments_std": body.principal_moments_std.tolist(),
    }


def _fuse_moments(runs: Sequence[RunInertia], total: int) -> dict[str, Any]:
    pooled = pooled_moments([each.entry for each in runs], total)
    if pooled is None:
        raise InputError("none of the runs has moments with a finite covariance; look at their verdicts")
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = pooled.widening**2 * pooled.covariance
    return {
        "principal_moments": [*pooled.ratios.tolist(), 1.0],
        "principal_moments_std": [*pooled.std.tolist(), 0.0],
        "principal_moments_cov": covariance.tolist(),
        "chi_square": pooled.chi_square,
        "degrees_of_freedom": pooled.degrees,
        "probability": pooled.probability,
        "widening": pooled.widening,
    }


def _fuse_in_common_axes(runs: Sequence[RunInertia], prior_std: float) -> dict[str, Any]:
    fused = fuse_inertias([each.belief for each in runs], prior_std)
    body = fused.body
    return {
        "principal_moments": body.principal_moments.tolist(),
        "principal_moments_std": body.principal_moments_std.tolist(),
        "principal_moments_cov": body.principal_moments_cov.tolist(),
        "principal_axes_g": body.principal_axes_g.tolist(),
        "principal_axes_std_rad": body.principal_axes_std.tolist(),
        "chi_square": fused.chi_square,
        "degrees_of_freedom": fused.degrees,
        "probability": fused.probability,
        "widening": fused.widening,
    }


def _common_prior(runs: Sequence[RunInertia]) -> float:
    """Deviation of the prior of all runs. InputError: as `_prior_std`, or different ones."""
    priors = {_prior_std(each) for each in runs}
    if len(priors) > 1:
        raise InputError("the runs have different initialisation.mass_std; run them with one prior")
    return priors.pop()


def _prior_std(run: RunInertia) -> float:
    """Deviation of the mass distribution's prior. InputError: frame g is not the body's, or the run began from a belief."""
    if not knows_frames(read_dataset(run.run / DATASET_FOLDER)):
        raise InputError(
            f"{path_text(run.run)}: its frame g is that of its first epoch, not the body's own; fuse without --same-axes"
        )
    told = read_toml(run.run / CONFIG_FILE).get("initialisation", {})
    if told.get("mean") or told.get("from_truth"):
        raise InputError(
            f"{path_text(run.run)}: began from a stated belief, which would count once a run; fuse without --same-axes"
        )
    return float(told.get(MASS_DISTRIBUTION.prior_option, MASS_DISTRIBUTION.prior_std))
