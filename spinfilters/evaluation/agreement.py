"""Agreement of a filter with the smoother of the same measurements.

The NEES that the filter is expected to have.
A smoother linearises until it has converged, a filter once. Where the smoother's belief N(x_s, P_s) is right, the error of a
filter's N(x_f, P_f) has the expected NEES

    E e' P_f^-1 e = tr(P_f^-1 R^-1 P_s R^-T) + d' P_f^-1 d,   x_s = x_f [+] d,

which is the number of components for a filter that loses nothing: then d has the covariance P_f - P_s. The error of a state is one
about the estimate, and R = d(error about x_s) / d(error about x_f) takes it from one estimate to the other. A mass distribution is
known a hundred times better in one direction than in another, and is told in axes that turn by some degrees between the two:
without R the larger deviation would count as an error in the smaller one. Errors of the calibration are in both, and not counted.
"""

from typing import Final

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.consistency import finite_epochs
from spinfilters.linear_algebra.epoch_stretches import by_stretches
from spinfilters.linear_algebra.normalised_square import normalised_trace
from spinfilters.state.blocks.rigid_body import MASS_DISTRIBUTION
from spinfilters.state.layout import StateLayout

WHOLE: Final = "state"
"""Name of the whole error beside that of a block."""


def compared_parts(layout: StateLayout) -> dict[str, slice]:
    """Components that are compared with the smoother's, by name.

    The whole error, and the mass distribution, whose errors the others would hide.
    """
    return {WHOLE: slice(0, layout.error_dim), MASS_DISTRIBUTION.name: layout.slice(MASS_DISTRIBUTION.name)}


def expected_nees(history: EstimateHistory, smoother: EstimateHistory) -> dict[str, Float[np.ndarray, " n"]]:
    """Expected NEES per degree of freedom of a filter's own epochs, by `compared_parts`.

    Those that both have; infinite where its covariance is singular.
    Epochs in which either is not finite are left out.
    """
    count, layout = min(len(history.time), len(smoother.time)), history.layout
    rows = np.arange(history.initialisation, count)
    rows = rows[finite_epochs(history)[rows] & finite_epochs(smoother)[rows]]

    parts = compared_parts(layout)

    def of(stretch: slice) -> dict[str, Float[np.ndarray, " n"]]:
        """Of some of the epochs."""
        at = rows[stretch]
        away = layout.local(history.mean[at], smoother.mean[at])
        try:
            about_filter = np.linalg.solve(layout.reset_jacobian(away), smoother.random_factor(at))
        except np.linalg.LinAlgError:  # so far away that no error about the filter's estimate tells it
            return dict.fromkeys(parts, np.full(len(at), np.inf))
        columns, factor = (
            np.concatenate([about_filter, away[..., np.newaxis]], axis=2),
            history.random_factor(at),
        )
        return {
            name: normalised_trace(columns[:, part], factor[:, part]) / (part.stop - part.start)
            for name, part in parts.items()
        }

    return by_stretches(len(rows), of)
