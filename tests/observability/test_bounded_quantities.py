"""Bounds of derived quantities, and how a certificate and a weak direction are worded."""

import numpy as np
import pytest

from observability import system as sensors
from observability.canonical_motions import landmarks, point_of
from observability.cases import Case
from observability.certificate import certify, document, sentences
from observability.coordinates import PrincipalChart
from observability.cramer_rao import (
    PLACE,
    bounded_quantities,
    cramer_rao_bound,
    ratio_jacobian,
    weak_direction_in_words,
)
from observability.system import System
from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.mass_distribution import from_inertia, inertia_matrix
from spinfilters.models.process import ProcessNoise
from tests.observability.analyser_samples import MOTIONS, TUMBLE
from tests.observability.bound_samples import LAYOUT, flight_of, stereo_watch

STEP = 1e-5


def ratios(x: np.ndarray) -> np.ndarray:
    """J1/J3 and J2/J3 of a state."""
    moments = np.linalg.eigvalsh(inertia_matrix(x[LAYOUT.mean_slice("s")]))
    return moments[:2] / moments[2]


def centre(x: np.ndarray) -> np.ndarray:
    """Place of the centre of mass."""
    R = matrix_from_quaternion(x[LAYOUT.mean_slice("a")])
    return x[LAYOUT.mean_slice("t")] + R @ x[LAYOUT.mean_slice("c")]


def test_slopes_of_the_ratios_are_finite_differences() -> None:
    x = LAYOUT.retract(LAYOUT.origin(), 0.3 * np.random.default_rng(0).standard_normal(LAYOUT.error_dim))
    eye = STEP * np.eye(LAYOUT.error_dim)[LAYOUT.slice("s")]
    differences = [(ratios(LAYOUT.retract(x, d)) - ratios(LAYOUT.retract(x, -d))) / (2 * STEP) for d in eye]
    np.testing.assert_allclose(
        ratio_jacobian(x[LAYOUT.mean_slice("s")]), np.transpose(differences), atol=1e-9
    )


def test_slopes_of_the_ratios_of_a_sphere_are_finite() -> None:
    assert np.isfinite(ratio_jacobian(from_inertia(np.eye(3)))).all()


def test_the_place_of_the_centre_of_mass_has_the_bound_of_its_slope_by_finite_differences() -> None:
    reference = flight_of(TUMBLE, 6, 0.5, ProcessNoise())
    bound = cramer_rao_bound(reference, [stereo_watch(4, 6)])
    eye, x = STEP * np.eye(LAYOUT.error_dim), reference.states[-1]
    slope = np.stack(
        [(centre(LAYOUT.retract(x, d)) - centre(LAYOUT.retract(x, -d))) / (2 * STEP) for d in eye], axis=1
    )
    expected = np.sqrt(np.trace(slope @ bound.covariances[-1] @ slope.T) / 3)
    assert bounded_quantities(bound, reference)[PLACE][-1] == pytest.approx(expected, rel=1e-7)


def test_a_weak_direction_is_named_by_its_largest_components() -> None:
    reference = flight_of(MOTIONS["spin about the minor axis"], 12, 0.5, ProcessNoise(0.0, 0.0))
    text = weak_direction_in_words(cramer_rao_bound(reference, [stereo_watch(4, 12)]))
    assert "; 100 % of the prior's deviation remains" in text
    assert (
        "(s: mass distribution; principal axes)" in text or "(c: centre of mass in g; principal axes)" in text
    )
    assert "w_" not in text


def test_an_open_certificate_says_that_its_rank_is_a_lower_bound_and_what_has_no_name() -> None:
    chart = PrincipalChart()
    system = System(chart, [sensors.watching("monocular", landmarks(1))])
    found = certify(system, point_of(chart, MOTIONS["no rotation"]))
    lines = sentences(found)
    assert f"{found.rank} of 23 unknowns at least are determined" in lines[0]
    assert f"{found.unnamed} without a name" in lines[1] or found.unnamed == 0
    assert "open: the exact rank is a lower bound" in lines[2]
    assert document(found)["certified"] is False


@pytest.mark.parametrize("sensor", ["stereo", "monocular", "lidar", "pose", "attitude", "gyro"])
def test_every_sensor_has_a_bound_that_falls(sensor: str) -> None:
    case = Case(sensors=(sensor,))
    reference = case.reference(20, 0.5)
    found = bounded_quantities(case.bound(reference), reference)
    assert found["inertia ratios", "1"][-1] < 0.8 * found["inertia ratios", "1"][0]
