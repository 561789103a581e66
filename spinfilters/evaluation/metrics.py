"""The one table of metrics: what `summary.json`, tables, pages, rows of a campaign and its report show of an estimator.

A metric is one line in `_METRICS`, or of another distribution an entry point of the group ``spinfilters.metrics``. From its line
follow its place in `summary.json`, its row in the terminal, in ``report.html`` and in a notebook, its column in the rows of a
campaign, and its mean over runs in the campaign's report. The metrics of this package are computed of one run or of many at once,
whose arrays have an axis of runs in front: their formulas count axes from the last.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from functools import cached_property
from operator import attrgetter
from typing import Any, Final

import numpy as np

from spinfilters.core.conventions import PerRun
from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.core.plugins import installed_plugins, require_made
from spinfilters.evaluation.consistency import NormalisedErrors
from spinfilters.evaluation.epoch_spans import EpochSpan, ObservationUse
from spinfilters.evaluation.estimator_evaluation import (
    ConstantEstimate,
    Evaluation,
    PosteriorDistance,
    numbers_text,
)
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR
from spinfilters.evaluation.trajectory_errors import BodyErrors
from spinfilters.filters.history import EstimateHistory
from spinfilters.models.body import BodyEstimate
from spinfilters.models.state_blocks import BLOCKS, ReportedConstant, StateBlock
from spinfilters.models.status import LABELS, QUANTITIES, TRANSLATION, Holds, Verdict

ValueOf = Callable[[EpochSpan], Any]
"""A metric's value within a span of epochs, in SI: a number, a text, an array; None where there is none."""
Form = Callable[[Any, float], str]
"""Text of a value, and of what it is multiplied by for its unit."""
DEGREES: Final = 180 / math.pi
"""Degrees per radian."""
ERRORS: Final = "errors"
"""Table of `summary.json` with what needs a truth."""


class Section(Enum):
    """Sections of tables, in their order."""

    USE = auto()
    BODY = auto()
    MOTION = auto()
    LATEST = auto()
    CONSISTENCY = auto()
    FURTHER = auto()
    COST = auto()


USE, BODY, MOTION, LATEST, CONSISTENCY, FURTHER, COST = Section


def number(form: str, between: str = " ") -> Form:
    """Text of a number, or of several with something between them, in a format such as ".3g"."""
    return lambda value, scale: between.join(
        format(scale * each, form) for each in np.atleast_1d(value).tolist()
    )


THREE_DIGITS: Final = number(".3g")


def words(value: str, _scale: float) -> str:
    """Text of a value that is one."""
    return value


