"""Dependence of a bound on its prior: what the measurements determine by themselves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import casadi as ca
import numpy as np
from jaxtyping import Float, Num
from scipy.linalg import eigh

from observability.body_model import body_rank, flow_of_system
from observability.canonical_motions import equal_moments, point_of
from observability.cases import Case
from observability.certificate import STEADY_ORDERS
from observability.codistribution import gradient_rows
from observability.cramer_rao import (
    BLOCK_NAMES,
    EACH_MOMENT,
    MOMENTS,
    PLACE,
    Bound,
    Quantity,
    prior_share,
    quantity_jacobian,
)
from observability.reference_trajectory import ReferenceTrajectory
from observability.residue_matrices import FIELD, null_vectors, product_of, rank_of, reduce_columns
from observability.system import System, SystemSensor
from spinfilters.core.attitude_expressions import Expression, rotate
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.state_layout import StateLayout

PRIOR_ONLY = 0.9
"""Share of the prior's deviation from which a direction counts as determined by the prior alone."""
HALVED = 0.5
"""Share that a longer flight has to bring the prior down to."""
SAME_DIRECTION = 1e-6
"""Length of what is left of an axis across others from which it is one more direction."""
ROUNDING = 1e-13
"""Of the largest variance of a quantity: what is below it is no difference between two bounds."""
LONGEST_FACTOR, MOST_EPOCHS, MOST_WORK = 64, 5000, 5e6
"""Of a longer flight: times the flight's own frames; frames; frames times the square of the unknowns (some seconds)."""
MIXING = {(0, 1): 2, (0, 2): 3, (1, 2): 4}
"""Component of the mass distribution's error that mixes two principal axes; components 0 and 1 are on the diagonal."""
ATTITUDE = BLOCK_NAMES["a"]


@dataclass(frozen=True)
class QuantityBound:
    """One quantity's bound, taken apart.

    Attributes
    ----------
    std : float
        Root mean square over components.
    dimension : int
        Components.
    prior_directions : ndarray of shape (k, d)
        (k, dimension) orthonormal rows, along which the prior alone speaks.
    std_along, std_across : float
        Root mean square along them and across them, 0 where there is no such direction.
    remains : float
        Largest share of the prior's deviation that remains across them.
    undetermined : int
        How many directions the sensors do not determine, exactly, however long they look.
    times_longer : float or None
        Factor of the flight's length that halves the prior's deviation in all other directions; None where
        the data determine them already.
    searched : float
        Largest factor that was tried; a ``times_longer`` of infinity means beyond it.
    """

    std: float
    dimension: int
    prior_directions: Float[np.ndarray, "k d"]
    std_along: float
    std_across: float
    remains: float
    undetermined: int
    times_longer: float | None = None
    searched: float = 1.0

    @property
    def in_principle_only(self) -> bool:
        """Whether the prior determines more than what the data leave open."""
        return len(self.prior_directions) > self.undetermined


def quantity_bounds(
    case: Case, reference: ReferenceTrajectory, bound: Bound, *, longer: bool = True
) -> dict[Quantity, QuantityBound]:
    """Bounds of every quantity after the last frame.

    Where a quantity is determined in principle only, a longer flight is tried if ``longer``.
    """
    counts = undetermined_directions(case)
    last = len(reference.time) - 1
    found = _taken_apart(bound.covariances[last], bound.widened[last], reference, last, counts)
    waiting = [name for name, each in found.items() if each.in_principle_only]
    if not waiting or not longer:
        return found
    factors = _times_longer(case, reference, bound, counts, waiting)
    return {name: _with_factor(each, name, *factors) for name, each in found.items()}


def undetermined_directions(case: Case) -> dict[Quantity, int]:
    """Exact undetermined directions of each quantity.

    No derivative of any order shows them; with g where it is defined to be.
    An attitude later on is undetermined where the rate is, and a place where the velocity is.
    """
    space, layout = _null_space(case), case.layout
    names = {block: space[_range(layout, block)] for block in layout.blocks}
    rows = {name: names[block] for block, name in BLOCK_NAMES.items() if block in layout.blocks}
    rows[ATTITUDE] = np.concatenate([names["a"], names["w"]])
    if layout.translates:
        rows[PLACE] = np.concatenate([_place_change(case, space), names["v"]])
    mass = _mixing_components(case)
    rows[MOMENTS] = names["s"][mass]
    if case.has_torque:
        rows[EACH_MOMENT] = np.concatenate([names["s"][mass], space[layout.error_dim :]])
    return {name: min(rank_of(part), 2 if name == MOMENTS else 3) for name, part in rows.items()}


def _taken_apart(
    covariance: Float[np.ndarray, "e e"],
    widened: Float[np.ndarray, "e e"],
    reference: ReferenceTrajectory,
    frame: int,
    counts: Mapping[Quantity, int],
) -> dict[Quantity, QuantityBound]:
    """Bounds of every quantity in a frame, from the state's covariance there and from that of widened priors."""
    jacobian = quantity_jacobian(reference.process.layout, reference, frame)
    found = {}
    for name, rows in jacobian.items():
        narrow, wide = (rows @ part @ rows.T for part in (covariance, widened))
        found[name] = _quantity_bound(narrow, wide, counts[name])
    return found


