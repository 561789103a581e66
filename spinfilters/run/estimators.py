"""The estimators of a comparison: an entry each, and the table of all.

One more is a class here, and a line in `OWN`. What an entry builds is imported when it is built, so that a comparison does not wait
for estimators that it leaves out; the MEKF and the smoother serve every run, for initialisation and verdict, and are imported here.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.chi_square import chi_square_tail
from spinfilters.core.errors import InputError
from spinfilters.core.plugins import entries_by_name, in_order, installed_plugins
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Estimator
from spinfilters.filters.filter import MultiplicativeFilter
from spinfilters.filters.flow_curvature import TURN, FlowCurvature
from spinfilters.filters.history import EstimateHistory
from spinfilters.filters.iterated_update import IterationOptions
from spinfilters.filters.noise_levels import VarianceComponent
from spinfilters.filters.timeline import OnEpoch, Timeline, times_of
from spinfilters.inference.estimator_entry import AnyEntry, EstimatorEntry
from spinfilters.inference.initial_estimate import InitialEstimate
from spinfilters.inference.noise_choice import adapted_levels, identified_scales
from spinfilters.inference.setup import Setup
from spinfilters.inference.smoother_run import (
    NAME,
    POSTERIOR,
    begin_after_initialisation,
    sample_at_once,
    sampled_history,
    sliding_smoother,
    smooth_and_sample,
    smoothed_history,
)
from spinfilters.io.sensor_format import sensor_format
from spinfilters.models.rotation_integrator import substeps, turns
from spinfilters.models.state_blocks import ACCELERATION, GYRO_BIAS
from spinfilters.settings.run_settings import Settings
from spinfilters.smoother.recursive_smoother import RecursiveSmoother
from spinfilters.smoother.window import FixedLag, FullSmoothing

if TYPE_CHECKING:
    from spinfilters.embedded.embedded_estimator import EmbeddedFilter
    from spinfilters.filters.ekf import InvariantEkf
    from spinfilters.filters.joint_ekf import JointEkf
    from spinfilters.filters.ukf import MultiplicativeUkf


UNTIL_CONVERGED = IterationOptions(iterations=30, tolerance=1e-6)
"""Of the iterated filter: to a millionth of a standard deviation, whatever the linear model promises."""


class MultiplicativeEntry(EstimatorEntry[MultiplicativeFilter]):
    """A multiplicative filter: it continues with the landmarks of the initialisation."""

    holds_landmarks = True

    def begin(self, estimator: MultiplicativeFilter, setup: Setup) -> None:
        """Start with the initialisation's belief and noise scales."""
        estimator.adapt_from(identified_scales(setup))
        estimator.start(setup.belief)

    def noise(
        self, estimator: MultiplicativeFilter, history: EstimateHistory, setup: Setup
    ) -> tuple[VarianceComponent, ...]:
        """Noise levels as adapted, in addition to those of the initialisation."""
        return adapted_levels(setup, estimator.level)

    def points(
        self, estimator: MultiplicativeFilter, history: EstimateHistory, setup: Setup
    ) -> Float[np.ndarray, "k 3"] | None:
        """Landmarks of the filter; those of the setup after a failure or without estimated ones."""
        if history.has_failed or not setup.maps_landmarks:
            return setup.map_points
        return estimator.landmark_belief.points_in_g

    def false_alarm_probability(self, setup: Setup, settings: Settings) -> float:
        """One minus the gate's probability."""
        return 1.0 - settings.robust.gate_probability


class MekfEntry(MultiplicativeEntry):
    """Table entry of `MultiplicativeEkf`."""

    name, order = "mekf", 0

    def build(self, setup: Setup, settings: Settings) -> MultiplicativeEkf:
        """The multiplicative EKF with the run's options."""
        return MultiplicativeEkf(
            setup.process,
            settings.robust,
            settings.adaptation,
            settings.iteration,
            settings.landmarks,
            FlowCurvature(TURN),
        )


class UkfEntry(MultiplicativeEntry):
    """Table entry of `MultiplicativeUkf`."""

    name, order = "ukf", 1

    def build(self, setup: Setup, settings: Settings) -> "MultiplicativeUkf":
        """The multiplicative UKF with the run's options."""
        from spinfilters.filters.ukf import MultiplicativeUkf

        return MultiplicativeUkf(
            setup.process, settings.ukf, settings.robust, settings.adaptation, settings.landmarks
        )


