"""Evaluation of one estimator's history: body, errors, consistency, bound, and the parts of its deviations."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.conventions import PerRun
from spinfilters.core.errors import NUMERICAL_ERRORS, InputError, numerical
from spinfilters.evaluation.consistency import (
    NormalisedErrors,
    finite_epochs,
    knows_state,
    nis_ratio,
    normalised_errors,
    rotation_nees,
)
from spinfilters.evaluation.estimated_motion import Trajectory, body_history, trajectory_of
from spinfilters.evaluation.trajectory_errors import (
    Alignment,
    BodyErrors,
    RmsErrors,
    TruthErrors,
    body_errors,
    inertial_turn,
    root_mean_square,
    tells_first_frame,
    truth_errors,
    truth_in_estimate_frames,
)
from spinfilters.filters.history import EstimateHistory, history_at
from spinfilters.io.input_file import reason
from spinfilters.io.truth import Truth
from spinfilters.models.body import BodyEstimate, BodyHistory, body_estimate
from spinfilters.models.state_blocks import BLOCKS, ReportedConstant, StateBlock
from spinfilters.models.state_mixture import central_half_widths
from spinfilters.models.status import EstimatorStatus

REPORTED: Final[Mapping[str, ReportedConstant]] = {
    block.name: block.reported for block in BLOCKS.values() if block.reported is not None
}
"""How they are shown, by the name of their block."""


@dataclass(frozen=True)
class ConstantEstimate:
    """A constant block as one belief sees it, or those of many runs, in the unit of the block."""

    block: StateBlock
    value: Float[np.ndarray, "*r k"]
    std: Float[np.ndarray, "*r k"]


def constant_estimates(history: EstimateHistory) -> dict[str, ConstantEstimate]:
    """Estimates of the blocks in `REPORTED` after the last epoch, by name."""
    layout, mean, factor = history.layout, history.mean[..., -1, :], history.factor[..., -1, :, :]
    std = np.sqrt(np.einsum("...ij,...ij->...i", factor, factor))
    held = [block for block in layout.constant if block.name in REPORTED]
    return {
        block.name: ConstantEstimate(
            block,
            mean[..., layout.mean_slice(block.name)],
            std[..., layout.slice(block.name)],
        )
        for block in held
    }


def numbers_text(values: Iterable[float], form: str) -> str:
    """Numbers side by side in one format; "unknown" where one is none."""
    listed = list(values)
    return " ".join(format(value, form) for value in listed) if all(map(math.isfinite, listed)) else "unknown"


Deviations = dict[str, Float[np.ndarray, " q"]]


@dataclass(frozen=True)
class DeviationPart:
    """Parts of the standard deviations of one quantity, in its unit."""

    random: Float[np.ndarray, " q"]
    calibration: Float[np.ndarray, " q"]

    @property
    def document(self) -> dict[str, list[float | None]]:
        """As summary.json holds it; None for what is not finite."""
        parts = {"random": self.random, "calibration": self.calibration}
        return {
            name: [float(x) if np.isfinite(x) else None for x in values] for name, values in parts.items()
        }


def without_calibration(history: EstimateHistory) -> EstimateHistory:
    """The history with the random part of its covariance alone."""
    return replace(history, factor=history.random_factor(), calibration=None)


def deviation_parts(history: EstimateHistory) -> dict[str, DeviationPart]:
    """Parts of the deviations by quantity, after the last epoch.

    See `_deviations`. Of an exact calibration all of it is random.
    """
    calibration = None if history.calibration is None else history.calibration[-1:]
    last = replace(history_at(history, np.array([-1])), calibration=calibration)
    total = _deviations(last)
    if last.calibration is None:
        return {name: DeviationPart(std, np.zeros_like(std)) for name, std in total.items()}
    chance = _deviations(without_calibration(last))
    found = {}
    for name, std in total.items():
        random = np.minimum(chance[name], std)
        found[name] = DeviationPart(random, np.sqrt(std**2 - random**2))
    return found


INTERVAL_LEVELS: Final = (0.5, 0.8, 0.95)
"""Probabilities of stated intervals."""
OF_MASS: Final = ("principal_moments", "principal_axes_rad", "k1", "k2")
"""Quantities that samples of the mass distribution give, where there are any."""


def stated_intervals(history: EstimateHistory) -> dict[str, Float[np.ndarray, "p q"]] | None:
    """Half widths of central intervals about the estimate after the last epoch, by quantity as `deviation_parts`.

    Where errors of the measurements may be correlated, one deviation covers several explanations at four of it, and is too wide in
    the middle. These are quantiles of the mixture of them.

    Returns
    -------
    dict or None
        Rows at `INTERVAL_LEVELS`; None where one Gaussian says it. Moments and axes that were sampled are left
        out (`BodyEstimate.principal_moments_interval`).
    """
    mixture = history.mixture
    if mixture is None or history.has_failed:
        return None
    last, levels = history_at(history, np.array([-1])), np.array(INTERVAL_LEVELS)
    components = [_deviations(replace(last, factor=factor[np.newaxis])) for factor in mixture.factors]
    sampled = () if history.mass is None else OF_MASS
    return {
        name: central_half_widths(levels, np.array([each[name] for each in components]), mixture.weights)
        for name in components[0]
        if name not in sampled
    }


def _deviations(last: EstimateHistory) -> Deviations:
    """Standard deviations of body and motion of one epoch.

    Moments (largest = 1), axes rad, k1 and k2, places m, velocity m/s, rate rad/s, constants.
    """
    belief, motion = last.belief(0), trajectory_of(last)
    body = body_estimate(belief)
    found = {
        "principal_moments": body.principal_moments_std,
        "principal_axes_rad": body.principal_axes_std,
        "k1": np.array([body.k1_std]),
        "k2": np.array([body.k2_std]),
        "attitude_rad": motion.std_attitude[0],
        "rate_rad_s": motion.std_rate[0],
    }
    if body.center_of_mass_std is not None:
        found["center_of_mass_m"] = body.center_of_mass_std
    if motion.sees_position:
        found |= {"position_m": motion.std_position[0], "velocity_m_s": motion.std_velocity[0]}
    constants = constant_estimates(last)
    return found | {REPORTED[name].value_key: each.std for name, each in constants.items()}


@dataclass(frozen=True)
class ErrorBound:
    """Standard deviations of the bound per error; None where there is no such error.

    Attributes
    ----------
    trajectory : Trajectory
        Motion of the truth, with the bound's standard deviations.
    rows : (n,) int array
        Epochs of it that have errors.
    body : BodyErrors
        Bound of the body's constants.
    fitted : bool
        Whether the frame g was fitted to the truth, which hides a part of the errors of the attitude and of the axes.
    """

    trajectory: Trajectory
    rows: Int[np.ndarray, " n"]
    body: BodyErrors
    fitted: bool

    @property
    def rms(self) -> RmsErrors:
        """Root mean square of the bound over all epochs of the errors."""
        return self.over(self.rows)

    def over(self, rows: Int[np.ndarray, " n"]) -> RmsErrors:
        """Root mean square of the bound over some epochs."""
        bound, position, velocity = self.trajectory, None, None
        if bound.sees_position:
            position = root_mean_square(bound.std_position[rows])
            velocity = root_mean_square(bound.std_velocity[rows])
        attitude = None if self.fitted else root_mean_square(bound.std_attitude[rows])
        return RmsErrors(position, attitude, velocity, root_mean_square(bound.std_rate[rows]))


def error_bound(limits: EstimateHistory, errors: TruthErrors, fitted: bool) -> ErrorBound:
    """The bound of these errors.

    Parameters
    ----------
    limits : EstimateHistory
        The truth with the bound's covariance, at the epochs of the trajectory that has the errors.
    fitted : bool
        See `ErrorBound`.
    """
    body = _body(body_estimate(limits.belief(-1), intervals=False), fitted)
    return ErrorBound(trajectory_of(limits), errors.rows, body, fitted)


def _body(body: BodyEstimate, fitted: bool) -> BodyErrors:
    """An axis moves by the turns about the other two."""
    turns = np.diag(body.principal_axes_cov)
    return BodyErrors(
        body.principal_moments_std,
        body.k1_std,
        body.k2_std,
        None if fitted else np.sqrt(turns.sum() - turns),
        None if fitted else body.center_of_mass_std,
    )


@dataclass(frozen=True)
class PosteriorDistance:
    """Distance of an estimator's belief from the posterior in one quantity (`spinfilters.evaluation.stated_errors`).

    Attributes
    ----------
    divergence : float
        Kullback-Leibler divergence, nats.
    tail : float
        Posterior probability outside the stated central 95 %.
    """

    divergence: float
    tail: float


_MOST_DECIMALS: Final = 9


@dataclass(frozen=True)
class Evaluation:
    """Evaluation of one estimator's run, or of many of its runs: arrays of what differs then have an axis (r,) in front.

    Attributes
    ----------
    truth : Truth or None
        Truth that it was compared with, in the truth's own frames.
    alignment : Alignment
        Alignment that was applied before.
    errors, body_errors : TruthErrors or None, BodyErrors or None
        Against the truth, None without one.
    nees : NormalisedErrors or None
        None when the truth does not give the whole state in the estimate's frames.
    bound : ErrorBound or None
        Cramer-Rao bound of the errors, where it was asked for and exists.
    bound_missing : str or None
        Why there is none, in words.
    distances : Mapping[str, PosteriorDistance] or None
        From a sampled posterior, by quantity; None where no estimator of the run has sampled it.
    last_error : (e,) float array or None
        Error of the state after the last epoch, from the estimate to the truth, where it was computed with many others'.
    """

    history: EstimateHistory
    truth: Truth | None = None
    alignment: Alignment = Alignment.NONE
    errors: TruthErrors | None = None
    body_errors: BodyErrors | None = None
    nees: NormalisedErrors | None = None
    bound: ErrorBound | None = None
    bound_missing: str | None = None
    distances: Mapping[str, PosteriorDistance] | None = None
    last_error: Float[np.ndarray, "*r e"] | None = None

    def of_run(self, run: int) -> "Evaluation":
        """One run, of the evaluation of many."""
        error, errors, nees, last = self.body_errors, self.errors, self.nees, self.last_error
        own = replace(
            self,
            history=self.history.of_run(run),
            errors=None if errors is None else errors.of_run(run),
            body_errors=None if error is None else error.of_run(run),
            nees=None if nees is None else nees.of_run(run),
            last_error=None if last is None else last[run],
        )
        own.__dict__["body"] = self.body.of_run(run)
        return own

    @property
    def name(self) -> str:
        """Name of the estimator."""
        return self.history.name

    @property
    def trajectory(self) -> Trajectory:
        """The motion after every epoch, computed anew from the history: a long recording has no room for both."""
        return trajectory_of(self.history)

    @property
    def truth_in_own_frames(self) -> Truth | None:
        """The truth in the estimate's frames i and g; None without one, or where a fit of the frames g relates them."""
        return self.truth_in_own_frames_at(None)

    def truth_in_own_frames_at(self, rows: Int[np.ndarray, " k"] | None) -> Truth | None:
        """`truth_in_own_frames` at some stamps of the truth, by ascending rows; at all where None."""
        if self.truth is None or self.alignment is Alignment.BODY_FRAME:
            return None
        return truth_in_estimate_frames(self.history, self.truth, self.alignment, rows)

    @property
    def bodies(self) -> BodyHistory:
        """The body after every epoch, made anew; `body` is the last."""
        return body_history(self.history)

    @cached_property
    def body(self) -> BodyEstimate:
        """The body after the last epoch; moments and axes are means over samples of their posterior where that was sampled.

        Samples are of white noise: where errors may be correlated, axes keep the deviations of the wider belief.
        """
        body, mass = body_estimate(self.history.belief(-1)), self.history.mass
        # An estimate that ended without numbers has no mass distribution, whatever was sampled before.
        has_numbers = bool(np.isfinite(body.principal_moments_std).all())
        if mass is None or not has_numbers:
            return body
        return mass.body(body, 0.0 if self.history.mixture is None else body.principal_axes_std)

    @property
    def moment_texts(self) -> list[str]:
        """The principal moments after the last epoch that are not 1 by definition, ``value ± std``."""
        moments, std = self.body.principal_moments[:2], self.body.principal_moments_std[:2]
        return [with_uncertainty(*pair) for pair in zip(moments.tolist(), std.tolist(), strict=True)]

    @cached_property
    def constants(self) -> dict[str, ConstantEstimate]:
        """Drag, gyro bias and the like after the last epoch, by the name of their block."""
        return constant_estimates(self.history)

    @cached_property
    def deviation_parts(self) -> dict[str, DeviationPart]:
        """Standard deviations after the last epoch in parts, by quantity."""
        return deviation_parts(self.history)

    @cached_property
    def intervals(self) -> dict[str, Float[np.ndarray, "p q"]] | None:
        """Half widths of central intervals after the last epoch (`stated_intervals`)."""
        return stated_intervals(self.history)

    @property
    def random_trajectory(self) -> Trajectory | None:
        """The motion with the random part of its deviations alone; None where the calibration adds nothing."""
        exact = self.history.calibration is None
        return None if exact else trajectory_of(without_calibration(self.history))

    @cached_property
    def rotation_nees(self) -> NormalisedErrors | None:
        """NEES of rate and mass distribution, for a gyro's estimate, which shares no frame i with a truth."""
        known = self.truth is not None and knows_state(self.truth, self.history.layout)
        if self.truth is None or not known or self.history.layout.translates:
            return None
        return rotation_nees(self.history, self.truth)

    def with_fields(self, **changes: Any) -> "Evaluation":
        """This evaluation with other errors; what was derived stays."""
        changed = replace(self, **changes)
        for name in ("body", "constants", "deviation_parts", "intervals"):
            if name in self.__dict__:
                changed.__dict__[name] = self.__dict__[name]
        return changed

    def has_estimates_of(self, other: "Evaluation") -> bool:
        """Whether both are of one history and its errors, whatever status, bound and distances were found since."""
        ours, theirs = self.history, other.history
        if ours.has_failed is not theirs.has_failed or self.alignment is not other.alignment:
            return False
        same = [
            getattr(ours, each.name) is getattr(theirs, each.name)
            for each in fields(ours)
            if each.name != "status"
        ]
        same += [
            getattr(self, name) is getattr(other, name) for name in ("truth", "errors", "body_errors", "nees")
        ]
        return all(same)

    def with_status(self, status: EstimatorStatus) -> "Evaluation":
        """This evaluation with another status."""
        return self.with_fields(history=replace(self.history, status=status))

    @property
    def own_begin(self) -> float | None:
        """Time of the first epoch that is the estimator's own, s; None where it has none."""
        own = self.history.time[self.history.own]
        return float(own[0]) if own.size else None

    @property
    def nis_ratio(self) -> PerRun | None:
        """NIS per degree of freedom over the run; the initialisation has none."""
        return nis_ratio(self.history)

    @property
    def milliseconds_per_frame(self) -> float | None:
        """Median over the estimator's own epochs that took any time; None when none did."""
        own = self.history.runtime[self.history.own]
        runtime = own[own > 0]
        return 1e3 * float(np.median(runtime)) if runtime.size else None


