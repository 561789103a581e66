"""Cramer-Rao bound of the state over time, and of the quantities that one reads from it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
from jaxtyping import Float
from scipy.linalg import qr, solve_triangular

from observability.reference_trajectory import ReferenceTrajectory, SensorSchedule, rows_at
from spinfilters.core.attitude_expressions import rotate
from spinfilters.core.compiled import Compiled
from spinfilters.core.errors import InputError, ShapeError
from spinfilters.core.linear_algebra import with_largest_positive
from spinfilters.core.mass_distribution import inertia, inertia_matrix
from spinfilters.core.working_time import building
from spinfilters.models.state_blocks import BLOCKS
from spinfilters.models.state_layout import POSE_BLOCKS, StateLayout, error_derivative

PRIOR_STD: dict[str, float] = {
    "t": 1e-6,
    "a": 1e-6,
    "v": 1.0,
    "w": 10.0,
    "c": 1.0,
    "s": 3.0,
    "d": 1.0,
    "n": 3.0,
}
"""Of the first frame: the pose of g is known by definition, the rest hardly (m, rad, m/s, rad/s, m, 1, 1/rad); n is the
logarithm of the inertia's scale, which a flight with a known torque holds."""
DEFINED = ("t", "a")
"""Blocks whose prior is a definition, of the frame g, unless a caller knows better."""
Deviations = Mapping[str, float | Float[np.ndarray, " _"]]
"""Of each block, for all components or one by one."""
WIDENING = 10.0
"""All other priors times this make the second bound, which shows what rests on them."""
LANDMARK_STD = 1.0
"""Prior of an unknown landmark's coordinates, m."""


@dataclass(frozen=True)
class Bound:
    """Cramer-Rao bound of every frame.

    Attributes
    ----------
    layout : StateLayout
        Of the state.
    prior_std : ndarray of shape (n,)
        Of all unknowns in the first frame.
    std : ndarray of shape (frames, n)
        Of the state's error, then of the flight's constants and the sensors' unknowns.
    covariances : ndarray of shape (frames, e, e)
        Of the state's error and the flight's constants.
    widened : ndarray of shape (frames, e, e)
        The same with all priors that are no definitions `WIDENING` times as wide.
    """

    layout: StateLayout
    prior_std: Float[np.ndarray, " n"]
    std: Float[np.ndarray, "frames n"]
    covariances: Float[np.ndarray, "frames e e"]
    widened: Float[np.ndarray, "frames e e"]

    def block(self, name: str) -> Float[np.ndarray, "frames b"]:
        """Standard deviations of one block."""
        return self.std[:, self.layout.slice(name)]

    @property
    def weak_direction(self) -> tuple[Float[np.ndarray, " e"], float]:
        """The least known direction of the state in prior deviations, and the prior's share.

        The pose is left out: its prior may be a definition. With P the bound and S the prior this is the top eigenvector of
        S^-1/2 P S^-1/2 over the other blocks; the second result is what `prior_directions` finds for it.
        """
        free = [
            k for block in self.layout.blocks if block not in POSE_BLOCKS for k in _range(self.layout, block)
        ]
        scale = self.prior_std[free]
        values = [
            part[-1][np.ix_(free, free)] / np.outer(scale, scale) for part in (self.covariances, self.widened)
        ]
        vector = np.linalg.eigh(values[0])[1][:, -1]
        direction = np.zeros(self.layout.error_dim)
        direction[free] = with_largest_positive(vector)
        narrow, wide = (float(vector @ part @ vector) for part in values)
        return direction, float(prior_share(wide / narrow))


def prior_share(growth: Float[np.ndarray, "*n"] | float) -> Float[np.ndarray, "*n"]:
    """Share of the prior's deviation that remains, from widened priors.

    Where a variance grows so much under priors `WIDENING` times as wide.
    Of one unknown with information p of the prior and d of the data the variance 1/(p + d) grows by (p + d)/(p/100 + d), and
    the share is sqrt(p / (p + d)), the deviation over that of the prior. Of several unknowns it shows, too, what rests on the
    priors of others: a scale of all lengths that only the prior of the landmarks holds.
    """
    share = (1 - 1 / np.asarray(growth)) / (1 - WIDENING**-2)
    return np.sqrt(np.clip(share, 0.0, 1.0))


