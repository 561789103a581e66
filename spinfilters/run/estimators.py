"""The estimators of a comparison: an entry each, and the table of all.

One more is a class, in a file of its own or here, and a line in `OWN`.
"""

from typing import TYPE_CHECKING, Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.core.plugins import entries_by_name, in_order, installed_plugins
from spinfilters.filters.estimator import Estimator
from spinfilters.filters.history import EstimateHistory
from spinfilters.filters.timeline import times_of
from spinfilters.inference.estimator_entry import AnyEntry, EstimatorEntry
from spinfilters.inference.setup import Setup
from spinfilters.models.rotation_integrator import substeps, turns
from spinfilters.run.filter_entries import (
    InvariantEntry,
    IteratedEntry,
    JointEntry,
    MekfEntry,
    RauchTungStriebelEntry,
    UkfEntry,
)
from spinfilters.run.smoother_entries import FixedLagEntry, LatestSmootherEntry, SmootherEntry
from spinfilters.settings.run_settings import Settings

if TYPE_CHECKING:
    from spinfilters.embedded.embedded_estimator import EmbeddedFilter


LARGEST_MAP = 16_384
"""Landmarks that the map holds: 48 bytes each."""


class EmbeddedEntry(EstimatorEntry["EmbeddedFilter"]):
    """Table entry of `spinfilters.embedded.embedded_estimator.EmbeddedFilter`."""

    name, order, real = "embedded", 5, "float"
    holds_landmarks = True

    def build(self, setup: Setup, settings: Settings) -> "EmbeddedFilter":
        """The embedded filter in compiled C. InputError: unfit sensors, no compiler."""
        from spinfilters.embedded.embedded_estimator import (
            EmbeddedFilter,  # builds expressions, rarely asked for
        )
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
        options = EmbedOptions(sensor.name, LARGEST_MAP, self.real, count)  # pyright: ignore[reportArgumentType]  (checked there)
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


# filterpy is slow to import and rarely asked for: each is imported when it is built


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
    *(FixedLagEntry(lag, 12 + place) for place, lag in enumerate(LAGS)),
)
"""Estimators of this package; the settings take their names from here (`spinfilters.settings.run_settings.estimator_names`)."""


def estimator_entries() -> dict[str, AnyEntry]:
    """Entries by name, in their order: these, and those of the entry points ``spinfilters.estimators``.

    InputError: a plug-in that cannot be loaded, a name that stands twice.
    """
    others = installed_plugins("spinfilters.estimators", EstimatorEntry)
    return entries_by_name(in_order((*OWN, *others)), "estimator")
