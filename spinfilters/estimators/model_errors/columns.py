"""Right-hand sides of a linearised smoothing problem, one column for each."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.model_errors.solved_columns import flat


@dataclass(frozen=True)
class Columns:
    """m right-hand sides: numbers for every whitened row.

    Attributes
    ----------
    sensors: (r, i, m) of every sensor without landmarks.   steps: (k - 1, d, m).
    observations: (N, 3, m), or None without any.   prior: (n, m) of the first state.
    is_measured: False where all numbers of sensors and observations are zero.
    """

    sensors: tuple[Float[np.ndarray, "_ _ m"], ...]
    steps: Float[np.ndarray, "k d m"]
    observations: Float[np.ndarray, "N 3 m"] | None
    prior: Float[np.ndarray, "n m"]
    is_measured: bool = True

    @property
    def count(self) -> int:
        """Of right-hand sides."""
        return self.steps.shape[2]

    @property
    def parts(self) -> tuple[Float[np.ndarray, "_ _ m"], ...]:
        """All rows by kind: sensors, steps, observations, prior."""
        seen = () if self.observations is None else (self.observations,)
        return (*self.sensors, self.steps, *seen, self.prior[None])

    @property
    def of_motion(self) -> "Columns":
        """The rows of steps and prior alone."""
        return Columns((), self.steps, None, self.prior, is_measured=False)

    def gram(self, other: "Columns") -> Float[np.ndarray, "m o"]:
        """Products of columns, summed over all rows."""
        return sum(
            (flat(a).T @ flat(b) for a, b in zip(self.parts, other.parts, strict=True)),
            np.zeros((self.count, other.count)),
        )

    @property
    def squares(self) -> Float[np.ndarray, " m"]:
        """Squared length of every column."""
        return np.asarray(sum(np.einsum("abm,abm->m", part, part) for part in self.parts))

    def scaled(self, factor: float) -> "Columns":
        """All columns times a number."""
        return self.times(factor * np.eye(self.count))

    def times(self, coefficients: Float[np.ndarray, "m o"]) -> "Columns":
        """Combinations of the columns."""
        seen = None if self.observations is None else _times(self.observations, coefficients)
        sensors = tuple(_times(part, coefficients) for part in self.sensors)
        return Columns(
            sensors, _times(self.steps, coefficients), seen, self.prior @ coefficients, self.is_measured
        )

    def minus(self, other: "Columns") -> "Columns":
        """Difference."""
        seen = None
        if self.observations is not None and other.observations is not None:
            seen = self.observations - other.observations
        sensors = tuple(a - b for a, b in zip(self.sensors, other.sensors, strict=True))
        return Columns(sensors, self.steps - other.steps, seen, self.prior - other.prior)

    def part(self, columns: slice) -> "Columns":
        """Some of them."""
        seen = None if self.observations is None else self.observations[:, :, columns]
        sensors = tuple(part[:, :, columns] for part in self.sensors)
        return Columns(sensors, self.steps[:, :, columns], seen, self.prior[:, columns], self.is_measured)

    @classmethod
    def joined(cls, parts: "list[Columns]") -> "Columns":
        """Columns side by side."""
        seen = None
        if parts[0].observations is not None:
            seen = np.concatenate([each.observations for each in parts if each.observations is not None], 2)
        sensors = tuple(
            np.concatenate(each, axis=2) for each in zip(*(p.sensors for p in parts), strict=True)
        )
        steps = np.concatenate([each.steps for each in parts], axis=2)
        prior, measured = np.concatenate([e.prior for e in parts], axis=1), any(e.is_measured for e in parts)
        return cls(sensors, steps, seen, prior, measured)


def _times(part: Float[np.ndarray, "a b m"], coefficients: Float[np.ndarray, "m o"]) -> np.ndarray:
    """One product of all rows."""
    return (flat(part) @ coefficients).reshape(*part.shape[:2], -1)
