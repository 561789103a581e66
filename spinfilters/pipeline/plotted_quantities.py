"""Quantities whose convergence is plotted: labels, units, and where estimates and truth hold them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.data.truth import Truth
from spinfilters.evaluation.estimated_motion import BodyRates, Trajectory, true_rates

ATTITUDE = "attitude"
"""The one of `QUANTITIES` whose values are quaternions q_ig."""


@dataclass(frozen=True)
class PlottedQuantity:
    """A quantity of k epochs whose convergence is plotted, SI.

    Attributes
    ----------
    label, unit: in the picture.   scale: what SI is multiplied by for that unit.   size: components of the values.
    estimate: values (k, size) and their standard deviations (k, 3).   true: values of a truth.
    """

    label: str
    unit: str
    scale: float
    size: int
    estimate: Callable[[Trajectory, BodyRates], tuple[Float[np.ndarray, "k q"], Float[np.ndarray, "k 3"]]]
    true: Callable[[Truth], Float[np.ndarray, "k q"]]


def _rates(rates: BodyRates) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]]:
    """Body rates of estimates, with covariance."""
    std = rates.std
    assert std is not None
    return rates.rate, std


QUANTITIES = {
    "position": PlottedQuantity(
        *("position", "mm", 1e3, 3),
        estimate=lambda trajectory, _: (trajectory.position, trajectory.std_position),
        true=lambda truth: truth.center_of_mass,
    ),
    ATTITUDE: PlottedQuantity(
        *("attitude", "deg", float(np.rad2deg(1.0)), 4),
        estimate=lambda trajectory, _: (trajectory.q_ig, trajectory.std_attitude),
        true=lambda truth: truth.q_ig,
    ),
    "velocity": PlottedQuantity(
        *("velocity", "mm/s", 1e3, 3),
        estimate=lambda trajectory, _: (trajectory.velocity, trajectory.std_velocity),
        true=lambda truth: truth.velocity,
    ),
    "body_rate": PlottedQuantity(
        *("body rate", "deg/s", float(np.rad2deg(1.0)), 3),
        estimate=lambda _, rates: _rates(rates),
        true=lambda truth: true_rates(truth).rate,
    ),
}
"""By the names of their surfaces; position and velocity are the centre of mass' in i."""


def deviations_of(name: str) -> str:
    """The name of the surface of a quantity's standard deviations."""
    return f"std_{name}"