@dataclass(frozen=True)
class Metric:
    """A number that describes an estimate.

    Attributes
    ----------
    key : str
        Its place among the estimator's numbers in `summary.json`, as "runtime_s.total"; what needs a truth begins with
        "errors.". "" where a list there holds it already.
    label : str
        Name of its row in tables; two spaces in front set it below the row above. "" for no row.
    unit : str
        As tables show it; "" for none.
    value : ValueOf
        Its value within a span of epochs, in SI; None where there is none.
    scale : float
        Shown units per SI unit.
    form : Form
        Text of a value at a scale, such as ``number(".2f")``.
    bound : ValueOf or None
        The Cramer-Rao bound of an error, asked for only where there is one.
    expected : float or None
        Value of a consistent estimator.
    section : Section
        Its section of tables.
    column : str or None
        Its column in a campaign's rows; None for the last part of its key, "" for no column.
    kind : type
        Of its values in a campaign's rows: float, int, str, bool, or list of numbers.
    of_epochs : bool
        Whether it is taken over epochs: `summary.json` then has it over those that all estimators share as well, and tables
        compare it over these.
    null : bool
        Whether `summary.json` says null where there is none; if not, the key is left out.
    of_many : bool
        Whether its value may be asked of an evaluation of many runs: one number for each, or one that all have.
    """

    key: str
    label: str
    unit: str
    value: ValueOf
    scale: float = 1.0
    form: Form = THREE_DIGITS
    bound: ValueOf | None = None
    expected: float | None = None
    section: Section = FURTHER
    column: str | None = None
    kind: type = float
    of_epochs: bool = False
    null: bool = True
    of_many: bool = False

    @cached_property
    def leaf(self) -> str:
        """The last part of its key."""
        return self.key.rpartition(".")[2]

    @cached_property
    def column_name(self) -> str:
        """Its column in a campaign's rows, "" for none."""
        return self.leaf if self.column is None else self.column

    @cached_property
    def bound_column(self) -> str:
        """Column of its bound, "" for none."""
        own = self.column_name
        return "" if self.bound is None or not own else f"bound_{own.removeprefix('error_')}"

    @property
    def needs_truth(self) -> bool:
        """Whether it is an error."""
        return self.key.startswith(f"{ERRORS}.")

    @property
    def heading(self) -> str:
        """Label with its unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    @property
    def title(self) -> str:
        """Heading where it does not stand below another row, with its unit."""
        under = not self.label or self.label.startswith(" ")
        name = self.column_name.removeprefix("error_").replace("_", " ") if under else self.label
        return f"{name} [{self.unit}]" if self.unit else name

    def of(self, span: EpochSpan) -> Any:
        """Its value, as plain numbers and texts; None also where it cannot be computed."""
        return _computed(self.value, span)

    def bound_of(self, span: EpochSpan) -> Any:
        """Its bound, as `of`; None without one."""
        has_bound = self.bound is not None and span.evaluation.bound is not None
        return _computed(self.bound, span) if self.bound is not None and has_bound else None

    def text(self, value: Any) -> str | None:
        """A value as tables show it; None of None."""
        if value is None:
            return None
        try:
            return require_made(self.form(value, self.scale), str, f"form of the metric {self.key!r}")
        except (*NUMERICAL_ERRORS, TypeError):
            shown = f"{value!r:.40}"
            raise InputError(
                f"the metric {self.key!r} has the value {shown}, which its form cannot show; mend or uninstall its plug-in"
            ) from None


def values_by_column(chosen: Sequence[Metric], span: EpochSpan) -> dict[str, Any]:
    """Values of those metrics that have a column of rows, as `Metric.of`, by that column."""
    with np.errstate(all="ignore"):
        return {each.column_name: _plain(each.value, span) for each in chosen if each.column_name}


def values_of_runs(chosen: Sequence[Metric], span: EpochSpan, runs: int) -> dict[str, list[Any]]:
    """`values_by_column` of each of many runs that were evaluated together, a list by column."""
    named = [each for each in chosen if each.column_name]
    with np.errstate(all="ignore"):
        return {each.column_name: _of_each(each, span, runs) for each in named}


def _of_each(metric: Metric, span: EpochSpan, runs: int) -> list[Any]:
    """Values of a metric for each run, at once where it can."""
    if metric.of_many:
        try:
            found = metric.value(span)
            values = None if found is None else np.asarray(found)
            return [found] * runs if values is None else _spread(values, runs)
        except (*NUMERICAL_ERRORS, InputError):  # of some run
            pass
    spans = (replace(span, evaluation=span.evaluation.of_run(run)) for run in range(runs))
    return [_plain(metric.value, each) for each in spans]


def _spread(values: np.ndarray, runs: int) -> list[Any]:
    """Plain values of each run; one number is that of all."""
    return values.tolist() if values.ndim else [values.tolist()] * runs


def _computed(value: ValueOf, span: EpochSpan) -> Any:
    with np.errstate(all="ignore"):
        return _plain(value, span)


def _plain(value: ValueOf, span: EpochSpan) -> Any:
    """A value with arrays and numbers of NumPy as plain ones."""
    try:
        found = value(span)
        return found if found is None else np.asarray(found).tolist()
    except (
        *NUMERICAL_ERRORS,
        InputError,
    ):  # one metric that a strange estimate does not have costs no result
        return None


def metrics() -> tuple[Metric, ...]:
    """Every metric: those of this package, then those of installed distributions.

    Raises
    ------
    InputError
        A plug-in that cannot be loaded; a key or a column that two metrics have, a key below that of another.
    """
    every = (*METRICS, *installed_plugins("spinfilters.metrics", Metric))
    keys = {each.key for each in every}
    for key in keys:
        if above := keys & {table for table in _tables_above(key) if table}:
            raise InputError(
                f"the metric {key!r} lies below the metric {above.pop()!r}, which is a value; uninstall one of the plug-ins"
            )
    columns = [name for each in every for name in (each.column_name, each.bound_column)]
    for what, names in (("key", [each.key for each in every]), ("column", columns)):
        held = [name for name in names if name]
        twice = sorted({name for name in held if held.count(name) > 1})
        if twice:
            raise InputError(f"two metrics have the {what} {twice[0]!r}; uninstall one of the plug-ins")
    return every


def _tables_above(key: str) -> list[str]:
    """Keys of the tables that a key with dots lies in."""
    parts = key.split(".")
    return [".".join(parts[:count]) for count in range(1, len(parts))]


def held_text(evaluation: Evaluation) -> str:
    """Name the quantities that hold, as "all but moments, axes" or "only position, rate", whichever is shorter.

    Quantities that its sensors cannot see are left out; empty of an estimate that has not been judged.
    """
    status, layout = evaluation.history.status, evaluation.history.layout
    names = [name for name in status.holds if layout.translates or name not in TRANSLATION]
    good = [LABELS[name] for name in names if status.holds[name] is Holds.OK]
    other = [LABELS[name] for name in names if status.holds[name] is not Holds.OK]
    if not names:
        return ""
    if not good or status.verdict is Verdict.FAILED:
        return "nothing"
    if not other:
        return "all"
    return f"all but {', '.join(other)}" if len(other) <= len(good) else f"only {', '.join(good)}"


def _own_epochs_text(span: EpochSpan) -> str:
    """Number of own epochs, and over how many of them errors and counts are where these are fewer."""
    own = len(span.evaluation.history.time[span.evaluation.history.own])
    compared = own if span.use is None else len(span.use.accepted)
    return str(own) if compared == own else f"{own}, {compared} compared"


def _history(read: Callable[[EstimateHistory], Any]) -> ValueOf:
    return lambda span: read(span.evaluation.history)


def _runtime(read: Callable[[np.ndarray], Any]) -> ValueOf:
    """Of the seconds of the estimator's own epochs that took any time."""

    def value(span: EpochSpan) -> Any:
        """None where no epoch took any."""
        own = span.evaluation.history.runtime[span.evaluation.history.own]
        return read(own[own > 0]) if (own > 0).any() else None

    return value


