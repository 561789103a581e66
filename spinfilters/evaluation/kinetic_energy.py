"""Kinetic energy of a rotation and of a translation with the deviation that those of rate and velocity give it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class EnergyCourse:
    """An energy over time.

    Attributes
    ----------
    time : (k,) float array
        Time, s.
    energy, std : (k,) float array
        Value and standard deviation, J.
    """

    time: Float[np.ndarray, " k"]
    energy: Float[np.ndarray, " k"]
    std: Float[np.ndarray, " k"]

    def change(self, begin: float, end: float) -> tuple[float, float]:
        """Relative change between two times (s) and its deviation: of a straight line through the logarithms within.

        Rows weigh by their deviations, and their errors are taken as independent. Rows without a deviation have no weight and are
        left out. LinAlgError: fewer than two rows.
        """
        inside = (self.time >= begin) & (self.time <= end) & (self.energy > 0) & (self.std > 0)
        weight = self.energy[inside] / self.std[inside]
        rows = np.stack([np.ones(len(weight)), self.time[inside] - begin], axis=1) * weight[:, None]
        normal = rows.T @ rows
        slope = np.linalg.solve(normal, rows.T @ (weight * np.log(self.energy[inside])))[1]
        ratio = float(np.exp(slope * (end - begin)))
        std = float(np.sqrt(np.linalg.inv(normal)[1, 1])) * (end - begin) * ratio
        return ratio - 1.0, std


def quadratic_energy(
    time: Float[np.ndarray, " k"],
    values: Float[np.ndarray, "k 3"],
    covariance: Float[np.ndarray, "k 3 3"],
    form: Float[np.ndarray, "3 3"],
) -> EnergyCourse:
    """E = x' A x / 2 of Gaussian x, A symmetric: w' J w / 2 (Tweddle 2013, Eq. 2.80), or m v' v / 2.

    The variance is (A x)' P (A x) + tr((A P)^2) / 2; the excess of the mean, tr(A P) / 2, is taken off.

    Parameters
    ----------
    time : (k,) float array
        Time, s.
    values : (k, 3) float array
        Rates, rad/s, or velocities, m/s.
    covariance : (k, 3, 3) float array
        Of the values.
    form : (3, 3) float array
        Inertia, kg m^2, in the axes of the rates, or the mass, kg, times the identity.

    Returns
    -------
    EnergyCourse
        Energies, J.
    """
    bent = values @ form
    product = form @ covariance
    excess = np.einsum("kii->k", product) / 2
    variance = np.einsum("ki,kij,kj->k", bent, covariance, bent)
    variance = variance + np.einsum("kij,kji->k", product, product) / 2
    return EnergyCourse(time, np.einsum("ki,ki->k", bent, values) / 2 - excess, np.sqrt(variance))
