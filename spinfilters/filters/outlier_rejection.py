"""Outlier rejection of each sensor: gate, robust weights, and what is remembered of refusals and recovery."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Num

from spinfilters.core.errors import InputError
from spinfilters.core.robust_losses import RobustLoss, build_loss
from spinfilters.io.stated_values import NumberRange

Deviations = Callable[[Bool[np.ndarray, " k"]], Float[np.ndarray, "s d r"]]
"""Y_i of the chosen values: whitened deviations that unit deviations of the predicted state cause."""


@dataclass(frozen=True)
class RobustOptions:
    """Options of outlier rejection.

    Attributes
    ----------
    gate_probability : float
        Probability that a correct value passes the gate, in (0, 1]; 1 for no gate.
    loss : str
        Loss of a residual within the gate: "none" (least squares), "gate" (no weight beyond width), "huber", "pseudo-huber" or
        "barron" (alpha = shape, c = width).
    width : float
        Residual from which the loss is no longer quadratic, in standard deviations.
    shape : float
        Barron's alpha, at most 2: 2 least squares, 1 pseudo-Huber, 0 Cauchy, -2 Geman-McClure.
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
        if not (np.isfinite(self.width) and self.width > 0):
            raise InputError(f"width is {self.width}; give a positive number of standard deviations")
        if not (np.isfinite(self.shape) and self.shape <= 2):
            raise InputError(f"shape is {self.shape}; give a finite number of at most 2 (2 is least squares)")
        build_loss(self.loss, self.width, self.shape)


def weights(
    innovation: Float[np.ndarray, "k d"], covariance: Float[np.ndarray, "k d d"], options: RobustOptions
) -> Float[np.ndarray, " k"]:
    """Weight of each value in [0, 1].

    0 outside the gate, where something is not finite, and where S is not positive definite.

    Parameters
    ----------
    innovation : ndarray of float, shape (k, d)
        Whitened innovations rho.
    covariance : ndarray of float, shape (k, d, d)
        S of the innovation in the same units, that of the predicted state included.
    """
    return distance_weights(squared_distances(innovation, covariance), innovation.shape[1], options)


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
    """Squared distances d2 = rho' S^-1 rho of all values by elimination, infinite where S is not positive definite."""
    k, d = innovation.shape
    # [S | rho] of all values, the last axis over values: each pivot adds (eliminated rho_j)^2 / pivot to the distance.
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
    from scipy.special import chdtri  # here alone: settings need none of it

    return float(chdtri(dof, 1 - probability))


def distance_weights(
    squared: Float[np.ndarray, " k"], dim: int, options: RobustOptions
) -> Float[np.ndarray, " k"]:
    """Weights of squared distances of values of this dimension; 0 outside the gate."""
    inside = (squared <= gate(options.gate_probability, dim)) & (squared < np.inf)
    return np.where(inside, _loss(options).weight(squared / dim), 0.0)


@cache
def _loss(options: RobustOptions) -> RobustLoss:
    return build_loss(options.loss, options.width, options.shape)


RECOVERY_COUNT = 3
"""Updates in a row hardly any of whose values the gate let through, after which it is the state that is doubted."""
AGREEING_SHARE = 0.2
"""Of an update's values inside the gate, from which on the state is believed, not the others: a lost state agrees with few values,
and by chance; where half of the associations are wrong, and landmarks that they made, a true one agrees with two of five."""
WIDEST = 1e100
"""Of the scale of Cauchy weights: its square is a number still."""
DUPLICATE_SHARE = 0.9
"""Of the landmarks common to two epochs, bit by bit the same in a repeated image; a tracker may find a few others in it."""
FEWEST_DUPLICATES = 4
"""Landmarks that must be the same: fewer, or a gyro's coarse digits, repeat by chance."""
SAMPLE = 12
"""Rows, spread over an epoch, none of which is found again in another image; of a repeated one nearly all are."""