def cramer_rao_bound(
    reference: ReferenceTrajectory,
    schedules: Sequence[SensorSchedule],
    prior_std: Deviations = PRIOR_STD,
    landmark_std: float = LANDMARK_STD,
    defined: Sequence[int] | None = None,
) -> Bound:
    """The bound along a flight.

    Parameters
    ----------
    prior_std : Deviations
        Of every block of the layout in the first frame, positive.
    landmark_std : float
        Of every unknown parameter.
    defined : Sequence[int] or None
        Components of the error whose prior is a definition, and no guess; None for those of `DEFINED`.

    Raises
    ------
    InputError, ShapeError
        For no sensors, sensors over other frames, or priors that are missing or not positive.
    """
    total = _columns(reference, schedules)[1]
    layout, constants = reference.process.layout, reference.constants
    prior = prior_deviations(layout, total, prior_std, landmark_std, constants)
    n, deviations, covariances = layout.error_dim + constants, [], []
    for roots in _information_roots(reference, schedules, prior, defined):
        inverses = _inverses(roots)
        deviations.append(np.sqrt(np.einsum("ij,ij->i", inverses[0], inverses[0])))
        covariances.append([inverse[:n] @ inverse[:n].T for inverse in inverses])
    narrow, widened = np.stack(covariances, axis=1)
    return Bound(layout, prior, np.stack(deviations), narrow, widened)


def later_covariances(
    reference: ReferenceTrajectory,
    schedules: Sequence[SensorSchedule],
    frames: Sequence[int],
    prior: Float[np.ndarray, " n"],
    defined: Sequence[int] | None = None,
) -> Iterator[tuple[Float[np.ndarray, "e e"], Float[np.ndarray, "e e"]]]:
    """Covariances of the bound and of the widened one at some frames of a long flight, one after the other.

    Those of the frames between are not computed, nor any after the last one that is asked for.

    Parameters
    ----------
    frames : Sequence[int]
        Ascending.
    prior : ndarray of shape (n,)
        Standard deviations of all unknowns in the first frame, as in a `Bound`.
    defined : Sequence[int] or None
        As of `cramer_rao_bound`.
    """
    n, asked = reference.process.layout.error_dim + reference.constants, set(frames)
    for frame, roots in enumerate(_information_roots(reference, schedules, prior, defined)):
        if frame in asked:
            narrow, widened = (inverse[:n] @ inverse[:n].T for inverse in _inverses(roots))
            yield narrow, widened


def _information_roots(
    reference: ReferenceTrajectory,
    schedules: Sequence[SensorSchedule],
    prior: Float[np.ndarray, " n"],
    defined: Sequence[int] | None,
) -> Iterator[list[Float[np.ndarray, "n n"]]]:
    """Roots of the information in every frame, with the prior and with the widened one."""
    starts, total = _columns(reference, schedules)
    wide = prior * _widening(reference.process.layout, total, defined)
    roots = [np.diag(1 / prior), np.diag(1 / wide)]
    for frame, x in enumerate(reference.states):
        if frame:
            step = reference.linearise(frame)
            roots = [predicted_root(*step, root) for root in roots]
        rows = [
            rows_at(schedule, frame, x, start, total)
            for schedule, start in zip(schedules, starts, strict=True)
        ]
        roots = [_triangular(np.concatenate([root, *rows]), total) for root in roots]
        yield roots


def _inverses(roots: Sequence[Float[np.ndarray, "n n"]]) -> list[Float[np.ndarray, "n n"]]:
    return [solve_triangular(root, np.eye(len(root)), check_finite=False) for root in roots]


def observability_gramian(
    reference: ReferenceTrajectory, schedules: Sequence[SensorSchedule]
) -> Float[np.ndarray, "n n"]:
    """Observability Gramian, sum of Phi' H' R^-1 H Phi over frames.

    Information about the first state and the unknown parameters, no noise, no prior.
    """
    starts, total = _columns(reference, schedules)
    n, transition = reference.process.layout.error_dim, np.eye(total)
    gramian = np.zeros((total, total))
    for frame, x in enumerate(reference.states):
        if frame:
            step = reference.linearise(frame)[0]
            transition[:n] = step @ transition[: step.shape[1]]
        for schedule, start in zip(schedules, starts, strict=True):
            rows = rows_at(schedule, frame, x, start, total) @ transition
            gramian += rows.T @ rows
    return gramian


