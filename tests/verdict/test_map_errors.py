"""Poses that were registered to a map share its errors, which depend on the view and look like other causes."""

from dataclasses import replace

import numpy as np
import pytest
from plain_comparison import plain_comparison

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.models.process import ProcessNoise
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate

POSITION_STD, ROTATION_STD = 1e-3, 2e-3
INFLATION = 2.0


def recording(map_error: float, drift: float, rate: float) -> Dataset:
    """Registered poses whose map is shifted by so much (m, g axes) before the view of its x side, and which drift in the body."""
    scenario = Scenario.simplified(
        kind="pose",
        principal_moments=(1.0, 0.8, 0.55),
        rate_rpm=(rate, 2 * rate, 1.5 * rate),
        epochs=40,
        interval=1.0,
        position_std=POSITION_STD,
        rotation_std=ROTATION_STD,
        noise=ProcessNoise(1e-10, 1e-10),
    )
    dataset = simulate(scenario)
    (stream,) = dataset.log.streams
    R, place = matrix_from_quaternion(stream.values[:, 3:]), stream.values[:, :3]
    view = np.einsum("kji,kj->ki", R, place / np.linalg.norm(place, axis=1, keepdims=True))
    late = np.linspace(-0.5, 0.5, len(place))
    shift = map_error * view[:, :1] * [0.5, 1.0, -0.7] + drift * late[:, None] * [0.0, 0.6, 0.8]
    values = np.concatenate([place + np.einsum("kij,kj->ki", R, shift), stream.values[:, 3:]], axis=1)
    covariance = INFLATION * np.diag(np.repeat([POSITION_STD, ROTATION_STD], 3) ** 2)
    rows = replace(stream, values=values, covariance=np.broadcast_to(covariance, (len(place), 6, 6)))
    options = replace(dataset.options, covariance_inflation=INFLATION)
    return replace(dataset, log=MeasurementLog((rows,)), options=options)


@pytest.mark.parametrize(
    ("map_error", "drift", "rate", "names"),
    [
        (0.0, 0.0, 1.0, ()),
        (4e-3, 0.0, 1.0, ("map-error",)),
        (
            0.0,
            0.02,
            1.0,
            ("map-error",),
        ),  # views come back twice only, so that the data do not tell which it is
        (0.0, 0.02, 5.0, ("point-drift",)),
    ],
)
def test_errors_of_a_map_are_not_taken_for_a_drift_of_the_point(
    map_error: float, drift: float, rate: float, names: tuple[str, ...]
) -> None:
    models = plain_comparison(recording(map_error, drift, rate), Settings(estimators=("smoother",))).models
    assert models.names == names
