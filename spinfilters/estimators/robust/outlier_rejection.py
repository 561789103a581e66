"""Outlier rejection: gate, robust weights, duplicate images, recovery.

Recovery follows repeated rejection of all measurements.

All innovations rho_i (d) are whitened by their noise, so that their covariance is S_i = I + Y_i Y_i', Y_i the deviations that
the predicted state causes. Each value is judged by its squared distance d2_i = rho_i' S_i^-1 rho_i, chi-square with d degrees of
freedom where all is well. The gate leaves a value out; a loss weighs it by w(r) = l'(r) / r of its loss l at r = sqrt(d2 / d),
whose root mean square is 1 whatever d is. Weight w stands for noise of covariance 1/w: rows times sqrt(w).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import chdtri

from spinfilters.data.number_range import NumberRange
from spinfilters.errors import InputError
from spinfilters.estimators.robust.duplicate_images import DuplicateImages

RECOVERY_COUNT = 3
"""Updates in a row hardly any of whose values the gate let through, after which it is the state that is doubted."""
AGREEING_SHARE = 0.2
"""Of an update's values inside the gate, from which on the state is believed, not the others: a lost state agrees with few values,
and by chance; where half of the associations are wrong, and landmarks that they made, a true one agrees with two of five."""
WIDEST = 1e100
"""Of the scale of Cauchy weights: its square is a number still."""

Deviations = Callable[[Bool[np.ndarray, " k"]], Float[np.ndarray, "s d r"]]
"""Y_i of the chosen values: whitened deviations that unit deviations of the predicted state cause."""


@dataclass(frozen=True)
class RobustOptions:
    """Options of outlier rejection.

    Attributes
    ----------
    gate_probability: of a true value to pass the gate, in (0, 1]; 1 for no gate.
    loss: "none" (least squares), "huber" (w = min(1, width / r)) or "barron" (Barron 2019, c = width, scaled to w(0) = 1).
    width: where the loss begins to bend, in standard deviations.
    shape: Barron's alpha, at most 2: 2 least squares, 1 pseudo-Huber, 0 Cauchy, -2 Geman-McClure.
    """

    gate_probability: Annotated[float, NumberRange(1e-15, 1)] = 0.9999
    loss: str = "none"
    width: Annotated[float, NumberRange(1e-6, 1e9)] = 2.5
    shape: Annotated[float, NumberRange(-1e9, 2)] = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.gate_probability <= 1:
            raise InputError(
                f"gate_probability is {self.gate_probability}; give a probability above 0, or 1 for no gate"
            )
        if self.loss not in _LOSSES:
            raise InputError(f"loss {self.loss!r} is unknown; choose from {', '.join(_LOSSES)}")
        if not (np.isfinite(self.width) and self.width > 0):
            raise InputError(f"width is {self.width}; give a positive number of standard deviations")
        if not (np.isfinite(self.shape) and self.shape <= 2):
            raise InputError(f"shape is {self.shape}; give a finite number of at most 2 (2 is least squares)")


def weights(
    innovation: Float[np.ndarray, "k d"], covariance: Float[np.ndarray, "k d d"], options: RobustOptions
) -> Float[np.ndarray, " k"]:
    """Weight of each value in [0, 1].

    0 outside the gate, where something is not finite, and where S is not positive definite.

    Parameters
    ----------
    innovation: whitened.   covariance: S of the innovation in the same units, that of the predicted state included.
    """
    return _distance_weights(squared_distances(innovation, covariance), innovation.shape[1], options)


def sparing_weights(
    innovation: Float[np.ndarray, "k d"], deviations: Deviations, options: RobustOptions
) -> Float[np.ndarray, " k"] | None:
    """Weights with S = I + Y Y', None when all are 1.

    S >= I, so a value with |rho|^2 inside the gate passes whatever the state's covariance: without a loss
    hardly any S is formed.
    """
    if options.loss != "none":
        every = np.ones(len(innovation), dtype=bool)
        return weights(innovation, innovation_covariance(deviations(every)), options)
    limit = gate(options.gate_probability, innovation.shape[1])
    squared = (innovation * innovation) @ np.ones(innovation.shape[1])
    if squared[squared.argmax()] <= limit:
        return None
    suspects = squared > limit
    result = np.ones(len(innovation))
    result[suspects] = weights(innovation[suspects], innovation_covariance(deviations(suspects)), options)
    return None if result.all() else result


def innovation_covariance(deviations: Float[np.ndarray, "k d r"]) -> Float[np.ndarray, "k d d"]:
    """S = I + Y Y' of every value."""
    return deviations @ np.swapaxes(deviations, 1, 2) + np.eye(deviations.shape[1])


def squared_distances(
    innovation: Float[np.ndarray, "k d"], covariance: Float[np.ndarray, "k d d"]
) -> Float[np.ndarray, " k"]:
    """Squared distances d2 = rho' S^-1 rho of all values by elimination.

    Infinite where S is not positive definite or NaN.
    """
    k, d = innovation.shape
    array = np.empty((d, d + 1, k))
    array[:, :d] = covariance.transpose(1, 2, 0)
    array[:, d] = innovation.T
    squared, good = np.zeros(k), np.ones(k, dtype=bool)
    with np.errstate(all="ignore"):
        for j in range(d):
            row, pivot = array[j, j + 1 :], array[j, j]
            good &= pivot > 0
            scaled = row / pivot
            squared += scaled[-1] * row[-1]
            if j + 1 < d:
                array[j + 1 :, j + 1 :] -= row[:-1, np.newaxis] * scaled
    good &= np.isfinite(squared)
    squared[~good] = np.inf
    return squared


