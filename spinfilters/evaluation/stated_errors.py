"""Errors in stated standard deviations, and how far what an estimator states is from a sampled posterior.

The errors are of every quantity over time, and of the published estimate at the end.

Of every component of a quantity after the last epoch the posterior is a mixture of Gaussians (`StateMixture`). An estimator states
a Gaussian N(mu, sigma^2) of it. With the posterior's mean and deviation m, s the divergence is, in nats,

    KL(N(m, s^2) || N(mu, sigma^2)) = ln(sigma / s) + (s^2 + (m - mu)^2) / (2 sigma^2) - 1/2,

and the tail is the posterior probability outside the stated central 95 %, which should be 5 %. Of both the component counts that is
farthest away.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import rotation_between
from spinfilters.core.conventions import PerRun
from spinfilters.core.mass_distribution import inertia_matrices, inertia_matrix
from spinfilters.evaluation.consistency import knows_state, true_states
from spinfilters.evaluation.estimated_motion import trajectory_of
from spinfilters.evaluation.estimator_evaluation import Evaluation, PosteriorDistance
from spinfilters.evaluation.trajectory_errors import Alignment, common_stamps
from spinfilters.filters.history import EstimateHistory, history_at
from spinfilters.models.body import turn_of_axes
from spinfilters.models.state_blocks import CENTRE_OF_MASS, MASS_DISTRIBUTION
from spinfilters.models.state_mixture import StateMixture, mixture_probability, mixture_quantiles
from spinfilters.models.status import ATTITUDE, AXES, CENTRE, MOMENTS, POSITION, RATE, VELOCITY

LARGEST_STATED_ERROR: Final = 4.0
"""Stated standard deviations, beyond which an error belies the verdict ``ok``."""
RATIOS: Final = "ratios"
"""Name of the errors of k1 and k2."""


def stated_errors(evaluation: Evaluation) -> dict[str, PerRun]:
    """Largest error component of each published quantity after the last epoch, in its stated standard deviations.

    Parameters
    ----------
    evaluation : Evaluation
        Compared with a truth; without one there are no errors.

    Returns
    -------
    dict[str, PerRun]
        By the name of a block of the state (without the mass distribution, which no file holds), and "moments", "ratios"
        and "axes"; infinite where error or deviation are not finite.
    """
    return _block_errors(evaluation) | {
        name: error for name, error in _body_errors(evaluation).items() if name != CENTRE
    }


def quantity_errors(evaluation: Evaluation) -> dict[str, Float[np.ndarray, " n"]]:
    """Largest error component of each quantity in its stated standard deviations, at the n own epochs with a truth.

    Parameters
    ----------
    evaluation : Evaluation
        Compared with a truth; without one there are no errors.

    Returns
    -------
    dict[str, (n,) float array]
        By the quantities of `spinfilters.models.status`; of moments, axes and centre of mass after the last epoch alone.
        Infinite where error or deviation are not finite. A fit of both frames g hides errors of attitude and axes, which
        are left out then.
    """
    errors, begin = evaluation.errors, evaluation.own_begin
    own = None if errors is None or begin is None else errors.within(begin, np.inf)
    if own is None:
        return {}
    motion, fitted = evaluation.trajectory, evaluation.alignment is Alignment.BODY_FRAME
    pairs = {
        POSITION: (own.position, motion.std_position),
        ATTITUDE: (None if fitted else own.attitude, motion.std_attitude),
        VELOCITY: (own.velocity, motion.std_velocity),
        RATE: (own.rate, motion.std_rate),
    }
    found = {
        name: _largest(error, std[own.rows]) for name, (error, std) in pairs.items() if error is not None
    }
    body = _body_errors(evaluation)
    if RATIOS in body:
        body[MOMENTS] = max(body[MOMENTS], body.pop(RATIOS))
    return found | {name: np.array([error]) for name, error in body.items()}


def _block_errors(evaluation: Evaluation) -> dict[str, PerRun]:
    """Errors of the state after the last epoch by block, where the truth holds every block."""
    history, layout, error = evaluation.history, evaluation.history.layout, evaluation.last_error
    if error is None:
        truth = evaluation.truth
        if truth is None or not knows_state(truth, layout):
            return {}
        _, rows = common_stamps(history.time[-1:], truth.time)
        true = evaluation.truth_in_own_frames_at(rows)
        if true is None:
            return {}
        if not np.isfinite(history.mean[-1]).all():
            return {"state": np.inf}
        error = layout.local(history.mean[-1], true_states(true, layout)[0])
    shares = _shares(error, np.linalg.norm(history.factor[..., -1, :, :], axis=-1))
    named = [block for block in layout.blocks if block != MASS_DISTRIBUTION.name]
    return {block: shares[..., layout.slice(block)].max(axis=-1) for block in named}


def _body_errors(evaluation: Evaluation) -> dict[str, PerRun]:
    """Errors of the mass properties after the last epoch."""
    errors, body = evaluation.body_errors, evaluation.body
    if errors is None:
        return {}
    pairs = {}
    if errors.principal_moments is not None and errors.k1 is not None and errors.k2 is not None:
        pairs[MOMENTS] = errors.principal_moments[..., :2], body.principal_moments_std[..., :2]
        pairs[RATIOS] = (
            np.stack([errors.k1, errors.k2], axis=-1),
            np.stack([body.k1_std, body.k2_std], axis=-1),
        )
    if errors.axes_angle is not None and evaluation.alignment is not Alignment.BODY_FRAME:
        variances = np.square(body.principal_axes_std)  # an axis moves by rotations about both others
        pairs[AXES] = errors.axes_angle, np.sqrt(variances.sum(axis=-1, keepdims=True) - variances)
    if errors.center_of_mass_g is not None and body.center_of_mass_std is not None:
        pairs[CENTRE] = errors.center_of_mass_g, body.center_of_mass_std
    return {name: _largest(*pair) for name, pair in pairs.items()}


def _largest(error: Float[np.ndarray, "*n c"], std: Float[np.ndarray, "*n c"]) -> Float[np.ndarray, "*n"]:
    return _shares(error, std).max(axis=-1)


def _shares(error: Float[np.ndarray, "*n"], std: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Errors in standard deviations, infinite where that is not a finite number."""
    with np.errstate(all="ignore"):
        value = np.abs(error / np.where(std > 0, std, np.nan))
    return np.where(np.isfinite(value), value, np.inf)


