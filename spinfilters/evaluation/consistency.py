"""Consistency of covariances: normalised errors against chi-square bands, and the agreement of two estimates."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import chdtri

from spinfilters.core.attitude_conversions import (
    inverse,
    matrix_from_quaternion,
    quaternion_from_rotation_vector,
    rotate,
)
from spinfilters.core.conventions import PerRun
from spinfilters.core.errors import InputError
from spinfilters.core.linear_algebra import (
    by_stretches,
    normalised_trace,
    regular_factors,
)
from spinfilters.core.mass_distribution import from_inertia
from spinfilters.evaluation.trajectory_errors import common_stamps, rows_within
from spinfilters.filters.history import EstimateHistory
from spinfilters.filters.normalised_squares import normalised_squares
from spinfilters.io.truth import BODY_KEYS, TRAJECTORY_FIELDS, Truth, truth_in_moved_frame
from spinfilters.models.state_blocks import BLOCKS, MASS_DISTRIBUTION, POSITION, RATE
from spinfilters.models.state_layout import StateLayout

_FRAME_STEP = 1e-5  # rad and m: of a central difference


@dataclass(frozen=True)
class NormalisedErrors:
    """NEES e' P^-1 e of the state's error, chi-square with its dimension for a consistent estimator.

    Those of many runs at the same times have an axis (r,) in front.

    Attributes
    ----------
    time : (n,) float array
        Time, s.
    total : (n,) float array
        NEES of the whole error, dimension ``dof``.
    blocks : dict[str, (n,) float array]
        NEES of every block of the state by name, dimension `StateBlock.dimension`.
    """

    time: Float[np.ndarray, " n"]
    total: Float[np.ndarray, "*r n"]
    dof: int
    blocks: dict[str, Float[np.ndarray, "*r n"]]

    @property
    def mean(self) -> PerRun:
        """Mean over time of the whole error's, divided by its dimension: 1 for a consistent estimator."""
        return np.mean(self.total, axis=-1) / self.dof

    def of_run(self, run: int) -> "NormalisedErrors":
        """NEES of one run, of those of many."""
        blocks = {block: values[run] for block, values in self.blocks.items()}
        return NormalisedErrors(self.time, self.total[run], self.dof, blocks)

    def within(self, begin: float, end: float) -> "NormalisedErrors | None":
        """Errors within a span of time (s), both ends included, without copies; None without any."""
        rows = rows_within(self.time, begin, end)
        if rows.start == rows.stop:
            return None
        blocks = {block: values[..., rows] for block, values in self.blocks.items()}
        return NormalisedErrors(self.time[rows], self.total[..., rows], self.dof, blocks)


def chi_square_band(
    dof: Int[np.ndarray, "*n"] | int, runs: int, probability: float = 0.95
) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
    """Limits between which the mean of ``runs`` independent chi-square numbers lies with this probability.

    (Quantiles of chi-square with runs * dof degrees of freedom over runs, at both tails; Bar-Shalom, Li,
    Kirubarajan 2001, section 5.4.) Epochs of one
    run are not independent in NEES, so compare each epoch with runs = 1, or means over separate runs.
    """
    tail = (1.0 - probability) / 2
    count = runs * np.asarray(dof)
    return chdtri(count, 1.0 - tail) / runs, chdtri(count, tail) / runs


def knows_state(truth: Truth, layout: StateLayout) -> bool:
    """Whether the truth holds every block of the layout; its frames must also be those of the estimate."""
    known = {*_fields(truth), RATE.name}
    if truth.center_of_mass_g is not None:
        known.add(POSITION.name)
    if truth.principal_moments is not None and truth.principal_axes_g is not None:
        known.add(MASS_DISTRIBUTION.name)
    return known.issuperset(layout.blocks)


def true_states(
    truth: Truth, layout: StateLayout, rows: slice | Int[np.ndarray, " n"] = slice(None)
) -> Float[np.ndarray, "n m"]:
    """True states of the layout at every stamp of the truth or at some of them, in the truth's frames i and g.

    Raises
    ------
    InputError
        When the truth does not give a block, or its moments are those of a plate, which no ``s`` is.
    """
    if not knows_state(truth, layout):
        raise InputError(
            f"the truth does not contain all of the blocks {', '.join(layout.blocks)}; give what truth.toml can hold of "
            f"{', '.join(BODY_KEYS)}"
        )
    q, time = truth.q_ig[rows], truth.time[rows]
    values = _fields(truth, rows) | {RATE.name: rotate(inverse(q), truth.rate_i[rows])}
    if truth.center_of_mass_g is not None:
        values[POSITION.name] = (
            truth.center_of_mass[rows] - matrix_from_quaternion(q) @ truth.center_of_mass_g
        )
    if truth.principal_moments is not None and truth.principal_axes_g is not None:
        axes = truth.principal_axes_g
        values[MASS_DISTRIBUTION.name] = from_inertia(axes.T @ np.diag(truth.principal_moments) @ axes)
    x = np.empty((len(time), layout.mean_dim))
    for block in layout.blocks:
        x[:, layout.mean_slice(block)] = values[block]
    return x


