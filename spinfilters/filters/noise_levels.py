"""Noise levels: posterior mean of a density, identified variance components, and adaptation to the innovations.

Posterior mean of a disturbance density. n squares determine a density theta in the presence of other noise: their variance is
1 - q + q theta / theta_0, with q the share of the density in it and theta_0 the most probable density under a prior that is flat
in its standard deviation. With y = ln theta / theta_0,

    ln p(y) = -n/2 (ln w + s / w) + y / 2,   w = 1 - q + q e^y,   s = 1 - 1 / (n q),   information of the data n q^2 / 2.

Squares of the density alone (q = 1) are skewed upwards: its mean lies by 2 / n above. Where other noise is larger (q near 0)
likelihood and prior reach down to zero, and the mean lies below the most probable value. A covariance in proportion to the mean
is that of the errors, whatever the density is.

Variance components. `ComponentRows` says which innovations a noise level explains, `VarianceComponent` what is identified of
it.

Adaptation. `NoiseAdaptation` follows the innovations by scale factors of each sensor's covariance and of the disturbances'
densities. For the logarithm of a scale that the covariance of the innovations depends on, the derivative of their
log-likelihood is half of

    y'Dy - tr D K,   its Fisher information half of tr (D K)^2,   cov y = K,

y what the update found of a unit normal quantity, K the share of its covariance that was explained, D what the scale adds to that
covariance. Log scale moves by log(1 + (y'Dy - tr D K) / I) with I the sum of tr (D K)^2 so far, forgotten over a horizon.

    sensor       y = residual after the update, K = S^-1, D = 1: the form R = E[r r'] + H P+ H' of Mohamed and Schwarz (1999)
    disturbance  F y = the correction, K = 1 - F^-1 P+ F^-T, P- = F F', F D F' = dP-/d log scale, which grows by
                 Phi . Phi' + G G' in a prediction and shrinks by P+ P-^-1 . P-^-1 P+ in an update (Mehra 1970 for the idea): the
                 noise of one step is hardly seen at once, but what all of them have left in the belief is. What is kept is D, and
                 (1 - K)' F' that carries it into the next prediction.
"""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated, Final, NamedTuple, Protocol

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.core.linear_algebra import dtrtri, dtrtrs
from spinfilters.io.disturbances import DENSITIES, NAMES, noise_columns
from spinfilters.io.stated_values import NumberRange
from spinfilters.models.state_layout import StateLayout

PRIOR_INFORMATION: Final = 0.5
"""Of the logarithm of a level, by a prior that is flat in its standard deviation."""
LEAST_INFORMATION: Final = 1e-3
"""Of the data, below which they contain no information."""
SMALLEST_VARIANCE: Final = 1e-9
DEVIATIONS: Final = np.linspace(-12.0, 5.0, 600)
"""Over which y is integrated, in its own standard deviations, of which none is taken for more than 1."""


@lru_cache(maxsize=1024)
def raised_logarithm(variance: float, share: float = 1.0) -> float:
    """Logarithm of a density's mean over the most probable one.

    Parameters
    ----------
    variance : float
        Variance of the density's logarithm, prior included.
    share : float
        Share q of the density in the variance of its data; at most the data's share of the information, so that s > 0.
    """
    variance = max(variance, SMALLEST_VARIANCE)
    information = max(1 / variance - PRIOR_INFORMATION, LEAST_INFORMATION)
    q = min(share, information / (information + PRIOR_INFORMATION))
    n = 2 * information / q**2
    y = min(variance, 1.0) ** 0.5 * DEVIATIONS
    w = 1 - q + q * np.exp(y)
    log_posterior = -n / 2 * (np.log(w) + (1 - 1 / (n * q)) / w) + y / 2
    weight = np.exp(log_posterior - log_posterior.max())
    return float(np.log(np.sum(weight * np.exp(y)) / np.sum(weight)))


TOLD_LOG_STD: Final = 0.6
"""Standard deviation of ln variance above which the data only bound a component from above."""
BOUND_STD: Final = 2.0
"""Standard deviations of ln variance from the estimate to the upper bound that is stated of such a component."""


@dataclass(frozen=True)
class ComponentRows:
    """A noise level of sensors: the innovations that it is the standard deviation of.

    Attributes
    ----------
    name : str
        Name of the noise option.
    value : float
        Value with which the problem was stated, in the option's unit.
    sensors : Mapping[int, tuple[int, ...]]
        Rows of the innovation, by the sensor's number in `Motion.sensors`.
    landmarks : bool
        Whether observations of landmarks are scaled by it.
    smallest : float
        Level below which an identification does not go, in the option's unit; 0 for no bound.
    """

    name: str
    value: float
    sensors: Mapping[int, tuple[int, ...]] = field(default_factory=dict)
    landmarks: bool = False
    smallest: float = 0.0