class DuplicateImages:
    """Recognises repeated values of one sensor, from the raw numbers alone.

    After time has gone on an epoch repeats the one before when nearly all values of the common landmarks are bit by bit the same
    (a camera with noise never measures the same twice). Without time going on, it repeats when every value has been there already.
    """

    def __init__(self) -> None:
        self._keys = np.zeros((0, 1))
        self._values = np.zeros((0, 1))
        self._time_passed = True

    @property
    def values(self) -> Float[np.ndarray, "k v"]:
        """Values of the latest epoch, none before the first."""
        return self._values

    def pass_time(self) -> None:
        """Mark that time has advanced, so that a new epoch follows."""
        self._time_passed = True

    def is_duplicate(self, keys: Num[np.ndarray, "k ..."], values: Float[np.ndarray, "k v"]) -> bool:
        """Whether values only repeat what was there, and remember them.

        Parameters
        ----------
        keys : ndarray, shape (k,) or (k, p)
            (k,) ids of landmarks or (k, p) parameters of the rows, by which a landmark is known again.
        """
        if not len(values):
            return False
        keys = keys.reshape(len(values), -1)
        before = _Image(self._keys, self._values)
        if (
            self._time_passed
            or keys.shape[1:] + values.shape[1:] != self._keys.shape[1:] + self._values.shape[1:]
        ):
            self._time_passed = False
            self._keys, self._values = keys.copy(), values.copy()
            return _frozen(_Image(keys, values), before)
        if _rows(keys, values) <= _rows(*before):
            return True
        self._keys, self._values = (
            np.concatenate([before.keys, keys]),
            np.concatenate([before.values, values]),
        )
        return False

    def remember(
        self, keys: Num[np.ndarray, "k ..."], values: Float[np.ndarray, "k v"], time_passed: bool
    ) -> None:
        """Remember values of a later epoch, which repeat nothing or are too few to be told from a repetition.

        Parameters
        ----------
        keys : ndarray, shape (k,) or (k, p)
            As of `is_duplicate`.
        time_passed : bool
            Whether time has advanced since.
        """
        self._keys, self._values = keys.reshape(len(values), -1).copy(), values.copy()
        self._time_passed = time_passed

    def snapshot(self) -> dict[str, np.ndarray]:
        """Its whole state as arrays."""
        return {
            "keys": self._keys.copy(),
            "values": self._values.copy(),
            "time_passed": np.array(self._time_passed),
        }

    def restore(self, snapshot: dict[str, np.ndarray]) -> None:
        """Go on from a `snapshot`."""
        self._keys, self._values = snapshot["keys"].copy(), snapshot["values"].copy()
        self._time_passed = bool(snapshot["time_passed"])


class SensorOutlierRejection:
    """Outlier rejection state of one sensor.

    The latest values, and how often in a row few passed the gate.
    A filter that is wrong would refuse everything for ever. So after `RECOVERY_COUNT` refusals in a row the gate is lifted for
    as long as fewer than `AGREEING_SHARE` of the values lie inside it, and Cauchy weights take its place, their width scaled by
    the median distance: the majority counts, and what disagrees with it does not.

    A further rule for each value belongs in `distance_weights` of this file; `sparing_weights` passes it only values outside the
    gate, where there is no loss. A rule that compares all values belongs in `weights` of this class. Where a rule applies, `limit`
    must be negative: compiled updates know one gate only. `spinfilters.filters.joint_ekf` has a gate of its own, as in a textbook.
    """

    def __init__(self, options: RobustOptions) -> None:
        self.options = options
        self.epochs = DuplicateImages()
        self._refusals = 0

    def limit(self, dim: int) -> float:
        """Squared distance up to which weights are 1 and beyond which they are 0; negative where another rule applies."""
        plain = self._refusals < RECOVERY_COUNT and self.options.loss == "none"
        return gate(self.options.gate_probability, dim) if plain else -1.0

    def count(self, values: int, refused: int) -> None:
        """Count an update by so many usable values, of which so many lie outside the gate."""
        self._refusals = self._refusals + 1 if values - refused < AGREEING_SHARE * values else 0

    def remember(
        self, keys: Num[np.ndarray, "k ..."], values: Float[np.ndarray, "k v"], time_passed: bool
    ) -> None:
        """Go on after epochs none of which was refused; parameters as of `DuplicateImages.remember`."""
        self._refusals = 0
        self.epochs.remember(keys, values, time_passed)

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
            result, refused = self._recover_weights(innovation, deviations)
        self.count(len(innovation), refused)
        return result

    def _recover_weights(
        self, innovation: Float[np.ndarray, "k d"], deviations: Deviations
    ) -> tuple[Float[np.ndarray, " k"], int]:
        """Cauchy weights about the median distance, and how many values the gate would refuse."""
        every, dim = np.ones(len(innovation), dtype=bool), innovation.shape[1]
        squared = squared_distances(innovation, innovation_covariance(deviations(every)))
        refused = int(np.count_nonzero(squared > gate(self.options.gate_probability, dim)))
        scale = float(np.clip(np.sqrt(np.median(squared) / dim), 1.0, WIDEST))
        cauchy = RobustOptions(1.0, "barron", scale * self.options.width, 0.0)
        return distance_weights(squared, dim, cauchy), refused

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


class _Image(NamedTuple):
    """Rows of one image: keys (k, q) of its landmarks, and values (k, v)."""

    keys: np.ndarray
    values: np.ndarray


def _frozen(now: _Image, before: _Image) -> bool:
    if min(len(now.keys), len(before.keys)) < FEWEST_DUPLICATES:
        return False
    sample = now.values[:: -(-len(now.values) // SAMPLE), :1]
    if not np.count_nonzero(
        sample == before.values[:, 0]
    ):  # the usual case, a twentieth of the time of comparing rows
        return False
    same = len(_rows(*now) & _rows(*before))
    common = len(_rows(now.keys) & _rows(before.keys))
    return same >= max(FEWEST_DUPLICATES, DUPLICATE_SHARE * common)


def _rows(*arrays: np.ndarray) -> set[bytes]:
    """Rows of arrays side by side as their bytes."""
    rows = np.concatenate([np.ascontiguousarray(array).view(np.uint8) for array in arrays], axis=1)
    return set(rows.view(np.dtype((np.void, rows.shape[1]))).ravel().tolist())
