"""The embedded filter's C in float, as it flies."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from spinfilters.errors import InputError
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.timeline import times_of
from spinfilters.models.rotation_integrator import substeps, turns
from spinfilters.pipeline.estimator_entry import EstimatorEntry
from spinfilters.pipeline.setup import Setup
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
        options = EmbedOptions(sensor.name, LARGEST_MAP, self.real, count)
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