def not_failed(evaluations: Iterable[Evaluation]) -> list[Evaluation]:
    """Evaluations of the estimators that have not failed, in their order."""
    return [each for each in evaluations if not each.history.has_failed]


def with_uncertainty(value: float, std: float) -> str:
    """``value ± std`` to two digits of the deviation, with 2 to 9 decimals; "unknown" where it is not a number."""
    if not math.isfinite(value):
        return "unknown"
    decimals = 1 - math.floor(math.log10(std)) if math.isfinite(std) and std > 0 else 4
    decimals = max(2, min(decimals, _MOST_DECIMALS))
    spread = f"{std:.{decimals}f}" if math.isfinite(std) else "unknown"
    return f"{value:.{decimals}f} ± {spread}"


def evaluate(
    history: EstimateHistory, truth: Truth | None = None, alignment: Alignment = Alignment.NONE
) -> Evaluation:
    """A history, with its errors where there is a truth.

    A history that is not finite throughout, or whose numbers cannot be evaluated, is ``failed``: its errors are those of the epochs
    that are finite, and it has none where no epoch is.

    Parameters
    ----------
    alignment : Alignment
        How the g of the estimate relates to that of the truth; `Alignment.FIRST_FRAME` becomes `Alignment.BODY_FRAME` where
        the truth does not give enough for it.

    Raises
    ------
    InputError
        A history without epochs, or a truth without any of its time stamps.
    """
    if not len(history.time):
        raise InputError(
            f"{history.name} left no epoch to evaluate: {'; '.join(history.status.reasons) or 'no reason'}"
        )
    with np.errstate(all="ignore"):  # the result is checked, and reported in the status
        evaluation, trajectory = _describe_estimate(_with_status(history))
        if truth is None:
            return evaluation
        if alignment is Alignment.FIRST_FRAME and not history.layout.translates:
            alignment = Alignment.INERTIAL_FRAME
        elif alignment is Alignment.FIRST_FRAME and not tells_first_frame(history, truth):
            alignment = Alignment.BODY_FRAME
        try:
            return _compare_with_truth(evaluation, trajectory, truth, alignment)
        except NUMERICAL_ERRORS as error:
            return _mark_failed(evaluation, f"its errors could not be computed ({reason(numerical(error))})")
        except InputError:
            if evaluation.history.has_failed:
                return evaluation
            raise


