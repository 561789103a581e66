"""Fixed-interval smoothing of a filter's history: the backward pass of Rauch, Tung and Striebel on the error state.

With the filtered belief (x, P = S S') of an epoch, the step x' = f(x), its transition F and noise G G' = Q, the predicted belief is
P' = F P F' + Q. What later measurements say of the next epoch, an error d about x' with the covariance T T', then gives

    A = P F' P'^-1,   e = A d,   P_s = (I - A F) P (I - A F)' + A (Q + T T') A'

(Rauch, Tung, Striebel 1965, Eqs 3.29 to 3.31, in Joseph form). Every covariance is a sum of squares, so that none becomes
indefinite. Errors are folded into the means, and covariances move with the derivative of each reset. All models are linearised
where the filter linearised them: what a smoother by least squares gains beyond this is what its repeated linearisation is worth.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from spinfilters.core.linear_algebra import dtrtrs
from spinfilters.filters.estimator import ProcessModel
from spinfilters.filters.history import EstimateHistory
from spinfilters.filters.square_root import triangular_factor
from spinfilters.models.state_layout import Gaussian


def smooth_backwards(process: ProcessModel, filtered: EstimateHistory) -> EstimateHistory:
    """Every epoch of a filter's history given all measurements of the history.

    Parameters
    ----------
    process : ProcessModel
        That the filter predicted with, at the stated noise.
    filtered : EstimateHistory
        Beliefs after each epoch's measurements, in the order of time.

    Returns
    -------
    EstimateHistory
        The same epochs, with smoothed means and covariance factors. Innovations belong to the filter and are left out.

    Raises
    ------
    numpy.linalg.LinAlgError
        A predicted covariance is singular to rounding.
    """
    if len(filtered.time) < 2:
        return filtered
    mean, factor = filtered.mean.copy(), filtered.factor.copy()
    for k in range(len(mean) - 2, -1, -1):
        dt = float(filtered.time[k + 1] - filtered.time[k])
        later = Gaussian(filtered.layout, mean[k + 1], factor[k + 1])
        here = smooth_step(process, filtered.belief(k), dt, later)
        mean[k], factor[k] = here.mean, here.factor
    nothing = np.zeros(len(mean))
    return replace(
        filtered, mean=mean, factor=factor, nis=nothing, dof=nothing.astype(int), log_likelihood=nothing
    )


def smooth_step(process: ProcessModel, filtered: Gaussian, dt: float, later: Gaussian) -> Gaussian:
    """The belief of one epoch given all measurements, from the smoothed belief of the next.

    Parameters
    ----------
    filtered : Gaussian
        Belief given the measurements up to its own epoch.
    dt : float
        Time to the next epoch, s; positive.
    later : Gaussian
        Smoothed belief of the next epoch.
    """
    layout, S = filtered.layout, filtered.factor
    predicted, F, G = process.linearise(filtered.mean, dt)
    moved = F @ S
    L = triangular_factor(np.concatenate([moved, G], axis=1).T)
    gain = S @ _solve_lower(L, moved).T  # A = P F' L^-T L^-1, here without its last factor
    gain = _solve_lower(L, gain.T, transposed=True).T
    d = layout.local(predicted, later.mean)
    # Errors about the later mean, referred to the predicted mean: the inverse of that reset.
    T = np.linalg.solve(layout.reset_jacobian(d), later.factor)
    e = gain @ d
    rows = np.concatenate([S - gain @ moved, gain @ G, gain @ T], axis=1)
    return Gaussian(
        layout,
        layout.retract(filtered.mean, e),
        triangular_factor((layout.reset_jacobian(e) @ rows).T),
    )


def _solve_lower(
    L: Float[np.ndarray, "n n"], rows: Float[np.ndarray, "n k"], transposed: bool = False
) -> Float[np.ndarray, "n k"]:
    """L^-1 rows, or L^-T rows."""
    found, info = dtrtrs(L, rows, lower=1, trans=int(transposed))
    if info != 0:
        raise np.linalg.LinAlgError("a predicted covariance is singular")
    return found