LEVELS: Final = (0.025, 0.25, 0.5, 0.75, 0.975)
"""Of published quantiles."""
STATED: Final = 1.959964
"""Deviations of a Gaussian's central 95 %."""
SMALLEST_TAIL: Final = 1e-9
"""Probability below which nothing is outside: some hundred samples do not resolve smaller ones."""


@dataclass(frozen=True)
class QuantityMixture:
    """Mixture of Gaussians of each component of a quantity.

    Attributes
    ----------
    values, std : (n, c) float arrays
        Means and deviations of the components of the mixture, in the quantity's unit; of axes and attitudes, rotation vectors about
        a reference.
    weights : (n,) float array
        Their sum is one.
    """

    values: Float[np.ndarray, "n c"]
    std: Float[np.ndarray, "n c"]
    weights: Float[np.ndarray, " n"]

    @property
    def mean(self) -> Float[np.ndarray, " c"]:
        """Mean of each component."""
        return self.weights @ self.values

    @property
    def deviation(self) -> Float[np.ndarray, " c"]:
        """Standard deviation of each component."""
        return np.sqrt(self.weights @ (np.square(self.values - self.mean) + np.square(self.std)))

    def quantiles(self, levels: Sequence[float] = LEVELS) -> Float[np.ndarray, "c q"]:
        """Quantiles of each component."""
        pairs = zip(self.values.T, self.std.T, strict=True)
        return np.array([mixture_quantiles(np.array(levels), *pair, self.weights) for pair in pairs])

    def outside(self, low: Float[np.ndarray, " c"], high: Float[np.ndarray, " c"]) -> Float[np.ndarray, " c"]:
        """Probability of each component outside an interval, to `SMALLEST_TAIL`, which rounding of sums does not reach."""
        found = []
        for k, (left, right) in enumerate(zip(low, high, strict=True)):
            values, std = self.values[:, k], self.std[:, k]
            below = mixture_probability(np.array([left]), values, std, self.weights)
            above = mixture_probability(np.array([-right]), -values, std, self.weights)  # mirrored: no 1 - p
            found.append(below[0] + above[0])
        tails = np.clip(found, 0.0, 1.0)
        return np.where(tails < SMALLEST_TAIL, 0.0, tails)


