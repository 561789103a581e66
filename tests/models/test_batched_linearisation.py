"""Many steps and many observations linearised side by side are those that are linearised one by one."""

import pickle
from collections.abc import Iterator

import numpy as np
import pytest

from spinfilters.core import c_library
from spinfilters.core.errors import InputError, ShapeError
from spinfilters.models.camera_landmarks import StereoLandmark, camera_parameters
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from tests.models.process_samples import LAYOUTS, random_point

NAMES = ["-".join(layout.blocks) for layout in LAYOUTS]
PROCESSES = {
    name: TorqueFreeProcess(layout, ProcessNoise()) for name, layout in zip(NAMES, LAYOUTS, strict=True)
}
FULL = "-".join(FULL_BLOCKS)
ROUNDING = 1e-13
TOLERANCE = 1e-7
"""Of steps whose number of substeps differs: the integration error that is allowed, with room for its derivatives."""
CALIBRATION = np.array([466.7, 460.0, 320.0, 240.0, 0.09])


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A machine without a compiler."""
    monkeypatch.setenv("SPINFILTERS_COMPILE", "off")
    c_library.compiler.cache_clear()
    yield
    c_library.compiler.cache_clear()


def _points(name: str, count: int, rate: float = 1.2) -> np.ndarray:
    layout, generator = PROCESSES[name].layout, np.random.default_rng(count)
    points = [random_point(layout, rate, generator) for _ in range(count)]
    return np.array(points).reshape(count, layout.mean_dim)


def _missed(process: TorqueFreeProcess, x: np.ndarray, dt: np.ndarray, size: float = 0.03) -> np.ndarray:
    """Points near those that the steps lead to."""
    layout, generator = process.layout, np.random.default_rng(len(x))
    moved = [process.step(here, float(step)) for here, step in zip(x, dt, strict=True)]
    errors = size * generator.standard_normal((len(x), layout.error_dim))
    if "s" in layout.blocks:
        errors[:, layout.slice("s")] = 0.0
    return layout.retract(np.array(moved).reshape(x.shape), errors)


def _one_by_one(
    process: TorqueFreeProcess, x: np.ndarray, there: np.ndarray, dt: np.ndarray
) -> list[np.ndarray]:
    """From the process' own linearisation and the layout's change of the error's origin."""
    every = []
    for here, missed, step in zip(x, there, dt, strict=True):
        moved, transition, noise = process.linearise(here, float(step))
        defect = process.layout.local(missed, moved)
        turn = np.linalg.inv(process.layout.reset_jacobian(defect))
        every.append((defect, turn @ transition, turn @ noise))
    return [np.array(part) for part in zip(*every, strict=True)]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("rate", [0.0, 1e-7, 0.3, 1.2])
def test_a_step_is_the_process_own_to_rounding(name: str, rate: float) -> None:
    process, x, dt = PROCESSES[name], _points(name, 1, rate), np.array([0.5])
    there = _missed(process, x, dt)
    defect, transition, noise = process.linearise_steps(x, there, dt)
    expected = _one_by_one(process, x, there, dt)
    np.testing.assert_allclose(defect, expected[0], rtol=ROUNDING, atol=ROUNDING)
    np.testing.assert_allclose(transition, expected[1], rtol=ROUNDING, atol=ROUNDING)
    np.testing.assert_allclose(noise, expected[2], rtol=1e-10, atol=1e-16)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("count", [3, 8, 11])
