"""How far the ridge of likely mass distributions bends away from its tangent.

Where a motion hardly shows one direction of the mass distribution, its posterior is long and thin, and may be curved. A Gaussian
follows the tangent. At z deviations along it the ridge is delta(z) deviations of the Gaussian away, across. Delta grows as z^2, and
the NEES per degree of freedom of truths along the ridge is on average

    1 + E[delta^2] / 5 = 1 + (3 / 5) delta(z)^2 / z^4,

five being the dimension. One linearisation on either side tells delta: of Gauss-Newton's step from there, the part across.
"""

from typing import Final

import numpy as np

from spinfilters.models.state_blocks import MASS_DISTRIBUTION
from spinfilters.smoother.linear_system import Marginals
from spinfilters.smoother.problem import LinearProblem, Problem

ALONG: Final = 2.0
"""Deviations along the tangent at which the ridge is looked for."""
DIMENSION: Final = 5
FOURTH_MOMENT: Final = 3.0
"""Of a unit normal number."""


def expected_nees(problem: Problem, linear: LinearProblem) -> float:
    """Expected NEES per degree of freedom of the mass distribution, were truths along the bent ridge.

    One where nothing bends, or where the state has no mass distribution; infinite where the problem beside the estimate has no
    solution.

    Parameters
    ----------
    problem : Problem
        Whose rows fit in memory together, landmarks or none.
    linear : LinearProblem
        About its solution.
    """
    solution, layout = linear.normal.solution, problem.layout
    if solution is None or problem.is_long or not layout.has(MASS_DISTRIBUTION):
        return 1.0
    s = layout.slice(MASS_DISTRIBUTION.name)
    factors = Marginals(solution, linear.normal.eliminated).factors
    covariance = factors[0, s] @ factors[0, s].T
    values, vectors = np.linalg.eigh(covariance)
    if not values[0] > 0:
        return float("inf")
    softest = vectors[:, -1] * np.sqrt(values[-1])
    # one deviation along the softest direction: every epoch follows by regression, landmarks by their poses
    along = factors @ np.swapaxes(factors[:, s], 1, 2) @ np.linalg.solve(covariance, softest)
    along[:, s] = softest
    squares = []
    for z in (ALONG, -ALONG):
        points, eliminated = linear.point.points, linear.normal.eliminated
        if eliminated is not None:
            points = points + eliminated.points_step(z * along[:, problem.ordering.pose])
        trajectory = layout.retract(linear.point.trajectory, z * along)
        here = problem.at(trajectory, points, linear.normal.stage.pose_only_loss)
        beside = problem.normal(here, linear.normal.stage).solution
        if beside is None:
            return float("inf")
        step = beside.errors[0, s]
        rows = Marginals(beside, None).epoch_rows(0)[s]
        back = rows @ (rows.T @ softest)
        across = step - back * float(softest @ step) / float(softest @ back)
        squares.append(float(across @ np.linalg.solve(covariance, across)))
    return 1 + FOURTH_MOMENT / DIMENSION * float(np.mean(squares)) / ALONG**4
