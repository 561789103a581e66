"""The process: its motion against the analytic one, its transition and its steps."""

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import (
    angle_between,
    matrix_from_quaternion,
    multiply,
    quaternion_from_matrix,
)
from spinfilters.core.compiled import Compiled
from spinfilters.core.errors import InputError
from spinfilters.core.mass_distribution import from_inertia, inertia_matrix
from spinfilters.core.torque_free import torque_free_motion
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, ROTATION_BLOCKS, StateLayout
from tests.models.process_samples import LAYOUTS, difference_transition, random_point

ROTATION, FULL = StateLayout(ROTATION_BLOCKS), StateLayout(FULL_BLOCKS)
DRAGGED = StateLayout((*ROTATION_BLOCKS, "d"))


@pytest.fixture(scope="module")
def precise() -> dict[StateLayout, TorqueFreeProcess]:
    """Processes whose integration error is that of rounding, so that differences of steps are derivatives."""
    return {layout: TorqueFreeProcess(layout, ProcessNoise(), tolerance=1e-13) for layout in LAYOUTS}


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: "".join(layout.blocks))
@pytest.mark.parametrize(
    ("dt", "rate"), [(1e-6, 1.0), (0.01, 60.0), (0.5, 1.0), (0.5, 0.01), (0.5, 0.0), (5.0, 1.0)]
)
def test_the_transition_is_the_derivative_of_the_step(
    precise: dict[StateLayout, TorqueFreeProcess], layout: StateLayout, dt: float, rate: float
) -> None:
    x = random_point(layout, rate, np.random.default_rng(3))
    if rate == 0.0 and "m" in layout.blocks:
        x[layout.mean_slice("m")] = 0.0  # a body at rest stays so without a torque alone
    if rate == 0.0 and "l" in layout.blocks:
        x[layout.mean_slice("l")] = 0.0  # a drag linear in the rate brakes the error of a rate of zero, too
    if rate == 0.0 and "h" in layout.blocks:
        x[layout.mean_slice("h")] = 0.0  # a flywheel turns the rate of a body that is pushed from rest
    after, transition, _ = precise[layout].linearise(x, dt)
    np.testing.assert_allclose(after, precise[layout].step(x, dt), atol=1e-12)
    if rate == 0.0:
        np.testing.assert_allclose(transition[layout.slice("w"), layout.slice("w")], np.eye(3), atol=1e-12)
        return
    expected = difference_transition(precise[layout], x, dt, 1e-4 * min(rate, 1.0))
    np.testing.assert_allclose(transition, expected, atol=2e-8 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("dt", [1e-6, 0.01, 0.5, 5.0])
def test_the_noise_free_motion_is_the_analytic_one(dt: float) -> None:
    generator = np.random.default_rng(5)
    process = TorqueFreeProcess(ROTATION, ProcessNoise(), tolerance=1e-12)
    for moments in ([1.0322, 1.0, 0.8596], [2.0, 1.5, 0.7], [1.0, 1.0, 1.9], [1.0, 1.0, 1.0]):
        x = random_point(ROTATION, 1.3, generator)
        R_gb = matrix_from_quaternion(_random_attitude(generator))
        x[ROTATION.mean_slice("s")] = from_inertia(R_gb @ np.diag(moments) @ R_gb.T)
        q_gb, q_ig = quaternion_from_matrix(R_gb), x[ROTATION.mean_slice("a")]
        motion = torque_free_motion(
            np.array(moments), R_gb.T @ x[ROTATION.mean_slice("w")], np.array([dt]), multiply(q_ig, q_gb)
        )
        after = process.step(x, dt)
        np.testing.assert_allclose(after[ROTATION.mean_slice("w")], R_gb @ motion.rate[0], atol=2e-11)
        assert angle_between(multiply(after[ROTATION.mean_slice("a")], q_gb), motion.attitude[0]) < 2e-11


def test_momentum_and_energy_are_kept_over_many_steps() -> None:
    process, x = (
        TorqueFreeProcess(ROTATION, ProcessNoise()),
        random_point(ROTATION, 1.0, np.random.default_rng(8)),
    )
    momentum, energy = _momentum(ROTATION, x), _energy(x)
    for _ in range(400):
        x = process.step(x, 0.5)
    np.testing.assert_allclose(_momentum(ROTATION, x), momentum, atol=1e-6)
    assert _energy(x) == pytest.approx(energy, rel=1e-7)


@pytest.mark.parametrize("dt", [1e-3, 0.5, 5.0])
def test_the_centre_of_mass_moves_straight(dt: float) -> None:
    process = TorqueFreeProcess(FULL, ProcessNoise())
    x = random_point(FULL, 2.0, np.random.default_rng(2))
    v = x[FULL.mean_slice("v")]
    np.testing.assert_allclose(_centre(process.step(x, dt)), _centre(x) + dt * v, atol=1e-13 * (1 + dt))


def test_drag_takes_a_fixed_share_of_the_momentum_per_angle_turned_and_leaves_its_direction() -> None:
    process = TorqueFreeProcess(DRAGGED, ProcessNoise(), tolerance=1e-12)
    x = random_point(DRAGGED, 1.0, np.random.default_rng(4))
    before, speeds, h = _momentum(DRAGGED, x), [], 0.01
    for _ in range(400):
        speeds.append(np.linalg.norm(x[DRAGGED.mean_slice("w")]))
        x = process.step(x, h)
    speeds.append(np.linalg.norm(x[DRAGGED.mean_slice("w")]))
    weights = np.ones(401)
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    angle = h / 3 * float(weights @ np.array(speeds))
    assert angle > 2.0
    np.testing.assert_allclose(_momentum(DRAGGED, x), np.exp(-0.02 * angle) * before, rtol=1e-9)


def test_linear_drag_takes_a_fixed_share_of_the_momentum_in_every_second_and_leaves_its_direction() -> None:
    layout = StateLayout((*ROTATION_BLOCKS, "l"))
    process = TorqueFreeProcess(layout, ProcessNoise(), tolerance=1e-12)
    x = random_point(layout, 1.0, np.random.default_rng(4))
    x[layout.mean_slice("l")] = 0.3
    before = _momentum(layout, x)
    np.testing.assert_allclose(_momentum(layout, process.step(x, 2.0)), np.exp(-0.6) * before, rtol=1e-9)


@pytest.mark.parametrize(("loose", "tight"), [(1e-6, 1e-8), (1e-8, 1e-10), (1e-10, 1e-12)])
def test_a_tighter_tolerance_changes_the_step_by_less_than_the_looser_one(loose: float, tight: float) -> None:
    generator = np.random.default_rng(6)
    points = np.array([random_point(ROTATION, rate, generator) for rate in (0.1, 1.0, 5.0) for _ in range(5)])
    coarse, fine = (TorqueFreeProcess(ROTATION, ProcessNoise(), tolerance) for tolerance in (loose, tight))
    for x in points:
        change = ROTATION.local(fine.step(x, 0.5), coarse.step(x, 0.5))
        assert np.abs(change[ROTATION.slice("a")]).max() < loose
        assert np.abs(change[ROTATION.slice("w")]).max() < loose * np.linalg.norm(x[ROTATION.mean_slice("w")])


def test_points_with_time_steps_of_their_own_move_as_those_of_each_step(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    layout, generator = StateLayout(FULL_BLOCKS), np.random.default_rng(4)
    process = TorqueFreeProcess(layout, ProcessNoise(0.0, 0.0), 1e-8)
    x = np.array([random_point(layout, 0.5, generator) for _ in range(60)])
    dt = np.concatenate([np.full(20, 0.1), generator.uniform(0.001, 3.0, 40)])
    together = process.step(x[:20], 0.1)
    alone = [process.step(x[k], float(dt[k])) for k in range(20, 60)]
    calls: list[int] = []
    evaluate = Compiled.__call__

    def counted(self: Compiled, *arguments: np.ndarray | float) -> tuple[np.ndarray, ...]:
        calls.append(len(arguments))
        return evaluate(self, *arguments)

    monkeypatch.setattr(Compiled, "__call__", counted)
    found = process.steps(x, dt)
    assert len(calls) < 15
    np.testing.assert_array_equal(found[:20], together)
    np.testing.assert_array_equal(found[20:], alone)


def test_a_batch_of_points_moves_as_each_of_them_alone() -> None:
    process = TorqueFreeProcess(FULL, ProcessNoise(), tolerance=1e-12)
    generator = np.random.default_rng(9)
    points = np.array([random_point(FULL, 1.0, generator) for _ in range(6)])
    each = np.array([process.step(x, 0.7) for x in points])
    np.testing.assert_allclose(process.step(points.reshape(2, 3, -1), 0.7).reshape(6, -1), each, atol=1e-12)


@pytest.mark.parametrize("dt", [0.0, -0.1, np.nan, np.inf])
def test_a_time_step_that_leads_nowhere_is_refused(dt: float) -> None:
    process = TorqueFreeProcess(ROTATION, ProcessNoise())
    with pytest.raises(InputError, match="time step"):
        process.step(ROTATION.origin(), dt)
    with pytest.raises(InputError, match="time step"):
        process.linearise(ROTATION.origin(), dt)


def test_a_density_or_tolerance_that_means_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="torque_psd"):
        ProcessNoise(torque_psd=-1e-9)
    with pytest.raises(InputError, match="force_psd"):
        ProcessNoise(force_psd=np.nan)
    with pytest.raises(InputError, match="tolerance"):
        TorqueFreeProcess(ROTATION, ProcessNoise(), tolerance=0.0)


def _random_attitude(generator: np.random.Generator) -> np.ndarray:
    q = generator.standard_normal(4)
    return q / np.linalg.norm(q)


def _momentum(layout: StateLayout, x: np.ndarray) -> np.ndarray:
    """R_ig J w."""
    J = inertia_matrix(x[layout.mean_slice("s")])
    return matrix_from_quaternion(x[layout.mean_slice("a")]) @ J @ x[layout.mean_slice("w")]


def _energy(x: np.ndarray) -> float:
    w = x[ROTATION.mean_slice("w")]
    return float(w @ inertia_matrix(x[ROTATION.mean_slice("s")]) @ w / 2)


def _centre(x: np.ndarray) -> np.ndarray:
    c = x[FULL.mean_slice("c")]
    return x[FULL.mean_slice("t")] + matrix_from_quaternion(x[FULL.mean_slice("a")]) @ c


def test_many_points_side_by_side_are_stepped_as_each_by_itself() -> None:
    layout = StateLayout(FULL_BLOCKS)
    process, generator = TorqueFreeProcess(layout, ProcessNoise()), np.random.default_rng(0)
    points = layout.retract(layout.origin(), 0.3 * generator.standard_normal((41, layout.error_dim)))
    for dt in (0.01, 0.5, 3.0):
        together = process.step(points, dt)
        np.testing.assert_allclose(together, [process.step(x, dt) for x in points], rtol=1e-8, atol=1e-8)
        np.testing.assert_array_equal(together, process.steps(points, np.full(len(points), dt)))
