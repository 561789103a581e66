"""The ranks that are known of rigid bodies, exactly."""

import numpy as np
import pytest

from observability import system as sensors
from observability.canonical_motions import landmarks, motion, point_of
from observability.certificate import Certificate, certify
from observability.coordinates import RATIOS, Chart, PrincipalChart, TensorChart
from observability.exact_numbers import rationals
from observability.system import Input, System, SystemSensor
from tests.observability.analyser_samples import (
    CHARTS,
    EULER,
    LOG_RATIOS,
    MOTIONS,
    TUMBLE,
    Z_SPIN,
    stereo_system,
)
from tests.observability.float_rank import float_rank

GYRO, PRINCIPAL, TENSOR = sensors.watching("gyro"), PrincipalChart(), TensorChart()
PUSH = [[rationals((0.1, 0.03, -0.02))]]
"""One experiment with one input: its Taylor coefficients."""
NULL_DIMENSIONS = {
    "tumble": 6,
    "spin about the major axis": 10,
    "spin about the intermediate axis": 10,
    "spin about the minor axis": 10,
    "rate in a principal plane": 6,
    "axisymmetric, nutating": 7,
    "axisymmetric, about its axis": 10,
    "axisymmetric, transverse": 10,
    "equal moments": 10,
    "no rotation": 14,
}
"""In the thesis' chart with at least three landmarks."""
EXTRA = {("equal moments", 1): 1, ("no rotation", 1): 3, ("no rotation", 2): 1}
"""What fewer landmarks leave undetermined beyond that."""


def analysed(chart: Chart, sensor: SystemSensor, name: str = "tumble") -> Certificate:
    """Certificate of one sensor at a motion."""
    return certify(System(chart, [sensor]), point_of(chart, MOTIONS[name]))


@pytest.mark.parametrize("name", NULL_DIMENSIONS)
@pytest.mark.parametrize(
    ("chart", "count"),
    [(CHARTS[0], count) for count in (1, 2, 3, 8)]
    + [(chart, count) for chart in CHARTS[1:] for count in (1, 2, 3)],
    ids=lambda value: str(value) if isinstance(value, int) else value.name,
)
def test_the_null_space_of_stereo_is_certified_and_named_whole(chart: Chart, name: str, count: int) -> None:
    found = certify(stereo_system(chart, count), point_of(chart, MOTIONS[name]))
    expected = NULL_DIMENSIONS[name] + EXTRA.get((name, count), 0) + (chart.name == "inertia tensor")
    if chart.name != "principal axes" and name == "axisymmetric, nutating":
        expected -= 1  # the axes of an axisymmetric body are no unknown here
    assert found.null_dimension == expected
    assert found.unnamed == 0
    assert found.certified
    assert max(each.change for each in found.explanations if each.finite) <= 1e-9
    assert found.regular == (expected == (7 if chart.name == "inertia tensor" else 6))


def test_euler_alone_shows_five_of_six_and_its_null_vector_is_the_inertia() -> None:
    found = analysed(EULER, GYRO)
    assert (found.rank, found.dimension, found.proof.name) == (5, 6, "SYMMETRIES")
    (vector,) = float_rank(System(EULER, [GYRO]), point_of(EULER, TUMBLE), 4).null_vectors(1).T
    expected = np.array([0, 0, 0, *map(float, TUMBLE.moments)]) / float(TUMBLE.moments[2])
    np.testing.assert_allclose(vector / vector[5], expected, atol=1e-12)


def test_log_ratios_are_determined_by_a_tumble_and_not_by_a_principal_spin() -> None:
    assert analysed(LOG_RATIOS, GYRO).rank == 5
    spin = analysed(LOG_RATIOS, GYRO, "spin about the minor axis")
    assert (spin.rank, [each.symmetry.name for each in spin.explanations]) == (3, ["k1", "k2"])


