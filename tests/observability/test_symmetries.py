"""Named symmetries: what they are in numbers, that false ones are refused, and what the finite test rests on."""

import casadi as ca
import numpy as np
import pytest

from observability import system as sensors
from observability.body_model import body_rank
from observability.canonical_motions import CANONICAL_MOTIONS, landmarks, point_of
from observability.certificate import Proof, certify
from observability.coordinates import FilterChart, PrincipalChart
from observability.exact_numbers import as_floats, rationals
from observability.explanation import Trajectories, candidates, explained, simulate, tangent_symmetries
from observability.symmetry import State, Symmetry
from observability.system import Input, System
from spinfilters.models.gauge import gauge_directions
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from tests.observability.analyser_samples import CHARTS, EULER, MOTIONS, TUMBLE, Z_SPIN, stereo_system
from tests.observability.float_rank import float_rank

PRINCIPAL, FILTER = PrincipalChart(), FilterChart()


def named(system: System, motion_name: str) -> dict[str, Symmetry]:
    """Candidates by name."""
    return {each.name: each for each in candidates(system, point_of(system.chart, MOTIONS[motion_name]))}


@pytest.mark.parametrize("name", ["tumble", "axisymmetric, nutating", "equal moments"])
def test_the_gauge_found_in_the_filters_state_is_the_one_that_the_filters_use(name: str) -> None:
    system, point = stereo_system(FILTER, 2), point_of(FILTER, MOTIONS[name])
    x = as_floats(point)
    exact = float_rank(system, point, 9)
    null_space = exact.vectors[exact.singular_values < 1e-12 * exact.singular_values[0]] * exact.scale
    gauge = gauge_directions(FILTER.layout, x)
    points = [as_floats(item)[:3] for item in system.sensors[0].parameters]
    turned = [np.concatenate([-_cross(p), np.eye(3)], axis=1) for p in points]
    whole = np.concatenate([gauge, *turned])
    basis, _ = np.linalg.qr(null_space.T)
    np.testing.assert_allclose(basis @ (basis.T @ whole), whole, atol=1e-7)


def _cross(p: np.ndarray) -> np.ndarray:
    return np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]])


def test_a_candidate_that_some_row_sees_is_no_tangent_symmetry() -> None:
    system, point = stereo_system(PRINCIPAL, 3), point_of(PRINCIPAL, TUMBLE)
    exact = body_rank(system, point, 8)
    names = {each.name for each in tangent_symmetries(system, point, exact).symmetries}
    assert len(names) == 6
    assert not names & {"k1", "k2", "scale of all lengths", "centre of mass along the spin axis"}


@pytest.mark.parametrize("name", ["k1", "scale of all lengths", "roll of the principal axes about x"])
def test_a_finite_move_along_what_is_no_symmetry_changes_the_outputs(name: str) -> None:
    system = stereo_system(PRINCIPAL, 3)
    assert explained(system, point_of(PRINCIPAL, TUMBLE), [named(system, "tumble")[name]]) == []


def test_a_direction_that_is_null_to_first_order_only_is_told_from_a_symmetry() -> None:
    system = stereo_system(PRINCIPAL, 1)
    point = point_of(PRINCIPAL, MOTIONS["no rotation"])
    known = named(system, "no rotation")
    finite, infinitesimal = explained(
        system, point, [known["k1"], known["turn about x that looks like drift"]]
    )
    assert finite.finite
    assert not infinitesimal.finite
    assert infinitesimal.change > 1e-3


@pytest.mark.parametrize("motion", CANONICAL_MOTIONS, ids=lambda motion: motion.name)
def test_every_candidate_leaves_the_state_where_it_is_at_amount_zero(motion) -> None:
    for chart in CHARTS:
        system = stereo_system(chart, 2)
        x, points, amount = ca.SX.sym("x", chart.mean_dim), ca.SX.sym("p", 3, 2), ca.SX.sym("e")
        numbers = as_floats(point_of(chart, motion))
        given = np.stack([as_floats(item)[:3] for item in system.sensors[0].parameters], axis=1)
        for each in candidates(system, point_of(chart, motion)):
            moved = each.move(State(chart.unpack(x), (points,)), amount)
            flat = ca.vertcat(chart.pack(chart.settled(moved.values)), ca.vec(moved.points[0]))
            found = np.asarray(ca.Function("move", [x, points, amount], [flat])(numbers, given, 0.0))[:, 0]
            np.testing.assert_allclose(
                found, np.concatenate([numbers, given.T.ravel()]), atol=1e-14, err_msg=each.name
            )
            away = np.asarray(ca.Function("move", [x, points, amount], [flat])(numbers, given, each.amount))[
                :, 0
            ]
            assert np.abs(away - found).max() > 1e-3, f"{each.name} does not move visibly"


def test_the_simulation_follows_the_process_model_of_the_filters() -> None:
    system = stereo_system(FILTER, 3)
    x = as_floats(point_of(FILTER, TUMBLE))
    parameters = np.stack([as_floats(item) for item in system.sensors[0].parameters])
    (values,) = simulate(system, Trajectories(x[:, np.newaxis], (parameters.T[:, :, np.newaxis],)), 2.0, 4)
    later = TorqueFreeProcess(FILTER.layout, ProcessNoise(), tolerance=1e-13).step(x, 2.0)
    expected = system.sensors[0].model.predict(later, parameters)
    np.testing.assert_allclose(values[-1, :, :, 0].T, expected, atol=1e-9)


def test_a_simulation_along_a_known_input_does_not_depend_on_how_it_is_cut() -> None:
    system = System(EULER, [sensors.watching("gyro")], [Input.TORQUE_X])
    x = as_floats(point_of(EULER, TUMBLE))[:, np.newaxis]
    start = Trajectories(x, (np.array([[0.002], [0.0]])[:, :, np.newaxis],))
    push = [rationals((0.1, 0.3, -0.2))]
    coarse, fine = (simulate(system, start, 1.0, steps, push)[0][-1] for steps in (2, 9))
    np.testing.assert_allclose(coarse, fine, atol=1e-13)
    assert np.abs(coarse - simulate(system, start, 1.0, 2, [rationals((0.0,))])[0][-1]).max() > 0.01


def test_a_steady_motion_is_certified_without_a_symmetry_for_every_direction() -> None:
    found = certify(stereo_system(PRINCIPAL, 2), point_of(PRINCIPAL, MOTIONS["no rotation"]))
    assert found.proof is Proof.STEADY
    assert sum(not each.finite for each in found.explanations) == 1


def test_what_cannot_be_proved_is_open() -> None:
    system = System(PRINCIPAL, [sensors.watching("monocular", landmarks(1))])
    found = certify(system, point_of(PRINCIPAL, MOTIONS["no rotation"]))
    assert found.proof is Proof.OPEN
    assert not found.certified
    assert found.rank + sum(each.finite for each in found.explanations) < found.dimension


def test_a_gyro_does_not_notice_where_its_observer_is() -> None:
    found = certify(System(PRINCIPAL, [sensors.watching("gyro")]), point_of(PRINCIPAL, TUMBLE))
    assert (found.rank, found.unnamed, found.proof) == (8, 0, Proof.SYMMETRIES)


def test_every_explanation_of_a_spin_is_named_as_a_physicist_would() -> None:
    found = certify(stereo_system(PRINCIPAL, 3), point_of(PRINCIPAL, Z_SPIN))
    groups = [each.symmetry.group for each in found.explanations]
    assert groups == [
        *["gauge translation"] * 3,
        *["gauge rotation"] * 3,
        "k1",
        "k2",
        "roll about the spin axis",
        "centre of mass along the spin axis",
    ]
