"""Standard deviations of state and body in two parts.

Chance, and errors of the calibration; of the latest state.
Squares add up: total^2 = random^2 + calibration^2. The total is what every other number of a run states.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.history import EPOCH_ARRAYS, EstimateHistory
from spinfilters.evaluation.body import body_estimate
from spinfilters.evaluation.estimated_motion import trajectory_of
from spinfilters.evaluation.reported_constants import REPORTED, constant_estimates

Deviations = dict[str, Float[np.ndarray, " q"]]


@dataclass(frozen=True)
class DeviationPart:
    """Parts of the standard deviations of one quantity, in its unit."""

    random: Float[np.ndarray, " q"]
    calibration: Float[np.ndarray, " q"]

    @property
    def document(self) -> dict[str, list[float | None]]:
        """As summary.json holds it; None for what is not finite."""
        parts = {"random": self.random, "calibration": self.calibration}
        return {
            name: [float(x) if np.isfinite(x) else None for x in values] for name, values in parts.items()
        }


def without_calibration(history: EstimateHistory) -> EstimateHistory:
    """The history with the random part of its covariance alone."""
    return replace(history, factor=history.random_factor(), calibration=None)


def deviation_parts(history: EstimateHistory) -> dict[str, DeviationPart]:
    """Parts of the deviations by quantity, after the last epoch.

    See `_deviations`. Of an exact calibration all of it is random.
    """
    last = replace(
        history,
        **{name: getattr(history, name)[-1:] for name in EPOCH_ARRAYS},
        calibration=None if history.calibration is None else history.calibration[-1:],
        observations=None,
        initialisation=0,
    )
    total = _deviations(last)
    if last.calibration is None:
        return {name: DeviationPart(std, np.zeros_like(std)) for name, std in total.items()}
    chance = _deviations(without_calibration(last))
    found = {}
    for name, std in total.items():
        random = np.minimum(chance[name], std)
        found[name] = DeviationPart(random, np.sqrt(std**2 - random**2))
    return found


def _deviations(last: EstimateHistory) -> Deviations:
    """Standard deviations of body and motion of one epoch.

    Moments (largest = 1), axes rad, k1 and k2, places m, velocity m/s, rate rad/s, constants.
    """
    belief, motion = last.belief(0), trajectory_of(last)
    body = body_estimate(belief)
    found = {
        "principal_moments": body.principal_moments_std,
        "principal_axes_rad": body.principal_axes_std,
        "k1": np.array([body.k1_std]),
        "k2": np.array([body.k2_std]),
        "attitude_rad": motion.std_attitude[0],
        "rate_rad_s": motion.std_rate[0],
    }
    if body.center_of_mass_std is not None:
        found["center_of_mass_m"] = body.center_of_mass_std
    if motion.sees_position:
        found |= {"position_m": motion.std_position[0], "velocity_m_s": motion.std_velocity[0]}
    constants = constant_estimates(belief)
    return found | {REPORTED[name].value_key: each.std for name, each in constants.items()}