class IteratedEntry(MultiplicativeEntry):
    """Table entry of the iterated EKF: the MEKF, every update of which is iterated until it converges."""

    name, order = "iekf", 8

    def build(self, setup: Setup, settings: Settings) -> MultiplicativeEkf:
        """The multiplicative EKF with updates iterated to convergence."""
        return MultiplicativeEkf(
            setup.process,
            settings.robust,
            settings.adaptation,
            UNTIL_CONVERGED,
            settings.landmarks,
            FlowCurvature(TURN),
        )


class RauchTungStriebelEntry(MekfEntry):
    """Table entry of the fixed-interval smoother of the MEKF: the same run, then `smooth_backwards`.

    Epochs of the initialisation stay as the initialisation has smoothed them.
    """

    name, order = "rts", 9
    holds_landmarks = False

    def final(
        self, estimator: MultiplicativeFilter, passed: EstimateHistory, setup: Setup
    ) -> EstimateHistory | None:
        """Every epoch given all measurements, linearised where the MEKF was."""
        from spinfilters.filters.rauch_tung_striebel import smooth_backwards

        if passed.has_failed:
            return None
        return smooth_backwards(setup.process, passed).preceded_by(setup.initial_arrays)


class InvariantEntry(MultiplicativeEntry):
    """Table entry of `InvariantEkf`."""

    name, order = "invariant", 10
    holds_landmarks = False

    def build(self, setup: Setup, settings: Settings) -> "InvariantEkf":
        """The invariant EKF with the run's options."""
        from spinfilters.filters.ekf import InvariantEkf

        return InvariantEkf(setup.process, settings.robust, settings.adaptation, settings.invariant)


class JointEntry(EstimatorEntry["JointEkf"]):
    """Table entry of `JointEkf`."""

    name, order = "ekf-joint", 11
    is_baseline = True
    holds_landmarks = True

    def build(self, setup: Setup, settings: Settings) -> "JointEkf":
        """The EKF with all landmarks in its state."""
        from spinfilters.filters.joint_ekf import JointEkf

        return JointEkf(setup.process, settings.robust)

    def begin(self, estimator: "JointEkf", setup: Setup) -> None:
        """Start with the initialisation's belief, landmarks included."""
        estimator.start(setup.belief)

    def points(
        self, estimator: "JointEkf", history: EstimateHistory, setup: Setup
    ) -> Float[np.ndarray, "k 3"] | None:
        """Landmarks of its state; those of the setup without estimated ones."""
        return estimator.points if setup.maps_landmarks else setup.map_points

    def false_alarm_probability(self, setup: Setup, settings: Settings) -> float:
        """One minus the gate's probability."""
        return 1.0 - settings.robust.gate_probability


@dataclass(frozen=True)
class BatchSmoother:
    """Batch smoother of sensors without landmarks, by a function such as `smooth_and_sample`."""

    setup: Setup
    settings: Settings
    smooth_all: Callable[[Setup, Settings, OnEpoch], EstimateHistory]

    def smooth(self, timeline: Timeline, initial: InitialEstimate, on_epoch: OnEpoch) -> EstimateHistory:
        """Smooth from the trajectory of an EKF that continues the initialisation."""
        own = replace(self.setup, timeline=timeline, initial=initial)
        return self.smooth_all(own, self.settings, on_epoch)


class SmootherEntry(EstimatorEntry[RecursiveSmoother]):
    """Recursive for tracks without a map (`RecursiveSmoother`), batch for everything else (`BatchSmoother`)."""

    name, order = NAME, 2
    holds_landmarks = True
    continues = False

    def batch(self, setup: Setup, settings: Settings) -> BatchSmoother | None:
        """The batch smoother where no landmarks are estimated, else None."""
        return None if setup.initial.has_landmarks else BatchSmoother(setup, settings, smooth_and_sample)

    def build(self, setup: Setup, settings: Settings) -> RecursiveSmoother:
        """The sliding smoother with the run's options."""
        return sliding_smoother(setup, settings)

    def begin(self, estimator: RecursiveSmoother, setup: Setup) -> None:
        """Begin with the epochs of the initialisation."""
        begin_after_initialisation(estimator, setup)

    def final(
        self, estimator: RecursiveSmoother, passed: EstimateHistory, setup: Setup
    ) -> EstimateHistory | None:
        """Smoothed estimates of all epochs."""
        return smoothed_history(estimator, passed, setup)

    def points(
        self, estimator: RecursiveSmoother, history: EstimateHistory, setup: Setup
    ) -> Float[np.ndarray, "k 3"] | None:
        """Landmarks (k, 3), m, frame g, of the last window."""
        return estimator.sliding.window.points

    def false_alarm_probability(self, setup: Setup, settings: Settings) -> float:
        """Chi-square tail beyond the gate, zero of other losses."""
        if settings.smoother.loss != "gate":
            return 0.0
        dimension = max(sensor_format(sensor).dimension for sensor in setup.dataset.log.sensors)
        return float(chi_square_tail(settings.smoother.width**2, dimension))


