"""Draws of simulation-based calibration: truth and measurements from a stated prior, and what an estimator states of the truth.

The rank of the truth in a posterior that is right is uniform (Talts et al. 2018). Each draw takes body, motion and noise from the
prior below and simulates the recording. It keeps the error, the stated deviation, the rank of the truth and scores of every
component of moments, axes, rate and centre of mass. Ranks and scores are those of the stated mixture where a deviation covers
several explanations of the measurements (`EstimateHistory.mixture`), and of a Gaussian elsewhere.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.special import chdtri, ndtr

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.evaluation.consistency import knows_state, true_states
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.recording_bound import without_bounds
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR, stated_errors
from spinfilters.evaluation.trajectory_errors import common_stamps
from spinfilters.filters.history import EstimateHistory, history_at
from spinfilters.filters.square_root import lower_roots
from spinfilters.models.body import body_estimate, turn_of_axes
from spinfilters.models.process import ProcessNoise
from spinfilters.models.status import AXES, CENTRE, MOMENTS, RATE, Verdict
from spinfilters.run.estimation import ComparisonExtent, compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate, without_noise
from spinfilters.verdict.check import LARGEST_MOMENT_STD

LOG_MOMENT_STD: Final = 0.3
"""Of the logarithms of the second moments, whose mean is removed: moments of inertia from 0.5 : 0.8 : 1 to 1 : 1 : 1 are likely."""
RATE_RPM: Final = (3.0, 12.0)
"""Least and largest rate of rotation, log-uniform; its direction is uniform."""
LEVELS: Final = {
    "gyro": {"gyro_std": (2e-4, 2e-2)},
    "attitude": {"attitude_std": (2e-3, 3e-2)},
    "pose": {"position_std": (1e-3, 2e-2), "rotation_std": (2e-3, 3e-2)},
    "lidar-points": {"lidar_range_std": (3e-3, 3e-2), "lidar_angle_std": (1e-4, 1e-3)},
    "stereo-tracks": {"pixel_std": (0.3, 2.0)},
}
"""Least and largest standard deviation of each sensor's noise, log-uniform, by field of a scenario or by noise option."""
PSD: Final = (1e-7, 1e-5)
"""Least and largest density of the disturbing torque, (rad/s^2)^2/Hz, and of the force, (m/s^2)^2/Hz; log-uniform."""
CENTRE_STD: Final = 0.02
"""Of each coordinate of the centre of mass in g, m."""
EPOCHS: Final = 100


@dataclass(frozen=True)
class CalibrationDraw:
    """What one estimator stated of one draw.

    Attributes
    ----------
    seed : int
        Of the draw.
    estimator : str
        Whose.
    verdict : str
        "ok", "degraded" or "failed".
    determined : bool
        Whether the stated deviations of the moments are at most a tenth of the largest.
    worst : float
        Largest error of a published quantity at the end, in stated deviations.
    quantities : dict
        By quantity a list of error, stated deviation and rank of the truth for each component.
    nees : dict
        NEES per degree of freedom of rate and mass distribution after the last epoch.
    scores : dict
        By quantity the CRPS and the negative log density of each component, by what is stated.
    mixture_nees : dict
        As ``nees`` by what is stated: of a mixture the chi-square number that is as improbable as a density as small.
    """

    seed: int
    estimator: str
    verdict: str
    determined: bool
    worst: float
    quantities: dict[str, list[tuple[float, float, float]]]
    nees: dict[str, float]
    scores: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    mixture_nees: dict[str, float] = field(default_factory=dict)

    @property
    def is_ok(self) -> bool:
        """Whether its verdict is ok."""
        return self.verdict == str(Verdict.OK)

    @property
    def is_right(self) -> bool:
        """Whether every published quantity is within `LARGEST_STATED_ERROR` deviations."""
        return self.worst <= LARGEST_STATED_ERROR


def drawn_scenario(sensor: str, seed: int) -> Scenario:
    """Body, motion and noise from the prior of a sensor.

    Raises
    ------
    InputError
        A sensor without a prior.
    """
    if sensor not in LEVELS:
        raise InputError(f"no prior is stated for the sensor {sensor}; choose from {', '.join(LEVELS)}")
    generator = np.random.default_rng([20261126, seed])

    def level(ends: tuple[float, float]) -> float:
        """Log-uniform between two numbers."""
        return float(np.exp(generator.uniform(*np.log(ends))))

    d = LOG_MOMENT_STD * generator.standard_normal(3)
    second = np.exp(d - d.mean())
    direction = generator.standard_normal(3)
    rates = level(RATE_RPM) * direction / np.linalg.norm(direction)
    x, y, z = (second.sum() - second).tolist()
    noise = {name: level(ends) for name, ends in LEVELS[sensor].items()}
    own = {each.name for each in fields(Scenario)}
    yaw, pitch, roll = generator.uniform(-1.0, 1.0, 3).tolist()
    u, v, w = rates.tolist()
    a, b, c = (CENTRE_STD * generator.standard_normal(3)).tolist()
    scenario = Scenario(
        kind=sensor,
        principal_moments=(x, y, z),
        rate_rpm=(u, v, w),
        axes_euler_g=(yaw, pitch, roll),
        center_of_mass_g=(a, b, c),
        epochs=EPOCHS,
        noise=ProcessNoise(force_psd=level(PSD), torque_psd=level(PSD)),
        seed=seed,
    )
    options = tuple((name, std) for name, std in noise.items() if name not in own)
    return replace(
        scenario, sensor_noise=options, **{name: std for name, std in noise.items() if name in own}
    )