@pytest.mark.parametrize(
    ("chart", "sensor", "rank"),
    [
        (PrincipalChart(RATIOS, with_place=False), sensors.watching("attitude"), 11),
        (PRINCIPAL, sensors.watching("pose"), 20),
        (PRINCIPAL, sensors.watching("monocular", landmarks(4), known=True), 20),
    ],
    ids=["lidar attitude", "lidar pose", "known map"],
)
def test_sensors_that_determine_everything(chart: Chart, sensor: SystemSensor, rank: int) -> None:
    found = analysed(chart, sensor)
    assert (found.rank, found.dimension, found.proof.name) == (rank, rank, "FULL")


@pytest.mark.parametrize("count", [1, 2, 3, 4, 8])
def test_one_camera_leaves_the_scale_of_all_lengths_too(count: int) -> None:
    found = analysed(PRINCIPAL, sensors.watching("monocular", landmarks(count)))
    assert (found.null_dimension, found.unnamed, found.certified) == (7, 0, True)
    assert "scale of all lengths" in {each.symmetry.name for each in found.explanations}


def test_a_known_torque_tells_the_whole_inertia() -> None:
    for chart in (EULER, TensorChart(with_attitude=False, with_place=False)):
        system = System(chart, [GYRO], [Input.TORQUE_X])
        assert certify(system, point_of(chart, TUMBLE), PUSH).null_dimension == 0


def test_a_spin_about_z_with_a_torque_about_z_tells_that_moment_alone() -> None:
    found = certify(System(EULER, [GYRO], [Input.TORQUE_Z]), point_of(EULER, Z_SPIN), PUSH)
    assert [each.symmetry.name for each in found.explanations] == ["moment about x", "moment about y"]
    assert (found.rank, found.proof.name) == (4, "SYMMETRIES")


def test_a_manoeuvre_of_the_inspector_gives_one_camera_its_scale() -> None:
    system = System(PRINCIPAL, [sensors.watching("monocular", landmarks(4))], [Input.INSPECTOR_X])
    assert certify(system, point_of(PRINCIPAL, TUMBLE), PUSH).null_dimension == 6
    idle = certify(system, point_of(PRINCIPAL, TUMBLE), [[rationals((0.0,))]])
    assert idle.null_dimension == 7


@pytest.mark.parametrize("gap", ["1e-3", "1e-6", "1e-12"])
def test_moments_that_hardly_differ_are_told_from_equal_ones(gap: str) -> None:
    step = rationals((gap,))[0]
    name, rate = "nearly a sphere", (0.3, 0.7, -0.5)
    nearly = motion(name, rate, (1 + step, 1, 1 - step))
    chart = TENSOR
    found = certify(stereo_system(chart, 4), point_of(chart, nearly))
    assert (found.null_dimension, found.unnamed) == (7, 0)
    sphere = certify(stereo_system(chart, 4), point_of(chart, motion(name, rate, (1, 1, 1))))
    assert sphere.null_dimension == 11


def test_a_float_rank_takes_moments_that_hardly_differ_for_equal_ones() -> None:
    nearly = motion("nearly a sphere", (0.3, 0.7, -0.5), ("1.000000000001", 1, "0.999999999999"))
    system = stereo_system(TENSOR, 4)
    assert (
        float_rank(system, point_of(TENSOR, nearly), 9).rank < certify(system, point_of(TENSOR, nearly)).rank
    )


@pytest.mark.parametrize("chart", CHARTS, ids=lambda chart: chart.name)
def test_a_float_rank_agrees_where_nothing_is_close(chart: Chart) -> None:
    system, point = stereo_system(chart, 4), point_of(chart, TUMBLE)
    assert float_rank(system, point, 6).rank == certify(system, point).rank


def test_a_hundred_landmarks() -> None:
    assert analysed(PRINCIPAL, sensors.watching("stereo", landmarks(100))).rank == 314


def test_ranks_by_order_rise_to_the_rank() -> None:
    found = analysed(PRINCIPAL, sensors.watching("stereo", landmarks(3)))
    assert found.ranks[:4] == (9, 15, 21, 23)
    assert found.order == 3