MOST_SAMPLED_EPOCHS = 400
"""Of a recording whose posterior is sampled: every sample holds all of them."""


class PosteriorEntry(SmootherEntry):
    """Table entry of the reference posterior (`spinfilters.smoother.posterior`)."""

    name, order = POSTERIOR, 30

    def batch(self, setup: Setup, settings: Settings) -> BatchSmoother | None:
        """The sampler about the smoother's solution, `sample_at_once`; None where landmarks are estimated.

        Raises
        ------
        InputError
            A recording that is too long.
        """
        if len(setup.timeline) > MOST_SAMPLED_EPOCHS:
            raise InputError(
                f"{self.name} takes at most {MOST_SAMPLED_EPOCHS} epochs, this recording has {len(setup.timeline)}; cut it "
                "(--segment), or leave the estimator out"
            )
        return None if setup.initial.has_landmarks else BatchSmoother(setup, settings, sample_at_once)

    def build(self, setup: Setup, settings: Settings) -> RecursiveSmoother:
        """The sliding smoother, which no epoch leaves."""
        return sliding_smoother(setup, settings, FullSmoothing())

    def final(self, estimator: RecursiveSmoother, passed: EstimateHistory, setup: Setup) -> EstimateHistory:
        """Samples about the smoother's solution."""
        return sampled_history(estimator, passed, setup)


class LatestSmootherEntry(SmootherEntry):
    """Table entry of the smoother without revision by later measurements, to be compared with filters."""

    name, order = "smoother-latest", 7

    def batch(self, setup: Setup, settings: Settings) -> BatchSmoother | None:
        """None: it takes landmarks epoch by epoch.

        Raises
        ------
        InputError
            Measurements without landmarks to be found, all of whose epochs the smoother takes at once.
        """
        if not setup.initial.has_landmarks:
            raise InputError(f"{self.name} takes only tracks without a map; choose smoother")
        return None

    def final(self, estimator: RecursiveSmoother, passed: EstimateHistory, setup: Setup) -> None:
        """None: what it said of each epoch as it came stands."""


class FixedLagEntry(SmootherEntry):
    """Table entry of the smoother with a fixed lag: an epoch leaves so many epochs behind the latest, and is final then.

    The window begins with the epochs of the initialisation. It is the same for all sensors, with landmarks or without.

    Parameters
    ----------
    lag : int
        Epochs between the latest and the one that leaves, at least; a fifth of a window leaves together.
    order : int
        Place in the table.
    """

    forgets = True

    def __init__(self, lag: int, order: int) -> None:
        self.name, self.order, self.lag = f"smoother-lag-{lag}", order, lag

    def batch(self, setup: Setup, settings: Settings) -> None:
        """None: it is always recursive."""

    def build(self, setup: Setup, settings: Settings) -> RecursiveSmoother:
        """The sliding smoother whose window holds so many epochs behind the latest, however little of the inertia is known."""
        return sliding_smoother(setup, settings, FixedLag(self.lag + 1, determined=np.inf))

    def final(
        self, estimator: RecursiveSmoother, passed: EstimateHistory, setup: Setup
    ) -> EstimateHistory | None:
        """Every epoch as it left the window, those still in it as they are in the end."""
        return replace(smoothed_history(estimator, passed, setup), name=self.name)


LARGEST_MAP = 16_384
"""Landmarks that the map holds: 48 bytes each."""