def _use(read: Callable[[ObservationUse], Any]) -> ValueOf:
    return lambda span: None if span.use is None else read(span.use)


def _body(read: Callable[[BodyEstimate], Any]) -> ValueOf:
    return lambda span: read(span.evaluation.body)


def _body_error(read: Callable[[BodyErrors], Any]) -> tuple[ValueOf, ValueOf]:
    """An error of the body, and its bound."""

    def error(span: EpochSpan) -> Any:
        """None without a truth."""
        errors = span.evaluation.body_errors
        return None if errors is None else read(errors)

    def bound(span: EpochSpan) -> Any:
        """None without a bound."""
        limits = span.evaluation.bound
        return None if limits is None else read(limits.body)

    return error, bound


def _moment_metrics(index: int, name: str) -> tuple[Metric, ...]:
    """Rows and columns of one principal moment over the largest, J of `index` among the ascending."""
    error, bound = _body_error(
        lambda e: None if e.principal_moments is None else e.principal_moments[..., index]
    )
    pair = lambda span: span.evaluation.moment_texts[index].split(" ± ")  # noqa: E731
    parts = _parts("principal_moments", lambda std: std[index])
    std, place = _body(lambda body: body.principal_moments_std[..., index]), index + 1
    within = _within("principal_moments", lambda half_widths: half_widths[:, index])
    # fmt: off
    return (
        Metric("", name, "", lambda s: pair(s)[0], form=words, section=BODY),
        Metric("", "  standard deviation", "", lambda s: pair(s)[-1], form=words, section=BODY),
        Metric("", "    random / calibration", "", parts, form=number(".2g", " / "), section=BODY),
        Metric("", "  50 / 80 / 95 % within ±", "", within, form=number(".2g", " / "), section=BODY),
        Metric("", "", "", std, section=BODY, column=f"std_moment_{place}"),
        Metric("", "  error", "", error, form=number("+#.2g"), bound=bound, section=BODY, column=f"error_moment_{place}"),
    )
    # fmt: on