@cache
def gate(probability: float, dof: int) -> float:
    """Squared distance below which a true value lies with this probability."""
    return float(chdtri(dof, 1 - probability))


def _distance_weights(
    squared: Float[np.ndarray, " k"], dim: int, options: RobustOptions
) -> Float[np.ndarray, " k"]:
    inside = (squared <= gate(options.gate_probability, dim)) & (squared < np.inf)
    return np.where(inside, _LOSSES[options.loss](squared / dim, options), 0.0)


def _least_squares(squared: Float[np.ndarray, " k"], options: RobustOptions) -> Float[np.ndarray, " k"]:
    return np.ones(len(squared))


def _huber(squared: Float[np.ndarray, " k"], options: RobustOptions) -> Float[np.ndarray, " k"]:
    return options.width / np.sqrt(np.maximum(squared, options.width**2))


def _barron(squared: Float[np.ndarray, " k"], options: RobustOptions) -> Float[np.ndarray, " k"]:
    if options.shape == 2:
        return np.ones(len(squared))
    return (squared / (options.width**2 * (2 - options.shape)) + 1) ** (options.shape / 2 - 1)


_LOSSES = {"none": _least_squares, "huber": _huber, "barron": _barron}


class SensorOutlierRejection:
    """Outlier rejection state of one sensor.

    The latest values, and how often in a row few passed the gate.
    A filter that is wrong would refuse everything for ever. So after `RECOVERY_COUNT` refusals in a row the gate is lifted for
    as long as
    fewer than `AGREEING_SHARE` of the values lie inside it, and Cauchy weights take its place, their width scaled by the median
    distance: the majority counts, and what disagrees with it does not.
    """

    def __init__(self, options: RobustOptions) -> None:
        self.options = options
        self.epochs = DuplicateImages()
        self._refusals = 0

    def limit(self, dim: int) -> float:
        """Squared distance up to which weights are 1.

        Beyond it they are 0; negative where there is no such rule.
        """
        plain = self._refusals < RECOVERY_COUNT and self.options.loss == "none"
        return gate(self.options.gate_probability, dim) if plain else -1.0

    def count(self, values: int, refused: int) -> None:
        """Count an update by so many usable values, of which so many lie outside the gate."""
        self._refusals = self._refusals + 1 if values - refused < AGREEING_SHARE * values else 0

    def weights(
        self, innovation: Float[np.ndarray, "k d"], deviations: Deviations
    ) -> Float[np.ndarray, " k"] | None:
        """Weights of an update's usable values, None when all are 1; counts what the gate refuses."""
        if not len(innovation):
            return None
        if self._refusals < RECOVERY_COUNT:
            result = sparing_weights(innovation, deviations, self.options)
            refused = 0 if result is None else int(np.count_nonzero(result == 0))
        else:
            result, refused = self._recovered(innovation, deviations)
        self.count(len(innovation), refused)
        return result

    def _recovered(
        self, innovation: Float[np.ndarray, "k d"], deviations: Deviations
    ) -> tuple[Float[np.ndarray, " k"], int]:
        """Cauchy weights about the median distance, and how many values the gate would refuse."""
        every, dim = np.ones(len(innovation), dtype=bool), innovation.shape[1]
        squared = squared_distances(innovation, innovation_covariance(deviations(every)))
        refused = int(np.count_nonzero(squared > gate(self.options.gate_probability, dim)))
        scale = float(np.clip(np.sqrt(np.median(squared) / dim), 1.0, WIDEST))
        cauchy = RobustOptions(1.0, "barron", scale * self.options.width, 0.0)
        return _distance_weights(squared, dim, cauchy), refused

    def snapshot(self) -> dict[str, np.ndarray]:
        """Its whole state as arrays."""
        return {"refusals": np.array(self._refusals), **self.epochs.snapshot()}

    def restore(self, snapshot: dict[str, np.ndarray]) -> None:
        """Go on from a `snapshot`."""
        self._refusals = int(snapshot["refusals"])
        self.epochs.restore(snapshot)


class OutlierRejection:
    """One `SensorOutlierRejection` for every sensor, by its name."""

    def __init__(self, options: RobustOptions) -> None:
        self.options = options
        self._guards: dict[str, SensorOutlierRejection] = {}

    def of(self, name: str) -> SensorOutlierRejection:
        """Rejection state of a sensor, created at its first measurement."""
        if name not in self._guards:
            self._guards[name] = SensorOutlierRejection(self.options)
        return self._guards[name]

    def pass_time(self) -> None:
        """Mark for all sensors that time has advanced."""
        for guard in self._guards.values():
            guard.epochs.pass_time()

    def snapshot(self) -> dict[str, np.ndarray]:
        """Everything remembered, as arrays named ``guard.<sensor>.<what>``."""
        return {
            f"guard.{name}.{what}": array
            for name, guard in self._guards.items()
            for what, array in guard.snapshot().items()
        }

    def restore(self, snapshot: dict[str, np.ndarray]) -> None:
        """Go on from the `snapshot` among these arrays."""
        kept: dict[str, dict[str, np.ndarray]] = {}
        for key, array in snapshot.items():
            if key.startswith("guard."):
                name, _, what = key.removeprefix("guard.").rpartition(".")
                kept.setdefault(name, {})[what] = array
        self._guards = {}
        for name, arrays in kept.items():
            self.of(name).restore(arrays)