@dataclass(frozen=True)
class VarianceComponent:
    """An identified noise level.

    Attributes
    ----------
    value : float
        Standard deviation of a sensor in the unit of its option, or density of a disturbance.
    log_std : float
        Standard deviation of ln variance (of a density, of its ln).
    share : float
        Share of the level in the variance of the data that identify it; the rest is other noise.
    """

    name: str
    value: float
    log_std: float
    share: float = 1.0

    @property
    def is_density(self) -> bool:
        """Whether it is the density of a disturbance."""
        return self.name in DENSITIES

    @property
    def told(self) -> bool:
        """Whether the data distinguish it from zero; if not, `upper` bounds it."""
        return self.log_std < TOLD_LOG_STD

    @property
    def expected(self) -> float:
        """Level to estimate with: of a density its mean."""
        if not self.is_density:
            return self.value
        return self.value * float(np.exp(raised_logarithm(self.log_std**2, self.share)))

    @property
    def upper(self) -> float:
        """Upper bound, in the unit of the value."""
        half = 1.0 if self.is_density else 0.5
        return self.value * float(np.exp(half * BOUND_STD * self.log_std))

    def scaled(self, log_variance: float, share: float) -> "VarianceComponent":
        """Of exp(log_variance) times the variance, with this share of the deviation."""
        half = 1.0 if self.is_density else 0.5
        value = self.value * float(np.exp(half * log_variance))
        return VarianceComponent(self.name, value, share * self.log_std, self.share)

    @property
    def std(self) -> float:
        """Standard deviation of the value, to first order."""
        half = 1.0 if self.is_density else 0.5
        return self.value * half * self.log_std


LARGEST_SCALE = 1000.0
"""Of a covariance or density, and the inverse of the smallest: beyond it the model is wrong, not its noise."""
FIRST_INFORMATION = 2.0
"""In scalar measurements, added to what is known: bounds the first steps, and those of a source hardly ever seen."""
SMALLEST_FACTOR = 0.1
"""By which one step multiplies a scale."""
BLOCK, CYCLE = 16, 512
"""Predictions of every cycle from which an identified level is learned further, its last. An epoch that is learned from costs an
EKF up to 3.8 times one that is not (a gyro's), so that all together cost a tenth; what is lost is little compared with what was
identified."""


HORIZON = NumberRange(1, 1e9, "updates", zero=True)


@dataclass(frozen=True)
class AdaptationOptions:
    """Options of noise adaptation: how fast it follows the innovations.

    Attributes
    ----------
    measurement : float
        Horizon of the sensors' scales, in updates of the sensor; 0 keeps the stated noise.
    process : float
        Horizon of the disturbances' scales, in predictions; 0 keeps the stated densities.
    """

    measurement: Annotated[float, HORIZON] = 0.0
    process: Annotated[float, HORIZON] = 0.0

    def __post_init__(self) -> None:
        for name in ("measurement", "process"):
            value = getattr(self, name)
            if not (np.isfinite(value) and (value == 0 or value >= 1)):
                raise InputError(f"adaptation.{name} is {value}; give 0 for none or a horizon of at least 1")


@dataclass(frozen=True)
class NoiseEvidence:
    """Evidence of one update on a noise scale: y'Dy, tr D K and tr (D K)^2 of the module's docstring."""

    squared: float
    expected: float
    information: float


@dataclass(frozen=True)
class NoiseScale:
    """Logarithm of a covariance scale, its information, and a density's share (`raised_logarithm`)."""

    logarithm: float = 0.0
    information: float = 0.0
    share: float = 1.0

    def after(self, evidence: NoiseEvidence, horizon: float) -> "NoiseScale":
        """Scale after further evidence, with exponential forgetting over this horizon."""
        information = (1 - 1 / horizon) * self.information + evidence.information
        excess = (evidence.squared - evidence.expected) / (information + FIRST_INFORMATION)
        step = np.log(max(1 + excess, SMALLEST_FACTOR)) if np.isfinite(excess) else 0.0
        limit = np.log(LARGEST_SCALE)
        return NoiseScale(float(np.clip(self.logarithm + step, -limit, limit)), information, self.share)


