"""What of a bound the data tell and what rests on priors, quantity by quantity, against what is determined in principle."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Num
from scipy.linalg import eigh

from observability.bounds.cramer_rao import Bound, prior_share
from observability.bounds.flight import Flight
from observability.bounds.quantities import (
    BLOCK_NAMES,
    EACH_MOMENT,
    MOMENTS,
    PLACE,
    Quantity,
    quantity_slopes,
)
from observability.cases import Case
from observability.certificate import STEADY_ORDERS, joined
from observability.codistribution import codistribution
from observability.elimination import (
    FIELD,
    Elimination,
    eliminate,
    null_vectors,
    product_of,
    rank_of,
    reduce_columns,
)
from observability.motions import point_of
from spinfilters.state.layout import StateLayout

PRIOR_ONLY = 0.9
"""Share of the prior's deviation from which a direction counts as told by the prior alone."""
HALVED = 0.5
"""Share that a longer flight has to bring the prior down to."""
ROUNDING = 1e-13
"""Of the largest variance of a quantity: what is below it is no difference between two bounds."""
LONGEST_FACTOR, MOST_FRAMES, MOST_WORK = 64, 5000, 5e6
"""Of a longer flight: times the flight's own frames; frames; frames times the square of the unknowns (some seconds)."""
DIAGONAL = {(0, 1): 2, (0, 2): 3, (1, 2): 4}
"""Component of the mass distribution's error that mixes two principal axes; the first two are on the diagonal."""


@dataclass(frozen=True)
class QuantityBound:
    """One quantity's bound, taken apart.

    Attributes
    ----------
    std: root mean square over components.   dimension: components.
    prior_directions: (k, dimension) orthonormal rows, along which the prior alone speaks.
    std_along, std_across: root mean square along them and across them, 0 where there is no such direction.
    remains: largest share of the prior's deviation that remains across them.
    undetermined: how many directions the sensors do not determine, exactly, however long they look.
    times_longer: factor of the flight's length that halves the prior's deviation in all other directions; None where the data tell
        them already.
    searched: largest factor that was tried; a ``times_longer`` of infinity means beyond it.
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
        """Whether the prior tells more than what is not determined."""
        return len(self.prior_directions) > self.undetermined


def quantity_bounds(case: Case, flight: Flight, bound: Bound) -> dict[Quantity, QuantityBound]:
    """Of every quantity after the last frame; a longer flight is tried where a quantity is determined in principle only."""
    counts = undetermined_directions(case)
    found = _taken_apart(bound, flight, len(flight.time) - 1, counts)
    waiting = [name for name, each in found.items() if each.in_principle_only]
    if not waiting:
        return found
    longer = _times_longer(case, flight, bound, counts)
    return {name: _with_factor(each, name, longer) for name, each in found.items()}


def undetermined_directions(case: Case) -> dict[Quantity, int]:
    """Of each quantity, directions that no derivative of any order shows, with g where it is defined to be; exact."""
    null_space = _null_space(case)
    rows = _components(case)
    return {name: min(rank_of(null_space[parts]), _dimension(name)) for name, parts in rows.items()}


def _taken_apart(
    bound: Bound, flight: Flight, frame: int, counts: Mapping[Quantity, int]
) -> dict[Quantity, QuantityBound]:
    slopes = quantity_slopes(bound.layout, flight, frame)
    parts = (bound.covariances[frame], bound.widened[frame])
    return {
        name: _quantity_bound(*[rows @ part @ rows.T for part in parts], counts[name])
        for name, rows in slopes.items()
    }


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
    along = (
        basis[:count] * np.sign(basis[:count][range(count), np.abs(basis[:count]).argmax(axis=1)])[:, None]
    )
    return QuantityBound(
        std=_deviation(narrow, np.eye(size)),
        dimension=size,
        prior_directions=along,
        std_along=_deviation(narrow, basis[:count]),
        std_across=_deviation(narrow, basis[count:]),
        remains=float(shares[: size - count].max(initial=0.0)),
        undetermined=undetermined,
    )


def _deviation(covariance: Float[np.ndarray, "k k"], rows: Float[np.ndarray, "n k"]) -> float:
    return float(np.sqrt(np.trace(rows @ covariance @ rows.T) / len(rows))) if len(rows) else 0.0


def _times_longer(
    case: Case, flight: Flight, bound: Bound, counts: Mapping[Quantity, int]
) -> tuple[dict[Quantity, float], float]:
    """The first of the factors 2, 4, ... that leaves a quantity to the data, and the largest that was tried."""
    frames, interval = len(flight.time), float(flight.time[-1] / max(1, len(flight.time) - 1))
    most = int(min(LONGEST_FACTOR * frames, MOST_FRAMES, MOST_WORK / len(bound.prior_std) ** 2))
    factors = [2**k for k in range(1, 7) if 2**k * frames <= most]
    found: dict[Quantity, float] = {}
    if not factors or frames < 2:
        return found, 1.0
    long = case.flight(factors[-1] * frames, interval)
    limits = case.bound(long)
    for factor in factors:
        later = _taken_apart(limits, long, factor * frames - 1, counts)
        for name, each in later.items():
            if not each.in_principle_only and each.remains <= HALVED:
                found.setdefault(name, float(factor))
    return found, float(factors[-1])


def _with_factor(
    each: QuantityBound, name: Quantity, longer: tuple[dict[Quantity, float], float]
) -> QuantityBound:
    if not each.in_principle_only:
        return each
    factors, searched = longer
    return replace(each, times_longer=factors.get(name, np.inf), searched=searched)


def _null_space(case: Case) -> Num[np.ndarray, "n d"]:
    """Residues over the error of the filters' state and the scale of the inertia: null directions that leave definitions alone."""
    system = case.filter_system
    point = point_of(system.chart, case.motion)
    experiments = list(case.experiments) or [()]
    rows = [codistribution(system, point, STEADY_ORDERS, FIELD, given) for given in experiments]
    eliminated: Elimination = eliminate([joined(parts) for parts in zip(*rows, strict=True)])
    space = eliminated.null_space()[: system.chart.error_dim]
    layout = case.layout
    fixed = [k for block in case.defined if block in layout.blocks for k in _range(layout, block)]
    if not fixed or not space.shape[1]:
        return space
    combinations = null_vectors(reduce_columns(space[np.newaxis, fixed], space.shape[1]), space.shape[1])
    return product_of(space, combinations)


def _components(case: Case) -> dict[Quantity, list[int]]:
    """Components of the error that decide each quantity: equal moments mix the axes between which they are equal."""
    layout, mass = case.layout, case.layout.slice("s").start
    found = {name: _range(layout, block) for block, name in BLOCK_NAMES.items() if block in layout.blocks}
    if "t" in layout.blocks:
        found[PLACE] = [*_range(layout, "t"), *_range(layout, "a"), *_range(layout, "c")]
    moments = case.motion.moments
    mixed = [mass + component for (a, b), component in DIAGONAL.items() if moments[a] == moments[b]]
    found[MOMENTS] = [mass, mass + 1, *mixed]
    if case.has_torque:
        found[EACH_MOMENT] = [mass, mass + 1, *mixed, layout.error_dim]
    return found


def _dimension(name: Quantity) -> int:
    return 2 if name == MOMENTS else 3


def _range(layout: StateLayout, block: str) -> list[int]:
    where = layout.slice(block)
    return list(range(where.start, where.stop))
