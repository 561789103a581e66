"""Score tests about a smoothed motion: their linear algebra, and which alternative they rank first."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from smoothed_motions import motion_near

from spinfilters.core.chi_square import chi_square_tail, fisher_tail
from spinfilters.filters.timeline import build_timeline
from spinfilters.inference.identified_noise import Unstated, noise_model
from spinfilters.inference.setup import Setup, camera_view
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.models.process import TorqueFreeProcess
from spinfilters.models.state_blocks import ACCELERATION, TORQUE
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map
from spinfilters.smoother.solver import SolverOptions, solve
from spinfilters.verdict import model_tests as model_errors
from spinfilters.verdict.model_errors.alternatives import table
from spinfilters.verdict.model_errors.hypotheses import (
    KnownLevels,
    is_settled,
    minus_twice_log_likelihood,
    noise_of,
    with_refused_in_a_row,
)
from spinfilters.verdict.model_errors.linear_rows import Columns, LinearRows
from spinfilters.verdict.model_errors.score_tests import score_tests
from spinfilters.verdict.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.verdict.model_tests import minus_twice_log_evidence

KINDS = ("pose", "gyro", "stereo-tracks")
WHOLE = Settings(process={"gravity": False}, initialisation={"share": 1.0})  # pyright: ignore[reportArgumentType]


def recording(kind: str, seed: int = 0) -> Dataset:
    """A short rich motion; tracks without their map."""
    scenario = Scenario.simplified(
        kind=kind, principal_moments=(1.0, 0.8, 0.55), rate_rpm=RICH_RPM, epochs=40, landmarks=60, seed=seed
    )
    dataset = simulate(scenario)
    return without_map(dataset) if dataset.known_map is not None else dataset


@cache
def prepared(kind: str) -> Setup:
    """With an initialisation that is the smoother of the whole recording."""
    return prepare(recording(kind), WHOLE)


@cache
def smoothed(kind: str) -> SmoothedMotion:
    """About the most probable motion."""
    setup = prepared(kind)
    return motion_near(setup, setup.initial.mean)


def columns_of(kind: str) -> Columns:
    """Of every alternative that is the same in the whole recording."""
    motion = smoothed(kind)
    made = [each.columns(motion) for each in table().values() if not each.by_epoch]
    return Columns.joined([each for each in made if each is not None])


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_left_is_a_projection(kind: str) -> None:
    rows, H = smoothed(kind).rows, columns_of(kind)
    H = H.times(np.diag(1 / np.sqrt(np.diag(H.gram(H)))))
    left = rows.residual(H)
    again = rows.residual(left).minus(left)
    np.testing.assert_allclose(again.gram(again), 0, atol=1e-9)
    np.testing.assert_allclose(left.gram(H), left.gram(left), atol=1e-7)


@pytest.mark.parametrize("kind", KINDS)
def test_the_cost_left_is_what_the_solver_says(kind: str) -> None:
    rows = smoothed(kind).rows
    left = rows.residual(rows.right)
    before = rows.here.cost(rows.normal.used, rows.normal.stage)
    expected = before - rows.normal.predicted_reduction
    assert left.gram(left)[0, 0] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_left_of_a_step_of_the_states(kind: str) -> None:
    rows = smoothed(kind).rows
    right = rows.right
    explained = right.minus(rows.residual(right))
    left = rows.residual(explained)
    assert left.gram(left)[0, 0] < 1e-9 * max(right.gram(right)[0, 0], 1.0)


@pytest.mark.parametrize("name", ["acceleration", "torque"])
def test_a_disturbance_points_where_the_block_that_holds_it_moves_the_steps(name: str) -> None:
    motion, block = smoothed("pose"), {"acceleration": ACCELERATION, "torque": TORQUE}[name]
    problem = motion.rows.problem
    layout, here = problem.layout.joined(block), motion.rows.here
    wider = np.concatenate([here.trajectory, np.zeros((len(here.trajectory), 3))], axis=1)
    process = problem.motion.process
    assert isinstance(process, TorqueFreeProcess)
    own = TorqueFreeProcess(layout, process.noise)
    _, transition, _ = own.linearise_steps(wider[:-1], wider[1:], problem.motion.dt)
    moving, d = problem.ordering.moving, len(problem.ordering.moving)
    exact = here.dynamics.rows[:, :, d : 2 * d] @ -transition[:, moving, layout.slice(block.name)]
    made = table()[name].columns(motion)
    assert made is not None
    cosine = np.vdot(made.steps, exact) / (np.linalg.norm(made.steps) * np.linalg.norm(exact))
    assert cosine > 0.98
    assert np.linalg.norm(made.steps) == pytest.approx(np.linalg.norm(exact), rel=0.1)


def shifted(rows: LinearRows, by: Columns) -> LinearRows:
    """The same problem with another right-hand side."""
    other = LinearRows(rows.problem, rows.here, rows.normal)
    right = rows.right.minus(by.times(-np.ones((by.count, 1))))
    other.__dict__.update(right=right, left=rows.residual(right))
    return other


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        *(("pose", name) for name in ("acceleration", "torque", "drag", "energy-loss", "rotor")),
        *(("gyro", name) for name in ("gyro-bias", "gyro-misalignment", "contact-at-end")),
        *(("stereo-tracks", name) for name in ("right-camera-late", "distortion", "contact-at-begin")),
    ],
)
def test_an_error_that_is_put_in_is_ranked_first_at_its_size(kind: str, name: str) -> None:
    motion, setup = smoothed(kind), prepared(kind)
    model = noise_model(motion.rows.problem, setup.noise, Unstated.of_all(setup.log, setup.process.noise))
    assert model is not None
    noise = noise_of(model, motion.rows)
    (before,) = (t for t in score_tests(motion, noise, table().values()) if t.error.name == name)
    columns, size = table()[name].columns(motion), 12 * before.std
    assert columns is not None
    wrong = replace(motion, rows=shifted(motion.rows, columns.times(np.diag(size))))
    after = score_tests(wrong, noise, table().values())
    assert name in [each.error.name for each in after[:2]]
    (own,) = (each for each in after if each.error.name == name)
    assert own.p_value < 1e-5
    if own.dof == len(size):  # else a part of it is absorbed by the states
        np.testing.assert_allclose(own.size - before.size, size, atol=5 * before.std.max())


@pytest.mark.parametrize(("size", "found"), [(0.01, True), (-0.01, False)])
def test_what_brakes_does_not_drive(size: float, found: bool) -> None:
    motion, setup = smoothed("pose"), prepared("pose")
    model = noise_model(motion.rows.problem, setup.noise, Unstated.of_all(setup.log, setup.process.noise))
    assert model is not None
    drag = table()["drag"]
    braked = drag.columns(motion)
    assert braked is not None
    wrong = replace(motion, rows=shifted(motion.rows, braked.times(np.array([[size]]))))
    (test,) = score_tests(wrong, noise_of(model, motion.rows), [drag])
    assert np.sign(test.size[0]) == np.sign(size)
    assert (test.p_value < 1e-6, test.p_value == 1.0) == (found, not found)


def test_an_error_drawn_by_epoch_is_found_by_its_variance_and_is_no_jump() -> None:
    motion, setup = smoothed("pose"), prepared("pose")
    model = noise_model(motion.rows.problem, setup.noise, Unstated.of_all(setup.log, setup.process.noise))
    assert model is not None
    noise, jitter = noise_of(model, motion.rows), table()["clock-jitter"]
    columns = jitter.columns(motion)
    assert columns is not None
    K = len(motion.time)
    for drawn in (0.1 * np.random.default_rng(4).standard_normal(K), 0.5 * np.eye(K)[K // 2]):
        read = zip(columns.formed.sensors, motion.rows.problem.motion.sensors, strict=True)
        late = (part * drawn[each.epoch, None, None] for part, each in read)
        wrong = replace(motion, rows=shifted(motion.rows, replace(columns.formed, sensors=tuple(late))))
        first = score_tests(wrong, noise, table().values())[0]
        assert first.error.name == "clock-jitter"
        assert first.is_possible == (np.count_nonzero(drawn) > 1)
        assert not first.is_possible or first.size[0] == pytest.approx(0.1, rel=0.4)


@pytest.mark.parametrize("kind", KINDS)
def test_a_right_model_is_not_doubted(kind: str) -> None:
    motion, setup = smoothed(kind), prepared(kind)
    model = noise_model(motion.rows.problem, setup.noise, Unstated.of_all(setup.log, setup.process.noise))
    assert model is not None
    found = score_tests(motion, noise_of(model, motion.rows), table().values())
    assert len(found) >= 8
    assert min(each.p_value for each in found) > 1e-4


def test_a_correlated_error_tells_its_level_by_the_independent_samples_that_states_leave() -> None:
    motion, setup = smoothed("gyro"), prepared("gyro")
    model = noise_model(motion.rows.problem, setup.noise, Unstated.of_all(setup.log, setup.process.noise))
    assert model is not None
    white = noise_of(model, motion.rows)
    slow = noise_of(model, motion.rows, KnownLevels(correlation={"gyro_noise_std": 3.0}))
    values = 3 * len(motion.time)
    by_states = values - white.redundancy[0]
    assert white.dof[0] == pytest.approx(white.redundancy[0] + 1)
    assert slow.dof[0] == pytest.approx(values / 3 - by_states + 1)
    shift = table()["gyro-bias"].columns(motion)
    assert shift is not None
    wrong = replace(motion, rows=shifted(motion.rows, shift.times(0.02 * np.eye(3))))
    by_white, by_slow = (
        next(t for t in score_tests(wrong, noise, table().values()) if t.error.name == "gyro-bias")
        for noise in (white, slow)
    )
    assert by_slow.statistic == by_white.statistic
    assert by_slow.p_value > 10 * by_white.p_value


def test_a_statistic_beside_a_correlated_error_is_compared_with_what_is_left() -> None:
    motion, setup = smoothed("gyro"), prepared("gyro")
    model = noise_model(motion.rows.problem, setup.noise, Unstated.of_all(setup.log, setup.process.noise))
    assert model is not None
    slow = noise_of(model, motion.rows, KnownLevels(correlation={"gyro_noise_std": 5.0}))
    dof, left = slow.redundancy.sum() / 5.0, np.array([4.0, 14.0])
    assert slow.beside_all(9.0, 3.0, left) == pytest.approx(fisher_tail((dof - 3) / 3, 3.0, dof - 3))
    assert slow.beside_all(9.0, 3.0, left) < chi_square_tail(9.0, 3.0)  # for the level is too large
    assert noise_of(model, motion.rows).beside_all(9.0, 3.0, left) == 1.0


def test_images_that_are_refused_in_a_row_are_taken_in_but_not_one_alone() -> None:
    rows = smoothed("stereo-tracks").rows
    fit = rows.normal.eliminated
    assert fit is not None

    def without(*epochs: int) -> tuple[LinearRows, np.ndarray]:
        """With two thirds of the observations of these epochs refused, and which epochs' observations."""
        own = np.isin(fit.observations.epoch, epochs)
        refused = own & (np.arange(len(own)) % 3 > 0)
        normal = replace(rows.normal, eliminated=replace(fit, used=fit.used & ~refused))
        return LinearRows(rows.problem, rows.here, normal), own

    alone, _ = without(39)
    assert with_refused_in_a_row(alone) is alone
    several, own = without(38, 39)
    taken = with_refused_in_a_row(several)
    assert taken is not None
    assert taken.normal.eliminated is not None
    assert taken.normal.eliminated.used[own].mean() == fit.used[own].mean()