class UpdateOutcome(Protocol):
    """Outcome of an update in the coordinates y of the prior belief.

    Correction y and triangle U (`spinfilters.filters.square_root.Correction`), NIS and its degrees of freedom.
    """

    @property
    def coordinates(self) -> Float[np.ndarray, " n"]:
        """Correction y."""
        ...

    @property
    def root(self) -> Float[np.ndarray, "r r"]:
        """Triangle U."""
        ...

    @property
    def nis(self) -> float:
        """Normalised innovation squared."""
        ...

    @property
    def dof(self) -> int:
        """Degrees of freedom."""
        ...


class PredictedMotion(NamedTuple):
    """A predicted belief with its transition and its process noise.

    Mean (m,), covariance factor (N, N) lower triangular, of its first n rows the transition (n, n) of the error, and factor (n,
    k) of the noise that was added, as scaled.
    """

    mean: Float[np.ndarray, " m"]
    factor: Float[np.ndarray, "N N"]
    transition: Float[np.ndarray, "n n"]
    noise: Float[np.ndarray, "n k"]


class NoiseAdaptation:
    """Scale factors of all noise sources of one filter, and the evidence on those of the disturbances.

    Parameters
    ----------
    identified : Mapping[str, NoiseScale] or None
        Scales by source ("sensor.pose", "process.torque") with the information that an identification has gathered. They go
        on from there, by a part of the epochs (`BLOCK`) and forgetting nothing where the options give no horizon; a density
        is scaled to its mean (`raised_logarithm`).
    """

    def __init__(
        self, options: AdaptationOptions, identified: Mapping[str, NoiseScale] | None = None
    ) -> None:
        self.options, self.identified = options, dict(identified or {})
        self._scales: dict[str, NoiseScale] = {}
        self._factors: dict[str, float] = {}
        self._column_scales: dict[tuple[str, ...], np.ndarray] = {}
        self._known: dict[str, np.ndarray] = {}
        self._predictions = 0

    def measurement_scale(self, sensor: str) -> float:
        """Scale of the sensor's noise covariance; 1 without adaptation."""
        return self._scale(f"sensor.{sensor}")

    def process_scale(self, source: str) -> float:
        """Scale of the density of a disturbance, by its name; 1 without adaptation."""
        return self._scale(f"process.{source}")

    def scaled(self, layout: StateLayout, noise: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
        """The noise factor of a process over this layout with its columns scaled."""
        scales = self.column_scales(layout)
        return noise if (scales == 1.0).all() else noise * scales

    def column_scales(self, layout: StateLayout) -> Float[np.ndarray, " k"]:
        """Factors of the columns of the noise factor of a process over this layout."""
        if layout.blocks not in self._column_scales:  # in most epochs nothing is learned
            columns = noise_columns(layout.blocks)
            scales = np.ones(max(at.stop for at in columns.values()))
            for source, at in columns.items():
                scales[at] = np.sqrt(self.process_scale(source))
            self._column_scales[layout.blocks] = scales
        return self._column_scales[layout.blocks]

    def observe_measurement(self, sensor: str, correction: UpdateOutcome) -> None:
        """Learn a sensor's scale from its update, which was made with `measurement_scale`."""
        name = f"sensor.{sensor}"
        if self._horizon(name):
            self._learn(name, residual_evidence(correction))

    def expect_motion(self, layout: StateLayout, motion: "PredictedMotion") -> None:
        """Store a prediction for comparison with the updated belief."""
        self._predictions += 1
        columns = noise_columns(layout.blocks)
        sources = [source for source in columns if self._horizon(f"process.{source}")]  # that adapt now
        if not sources:
            self._known = {}
            return
        n = len(motion.transition)
        factor = motion.factor[:n, :n]
        carried = self._known.get("carried", np.zeros((n, n)))
        solved, failed = dtrtrs(factor, np.hstack([motion.transition @ carried, motion.noise]), lower=1)
        kept = {} if failed else {"mean": motion.mean, "factor": factor}
        moved, entered = solved[:, :n], solved[:, n:]
        for source in sources if kept else ():
            own = entered[:, columns[source]]
            kept[source] = own @ own.T
            if source in self._known:
                kept[source] += moved @ self._known[source] @ moved.T
        self._known = kept

    def observe_motion(
        self, layout: StateLayout, mean: Float[np.ndarray, " m"], factor: Float[np.ndarray, "n r"]
    ) -> None:
        """Update the disturbances' scales by the belief's change since `expect_motion`."""
        known, self._known = self._known, {}
        if "factor" not in known:
            return
        predicted = known["factor"]
        error = layout.local(known["mean"], mean)
        # the belief refers to its own mean: in the prediction's tangent space it may turn out wider than predicted where it is thin
        reset = layout.reset_jacobian(error) if layout.curved else None
        at_prediction = factor if reset is None else np.linalg.solve(reset, factor)
        solved, failed = dtrtrs(predicted, np.column_stack([at_prediction, error]), lower=1)
        if failed:
            return
        left, y = solved[:, :-1] @ solved[:, :-1].T, solved[:, -1]
        carried = predicted @ left
        self._known = {"carried": carried if reset is None else reset @ carried}
        for source in NAMES:
            if source in known:
                self._known[source] = known[source]
                self._learn(f"process.{source}", motion_evidence(known[source], left, y))

    def constant_predictions(self, sensors: Sequence[str]) -> int:
        """For how many predictions to come no scale changes: neither of these sensors nor of a disturbance.

        Parameters
        ----------
        sensors : Sequence[str]
            Names of the sensors that measure then.
        """
        sources = (*(f"sensor.{name}" for name in sensors), *(f"process.{source}" for source in NAMES))
        if self._known or any(
            self.options.measurement if name.startswith("sensor.") else self.options.process
            for name in sources
        ):
            return 0
        if self.identified.keys().isdisjoint(sources):
            return sys.maxsize
        return max(CYCLE - BLOCK - 1 - self._predictions % CYCLE, 0)

    def count_predictions(self, predictions: int) -> None:
        """Count predictions in which no scale changed."""
        self._predictions += predictions

    def snapshot(self) -> dict[str, np.ndarray]:
        """Everything learned, as arrays named ``noise.<what>``."""
        scales = {
            f"noise.{name}": np.array([scale.logarithm, scale.information, scale.share])
            for name, scale in self._scales.items()
        }
        if self.identified:
            scales["noise.predictions"] = np.array(self._predictions)
        return scales | {f"noise.known.{name}": array.copy() for name, array in self._known.items()}

    def restore(self, snapshot: dict[str, np.ndarray]) -> None:
        """Go on from the `snapshot` among these arrays."""
        self._scales, self._factors, self._known, self._column_scales = {}, {}, {}, {}
        self._predictions = int(snapshot.get("noise.predictions", 0))
        for key, array in snapshot.items():
            name = key.removeprefix("noise.")
            if name.startswith("known."):
                self._known[name.removeprefix("known.")] = array.copy()
            elif name != key and name != "predictions":
                self._scales[name] = NoiseScale(*array.tolist())

    def level(self, name: str) -> NoiseScale:
        """Most probable scale of a source so far."""
        return self._scales.get(name, self.identified.get(name, NoiseScale()))

    def _scale(self, name: str) -> float:
        if name not in self._factors:  # in most epochs nothing is learned
            level, raised = self.level(name), 0.0
            if name in self.identified and name.startswith("process."):
                raised = raised_logarithm(2 / level.information, level.share)
            self._factors[name] = float(np.exp(level.logarithm + raised))
        return self._factors[name]

    def _horizon(self, name: str) -> float:
        """Number of updates over which a source's evidence is forgotten; 0 where nothing is learned now."""
        stated = self.options.measurement if name.startswith("sensor.") else self.options.process
        if stated or name not in self.identified:
            return stated
        return np.inf if self._predictions % CYCLE >= CYCLE - BLOCK else 0.0

    def _learn(self, name: str, evidence: NoiseEvidence) -> None:
        self._scales[name] = self.level(name).after(evidence, self._horizon(name))
        self._factors.pop(name, None)
        self._column_scales.clear()


def residual_evidence(correction: UpdateOutcome) -> NoiseEvidence:
    """Evidence on a sensor's noise.

    |r|^2 = nis - |y|^2, and S^-1 has r eigenvalues of (U'U)^-1 and else ones.
    """
    y, inverse = correction.coordinates, np.triu(dtrtri(correction.root)[0])
    left = inverse @ inverse.T
    free = correction.dof - len(left)
    squared = max(correction.nis - float(y @ y), 0.0)
    return NoiseEvidence(squared, free + float(np.trace(left)), free + float(np.sum(left * left)))


def motion_evidence(
    sensitivity: Float[np.ndarray, "n n"], left: Float[np.ndarray, "n n"], y: Float[np.ndarray, " n"]
) -> NoiseEvidence:
    """Evidence on a disturbance. From D, the remaining covariance 1 - K of y, and y."""
    share = sensitivity - sensitivity @ left
    return NoiseEvidence(float(y @ sensitivity @ y), float(np.trace(share)), float(np.sum(share * share.T)))