def _fields(truth: Truth, rows: slice | Int[np.ndarray, " n"] = slice(None)) -> dict[str, np.ndarray]:
    """Points of the blocks that the truth holds as such, by name, at some of its stamps."""
    told = {block.name: block.truth_field for block in BLOCKS.values() if block.truth_field}
    points = {name: getattr(truth, field) for name, field in told.items()}
    return {
        name: point[rows] if told[name] in TRAJECTORY_FIELDS else point
        for name, point in points.items()
        if point is not None
    }


def normalised_errors(history: EstimateHistory, truth: Truth) -> NormalisedErrors:
    """NEES of a history at its common stamps with a truth.

    Both are in the same frames i and g (`truth_in_first_frame`, if need be). Epochs whose mean or factor is not finite are
    left out.

    Where g is the frame that fits the measurements best (`Truth.frame_is_fitted`), the whole error has six degrees of freedom less:
    its NEES is the least over all small changes of g, chi-square whatever the fit was. Blocks' are as they are.

    The tangent is taken at the estimate. Where the pose of g at the first epoch is exact by definition, the error and the NEES
    of blocks t and a vanish there, and the whole state has six degrees of freedom less in that one epoch.

    Raises
    ------
    InputError
        As `true_states` and `common_stamps`.
    """
    layout = history.layout
    rows, true_rows = _comparable_epochs(history, truth)
    moved = _frame_changes(truth, layout)[true_rows] if truth.frame_is_fitted else None

    def derive(part: slice) -> dict[str, np.ndarray]:
        """Quantities of a stretch of epochs."""
        away, factor = _errors(history, truth, rows[part], true_rows[part])
        parts = {b: layout.slice(b) for b in layout.blocks}
        if moved is None:
            parts["total"] = slice(0, layout.error_dim)
        columns = normalised_squares(away, factor, list(parts.values())).T
        found = dict(zip(parts, columns, strict=True))
        return found if moved is None else found | {"total": _least_square(away, factor, moved[part])}

    squares = by_stretches(len(rows), derive, history.factor)
    dof = layout.error_dim - (0 if moved is None else moved.shape[2])
    return NormalisedErrors(history.time[rows], squares.pop("total"), dof, squares)


def _errors(
    history: EstimateHistory, truth: Truth, rows: Int[np.ndarray, " n"], true_rows: Int[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "n e"], Float[np.ndarray, "n e e"]]:
    """Errors of some epochs from the estimates to the truth, and the factors of their covariances."""
    own, layout = _as_slice(rows), history.layout
    truly = true_states(truth, layout, _as_slice(true_rows))
    return layout.local_pairs(history.mean[own], truly), history.factor[own]


def _as_slice(rows: Int[np.ndarray, " n"]) -> slice | Int[np.ndarray, " n"]:
    """Ascending rows as a slice where none is left out: no array is copied."""
    return slice(rows[0], rows[-1] + 1) if rows[-1] - rows[0] == len(rows) - 1 else rows