def test_steps_of_different_length_are_the_process_own_to_its_tolerance(name: str, count: int) -> None:
    process, x = PROCESSES[name], _points(name, count)
    dt = np.linspace(0.05, 0.5, count)
    there = _missed(process, x, dt)
    found = process.linearise_steps(x, there, dt)
    for part, expected in zip(found, _one_by_one(process, x, there, dt), strict=True):
        assert part.shape == expected.shape
        np.testing.assert_allclose(part, expected, rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("name", NAMES)
def test_slopes_about_other_constants_leave_the_defect_alone(name: str) -> None:
    process, x, dt = PROCESSES[name], _points(name, 3), np.full(3, 0.5)
    about, there, mass = x.copy(), _missed(process, x, dt), process.layout.mean_slice("s")
    about[:, mass] += 0.05
    defect, transition, noise = process.linearise_steps(x, there, dt, about)
    turn = np.linalg.inv(process.layout.reset_jacobian(defect))
    slopes = _one_by_one(process, about, process.step(about, 0.5), dt)
    np.testing.assert_allclose(defect, _one_by_one(process, x, there, dt)[0], rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(transition, turn @ slopes[1], rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(noise, turn @ slopes[2], rtol=0, atol=TOLERANCE)
    assert np.abs(transition - process.linearise_steps(x, there, dt)[1]).max() > 1e-3


@pytest.mark.parametrize("name", NAMES)
def test_a_step_does_not_depend_on_where_it_stands(name: str) -> None:
    process, x, dt = PROCESSES[name], _points(name, 11), np.linspace(0.1, 0.4, 11)
    there, order = _missed(process, x, dt), np.random.default_rng(0).permutation(11)
    together = process.linearise_steps(x, there, dt)
    shuffled = process.linearise_steps(x[order], there[order], dt[order])
    for found, expected in zip(shuffled, together, strict=True):
        np.testing.assert_array_equal(found, expected[order])


@pytest.mark.parametrize("name", NAMES)
def test_no_steps_give_arrays_of_the_shapes_of_steps(name: str) -> None:
    process, one = PROCESSES[name], _points(name, 1)
    none = process.linearise_steps(_points(name, 0), _points(name, 0), np.zeros(0))
    expected = process.linearise_steps(one, one, np.ones(1))
    assert [part.shape[1:] for part in none] == [part.shape[1:] for part in expected]
    assert all(len(part) == 0 for part in none)


@pytest.mark.parametrize("wrong", [0.0, -0.1, np.nan, np.inf])
def test_a_time_step_that_is_none_is_named(wrong: float) -> None:
    x = _points(NAMES[0], 3)
    with pytest.raises(InputError, match=f"time step is {wrong} s"):
        PROCESSES[NAMES[0]].linearise_steps(x, x, np.array([0.1, wrong, 0.2]))


def test_a_state_that_is_not_finite_gives_numbers_that_are_not() -> None:
    name = FULL
    x = _points(name, 2)
    there = x.copy()
    x[0, PROCESSES[name].layout.mean_slice("w")] = np.nan
    defect = PROCESSES[name].linearise_steps(x, there, np.full(2, 0.5))[0]
    assert np.isnan(defect[0]).any()
    assert np.isfinite(defect[1]).all()


def test_other_densities_scale_the_noise_alone() -> None:
    layout = StateLayout(FULL_BLOCKS)
    x, dt = _points(FULL, 2), np.full(2, 0.5)
    one = TorqueFreeProcess(layout, ProcessNoise(4e-8, 1e-6)).linearise_steps(x, x, dt)
    four = TorqueFreeProcess(layout, ProcessNoise(16e-8, 4e-6)).linearise_steps(x, x, dt)
    np.testing.assert_array_equal(one[1], four[1])
    np.testing.assert_allclose(2 * one[2], four[2], rtol=1e-12)


def test_without_a_compiler_steps_are_the_same(no_compiler: None) -> None:
    for layout, name in zip(LAYOUTS, NAMES, strict=True):
        interpreted = TorqueFreeProcess(layout, ProcessNoise())
        x, dt = _points(name, 2), np.full(2, 0.5)
        there = _missed(PROCESSES[name], x, dt)
        expected = PROCESSES[name].linearise_steps(x, there, dt)
        for found, part in zip(interpreted.linearise_steps(x, there, dt), expected, strict=True):
            np.testing.assert_allclose(found, part, rtol=1e-10, atol=1e-15)


def _scene(count: int) -> tuple[StereoLandmark, np.ndarray, np.ndarray, np.ndarray]:
    """A sensor, states, parameters and values; some points are behind the camera."""
    layout, generator = StateLayout(FULL_BLOCKS), np.random.default_rng(count)
    sensor, x = StereoLandmark(layout), _points(FULL, count)
    x[:, layout.mean_slice("t")] = [0.02, -0.01, 0.6] + 0.1 * generator.standard_normal((count, 3))
    x[::5, 2] = -0.5
    parameters = camera_parameters(0.1 * generator.standard_normal((count, 3)), CALIBRATION, 1.3)
    values = sensor.predict(x, parameters) + generator.standard_normal((count, 3))
    return sensor, x, parameters, values


def _check_observations(count: int) -> None:
    sensor, x, parameters, values = _scene(count)
    rows, valid, square, determinant = sensor.observation_rows(
        x, parameters[:, :3].copy(), parameters[:, 3:].copy(), values, rows=(None,) * 4
    )
    rows = rows.reshape(count, 3, 10)
    for k in range(count):
        one = sensor.linearise_landmarks(x[k], parameters[k : k + 1], values[k : k + 1])
        np.testing.assert_array_equal(rows[k, :, :6], one.jacobian[0])
        np.testing.assert_array_equal(rows[k, :, 6:9], one.by_landmark[0])
        np.testing.assert_array_equal(rows[k, :, 9], one.innovation[0])
        assert (valid[k, 0] > 0) == one.valid[0] == (k % 5 != 0)
        np.testing.assert_allclose(square[k, 0], one.innovation[0] @ one.innovation[0], rtol=1e-14)
        assert np.log(determinant[k, 0]) == one.log_noise[0]


@pytest.mark.parametrize("count", [1, 8, 21])
def test_observations_side_by_side_have_the_bits_of_observations_one_by_one(count: int) -> None:
    _check_observations(count)


def test_without_a_compiler_observations_side_by_side_have_the_bits_of_observations_one_by_one(
    no_compiler: None,
) -> None:
    _check_observations(6)


def test_observations_choose_their_states_and_landmarks() -> None:
    sensor, x, parameters, values = _scene(6)
    points, rest = parameters[:4, :3].copy(), np.tile(parameters[:1, 3:], (5, 1))
    frame, landmark = np.array([1, 1, 4, 2, 3]), np.array([0, 3, 1, 1, 2])
    found = sensor.observation_rows(x, points, rest, values[:5], rows=(frame, landmark, None, None))
    expected = sensor.observation_rows(x[frame], points[landmark], rest, values[:5], rows=(None,) * 4)
    np.testing.assert_array_equal(found[0], expected[0])


def test_observations_without_their_values_are_refused() -> None:
    sensor, x, parameters, values = _scene(4)
    with pytest.raises(ShapeError, match="stereo_observation_rows"):
        sensor.observation_rows(x, parameters, parameters[:, 3:].copy(), values, rows=(None,) * 4)


def test_the_rows_of_observations_survive_pickling() -> None:
    sensor, x, parameters, values = _scene(3)
    arguments = (x, parameters[:, :3].copy(), parameters[:, 3:].copy(), values)
    before = sensor.observation_rows(*arguments, rows=(None,) * 4)[0]
    after = pickle.loads(pickle.dumps(sensor.observation_rows))(*arguments, rows=(None,) * 4)[0]
    np.testing.assert_array_equal(before, after)
