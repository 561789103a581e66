"""One inertia from several recordings of one body (Tweddle 2013, section 7.2, leaves it to others).

Every recording has a belief about the mass distribution s with the error covariance P_i, from one prior of covariance P_0 about the
sphere. In axes g that all recordings share, the likeliest s is where

    sum_i d_i' P_i^-1 d_i - (n - 1) d_0' P_0^-1 d_0,   d_i = s_i [-] s, d_0 = 0 [-] s

is least: the prior, which is in every belief, counts once. So a motion that shows one direction of s only is added without its
prior in all others.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.core.chi_square import chi_square_tail
from spinfilters.core.errors import InputError
from spinfilters.models.body import BodyEstimate, body_estimate
from spinfilters.models.state_blocks import MASS_DISTRIBUTION
from spinfilters.models.state_layout import Gaussian, StateLayout

DISAGREEMENT = 0.01
"""Probability of a chi-square as large, below which recordings disagree and deviations are widened by its root per degree."""
_STEPS, _SETTLED = 50, 1e-10
_DETERMINED = 10.0  # information in terms of the prior's, from which on a recording counts for a direction


@dataclass(frozen=True, eq=False)
class FusedInertia:
    """The mass distribution by all recordings.

    Attributes
    ----------
    belief : Gaussian
        Over the block s alone, widened where the recordings disagree.
    chi_square : float
        Of the recordings about it, of ``degrees`` degrees of freedom: the directions that they determine beyond one each.
    recordings : int
        How many there are.
    """

    belief: Gaussian
    chi_square: float
    degrees: int
    recordings: int

    @property
    def probability(self) -> float:
        """Probability of a chi-square as large, 1 for a single recording."""
        return float(chi_square_tail(self.chi_square, self.degrees)) if self.degrees else 1.0

    @property
    def widening(self) -> float:
        """Factor on the deviations: 1 where the recordings agree."""
        return widening_factor(self.chi_square, self.degrees)

    @property
    def body(self) -> BodyEstimate:
        """Moments and axes with their deviations."""
        return body_estimate(self.belief)


def widening_factor(chi_square: float, degrees: int) -> float:
    """Factor on the deviations of a mean of recordings: 1 where they agree, the root of chi-square per degree where not."""
    if not degrees or chi_square_tail(chi_square, degrees) >= DISAGREEMENT:
        return 1.0
    return float(np.sqrt(chi_square / degrees))


def mass_belief(belief: Gaussian) -> Gaussian:
    """The belief about the mass distribution alone, in axes g.

    Raises
    ------
    InputError
        A state without mass distribution, or a belief that is not finite.
    """
    layout = belief.layout
    if not layout.has(MASS_DISTRIBUTION):
        raise InputError("the state has no mass distribution")
    factor = belief.factor[layout.slice(MASS_DISTRIBUTION.name)]
    mean = belief.mean[layout.mean_slice(MASS_DISTRIBUTION.name)]
    if not (np.isfinite(factor).all() and np.isfinite(mean).all()):
        raise InputError("the mass distribution is not finite")
    return Gaussian.from_covariance(StateLayout((MASS_DISTRIBUTION.name,)), mean, factor @ factor.T)


def fuse_inertias(beliefs: Sequence[Gaussian], prior_std: float) -> FusedInertia:
    """The likeliest mass distribution of several independent recordings of one body.

    Parameters
    ----------
    beliefs : sequence of Gaussian
        Of `mass_belief`, at least one, in common axes g.
    prior_std : float
        Deviation of each of the five numbers about the sphere that every belief began from.

    Returns
    -------
    FusedInertia
        With how well the recordings agree.

    Raises
    ------
    InputError
        No belief, one of another layout or a singular one, or recordings that contradict one another by so much that no
        inertia is between them.
    """
    if not beliefs:
        raise InputError("there is no recording to fuse; give at least one")
    layout, others = beliefs[0].layout, len(beliefs) - 1
    prior = Gaussian(layout, layout.origin(), prior_std * np.eye(layout.error_dim))
    known = [_information(belief) for belief in beliefs]
    terms = [*zip(beliefs, known, np.ones(len(beliefs)), strict=True), (prior, _information(prior), -others)]
    mean = beliefs[int(np.argmax([np.linalg.eigvalsh(each)[0] for each in known]))].mean
    H, cost = np.zeros((layout.error_dim, layout.error_dim)), 0.0
    for _ in range(_STEPS):
        H, b, cost = 0 * H, np.zeros(layout.error_dim), 0.0
        for belief, information, count in terms:
            # d_i about the mean moves by G^-1 with the step, G the derivative of the error about the mean by that about s_i
            apart = layout.local(belief.mean, mean)
            back = np.linalg.inv(layout.reset_jacobian(apart))
            H += count * back.T @ information @ back
            b -= count * back.T @ information @ apart
            cost += count * float(apart @ information @ apart)
        if not np.linalg.eigvalsh(H)[0] > 0:
            raise InputError(
                "together the recordings determine less than the prior alone; give recordings of motions that wobble"
            )
        step = np.linalg.solve(H, b)
        mean = layout.retract(mean, step)
        if np.linalg.norm(step) < _SETTLED:
            break
    else:
        raise InputError(
            "the recordings contradict one another: no inertia lies between them; fuse fewer of them"
        )
    determined = [
        int(np.count_nonzero(np.linalg.eigvalsh(each) > _DETERMINED / prior_std**2)) for each in (*known, H)
    ]
    degrees = max(sum(determined[:-1]) - determined[-1], 0)
    square = max(cost, 0.0)
    covariance = widening_factor(square, degrees) ** 2 * np.linalg.inv(H)
    belief = Gaussian.from_covariance(layout, mean, (covariance + covariance.T) / 2)
    return FusedInertia(belief, square, degrees, len(beliefs))


def _information(belief: Gaussian) -> Float[np.ndarray, "n n"]:
    """Inverse covariance. InputError: a singular one."""
    try:
        root = np.linalg.inv(belief.factor)
    except np.linalg.LinAlgError:
        raise InputError("the covariance of a mass distribution is singular") from None
    return root.T @ root