def _constant_metrics(block: StateBlock, reported: ReportedConstant) -> tuple[Metric, ...]:
    """Value and standard deviation of a constant that is a result of its own."""
    kind = float if block.dimension == 1 else list

    def estimate(read: Callable[[ConstantEstimate], np.ndarray]) -> ValueOf:
        """A number, or several; None of what is not estimated."""

        def value(span: EpochSpan) -> Any:
            """Of the last epoch."""
            found = span.evaluation.constants.get(block.name)
            return None if found is None else read(found)[..., 0] if block.dimension == 1 else read(found)

        return value

    def text(form: str) -> Form:
        """Numbers side by side."""
        return lambda value, _: numbers_text(np.atleast_1d(value).tolist(), form)

    # fmt: off
    return (
        Metric(reported.value_key, block.label, block.unit, estimate(lambda e: e.value), form=text(reported.value_format),
               section=BODY, kind=kind),
        Metric(reported.std_key, "  standard deviation", "", estimate(lambda e: e.std), form=text(reported.std_format),
               section=BODY, kind=kind),
    )
    # fmt: on


def _motion_metrics(name: str, field: str, unit: str, scale: float) -> tuple[Metric, ...]:
    """Error of something that moves: root mean square over epochs with its bound, and length at the last one.

    The length of a rate's error depends on the axes: those of i, as in `truth.csv`, hold the attitude's error too.
    """

    def last(span: EpochSpan) -> Any:
        """Length of the last error."""
        error = None if span.errors is None else getattr(span.errors, name)
        return None if error is None else np.linalg.norm(error[..., -1, :], axis=-1)

    label = f"{name} error in i" if name == "rate" else f"{name} error"
    # fmt: off
    return (
        Metric(f"errors.rms_{field}", label, unit, lambda s: getattr(s.rms, name, None), scale,
               bound=lambda s: getattr(s.bound, name, None), section=MOTION, column=f"error_{field}", of_epochs=True),
        Metric(f"errors.last_{field}", "", unit, last, scale, section=MOTION),
    )
    # fmt: on


def _parts(quantity: str, read: Callable[[np.ndarray], float]) -> ValueOf:
    """Random and calibration part of a standard deviation after the last epoch; None where the calibration is exact."""

    def value(span: EpochSpan) -> Any:
        """Both parts."""
        evaluation = span.evaluation
        part = None if evaluation.history.calibration is None else evaluation.deviation_parts.get(quantity)
        return None if part is None else [read(part.random), read(part.calibration)]

    return value


def _of_quantity(
    mapping: Callable[[Evaluation], Mapping[str, Any] | None], quantity: str, read: Callable[[Any], Any]
) -> ValueOf:
    """What is read of one quantity after the last epoch, of a mapping by quantity; None where that does not hold it."""

    def value(span: EpochSpan) -> Any:
        """None without the mapping, too."""
        found = (mapping(span.evaluation) or {}).get(quantity)
        return None if found is None else read(found)

    return value


def _within(quantity: str, read: Callable[[np.ndarray], np.ndarray]) -> ValueOf:
    """Half widths of intervals, of a component at all levels or of all components at one; None where one Gaussian says it."""
    return _of_quantity(lambda evaluation: evaluation.intervals, quantity, read)


def _nees_metric(block: StateBlock) -> Metric:
    """NEES of one block."""

    def mean(span: EpochSpan) -> PerRun | None:
        """None where the state has no such block."""
        squares = None if span.nees is None else span.nees.blocks.get(block.name)
        return None if squares is None else np.mean(squares, axis=-1) / block.dimension

    # fmt: off
    return Metric(f"errors.nees_per_dof_{block.name}", f"  {block.label}", "", mean, form=number(".2f"), expected=1.0,
                  section=CONSISTENCY, column=f"nees_{block.name}", of_epochs=True, null=False)
    # fmt: on


def _nees(read: Callable[[NormalisedErrors], Any]) -> ValueOf:
    return lambda span: None if span.nees is None else read(span.nees)


def _distance_metrics(quantity: str) -> tuple[Metric, ...]:
    """Divergence and tail of a quantity from the posterior, where an estimator of the run has sampled it."""

    def distance(read: Callable[[PosteriorDistance], float]) -> ValueOf:
        """None without a posterior."""
        return _of_quantity(lambda evaluation: evaluation.distances, quantity, read)

    label = LABELS[quantity]
    # fmt: off
    return (
        Metric(f"posterior_divergence.{quantity}", f"divergence from the posterior, {label}", "nats",
               distance(lambda d: d.divergence), form=number(".2g"), section=CONSISTENCY,
               column="", null=False),
        Metric(f"posterior_tail.{quantity}", "  posterior outside stated 95 %", "%", distance(lambda d: d.tail), 100.0,
               form=number(".2g"), expected=0.05, section=CONSISTENCY, column="", null=False),
    )
    # fmt: on