def made_draws(sensor: str, seed: int, estimators: Sequence[str], stated: bool) -> list[CalibrationDraw]:
    """One draw, by every estimator; empty where the recording cannot be initialised.

    Parameters
    ----------
    stated : bool
        Whether the data set states its noise; if not, it is identified.

    Raises
    ------
    KeyboardInterrupt
        Ctrl-C was pressed: a draw that lacks epochs or estimators is none.
    """
    data = simulate(drawn_scenario(sensor, seed))
    settings = Settings(estimators=tuple(estimators))
    try:
        setup = prepare(data if stated else without_noise(data), settings)
        comparison = compare_estimators(
            setup, settings, lambda name, done, every: None, extent=ComparisonExtent(bounding=without_bounds)
        )
    except (InputError, *NUMERICAL_ERRORS):
        return []
    if comparison.interrupted:
        raise KeyboardInterrupt
    return [calibration_draw(each, seed) for each in comparison.evaluations]


def calibration_draw(evaluation: Evaluation, seed: int) -> CalibrationDraw:
    """What an evaluation with a truth says of a draw."""
    status, stated = evaluation.history.status, stated_components(evaluation)
    found = {name: [each.triple for each in components] for name, components in stated.items()}
    moments = found.get(MOMENTS, [])
    return CalibrationDraw(
        seed,
        evaluation.name,
        str(status.verdict),
        bool(moments) and max(std for _, std, _ in moments[:2]) <= LARGEST_MOMENT_STD,
        max(stated_errors(evaluation).values(), default=float("inf")),
        found,
        _last_nees(evaluation),
        {name: [each.scores for each in components] for name, components in stated.items()},
        _mixture_nees(evaluation, seed),
    )


@dataclass(frozen=True)
class StatedComponent:
    """Error of one component, and what is stated of it.

    Attributes
    ----------
    error, std : float
        Estimate minus truth, and its stated deviation.
    weights, deviations : (c,) float arrays
        Of Gaussians about zero that describe the error.
    sampled_rank : float or None
        Rank of the truth among samples of the posterior; None without any.
    """

    error: float
    std: float
    weights: Float[np.ndarray, " c"]
    deviations: Float[np.ndarray, " c"]
    sampled_rank: float | None = None

    @property
    def triple(self) -> tuple[float, float, float]:
        """Error, deviation and rank."""
        with np.errstate(all="ignore"):
            rank = float(self.weights @ ndtr(-self.error / self.deviations))
        return self.error, self.std, rank if self.sampled_rank is None else self.sampled_rank

    @property
    def scores(self) -> tuple[float, float]:
        """CRPS, E |x - error| - E |x - x'| / 2, and negative log density."""
        s, w = self.deviations, self.weights
        with np.errstate(all="ignore"):
            z = self.error / s
            density = np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
            away = self.error * (2 * ndtr(z) - 1) + 2 * s * density
            apart = np.hypot(s[:, np.newaxis], s) * np.sqrt(2 / np.pi)
            return float(w @ away - 0.5 * w @ apart @ w), float(-np.log(w @ (density / s)))


def stated_components(evaluation: Evaluation) -> dict[str, list[StatedComponent]]:
    """Every component after the last epoch, by quantity."""
    truth, history, body = evaluation.truth_in_own_frames, evaluation.history, evaluation.body
    layout = history.layout
    if truth is None or not knows_state(truth, layout) or not np.isfinite(history.factor[-1]).all():
        return {}
    _, rows = common_stamps(history.time[-1:], truth.time)
    state = true_states(truth, layout)[rows[0]]
    error = -layout.local(history.mean[-1], state)
    weights, each = _stated_deviations(history)
    found = {RATE: _components(error[layout.slice("w")], weights, each[RATE])}
    if layout.translates:
        found[CENTRE] = _components(error[layout.slice("c")], weights, each[CENTRE])
    assert truth.principal_moments is not None
    assert truth.principal_axes_g is not None
    order = np.argsort(truth.principal_moments)
    true = truth.principal_moments[order] / truth.principal_moments.max()
    ratios = np.log([true[2] / true[1], true[1] / true[0]])
    away = np.array([*(body.principal_moments - true)[:2], body.k1 - ratios[0], body.k2 - ratios[1]])
    if history.mass is None:
        found[MOMENTS] = _components(away, weights, each[MOMENTS])
    else:  # a posterior that was sampled gives ranks of its own
        std = np.array([*body.principal_moments_std[:2], body.k1_std, body.k2_std])
        found[MOMENTS] = _components(away, np.ones(1), np.tile(std, (2, 1)))
        for k in range(2):
            below = float(history.mass.weights @ (history.mass.principal_moments[:, k] < true[k]))
            found[MOMENTS][k] = replace(found[MOMENTS][k], sampled_rank=below)
    turn = turn_of_axes(body.principal_axes_g, truth.principal_axes_g[order])
    if history.mass is None:
        found[AXES] = _components(turn, weights, each[AXES])
    else:
        found[AXES] = _components(turn, np.ones(1), np.tile(body.principal_axes_std, (2, 1)))
        beyond = history.mass.weights @ (history.mass.turns(body.principal_axes_g) > turn)
        for k, rank in enumerate(
            beyond.tolist()
        ):  # a turn is truth minus estimate, so that its rank is from above
            found[AXES][k] = replace(found[AXES][k], sampled_rank=rank)
    return found


