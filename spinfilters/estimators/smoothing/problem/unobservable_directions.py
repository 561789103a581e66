"""Findings of unobservable directions of a linear problem.

Directions in which the measurements add nothing to the prior.
A direction of the first state counts as undetermined when its standard deviation is still most of the prior's. The pose of the
first epoch is left out: it defines frame g and is not measured.
"""

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.smoothing.factors.variable_ordering import VariableOrdering
from spinfilters.estimators.smoothing.linear.marginals import Marginals
from spinfilters.estimators.smoothing.problem.least_squares import (
    LinearizationPoint,
    NormalEquations,
    Problem,
)
from spinfilters.linear_algebra.signs import with_largest_positive
from spinfilters.state.block import StateBlock
from spinfilters.state.blocks.rigid_body import CENTRE_OF_MASS, MASS_DISTRIBUTION, RATE
from spinfilters.state.layout import POSE_BLOCKS
from spinfilters.state.quantities import NOTHING, OF_BLOCKS
from spinfilters.state.status import Finding

LEFT = 0.7
"""Of the prior's standard deviation, above which nothing has been learnt."""
ALONG = 0.95
"""Cosine of the angle within which a direction is called an axis."""
CHECK = "unobservable"
"""Name of the check in the verdict."""
CURES = {
    MASS_DISTRIBUTION.name: "record a motion that wobbles",
    CENTRE_OF_MASS.name: "record a rotation about more than one axis",
}
"""By block; other constants need more data."""
MORE_DATA = "give a longer recording, or leave it out of the state"


def unobservable_directions(
    problem: Problem, here: LinearizationPoint, normal: NormalEquations, marginals: Marginals | None = None
) -> list[Finding]:
    """Findings of unobservable directions; empty when there are none.

    Parameters
    ----------
    normal: the linear problem about ``here``.   marginals: of its solution, where they are at hand.
    """
    solution = normal.solution
    if solution is None:
        name = component_name(problem.ordering, normal.unobservable)
        return [Finding(CHECK, f"{name} is not determined by any measurement")]
    prior = problem.motion.prior
    if prior is None:
        return []
    layout, first, std = problem.layout, here.trajectory[0], np.linalg.norm(prior.factor, axis=1)
    rows = (marginals or Marginals(solution, None)).epoch_rows(0)
    covariance = rows @ rows.T
    axis = first[layout.mean_slice(RATE.name)] if layout.has(RATE) else np.zeros(3)
    findings: list[Finding] = []
    for block in layout.members:
        if block.name not in POSE_BLOCKS:
            at = layout.slice(block.name)
            own = covariance[at, at] / np.outer(std[at], std[at])
            findings += _findings(block, own, axis)
    return findings


def component_name(ordering: VariableOrdering, number: int) -> str:
    """Name of an unknown by its number in elimination order."""
    v, p = len(ordering.tridiagonal), len(ordering.pose)
    assembled, has_landmarks = ordering.epochs * v, ordering.epochs * p
    if number < assembled:
        component, where = ordering.tridiagonal[number % v], f" in epoch {number // v}"
    elif number < assembled + has_landmarks:
        component, where = ordering.pose[(number - assembled) % p], f" in epoch {(number - assembled) // p}"
    else:
        component, where = (
            ordering.constant[min(number - assembled - has_landmarks, len(ordering.constant) - 1)],
            "",
        )
    return ordering.layout.block_of(int(component)).phrase + where


def _findings(
    block: StateBlock, covariance: Float[np.ndarray, "b b"], axis: Float[np.ndarray, " 3"]
) -> list[Finding]:
    """Findings of one block whose covariance is in units of the prior's."""
    values, vectors = np.linalg.eigh(covariance)
    left = values > LEFT**2
    count, size = int(left.sum()), len(values)
    if not count:
        return []
    name = "the inertia" if block == MASS_DISTRIBUTION else block.phrase
    sentence = f"{name} is not determined: the data constrain {size - count} of its {size} parameters"
    if count == size:
        sentence = f"{name} is not determined by any measurement"
    elif size == 3 and count == 1:
        sentence = f"{name} is not determined {_direction(vectors[:, left][:, 0], axis)}"
    return [
        Finding(
            f"{CHECK}:{block.name}",
            sentence,
            CURES.get(block.name, MORE_DATA),
            {"constrained": size - count, "parameters": size},
            OF_BLOCKS.get(block.name, NOTHING),
        )
    ]


def _direction(vector: Float[np.ndarray, " 3"], axis: Float[np.ndarray, " 3"]) -> str:
    length = float(np.linalg.norm(axis))
    if length > 0 and abs(float(vector @ axis)) > ALONG * length:
        return "along the axis of rotation"
    x, y, z = with_largest_positive(vector)
    return f"along ({x:.2f}, {y:.2f}, {z:.2f}) in frame g"
