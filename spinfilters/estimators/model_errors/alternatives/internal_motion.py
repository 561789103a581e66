"""What sloshes or flexes inside a body: it dissipates energy."""

import numpy as np

from spinfilters.estimators.model_errors.alternative import Alternative
from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion


class EnergyLoss(Alternative):
    """Energy dissipation: the kinetic energy falls, the angular momentum stays.

    J w' loses k |h| (w less its part along h).
    """

    name, phrase, unit = "energy-loss", "a loss of energy within the body", "1/rad"
    plausible = 0.3
    only_positive = True
    cure = (
        "something sloshes or flexes inside: take a shorter recording, or state a larger process.torque_psd"
    )

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """One column: torque against the rate across the angular momentum."""
        momentum = motion.rates @ motion.inertia
        size = np.linalg.norm(momentum, axis=1, keepdims=True)
        along = momentum / np.maximum(size, np.finfo(float).tiny)
        across = motion.rates - along * np.einsum("ki,ki->k", along, motion.rates)[:, None]
        lost = np.linalg.solve(motion.inertia, (size * across).T).T
        return motion.disturbed(angular=-lost[:, :, None])