def _stated_deviations(
    history: EstimateHistory,
) -> tuple[Float[np.ndarray, " c"], dict[str, Float[np.ndarray, "d q"]]]:
    """Weights of the stated Gaussians of the last error, and deviations by quantity: those stated, then of each Gaussian."""
    last, mixture = history_at(history, np.array([-1])), history.mixture
    factors = [history.factor[-1]] * 2 if mixture is None else [history.factor[-1], *mixture.factors]
    found: dict[str, list[np.ndarray]] = {name: [] for name in (RATE, CENTRE, MOMENTS, AXES)}
    for factor in factors:
        body = body_estimate(replace(last, factor=factor[np.newaxis]).belief(0))
        std = np.linalg.norm(factor, axis=1)
        found[RATE].append(std[history.layout.slice("w")])
        if history.layout.translates:
            found[CENTRE].append(std[history.layout.slice("c")])
        found[MOMENTS].append(np.array([*body.principal_moments_std[:2], body.k1_std, body.k2_std]))
        found[AXES].append(body.principal_axes_std)
    weights = np.ones(1) if mixture is None else mixture.weights
    return weights, {name: np.array(own) for name, own in found.items()}


def _components(
    error: Float[np.ndarray, " q"], weights: Float[np.ndarray, " c"], deviations: Float[np.ndarray, "d q"]
) -> list[StatedComponent]:
    """Components of a quantity: the first row of deviations is stated, the others are of the Gaussians."""
    std, own = deviations[0], np.where(deviations[1:] > 0, deviations[1:], np.nan)
    return [StatedComponent(float(away), float(std[k]), weights, own[:, k]) for k, away in enumerate(error)]


DIMENSIONS: Final = {"w": 3, "s": 5, "c": 3}
"""Of the blocks whose NEES is kept."""
MIXTURE_SAMPLES: Final = 4000
"""Of a mixture, for the probability of a density as small."""


def _last_nees(evaluation: Evaluation) -> dict[str, float]:
    found = evaluation.nees or evaluation.rotation_nees
    if found is None:
        return {}
    return {
        name: float(found.blocks[name][-1]) / count
        for name, count in DIMENSIONS.items()
        if name in found.blocks
    }


def _mixture_nees(evaluation: Evaluation, seed: int) -> dict[str, float]:
    history, truth = evaluation.history, evaluation.truth_in_own_frames
    stated, mixture, layout = _last_nees(evaluation), history.mixture, history.layout
    if mixture is None or truth is None:
        return stated
    _, rows = common_stamps(history.time[-1:], truth.time)
    error = layout.local(history.mean[-1], true_states(truth, layout)[rows[0]])
    return {
        name: mixture_square(
            error[layout.slice(name)],
            mixture.weights,
            mixture.factors[:, layout.slice(name)],
            np.random.default_rng([seed, DIMENSIONS[name]]),
        )
        / DIMENSIONS[name]
        for name in stated
    }


def mixture_square(
    error: Float[np.ndarray, " d"],
    weights: Float[np.ndarray, " c"],
    factors: Float[np.ndarray, "c d e"],
    generator: np.random.Generator,
) -> float:
    """The chi-square number that is as improbable as a density of the mixture as small as that of an error.

    Of one Gaussian it is the NEES. The probability is counted over samples. Factors are rows of those of an `ErrorMixture`.
    """
    chosen = generator.choice(len(weights), MIXTURE_SAMPLES, p=weights)
    z = generator.standard_normal((MIXTURE_SAMPLES, factors.shape[2]))
    every = np.concatenate([error[np.newaxis], np.einsum("nij,nj->ni", factors[chosen], z)])
    parts = []
    for weight, root in zip(weights, lower_roots(factors), strict=True):
        squares = np.square(np.linalg.solve(root, every.T)).sum(axis=0)
        parts.append(np.log(weight) - np.linalg.slogdet(root)[1] - 0.5 * squares)
    logs = np.logaddexp.reduce(parts, axis=0)
    beyond = (np.count_nonzero(logs[1:] <= logs[0]) + 0.5) / (MIXTURE_SAMPLES + 1)
    return float(chdtri(len(error), beyond))