def _with_status(history: EstimateHistory) -> EstimateHistory:
    """The history, ``failed`` where an epoch is not finite."""
    bad = np.flatnonzero(~finite_epochs(history))
    if not len(bad) or history.has_failed:
        return history
    why = f"{len(bad)} of {len(history.time)} epochs are not finite, first t = {history.time[bad[0]]:.3f} s"
    return replace(history, status=history.status.failed(why))


def _describe_estimate(history: EstimateHistory) -> tuple[Evaluation, Trajectory]:
    """Evaluation without a truth, and the trajectory.

    A history whose numbers cannot be evaluated keeps nothing but its epochs.
    """
    try:
        evaluation, trajectory = Evaluation(history), trajectory_of(history)
        _ = evaluation.body
        finite = trajectory.is_finite.all() or history.has_failed
        if not finite:
            evaluation = _mark_failed(evaluation, "the motion that follows from the estimate is not finite")
        return evaluation, trajectory
    except NUMERICAL_ERRORS as error:
        status = history.status.failed(f"the estimate could not be evaluated ({reason(numerical(error))})")
        mean, factor = np.full_like(history.mean, np.nan), np.full_like(history.factor, np.nan)
        lost = replace(history, mean=mean, factor=factor, status=status, calibration=None, mixture=None)
        return Evaluation(lost), trajectory_of(lost)


def _mark_failed(evaluation: Evaluation, why: str) -> Evaluation:
    return evaluation.with_status(evaluation.history.status.failed(why))


def _compare_with_truth(
    evaluation: Evaluation, trajectory: Trajectory, truth: Truth, alignment: Alignment
) -> Evaluation:
    history = evaluation.history
    is_turned = alignment is Alignment.INERTIAL_FRAME
    turn = inertial_turn(history, truth) if is_turned else None
    common = truth if is_turned else truth_in_estimate_frames(history, truth, alignment)
    errors = truth_errors(trajectory, truth, alignment, turn)
    frame = errors.frame if alignment is Alignment.BODY_FRAME else None
    exact = alignment in (Alignment.NONE, Alignment.FIRST_FRAME)
    known = exact and knows_state(common, history.layout) and bool(finite_epochs(history).any())
    return evaluation.with_fields(
        truth=truth,
        alignment=alignment,
        errors=errors,
        body_errors=body_errors(evaluation.body, common, frame),
        nees=normalised_errors(history, common) if known else None,
    )