def _comparable_epochs(
    history: EstimateHistory, truth: Truth
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Rows of history and truth at their common stamps, without epochs whose estimate is not finite."""
    rows, true_rows = common_stamps(history.time, truth.time)
    finite = finite_epochs(history)[rows]
    return rows[finite], true_rows[finite]


def rotation_nees(history: EstimateHistory, truth: Truth) -> NormalisedErrors | None:
    """NEES of rate and mass distribution, which need no frame i, where both are in the same axes of g; None without an epoch.

    Raises
    ------
    InputError
        As `true_states` and `common_stamps`.
    """
    layout = history.layout
    rows, true_rows = _comparable_epochs(history, truth)
    if not len(rows):
        return None
    blocks = (RATE.name, MASS_DISTRIBUTION.name)
    components = np.arange(layout.error_dim)
    both = np.concatenate([components[layout.slice(block)] for block in blocks])
    first = len(components[layout.slice(RATE.name)])
    parts = {"total": slice(0, len(both)), blocks[0]: slice(0, first), blocks[1]: slice(first, len(both))}

    def derive(part: slice) -> dict[str, np.ndarray]:
        """NEES of a stretch of epochs."""
        away, factor = _errors(history, truth, rows[part], true_rows[part])
        columns = normalised_squares(away[:, both], factor[:, both], list(parts.values())).T
        return dict(zip(parts, columns, strict=True))

    squares = by_stretches(len(rows), derive, history.factor)
    return NormalisedErrors(history.time[rows], squares.pop("total"), len(both), squares)


def _frame_changes(truth: Truth, layout: StateLayout) -> Float[np.ndarray, "n k 6"]:
    """Central differences of the true states by a small rotation (rad) and shift (m) of g."""
    columns = []
    for step in _FRAME_STEP * np.eye(6):
        near = [
            truth_in_moved_frame(truth, quaternion_from_rotation_vector(sign * step[:3]), sign * step[3:])
            for sign in (-1, 1)
        ]
        before, after = (true_states(each, layout) for each in near)
        columns.append(layout.local(before, after) / (2 * _FRAME_STEP))
    return np.stack(columns, axis=2)


def _least_square(
    error: Float[np.ndarray, "n k"], factor: Float[np.ndarray, "n k e"], moved: Float[np.ndarray, "n k c"]
) -> Float[np.ndarray, " n"]:
    """Least square over changes of the frame, infinite where P is singular."""
    upper = np.asarray(np.linalg.qr(np.swapaxes(factor, 1, 2), mode="r"))
    regular = regular_factors(upper)
    both = np.concatenate([moved, error[:, :, np.newaxis]], axis=2)
    whitened = np.linalg.solve(np.swapaxes(upper[regular], 1, 2), both[regular])
    result = np.full(len(error), np.inf)
    result[regular] = np.asarray(np.linalg.qr(whitened, mode="r"))[:, -1, -1] ** 2
    return result


def finite_epochs(history: EstimateHistory) -> Bool[np.ndarray, " n"]:
    """Mask of a history's epochs with finite mean and factor."""
    if not len(history.time):
        return np.zeros(0, dtype=bool)

    def are_finite(rows: slice) -> dict[str, np.ndarray]:
        """Mask of a stretch of epochs."""
        mean, factor = np.isfinite(history.mean[rows]), np.isfinite(history.factor[rows])
        return {"finite": np.asarray(mean.all(axis=1) & factor.all(axis=(1, 2)))}

    return by_stretches(len(history.time), are_finite, history.factor)["finite"]


def nis_ratio(history: EstimateHistory) -> PerRun | None:
    """Sum of the NIS over its degrees of freedom, 1 when consistent; None without any update."""
    dof = history.dof.sum(axis=-1)
    return history.nis.sum(axis=-1) / dof if dof.all() else None


WHOLE: Final = "state"
"""Name of the whole error, next to that of a block."""


def compared_parts(layout: StateLayout) -> dict[str, slice]:
    """Components that are compared with the smoother's, by name.

    The whole error, and the mass distribution, whose errors the others would hide.
    """
    return {WHOLE: slice(0, layout.error_dim), MASS_DISTRIBUTION.name: layout.slice(MASS_DISTRIBUTION.name)}


def expected_nees(history: EstimateHistory, smoother: EstimateHistory) -> dict[str, Float[np.ndarray, " n"]]:
    """Expected NEES per degree of freedom of a filter's own epochs with the smoother as truth, by `compared_parts`.

    Only epochs that both have and in which both are finite; infinite where the filter's covariance is singular, or where the
    two are too far apart for a number.
    """
    count, layout = min(len(history.time), len(smoother.time)), history.layout
    rows = np.arange(history.initialisation, count)
    rows = rows[finite_epochs(history)[rows] & finite_epochs(smoother)[rows]]

    parts = compared_parts(layout)

    def of(stretch: slice) -> dict[str, Float[np.ndarray, " n"]]:
        """Of some of the epochs."""
        at = rows[stretch]
        away = layout.local(history.mean[at], smoother.mean[at])
        try:
            about_filter = np.linalg.solve(layout.reset_jacobian(away), smoother.random_factor(at))
        except np.linalg.LinAlgError:  # too far away for an error about the filter's estimate
            return dict.fromkeys(parts, np.full(len(at), np.inf))
        columns, factor = (
            np.concatenate([about_filter, away[..., np.newaxis]], axis=2),
            history.random_factor(at),
        )
        found = {
            name: normalised_trace(columns[:, part], factor[:, part]) / (part.stop - part.start)
            for name, part in parts.items()
        }
        return {name: np.where(np.isnan(nees), np.inf, nees) for name, nees in found.items()}

    return by_stretches(len(rows), of)
