"""Draws of simulation-based calibration: truth and measurements from a stated prior, and what an estimator states of the truth.

The rank of the truth in a posterior that is right is uniform (Talts et al. 2018). Each draw takes body, motion and noise from the
prior below and simulates the recording. It keeps the error, the stated deviation and the rank of the truth of every component of
moments, axes, rate and centre of mass.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.evaluation.consistency import knows_state, true_states
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.recording_bound import without_bounds
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR, stated_errors
from spinfilters.evaluation.trajectory_errors import common_stamps
from spinfilters.models.body import turn_of_axes
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
    "pose": {"position_std": (1e-3, 2e-2), "rotation_std": (2e-3, 3e-2)},
    "stereo-tracks": {"pixel_std": (0.3, 2.0)},
}
"""Least and largest standard deviation of each sensor's noise, log-uniform."""
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
    """

    seed: int
    estimator: str
    verdict: str
    determined: bool
    worst: float
    quantities: dict[str, list[tuple[float, float, float]]]
    nees: dict[str, float]

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
    return replace(scenario, **noise)


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
    status, found = evaluation.history.status, component_errors(evaluation)
    moments = found.get(MOMENTS, [])
    return CalibrationDraw(
        seed,
        evaluation.name,
        str(status.verdict),
        bool(moments) and max(std for _, std, _ in moments[:2]) <= LARGEST_MOMENT_STD,
        max(stated_errors(evaluation).values(), default=float("inf")),
        found,
        _last_nees(evaluation),
    )


def component_errors(evaluation: Evaluation) -> dict[str, list[tuple[float, float, float]]]:
    """Error, stated deviation and rank of the truth of every component after the last epoch, by quantity."""
    truth, history, body = evaluation.truth_in_own_frames, evaluation.history, evaluation.body
    layout = history.layout
    if truth is None or not knows_state(truth, layout) or not np.isfinite(history.factor[-1]).all():
        return {}
    _, rows = common_stamps(history.time[-1:], truth.time)
    state = true_states(truth, layout)[rows[0]]
    error = -layout.local(history.mean[-1], state)
    std = np.linalg.norm(history.factor[-1], axis=1)
    found = {RATE: _ranked(error[layout.slice("w")], std[layout.slice("w")])}
    if layout.translates:
        found[CENTRE] = _ranked(error[layout.slice("c")], std[layout.slice("c")])
    assert truth.principal_moments is not None
    assert truth.principal_axes_g is not None
    order = np.argsort(truth.principal_moments)
    true = truth.principal_moments[order] / truth.principal_moments.max()
    ratios = np.log([true[2] / true[1], true[1] / true[0]])
    away = np.array([*(body.principal_moments - true)[:2], body.k1 - ratios[0], body.k2 - ratios[1]])
    found[MOMENTS] = _ranked(away, np.array([*body.principal_moments_std[:2], body.k1_std, body.k2_std]))
    if history.mass is not None:  # a posterior that was sampled gives ranks of its own
        for k in range(2):
            below = history.mass.principal_moments[:, k] < true[k]
            found[MOMENTS][k] = (*found[MOMENTS][k][:2], float(history.mass.weights @ below))
    turn = turn_of_axes(body.principal_axes_g, truth.principal_axes_g[order])
    found[AXES] = _ranked(turn, body.principal_axes_std)
    return found


def _ranked(error: Float[np.ndarray, " c"], std: Float[np.ndarray, " c"]) -> list[tuple[float, float, float]]:
    """Components with the rank of the truth in a Gaussian: its probability below the truth."""
    ranks = ndtr(-error / np.where(std > 0, std, np.nan))
    return list(zip(error.tolist(), std.tolist(), ranks.tolist(), strict=True))


def _last_nees(evaluation: Evaluation) -> dict[str, float]:
    found = evaluation.nees or evaluation.rotation_nees
    if found is None:
        return {}
    dimension = {"w": 3, "s": 5, "c": 3}
    return {
        name: float(found.blocks[name][-1]) / count
        for name, count in dimension.items()
        if name in found.blocks
    }