def prior_deviations(
    layout: StateLayout, total: int, prior_std: Deviations, landmark_std: float, constants: int = 0
) -> Float[np.ndarray, " n"]:
    """Standard deviations of all unknowns in the first frame; ``constants`` follow the state (`ReferenceTrajectory.constants`)."""
    deviations = np.full(total, landmark_std)
    if constants:
        deviations[layout.error_dim : layout.error_dim + constants] = prior_std["n"]
    for block in layout.blocks:
        if block not in prior_std:
            raise InputError(
                f"the prior names {', '.join(prior_std)} and not block {block}; give its standard deviation"
            )
        deviations[layout.slice(block)] = prior_std[block]
    if not np.all(np.isfinite(deviations) & (deviations > 0)):
        raise InputError(
            "prior standard deviations must be positive and finite; give a large one for what is unknown"
        )
    return deviations


def _widening(layout: StateLayout, total: int, defined: Sequence[int] | None) -> Float[np.ndarray, " n"]:
    factors = np.full(total, WIDENING)
    if defined is None:
        defined = [k for block in DEFINED if block in layout.blocks for k in _range(layout, block)]
    factors[list(defined)] = 1.0
    return factors


def predicted_root(
    transition: Float[np.ndarray, "e k"], entry: Float[np.ndarray, "e q"], root: Float[np.ndarray, "n n"]
) -> Float[np.ndarray, "n n"]:
    """Information root of the next state, its noise marginalised by QR.

    x' = Phi x + T c + G n with n standard normal.
    """
    (n, width), noise, total = transition.shape, entry.shape[1], len(root)
    back = root.copy()
    back[:, :n] = np.linalg.solve(transition[:, :n].T, root[:, :n].T).T
    back[:, n:width] -= back[:, :n] @ transition[:, n:]
    stacked = np.block([[np.eye(noise), np.zeros((noise, total))], [-back[:, :n] @ entry, back]])
    return _triangular(stacked, noise + total)[noise:, noise:]


def _triangular(stacked: Float[np.ndarray, "k n"], size: int) -> Float[np.ndarray, "n n"]:
    return np.asarray(qr(stacked, mode="r", overwrite_a=True, check_finite=False)[0])[:size]


def _columns(reference: ReferenceTrajectory, schedules: Sequence[SensorSchedule]) -> tuple[list[int], int]:
    """Offsets of every sensor's own unknowns, and the number of unknowns."""
    if not schedules:
        raise InputError("nothing is measured: give at least one sensor")
    start, starts = reference.process.layout.error_dim + reference.constants, []
    for schedule in schedules:
        if len(schedule.seen) != len(reference.time):
            raise ShapeError(
                f"{schedule.model.name} sees {len(schedule.seen)} frames of a flight of {len(reference.time)}"
            )
        starts.append(start)
        start += schedule.own
    return starts, start


def _range(layout: StateLayout, block: str) -> range:
    where = layout.slice(block)
    return range(where.start, where.stop)


BLOCK_NAMES = {
    "a": ("attitude", "rad"),
    "v": ("velocity", "m/s"),
    "w": ("body rate", "rad/s"),
    "c": ("centre of mass in g", "m"),
    "b": ("gyro bias", "rad/s"),
}
WEAK_NAMES = {name: words for name, (words, _) in BLOCK_NAMES.items()} | {"s": "mass distribution"}
PLACE, MOMENTS = ("place of the centre of mass", "m"), ("inertia ratios", "1")
EACH_MOMENT = ("each moment, relative", "1")
"""Of J_xx, J_yy, J_zz, where a known torque gives the inertia a scale."""
Quantity = tuple[str, str]
"""A name and a unit."""
COMPONENTS = {
    **{block: tuple(f"{block}_{axis}" for axis in "xyz") for block in "tavwcb"},
    "s": ("s_xx", "s_yy", "s_xy", "s_xz", "s_yz"),
    "d": ("d",),
}
"""Names of the components of an error; those of the mass distribution are entries of D."""


def bounded_quantities(
    bound: Bound, reference: ReferenceTrajectory
) -> dict[Quantity, Float[np.ndarray, " frames"]]:
    """Standard deviations (root mean square over components) of every quantity and frame, by (name, unit)."""
    found = {}
    jacobian = [quantity_jacobian(bound.layout, reference, frame) for frame in range(len(reference.time))]
    for name in jacobian[0]:
        roots = [
            np.sqrt(np.trace(slope[name] @ covariance @ slope[name].T) / len(slope[name]))
            for slope, covariance in zip(jacobian, bound.covariances, strict=True)
        ]
        found[name] = np.array(roots)
    return found