def posterior_quantities(posterior: StateMixture, reference: EstimateHistory) -> dict[str, QuantityMixture]:
    """Mixtures of the published quantities after the last epoch, by the names of `spinfilters.models.status`.

    Parameters
    ----------
    reference : EstimateHistory
        Attitude and axes are rotation vectors about those of its last epoch; of its layout.
    """
    layout, weights = posterior.layout, posterior.weights
    count = len(weights)
    last = history_at(reference, np.full(count, -1))
    motion = trajectory_of(replace(last, mean=posterior.means, factor=posterior.factors))
    about = reference.mean[-1, layout.mean_slice("a")]
    turns = rotation_between(about[np.newaxis], motion.q_ig)
    points, point_weights = posterior.mass_points, posterior.mass_weights
    if points is None or point_weights is None:
        points, point_weights = posterior.means[:, layout.mean_slice("s")], weights
    moments, axes = _bodies(points, reference.mean[-1, layout.mean_slice("s")])
    logs = np.log(moments[:, [2, 1]] / moments[:, [1, 0]])
    shapes = np.concatenate([moments[:, :2], logs], axis=1)
    found = {
        ATTITUDE: (turns, motion.std_attitude),
        RATE: (motion.rate_i, motion.std_rate),
        MOMENTS: (shapes, np.zeros_like(shapes)),
        AXES: (axes, np.zeros_like(axes)),
    }
    if motion.sees_position:
        found[POSITION] = motion.position, motion.std_position
        found[VELOCITY] = motion.velocity, motion.std_velocity
    if layout.has(CENTRE_OF_MASS):
        centre = posterior.means[:, layout.mean_slice(CENTRE_OF_MASS.name)]
        std = np.linalg.norm(posterior.factors[:, layout.slice(CENTRE_OF_MASS.name)], axis=2)
        found[CENTRE] = centre, std
    return {
        name: QuantityMixture(values, std, point_weights if name in (MOMENTS, AXES) else weights)
        for name, (values, std) in found.items()
    }


def posterior_distances(evaluation: Evaluation, posterior: StateMixture) -> dict[str, PosteriorDistance]:
    """Distances of one estimator's belief after the last epoch, by quantity; empty of another state or of no finite belief."""
    history = evaluation.history
    if history.layout != posterior.layout or not np.isfinite(history.factor[-1]).all():
        return {}
    quantities, stated = posterior_quantities(posterior, history), stated_beliefs(evaluation)
    return {name: _distance(mixture, *stated[name]) for name, mixture in quantities.items()}


def with_posterior_distances(evaluations: Sequence[Evaluation]) -> list[Evaluation]:
    """Evaluations with their distances from the posterior, where an estimator has sampled it."""
    sampled = (each.history.posterior for each in evaluations if not each.history.has_failed)
    posterior = next((each for each in sampled if each is not None), None)
    if posterior is None:
        return list(evaluations)
    return [each.with_fields(distances=posterior_distances(each, posterior)) for each in evaluations]


def stated_beliefs(
    evaluation: Evaluation,
) -> Mapping[str, tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"]]]:
    """Mean and deviation that an estimate states of each component after the last epoch, about itself as `posterior_quantities`."""
    history, body = evaluation.history, evaluation.body
    motion = trajectory_of(history_at(history, np.array([-1])))
    nothing = np.zeros(3)
    stated = {
        ATTITUDE: (nothing, motion.std_attitude[0]),
        RATE: (motion.rate_i[0], motion.std_rate[0]),
        MOMENTS: (body.shape, body.shape_std),
        AXES: (nothing, body.principal_axes_std),
    }
    if motion.sees_position:
        stated[POSITION] = motion.position[0], motion.std_position[0]
        stated[VELOCITY] = motion.velocity[0], motion.std_velocity[0]
    if body.center_of_mass_g is not None and body.center_of_mass_std is not None:
        stated[CENTRE] = body.center_of_mass_g, body.center_of_mass_std
    return stated


def _distance(
    mixture: QuantityMixture, mean: Float[np.ndarray, " c"], std: Float[np.ndarray, " c"]
) -> PosteriorDistance:
    m, s = mixture.mean, mixture.deviation
    with np.errstate(all="ignore"):
        divergence = np.log(std / s) + (s**2 + (m - mean) ** 2) / (2 * std**2) - 0.5
        outside = mixture.outside(mean - STATED * std, mean + STATED * std)
    return PosteriorDistance(float(divergence.max()), float(outside[np.abs(outside - 0.05).argmax()]))


def _bodies(
    points: Float[np.ndarray, "n 5"], about: Float[np.ndarray, " 5"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Principal moments, largest = 1, and rotation vectors of the principal axes about those of one mass distribution."""
    _, origin = np.linalg.eigh(inertia_matrix(about))
    moments, vectors = np.linalg.eigh(inertia_matrices(points))
    axes = np.swapaxes(vectors, 1, 2)
    return moments / moments[:, 2:], turn_of_axes(np.broadcast_to(origin.T, axes.shape), axes)
