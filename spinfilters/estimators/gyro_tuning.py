"""Noise of a gyro run from its own innovations: how much is the gyro's scale error, how much the body's disturbance.

A consumer gyro's error is neither white nor of known size. For each of a few disturbance densities the scale error is rescaled until
the innovations of the MEKF have the size that it predicts; the pair with the greatest likelihood is taken (maximum-likelihood
identification after Mehra 1970, on a grid because the likelihood is flat and sometimes has two maxima).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spinfilters.estimators.history import EstimateHistory

TORQUE_STD_GRID = (1e-3, 0.03, 0.1, 0.3, 1.0)
"""Square roots of the densities tried, (rad/s^2)/sqrt(Hz)."""
RESCALINGS = 4
SMALLEST_SCALE, LARGEST_SCALE = 1e-5, 0.3


@dataclass(frozen=True)
class GyroTuning:
    """Chosen densities and how well they explain the innovations.

    Attributes
    ----------
    torque_psd: (rad/s^2)^2/Hz.   gyro_scale_std: relative to |w|.
    log_likelihood: of all samples under them.
    """

    torque_psd: float
    gyro_scale_std: float
    log_likelihood: float


def tune_gyro(attempt: Callable[[float, float], EstimateHistory | None], first_scale: float) -> GyroTuning | None:
    """The most likely (torque_psd, gyro_scale_std); None when no attempt ends well.

    Parameters
    ----------
    attempt: runs a filter with a torque density and a scale standard deviation; None when it fails.
    first_scale: where the rescaling begins.
    """
    best: GyroTuning | None = None
    for torque_std in TORQUE_STD_GRID:
        scale = first_scale
        for _ in range(RESCALINGS):
            history = attempt(torque_std**2, scale)
            if history is None:
                break
            likelihood = float(history.log_likelihood.sum())
            if np.isfinite(likelihood) and (best is None or likelihood > best.log_likelihood):
                best = GyroTuning(torque_std**2, scale, likelihood)
            ratio = float(np.sqrt(history.nis.sum() / max(int(history.dof.sum()), 1)))
            scale = float(np.clip(scale * ratio, SMALLEST_SCALE, LARGEST_SCALE))
            if abs(ratio - 1) < 0.02:
                break
    return best