def _quantity_bound(
    narrow: Float[np.ndarray, "k k"], wide: Float[np.ndarray, "k k"], undetermined: int
) -> QuantityBound:
    size = len(narrow)
    floor = ROUNDING * np.trace(wide) / size * np.eye(size)
    growth, vectors = eigh(wide + floor, narrow + floor)
    shares = prior_share(growth)
    count = max(int((shares >= PRIOR_ONLY).sum()), undetermined)
    spread = (
        narrow @ vectors
    )  # a vector v weighs components; what is uncertain lies along the covariance times v
    basis = np.linalg.qr(spread[:, ::-1] / np.linalg.norm(spread[:, ::-1], axis=0))[0].T
    return QuantityBound(
        std=_deviation(narrow, np.eye(size)),
        dimension=size,
        prior_directions=_readable(basis[:count]),
        std_along=_deviation(narrow, basis[:count]),
        std_across=_deviation(narrow, basis[count:]),
        remains=float(shares[: size - count].max(initial=0.0)),
        undetermined=undetermined,
    )


def _readable(rows: Float[np.ndarray, "k d"]) -> Float[np.ndarray, "k d"]:
    """A readable orthonormal basis of the same directions.

    The axes among them come first, and largest entries are positive.
    """
    projector, found = rows.T @ rows, []
    for axis in np.argsort(-np.diag(projector), kind="stable"):
        rest = projector[axis] - sum((each * each[axis] for each in found), np.zeros(len(projector)))
        if len(found) < len(rows) and np.linalg.norm(rest) > SAME_DIRECTION:
            found.append(rest / np.linalg.norm(rest))
    return np.array([each * np.sign(each[np.abs(each).argmax()]) for each in found]).reshape(
        -1, rows.shape[1]
    )


def _deviation(covariance: Float[np.ndarray, "k k"], rows: Float[np.ndarray, "n k"]) -> float:
    return float(np.sqrt(np.trace(rows @ covariance @ rows.T) / len(rows))) if len(rows) else 0.0


def _times_longer(
    case: Case,
    reference: ReferenceTrajectory,
    bound: Bound,
    counts: Mapping[Quantity, int],
    waiting: Sequence[Quantity],
) -> tuple[dict[Quantity, float], float]:
    """The factor of the length that leaves a quantity to data.

    The first of the factors 2, 4, ..., and the largest that may be tried: none after every quantity that waits has its own.
    """
    frames, interval = len(reference.time), float(reference.time[-1] / max(1, len(reference.time) - 1))
    most = int(min(LONGEST_FACTOR * frames, MOST_EPOCHS, MOST_WORK / len(bound.prior_std) ** 2))
    factors = [2**k for k in range(1, 7) if 2**k * frames <= most]
    found: dict[Quantity, float] = {}
    if not factors or frames < 2:
        return found, 1.0
    long = case.reference(factors[-1] * frames, interval)
    ends = [factor * frames - 1 for factor in factors]
    for factor, end, parts in zip(
        factors, ends, case.later_covariances(long, ends, bound.prior_std), strict=False
    ):
        later = _taken_apart(*parts, long, end, counts)
        for name in waiting:
            each = later[name]
            if not each.in_principle_only and each.remains <= HALVED:
                found.setdefault(name, float(factor))
        if len(found) == len(waiting):
            break
    return found, float(factors[-1])


def _with_factor(
    each: QuantityBound, name: Quantity, factors: Mapping[Quantity, float], searched: float
) -> QuantityBound:
    if not each.in_principle_only:
        return each
    return replace(each, times_longer=factors.get(name, np.inf), searched=searched)


def _null_space(case: Case) -> Num[np.ndarray, "n d"]:
    """Null directions that leave definitions alone, as residues.

    Over the error of the filters' state and the scale of the inertia.
    """
    system = case.filter_system
    point = point_of(system.chart, case.motion)
    exact = body_rank(system, point, STEADY_ORDERS, case.experiments)
    space = exact.null_space[: system.chart.error_dim]
    if not case.defined or not space.shape[1]:
        return space
    combinations = null_vectors(
        reduce_columns(space[np.newaxis, list(case.defined)], space.shape[1]), space.shape[1]
    )
    return product_of(space, combinations)


def _place_change(case: Case, space: Num[np.ndarray, "n d"]) -> Num[np.ndarray, "3 d"]:
    """Change of the centre of mass's place along null directions."""
    chart = case.filter_system.chart
    system = System(chart, [SystemSensor(_CentreOfMass(case.layout), ((Fraction(0),),))])
    (rows,) = gradient_rows(flow_of_system(system, point_of(chart, case.motion), FIELD), 1)
    return product_of(rows.families[0][0], space)


class _CentreOfMass(MeasurementModel):
    """t + R_ig c as if it were measured; its one parameter is not read."""

    name, dim, value_dim, parameter_dim, needs = "centre of mass", 3, 3, 1, ("t", "a", "c")

    def symbolic(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Centre of mass in frame i, t + R_ig c, m."""
        return state["t"] + rotate(state["q"], state["c"])

    def noise_factor(self, state: dict[str, Expression], parameters: Expression) -> Expression:
        """Unit covariance factor: 1 m along each axis."""
        return ca.DM.eye(3)


def _mixing_components(case: Case) -> list[int]:
    """Components of the mass distribution that set the moments, or mix axes whose moments are equal."""
    return [0, 1, *[component for pair, component in MIXING.items() if equal_moments(case.motion, *pair)]]


def _range(layout: StateLayout, block: str) -> list[int]:
    where = layout.slice(block)
    return list(range(where.start, where.stop))
