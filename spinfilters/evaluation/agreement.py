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

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.history import EstimateHistory
from spinfilters.evaluation.consistency import finite_epochs


def expected_nees(history: EstimateHistory, smoother: EstimateHistory) -> Float[np.ndarray, " n"]:
    """Expected NEES per degree of freedom of a filter's own epochs.

    Those that both have; infinite where its covariance is singular.
    Epochs in which either is not finite are left out.
    """
    count, layout = min(len(history.time), len(smoother.time)), history.layout
    rows = np.arange(history.initialisation, count)
    rows = rows[finite_epochs(history)[rows] & finite_epochs(smoother)[rows]]
    away = layout.local(history.mean[rows], smoother.mean[rows])
    parts = zip(
        history.random_factor()[rows],
        smoother.random_factor()[rows],
        layout.reset_jacobian(away),
        away,
        strict=True,
    )
    result = np.full(len(rows), np.inf)
    for k, (factor, smoothed, reset, error) in enumerate(parts):
        try:
            about_filter = np.linalg.solve(reset, smoothed)
            columns = np.column_stack([about_filter, error])
            result[k] = np.square(np.linalg.solve(factor, columns)).sum() / layout.error_dim
        except np.linalg.LinAlgError:
            continue
    return result