def _worst(read: Callable[[str, float], Any]) -> ValueOf:
    """Of the quantity with the largest error in stated standard deviations, and that error."""
    return lambda span: None if span.worst_stated_error is None else read(*span.worst_stated_error)


_centre = _body_error(
    lambda e: None if e.center_of_mass_g is None else np.linalg.norm(e.center_of_mass_g, axis=-1)
)
_axis = _body_error(lambda e: None if e.axes_angle is None else e.axes_angle.max(axis=-1))
_moments_error, _k1_error, _k2_error, _axes_angle, _centre_error = (
    _body_error(attrgetter(name))
    for name in ("principal_moments", "k1", "k2", "axes_angle", "center_of_mass_g")
)

MOTIONS: Final = (
    ("position", "position_m", "mm", 1e3),
    ("attitude", "attitude_rad", "deg", DEGREES),
    ("velocity", "velocity_m_s", "mm/s", 1e3),
    ("rate", "rate_rad_s", "deg/s", DEGREES),
)
"""What moves: name, field of keys, unit, and that per SI unit."""


def _in_axes(name: str) -> str:
    """Name of what moves with its axes, where its deviation depends on them: that of a rate in i has the attitude's in it."""
    return f"{name} in i" if name == "rate" else name


# fmt: off
_METRICS: Final[tuple[Metric, ...]] = (
    # the estimator, its epochs and its observations
    Metric("status", "status", "", _history(lambda h: str(h.status.verdict)), form=words, section=USE, column="verdict",
           kind=str),
    Metric("", "what holds", "", lambda s: held_text(s.evaluation) or None, form=words, section=USE),
    Metric("frames", "", "", _history(lambda h: len(h.time)), section=USE, column="epochs", kind=int),
    Metric("initialisation_epochs", "", "", _history(lambda h: h.initialisation), section=USE, kind=int),
    Metric("", "own epochs", "", _own_epochs_text, form=words, section=USE),
    Metric("observations.epochs", "", "", lambda s: 0 if s.use is None else len(s.use.accepted), section=USE, column="",
           of_epochs=True),
    Metric("observations.available_per_epoch", "observations per epoch", "", _use(lambda u: u.available_per_epoch),
           form=number(".1f"), section=USE, of_epochs=True),
    Metric("observations.used_per_epoch", "  of these used", "", _use(lambda u: u.used_per_epoch), form=number(".1f"),
           section=USE, of_epochs=True),
    Metric("observations.share_used", "  share used", "", _use(lambda u: u.share), form=lambda share, _: f"{100 * share:.1f} %",
           section=USE, of_epochs=True),
    Metric("measurements.accepted", "", "", _history(lambda h: h.accepted[..., h.own].sum(axis=-1)), section=USE, kind=int),
    Metric("measurements.rejected", "", "", _history(lambda h: h.rejected[..., h.own].sum(axis=-1)), section=USE, kind=int),
    Metric("", "accepted / rejected", "", _use(lambda u: f"{u.accepted.sum()} / {u.rejected.sum()}"), form=words, section=USE),

    # the body after the last epoch, and its errors
    Metric("principal_moments", "", "", _body(lambda b: b.principal_moments), section=BODY, kind=list),
    Metric("principal_moments_std", "", "", _body(lambda b: b.principal_moments_std), section=BODY, kind=list),
    Metric("principal_moments_cov", "", "", _body(lambda b: b.principal_moments_cov), section=BODY, column=""),
    Metric("principal_moments_interval", "", "", _body(lambda b: b.principal_moments_interval), section=BODY, column=""),
    Metric("principal_axes_g", "", "", _body(lambda b: b.principal_axes_g), section=BODY, column=""),
    Metric("principal_axes_std_rad", "", "", _body(lambda b: b.principal_axes_std), section=BODY, kind=list),
    Metric("center_of_mass_g", "", "", _body(lambda b: b.center_of_mass_g), section=BODY, kind=list),
    Metric("center_of_mass_std_m", "", "", _body(lambda b: b.center_of_mass_std), section=BODY, kind=list),
    Metric("k1", "", "", _body(lambda b: b.k1), section=BODY),
    Metric("k1_std", "", "", _body(lambda b: b.k1_std), section=BODY, column="std_k1"),
    Metric("k2", "", "", _body(lambda b: b.k2), section=BODY),
    Metric("k2_std", "", "", _body(lambda b: b.k2_std), section=BODY, column="std_k2"),
    *_moment_metrics(0, "J smallest / largest"),
    *_moment_metrics(1, "J middle / largest"),
    Metric("errors.principal_moments_error", "", "", _moments_error[0], bound=_moments_error[1], section=BODY, column=""),
    Metric("errors.k1_error", "", "", _k1_error[0], bound=_k1_error[1], section=BODY, column="error_k1"),
    Metric("errors.k2_error", "", "", _k2_error[0], bound=_k2_error[1], section=BODY, column="error_k2"),
    Metric("errors.axes_angle_rad", "", "", _axes_angle[0], bound=_axes_angle[1], section=BODY, column=""),
    Metric("errors.center_of_mass_error_m", "", "", _centre_error[0], bound=_centre_error[1], section=BODY, column=""),
    Metric("", "worst principal axis", "deg", _axis[0], DEGREES, bound=_axis[1], section=BODY, column="error_axis_rad"),
    Metric("", "centre of mass, error", "mm", _centre[0], 1e3, bound=_centre[1], section=BODY, column="error_center_of_mass_m"),
    *(metric for block in BLOCKS.values() if block.reported for metric in _constant_metrics(block, block.reported)),

    Metric("errors.alignment", "", "", lambda s: str(s.evaluation.alignment), form=words, section=BODY, column="", kind=str),

    # the motion, compared with the truth
    *(metric for motion in MOTIONS for metric in _motion_metrics(*motion)),
    Metric("errors.ape_rmse_m", "", "m", lambda s: getattr(s.evaluation.errors, "ape_rmse", None), column=""),
    Metric("errors.ape_angle_rmse_deg", "", "deg", lambda s: getattr(s.evaluation.errors, "ape_angle_rmse_deg", None), column=""),
    *(Metric("", f"{_in_axes(name)}: random / calibration", unit, _parts(field, lambda std: math.hypot(*std)), scale,
             form=number(".2g", " / "), section=LATEST)
      for name, field, unit, scale in (*MOTIONS, ("centre of mass", "center_of_mass_m", "mm", 1e3))),

    *(Metric("", f"{_in_axes(name)}: 95 % within ±", unit, _within(field, lambda half_widths: half_widths[-1]), scale,
             form=number(".2g"), section=LATEST)
      for name, field, unit, scale in MOTIONS),

    # consistency of the covariance
    Metric("errors.nees_per_dof", "NEES per dof", "", _nees(lambda n: n.mean), form=number(".2f"), expected=1.0,
           section=CONSISTENCY, column="nees", of_epochs=True),
    *map(_nees_metric, BLOCKS.values()),
    Metric("errors.last_nees_per_dof", "", "", _nees(lambda n: n.total[..., -1] / n.dof), expected=1.0, section=CONSISTENCY,
           column="nees_last"),
    Metric("errors.nees_dof", "", "", _nees(lambda n: n.dof), section=CONSISTENCY, column="dof", kind=int),
    Metric("nis_per_dof", "NIS per dof", "", lambda s: s.evaluation.nis_ratio, form=number(".3f"), expected=1.0,
           section=CONSISTENCY, column="nis"),
    *(metric for quantity in QUANTITIES for metric in _distance_metrics(quantity)),
    Metric("errors.worst_error", "largest error at the end", "std", _worst(lambda _, error: error), form=number(".2g"),
           section=CONSISTENCY),
    Metric("errors.worst_quantity", "", "", _worst(lambda quantity, _: quantity), form=words, section=CONSISTENCY, kind=str),
    Metric("errors.right", "", "", _worst(lambda _, error: error <= LARGEST_STATED_ERROR), section=CONSISTENCY, kind=bool),

    # what it took
    Metric("runtime_s.total", "", "s", _history(lambda h: h.runtime.sum()), section=COST, column=""),
    Metric("runtime_s.per_frame_median", "processor ms per epoch", "", _runtime(np.median), 1e3, section=COST,
           column="time_per_epoch_s"),
    Metric("runtime_s.per_frame_max", "", "s", _runtime(np.max), section=COST, column=""),
)
# fmt: on
METRICS: Final = tuple(replace(each, of_many=True) for each in _METRICS)
"""Every metric of this package, in the order of rows within their groups."""
