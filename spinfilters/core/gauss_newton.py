"""Gauss-Newton for states of few unknowns, such as the pose of one scan.

About a state x the whitened residual r = z - h(x) is linear in a small step d, r - J d, whose weighted squares are least where

    (J' W J + D) d = J' W r,   W the weights of a robust loss, D a diagonal damping.

The state moves by d, and all begins anew until d is small. What the linearisation is made of, how a state moves and which step is
small belong to the problem. The smoother has a solver of its own, which eliminates its unknowns along time, and so has every
adjustment whose many poses are eliminated before the map.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

import numpy as np
from jaxtyping import Float

from spinfilters.core.robust_losses import RobustLoss


@dataclass(frozen=True, eq=False)
class StepEquations:
    """Linearised least squares H d = b of a step d of n unknowns.

    Attributes
    ----------
    information : ndarray of shape (n, n)
        H = J' W J without damping, the inverse covariance of the state where the residuals are whitened.
    gradient : ndarray of shape (n,)
        b = J' W r, half the negative gradient of the cost.
    """

    information: Float[np.ndarray, "n n"]
    gradient: Float[np.ndarray, " n"]


def step_equations(
    residual: Float[np.ndarray, " m"], jacobian: Float[np.ndarray, "m n"], loss: RobustLoss | None = None
) -> StepEquations:
    """Normal equations of m scalar residuals.

    Parameters
    ----------
    residual : ndarray of shape (m,)
        r = z - h(x), whitened where a loss is given; finite, so that rows without a prediction are left out.
    jacobian : ndarray of shape (m, n)
        J = dh/dx.
    loss : RobustLoss or None
        Of the squared residuals; None for plain least squares.
    """
    if loss is None:
        return StepEquations(jacobian.T @ jacobian, jacobian.T @ residual)
    weight = loss.weight(residual**2)
    return StepEquations((jacobian * weight[:, None]).T @ jacobian, jacobian.T @ (weight * residual))


class LeastSquaresEnd(Enum):
    """How a Gauss-Newton iteration ended."""

    SETTLED = "the last step is small"
    UNSETTLED = "the last step allowed is not small"
    UNDETERMINED = "no step about the state: too few residuals, or singular equations"


State = TypeVar("State")
Normal = TypeVar("Normal", bound=StepEquations)


@dataclass(frozen=True, eq=False)
class GaussNewtonSolution(Generic[State, Normal]):
    """Result of `gauss_newton`.

    Attributes
    ----------
    state : State
        After the last step that was taken.
    normal : StepEquations or None
        Of the last state that was linearised, one step before; None where none was.
    end : LeastSquaresEnd
        How the iteration ended.
    """

    state: State
    normal: Normal | None
    end: LeastSquaresEnd


def gauss_newton(
    state: State,
    linearise: Callable[[State], Normal | None],
    retract: Callable[[State, Float[np.ndarray, " n"]], State],
    is_small: Callable[[Float[np.ndarray, " n"], Normal], bool],
    most_steps: int,
    damping: Callable[[Float[np.ndarray, "n n"]], Float[np.ndarray, " n"] | float] | None = None,
) -> GaussNewtonSolution[State, Normal]:
    """State of least squares, by Gauss-Newton steps from a start.

    Parameters
    ----------
    state : State
        Where the steps begin.
    linearise : callable
        Normal equations about a state; None where it determines none, which ends the iteration.
    retract : callable
        The state moved by a step.
    is_small : callable
        Whether a step, with the equations that it solves, is the last one. It is taken all the same.
    most_steps : int
        Steps at most.
    damping : callable or None
        Diagonal that is added to the information, from the information; None adds nothing.

    Returns
    -------
    GaussNewtonSolution
        Equations that are singular or not finite end the iteration at the state before, as undetermined.
    """
    normal: Normal | None = None
    for _ in range(most_steps):
        about = linearise(state)
        if about is None:
            return GaussNewtonSolution(state, normal, LeastSquaresEnd.UNDETERMINED)
        normal, H = about, about.information
        if damping is not None:
            H = H + np.diag(np.broadcast_to(damping(H), len(H)))
        try:
            step = np.linalg.solve(H, normal.gradient)
        except np.linalg.LinAlgError:
            return GaussNewtonSolution(state, normal, LeastSquaresEnd.UNDETERMINED)
        if not np.isfinite(step).all():
            return GaussNewtonSolution(state, normal, LeastSquaresEnd.UNDETERMINED)
        state = retract(state, step)
        if is_small(step, normal):
            return GaussNewtonSolution(state, normal, LeastSquaresEnd.SETTLED)
    return GaussNewtonSolution(state, normal, LeastSquaresEnd.UNSETTLED)