def test_states_are_settled_near_the_most_probable_ones_alone() -> None:
    rows = smoothed("gyro").rows
    assert is_settled(rows)
    layout, away = rows.problem.layout, np.zeros((len(rows.here.trajectory), rows.problem.layout.error_dim))
    away[::2, layout.slice("w")] = 0.2
    here = rows.problem.at(layout.retract(rows.here.trajectory, away), rows.here.points)
    assert not is_settled(LinearRows(rows.problem, here, rows.problem.normal(here, rows.normal.stage)))


def test_the_likelihood_is_greatest_near_the_true_noise() -> None:
    setup = prepared("pose")
    trajectory, found = setup.initial.mean, []
    for factor in (0.2, 1.0, 5.0):
        problem = model_errors.linear_problem(setup, setup.timeline[: len(trajectory)])
        sensors = tuple(replace(each, scale=np.full(6, factor)) for each in problem.motion.sensors)
        other = replace(problem, motion=replace(problem.motion, sensors=sensors))
        solved = solve(other, other.at(trajectory, np.zeros((0, 3))), SolverOptions())
        found.append(minus_twice_log_likelihood(LinearRows(other, solved.point, solved.normal)))
    assert found[1] < min(found[0], found[2]) - 20


@pytest.mark.parametrize(("kind", "option"), [("pose", "pose_position_std"), ("stereo-tracks", "pixel_std")])
def test_the_evidence_tells_noise_that_is_stated_wrongly(kind: str, option: str) -> None:
    setup, found = prepared(kind), []
    log = MeasurementLog(tuple(replace(stream, covariance=None) for stream in setup.log.streams))
    for factor in (0.2, 1.0, 5.0):
        noise = replace(setup.noise, **{option: factor * getattr(setup.noise, option)})
        timeline = build_timeline(log, setup.process.layout, noise, camera_view(setup.dataset))
        own = replace(setup, timeline=timeline)
        evidence = minus_twice_log_evidence(own, setup.initial.mean)
        assert evidence is not None
        found.append(evidence)
    assert found[1] < min(found[0], found[2]) - 20


def test_a_sensor_of_which_nothing_counts_has_rows_of_no_number() -> None:
    rows = smoothed("gyro").rows
    (sensor,) = rows.problem.motion.sensors
    none = replace(sensor, epoch=sensor.epoch[:0], values=sensor.values[:0], parameters=sensor.parameters[:0])
    motion = replace(rows.problem.motion, sensors=(none,))
    empty = LinearRows(replace(rows.problem, motion=motion), rows.here, rows.normal)
    left = empty.residual(empty.nothing(2))
    assert left.count == 2


def test_a_log_of_one_sensor_has_no_delay_between_sensors() -> None:
    log = recording("gyro").log
    assert isinstance(log, MeasurementLog)
    assert table()["sensor-delay"].columns(smoothed("gyro")) is None
