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

        Rows weigh by their deviations, and their errors are taken as independent. Rows whose deviation is
        below rounding have no meaningful weight and are left out. LinAlgError: fewer than two times.
        """
        inside = (self.time >= begin) & (self.time <= end) & (self.energy > 0)
        inside &= self.std > np.finfo(float).eps * self.energy
        if len(np.unique(self.time[inside])) < 2:
            raise np.linalg.LinAlgError("fewer than two times")
        weight = self.energy[inside] / self.std[inside]
        rows = np.stack([np.ones(len(weight)), self.time[inside] - begin], axis=1) * weight[:, None]
        Q, R = np.linalg.qr(rows)  # of log E = a + b t: b = (Q' y)_2 / R_22, its deviation 1 / |R_22|
        slope = (Q.T @ (weight * np.log(self.energy[inside])))[1] / R[1, 1]
        ratio = float(np.exp(slope * (end - begin)))
        std = (end - begin) * ratio / float(abs(R[1, 1]))
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
