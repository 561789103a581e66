"""What rests on priors is told from what the data tell, and from what is determined in principle."""

import numpy as np
import pytest

from observability.canonical_motions import CANONICAL_MOTIONS, motion
from observability.cases import Case
from observability.cramer_rao import MOMENTS, PLACE, observability_gramian, prior_share
from observability.exact_numbers import as_floats
from observability.prior_dependence import (
    HALVED,
    PRIOR_ONLY,
    QuantityBound,
    _null_space,
    quantity_bounds,
    undetermined_directions,
)
from observability.reference_trajectory import SensorSchedule
from observability.system import Input
from spinfilters.models.process import ProcessNoise

CENTRE, ATTITUDE = ("centre of mass in g", "m"), ("attitude", "rad")
MOTIONS = {each.name: each for each in CANONICAL_MOTIONS}
Y_SPIN = MOTIONS["spin about the intermediate axis"]


def bounds_of(case: Case, frames: int = 60) -> dict[tuple[str, str], QuantityBound]:
    """After so many frames at 0.5 s."""
    reference = case.reference(frames, 0.5)
    return quantity_bounds(case, reference, case.bound(reference))


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_the_share_of_one_unknown_is_its_deviation_over_that_of_the_prior(share: float) -> None:
    prior, data = share**2, 1 - share**2  # informations, together 1
    growth = 1.0 / (prior / 100 + data)
    assert prior_share(growth) == pytest.approx(share, abs=1e-12)


def test_a_spin_leaves_the_prior_the_centre_of_mass_along_its_axis_and_the_ratios() -> None:
    found = bounds_of(Case(motion=Y_SPIN))
    centre = found[CENTRE]
    np.testing.assert_allclose(centre.prior_directions, [[0.0, 1.0, 0.0]], atol=1e-6)
    assert centre.std_along == pytest.approx(1.0, rel=1e-3)
    assert centre.std_across < 0.01
    assert (centre.undetermined, centre.in_principle_only, centre.times_longer) == (1, False, None)
    assert (len(found[MOMENTS].prior_directions), found[MOMENTS].undetermined) == (2, 2)
    assert len(found[PLACE].prior_directions) == found[PLACE].undetermined == 1
    assert len(found[ATTITUDE].prior_directions) == 0


def test_a_tumble_leaves_the_prior_nothing() -> None:
    for each in bounds_of(Case()).values():
        assert (len(each.prior_directions), each.undetermined) == (0, 0)
        assert each.remains < 0.2


def test_a_scale_that_only_the_prior_of_landmarks_holds_is_found_though_the_bound_is_below_the_prior() -> (
    None
):
    found = bounds_of(Case(sensors=("monocular",)))
    centre = found[CENTRE]
    assert centre.std < 0.5
    assert (len(centre.prior_directions), centre.undetermined) == (1, 1)
    assert centre.std_across < 0.01


def test_nearly_equal_moments_are_determined_in_principle_only_and_the_longer_flight_keeps_its_word() -> None:
    case = Case(sensors=("gyro",), motion=motion("nearly a sphere", (0.3, 0.7, -0.5), ("1.01", 1, "0.99")))
    found = bounds_of(case, 20)[MOMENTS]
    assert found.undetermined == 0
    assert found.in_principle_only
    factor = found.times_longer
    assert factor is not None
    assert np.isfinite(factor)
    longer, shorter = (bounds_of(case, round(20 * factor / cut))[MOMENTS] for cut in (1, 2))
    assert len(longer.prior_directions) == 0
    assert longer.remains <= HALVED
    assert shorter.remains > HALVED or len(shorter.prior_directions)


def test_moments_1e_5_apart_need_longer_than_was_tried() -> None:
    case = Case(
        sensors=("gyro",),
        motion=motion("nearly a sphere", (0.3, 0.7, -0.5), ("1.00001", 1, "0.99999")),
    )
    found = bounds_of(case, 20)[MOMENTS]
    assert (found.undetermined, found.times_longer, found.searched) == (0, np.inf, 64)


def test_equal_moments_are_not_determined_at_all() -> None:
    found = bounds_of(Case(motion=MOTIONS["equal moments"]))[MOMENTS]
    assert not found.in_principle_only
    assert found.undetermined == 2


CASES = {
    "stereo": Case(),
    "stereo, spin": Case(motion=Y_SPIN),
    "one camera": Case(sensors=("monocular",)),
    "lidar and gyro, spin": Case(sensors=("lidar", "gyro"), motion=Y_SPIN),
    "attitude and gyro": Case(sensors=("attitude", "gyro")),
    "known map, spin": Case(known_map=True, motion=Y_SPIN),
    "torque": Case(inputs=(Input.TORQUE_X,)),
    "gyro, spin": Case(sensors=("gyro",), motion=Y_SPIN),
    "equal moments": Case(motion=MOTIONS["equal moments"]),
}


@pytest.mark.parametrize("name", CASES)
def test_the_exact_null_space_is_that_of_a_gramian_without_prior_and_noise(name: str) -> None:
    """Numerically: the Gramian of a flight, without the components that are definitions."""
    case = CASES[name]
    reference = case.reference(40, 0.5, ProcessNoise(0.0, 0.0))
    schedules = []
    for sensor in case.system.sensors:
        items = np.stack([as_floats(item) for item in sensor.parameters])
        model = type(sensor.model)(reference.process.layout)
        schedules.append(SensorSchedule(model, items, sensor.unknown, np.ones((40, len(items)), dtype=bool)))
    gramian = observability_gramian(reference, schedules)
    kept = np.setdiff1d(np.arange(len(gramian)), case.defined)
    gramian = gramian[np.ix_(kept, kept)]
    scale = 1 / np.sqrt(np.diag(gramian).clip(min=1e-9))
    values = np.linalg.eigvalsh(gramian * np.outer(scale, scale))
    assert (values < 1e-9 * values[-1]).sum() == _null_space(case).shape[1]


def test_every_direction_that_is_not_determined_is_prior_only_in_the_bound() -> None:
    for case in CASES.values():
        exact, found = undetermined_directions(case), bounds_of(case, 40)
        for name, each in found.items():
            assert len(each.prior_directions) >= exact[name]
            assert each.remains < PRIOR_ONLY


@pytest.mark.parametrize(
    ("case", "axes"),
    [
        (Case(), (0, 1, 2)),
        (Case(sensors=("gyro",)), (0, 1, 2)),
        (Case(sensors=("stereo", "gyro")), ()),
        (Case(sensors=("stereo", "gyro"), motion=Y_SPIN), (1,)),
        (Case(sensors=("stereo", "gyro"), motion=MOTIONS["no rotation"]), (0, 1, 2)),
        (Case(inputs=(Input.TORQUE_Z,)), (2,)),
        (Case(inputs=(Input.TORQUE_Z, Input.TORQUE_X)), ()),
        (Case(sensors=("stereo", "gyro"), inputs=(Input.TORQUE_Z,), motion=Y_SPIN), ()),
        (Case(sensors=("magnetometer",)), ()),
        (Case(sensors=("stereo", "magnetometer")), ()),
        (Case(sensors=("gyro", "magnetometer"), motion=Y_SPIN), ()),
        (Case(sensors=("pose",)), ()),
        (Case(known_map=True), ()),
    ],
)
def test_the_first_attitude_is_a_definition_only_about_axes_that_nothing_tells(
    case: Case, axes: tuple[int, ...]
) -> None:
    assert case.free_rotations == axes
    assert case.place_is_defined == (case.has_place and case.sensors != ("pose",) and not case.known_map)