def quantity_jacobian(
    layout: StateLayout, reference: ReferenceTrajectory, frame: int
) -> dict[Quantity, Float[np.ndarray, "k e"]]:
    """Derivatives of every quantity by the error of the state and the flight's constants."""
    s = reference.states[0][layout.mean_slice("s")]  # a constant
    jacobian = _jacobian(layout, reference.states[frame])
    jacobian[MOMENTS] = _by_mass(layout, ratio_jacobian(s))
    if reference.constants:
        jacobian[EACH_MOMENT] = _by_mass(layout, _moment_jacobian(s))
    padded = {name: np.pad(rows, ((0, 0), (0, reference.constants))) for name, rows in jacobian.items()}
    if reference.constants:
        padded[EACH_MOMENT][:, layout.error_dim] = 1.0
    return padded


def _by_mass(layout: StateLayout, jacobian: Float[np.ndarray, "k 5"]) -> Float[np.ndarray, "k e"]:
    rows = np.zeros((len(jacobian), layout.error_dim))
    rows[:, layout.slice("s")] = jacobian
    return rows


def weak_direction_in_words(bound: Bound, axes: str = "") -> str:
    """Main components of the least known direction, and its share of the prior.

    ``axes`` are those of a state whose frame g is not along the principal axes.
    """
    direction, remains = bound.weak_direction
    order = np.argsort(-np.abs(direction))
    count = int(np.searchsorted(np.cumsum(direction[order] ** 2), 0.95)) + 1
    names = _component_names(bound.layout)
    parts = " ".join(f"{direction[k]:+.2f} {names[k]}" for k in order[:count])
    blocks = dict.fromkeys(names[k][0] for k in order[:count])
    meaning = ", ".join(f"{block}: {WEAK_NAMES.get(block) or BLOCKS[block].label}" for block in blocks)
    frame = axes or (
        "principal axes"
        if blocks.keys() <= set("awcs")
        else "velocities in camera axes, others in principal axes"
    )
    return f"{parts} in prior deviations ({meaning}; {frame}); {100 * remains:.3g} % of the prior's deviation remains"


def _component_names(layout: StateLayout) -> list[str]:
    return [
        name
        for block in layout.blocks
        for name in COMPONENTS.get(block) or [f"{block}_{axis}" for axis in "xyz"[: BLOCKS[block].dimension]]
    ]


def _jacobian(
    layout: StateLayout, x: Float[np.ndarray, " m"]
) -> dict[tuple[str, str], Float[np.ndarray, "k e"]]:
    """Jacobian of all non-constant quantities and of blocks by the state's error."""
    eye = np.eye(layout.error_dim)
    jacobian = {
        quantity: eye[layout.slice(block)]
        for block, quantity in BLOCK_NAMES.items()
        if block in layout.blocks
    }
    if layout.translates:
        jacobian[PLACE] = _place(layout)(x)[0]
    return jacobian


def ratio_jacobian(s: Float[np.ndarray, " 5"]) -> Float[np.ndarray, "2 5"]:
    """Derivatives of J1/J3 and J2/J3 (moments ascending) by the error of the mass distribution."""
    moments, axes = np.linalg.eigh(inertia_matrix(s))
    changes = _inertia_jacobian()(s)[0].reshape(3, 3, 5)
    along = np.einsum("ik,ijd,jk->kd", axes, changes, axes)
    return (along[:2] - np.outer(moments[:2] / moments[2], along[2])) / moments[2]


def _moment_jacobian(s: Float[np.ndarray, " 5"]) -> Float[np.ndarray, "3 5"]:
    """Jacobian of the logarithms of J's diagonal by the mass distribution's error."""
    changes = _inertia_jacobian()(s)[0].reshape(3, 3, 5)
    return np.einsum("iid->id", changes) / np.diag(inertia_matrix(s))[:, np.newaxis]


@cache
@building()
def _place(layout: StateLayout) -> Compiled:
    x, d = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("d", layout.error_dim)
    values = layout.unpack(layout.retract_expression(x, d))
    slope = error_derivative(values["t"] + rotate(values["q"], values["c"]), d)
    return Compiled.interpreted(ca.Function("place", [x], [slope]))


@cache
@building()
def _inertia_jacobian() -> Compiled:
    """s -> derivatives of J, flattened, by the multiplicative error."""
    layout = StateLayout(("a", "w", "s"))
    x, d = ca.SX.sym("x", layout.mean_dim), ca.SX.sym("d", layout.error_dim)
    moved = layout.unpack(layout.retract_expression(x, d))["s"]
    at = error_derivative(ca.vec(inertia(moved)), d, layout.slice("s"))
    s = ca.SX.sym("s", 5)
    point = ca.vertcat(ca.SX([0, 0, 0, 1, 0, 0, 0]), s)
    return Compiled.interpreted(ca.Function("inertia_slopes", [s], [ca.substitute(at, x, point)]))
