"""A report says what was asked, what was not, and in which axes."""

import itertools

import pytest

from observability.analysis_report import analyse, axes_in_words, close_moments, scope
from observability.canonical_motions import CANONICAL_MOTIONS, motion
from observability.cases import Case
from observability.system import Input, analysed_sensors
from spinfilters.models.sensor_registry import sensor_of

MOTIONS = {each.name: each for each in CANONICAL_MOTIONS}


@pytest.mark.parametrize("sensor", analysed_sensors())
def test_what_a_sensor_was_not_asked_is_said(sensor: str) -> None:
    case = Case(sensors=(sensor,))
    found = scope(case)
    assert "overall scale of the inertia" in found.not_asked
    assert ("attitude" in found.not_asked) == (sensor == "gyro")
    rotation_only = not sensor_of(sensor).sees_place
    assert ("position and velocity" in found.not_asked) == rotation_only
    assert ("centre of mass" in found.not_asked) == rotation_only
    assert ("a map of landmarks" in found.not_asked) == (
        sensor not in ("stereo", "monocular", "lidar-points")
    )
    assert not set(found.asked) & set(found.not_asked)


def test_a_gyro_is_not_said_to_leave_nothing_without_what_was_not_asked() -> None:
    lines = analyse(Case(sensors=("gyro",)), 10, 0.5).sentences
    assert "Nothing of what was asked is left undetermined." in lines
    assert any(
        line.startswith("Not asked: attitude; position and velocity; centre of mass") for line in lines
    )
    assert not any("Nothing is left" in line for line in lines)


def test_a_known_map_is_taken_as_known_and_not_asked() -> None:
    found = scope(Case(known_map=True))
    assert "the map" in found.taken_as_known
    assert "a map of landmarks" in found.not_asked


@pytest.mark.parametrize(
    ("case", "asked"),
    [
        (Case(sensors=("gyro",), unknowns="moments"), "the three principal moments, scale included"),
        (Case(sensors=("gyro",), inputs=(Input.TORQUE_X,)), "the three principal moments, scale included"),
        (Case(chart="tensor"), "the inertia tensor, scale included"),
    ],
)
def test_a_scale_that_is_asked_is_not_among_what_is_not(case: Case, asked: str) -> None:
    found = scope(case)
    assert asked in found.asked
    assert not any("scale" in words for words in found.not_asked)


def test_the_axes_of_torques_and_manoeuvres_are_named() -> None:
    assert "torques" not in axes_in_words(Case())
    words = axes_in_words(Case(inputs=(Input.TORQUE_X, Input.INSPECTOR_X)))
    assert "principal axes" in words
    assert "known in frame g" in words
    assert "camera's axes at the first frame" in words


@pytest.mark.parametrize("axes", ["X", "Z", "YZ"])
@pytest.mark.parametrize("sensor", ["gyro", "stereo", "attitude"])
@pytest.mark.parametrize("name", ["tumble", "spin about the minor axis"])
def test_a_torque_is_about_the_same_axis_in_every_chart(axes: str, sensor: str, name: str) -> None:
    inputs = tuple(Input[f"TORQUE_{axis}"] for axis in axes)
    cases = [
        Case(sensors=(sensor,), inputs=inputs, motion=MOTIONS[name], chart=chart)
        for chart in ("principal", "tensor")
    ]
    principal, tensor = (case.certificate() for case in cases)
    # a gyro's principal chart takes the three angles of the axes as known, the tensor's does not
    given = tensor.dimension - principal.dimension
    undetermined = principal.null_dimension
    assert given in (0, 3)
    assert undetermined <= tensor.null_dimension <= undetermined + given
    if not given:
        assert tensor.null_dimension == undetermined


@pytest.mark.parametrize("pair", list(itertools.combinations(analysed_sensors(), 2)), ids="+".join)
def test_two_sensors_together_determine_at_least_what_each_does(pair: tuple[str, str]) -> None:
    both = Case(sensors=pair).certificate()
    assert both.unnamed == 0
    assert both.certified
    alone = [Case(sensors=(each,)).certificate() for each in pair]
    if Case(sensors=pair).has_place:
        common = 20  # of the principal chart with place: what remains is landmarks
        for each, name in zip(alone, pair, strict=True):
            if each.dimension >= common:
                assert both.null_dimension <= each.null_dimension, name


def test_a_gyro_beside_a_camera_tells_where_g_points() -> None:
    groups = {each.symmetry.group for each in Case(sensors=("stereo", "gyro")).certificate().explanations}
    assert groups == {"gauge translation"}


def test_chapter_three_of_the_thesis_is_answered_with_its_null_vector() -> None:
    case = Case(sensors=("gyro",), unknowns="moments")
    found = analyse(case, 10, 0.5)
    certificate = found.certificate
    assert (certificate.rank, certificate.dimension, certificate.certified) == (5, 6, True)
    jx, jy, jz = (float(moment) for moment in case.motion.moments)
    (null,) = found.document()["not_determined"]
    assert null["null_vector"] == pytest.approx({"J_x": jx / jz, "J_y": jy / jz, "J_z": 1.0})
    assert any("Null vector of the scale of the inertia" in line for line in found.sentences)


def test_close_moments_in_the_thesis_chart_are_answered_in_the_regular_one_too() -> None:
    text = " ".join(analyse(Case(motion=MOTIONS["equal moments"]), 10, 0.5).sentences)
    assert "All three moments are equal: every axis is principal." in text
    assert "This chart is singular there" in text
    assert "inertia that keeps the spin axis principal (3)" in text
    assert "inertia ratios               prior only" in text


def test_nearly_close_moments_are_named_and_their_verdict_is_in_principle_only() -> None:
    near = motion("nearly a sphere", (0.3, 0.7, -0.5), ("1.001", 1, "0.999"))
    text = " ".join(analyse(Case(sensors=("gyro",), motion=near), 20, 0.5).sentences)
    assert "Nearly singular: moments differ little (x and y by 0.1 %, x and z by 0.2 %" in text
    assert "Determined in principle only, the bound being no better than the prior: inertia ratios." in text
    assert close_moments(MOTIONS["tumble"]) == []


def test_one_direction_of_the_centre_of_mass_is_named_in_words_and_as_a_vector() -> None:
    spin = MOTIONS["spin about the intermediate axis"]
    found = analyse(Case(motion=spin), 20, 0.5)
    text = " ".join(found.sentences)
    assert "centre of mass along the spin axis" in text
    assert "The spin axis is (0, 1, 0) in the body's principal axes x, y, z." in text
    assert "prior only (1 m) along (0, 1, 0) (frame g, the spin axis): not determined" in text
    verdict = found.document()["bound_verdicts"]["centre of mass in g [m]"]
    assert verdict["directions_not_determined"] == 1
    assert verdict["prior_only_directions"] == [pytest.approx([0.0, 1.0, 0.0], abs=1e-6)]


def test_a_body_at_rest_under_one_torque_hides_its_centre_of_mass_along_that_axis_alone() -> None:
    case = Case(sensors=("stereo", "gyro"), inputs=(Input.TORQUE_Y,), motion=MOTIONS["no rotation"])
    text = " ".join(analyse(case, 20, 0.5).sentences)
    assert "centre of mass along y" in text
    assert "moment about x; moment about z" in text