class EmbeddedEntry(EstimatorEntry["EmbeddedFilter"]):
    """Table entry of `spinfilters.embedded.embedded_estimator.EmbeddedFilter`."""

    name, order, real = "embedded", 5, "float"
    holds_landmarks = True

    def build(self, setup: Setup, settings: Settings) -> "EmbeddedFilter":
        """The embedded filter in compiled C. InputError: unfit sensors, no compiler."""
        from spinfilters.embedded.embedded_estimator import EmbeddedFilter
        from spinfilters.embedded.embedded_options import EmbedOptions
        from spinfilters.embedded.emitted_sensors import EMITTED_SENSORS

        sensors = setup.dataset.log.sensors
        fit = (each for each in EMITTED_SENSORS.values() if set(sensors) <= set(each.taken))
        sensor = next(fit, None)
        if sensor is None:
            raise InputError(
                f"the embedded filter takes stereo tracks and poses, poses, or a gyro, not {' and '.join(sensors)}; leave it out "
                "of --estimators"
            )
        count = _substeps(setup, settings.process.tolerance)
        layout = setup.process.layout
        bias_std = settings.initialisation.gyro_bias_std if layout.has(GYRO_BIAS) else 0.0
        pulled = layout.has(ACCELERATION)
        options = EmbedOptions(sensor.name, LARGEST_MAP, self.real, count, bias_std, acceleration=pulled)  # pyright: ignore[reportArgumentType]  (checked there)
        return EmbeddedFilter(setup.process, options)

    def begin(self, estimator: "EmbeddedFilter", setup: Setup) -> None:
        """Start with the belief of the initialisation."""
        estimator.start(setup.belief)

    def points(
        self, estimator: "EmbeddedFilter", history: EstimateHistory, setup: Setup
    ) -> Float[np.ndarray, "k 3"] | None:
        """Landmarks (k, 3), m, frame g, of the known or the estimated map."""
        return setup.map_points if setup.dataset.known_map is not None else estimator.points

    def false_alarm_probability(self, setup: Setup, settings: Settings) -> float:
        """1e-4, the tail beyond the fixed gate."""
        return 1e-4


def _substeps(setup: Setup, tolerance: float) -> int:
    """Substeps of the Python filter's longest step at the initialisation's rate."""
    longest = np.diff(times_of(setup.timeline)).max(initial=0.0)
    rates = setup.initial.mean[:, setup.process.layout.mean_slice("w")]
    turn = float(np.nanmax(turns(rates, np.array(longest)), initial=0.0))
    return min(max(substeps(turn, tolerance), 4), 64) if np.isfinite(turn) else 4


class EmbeddedDoubleEntry(EmbeddedEntry):
    """Table entry of the embedded filter in double precision: what float costs is the difference."""

    name, order, real = "embedded-double", 6, "double"


class FilterpyEkfEntry(EstimatorEntry[Estimator]):
    """Table entry of `spinfilters.filters.baselines.FilterpyEkf`."""

    name, order = "filterpy-ekf", 3
    is_baseline = True

    def build(self, setup: Setup, settings: Settings) -> Estimator:
        """filterpy's EKF on the run's process."""
        from spinfilters.filters.baselines import FilterpyEkf

        return FilterpyEkf(setup.process)


class FilterpyUkfEntry(EstimatorEntry[Estimator]):
    """Table entry of `spinfilters.filters.baselines.FilterpyUkf`."""

    name, order = "filterpy-ukf", 4
    is_baseline = True

    def build(self, setup: Setup, settings: Settings) -> Estimator:
        """filterpy's UKF on the run's process."""
        from spinfilters.filters.baselines import FilterpyUkf

        return FilterpyUkf(setup.process)


LAGS: Final = (1, 2, 5, 10, 20, 50)
"""Lags of the smoothers with a fixed lag, epochs."""
OWN: Final[tuple[AnyEntry, ...]] = (
    MekfEntry(),
    UkfEntry(),
    SmootherEntry(),
    FilterpyEkfEntry(),
    FilterpyUkfEntry(),
    EmbeddedEntry(),
    EmbeddedDoubleEntry(),
    LatestSmootherEntry(),
    IteratedEntry(),
    RauchTungStriebelEntry(),
    InvariantEntry(),
    JointEntry(),
    PosteriorEntry(),
    *(FixedLagEntry(lag, 12 + place) for place, lag in enumerate(LAGS)),
)
"""Estimators of this package; the settings take their names from here (`spinfilters.settings.run_settings.estimator_names`)."""


def estimator_entries() -> dict[str, AnyEntry]:
    """Entries by name, in their order: these, and those of the entry points ``spinfilters.estimators``.

    InputError: a plug-in that cannot be loaded, a name that stands twice.
    """
    others = installed_plugins("spinfilters.estimators", EstimatorEntry)
    return entries_by_name(in_order((*OWN, *others)), "estimator")
