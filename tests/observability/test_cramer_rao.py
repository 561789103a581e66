"""The bound against finite differences, against one large least-squares problem, and against what estimates really scatter by."""

from collections.abc import Callable

import numpy as np
import pytest

from observability.cramer_rao import cramer_rao_bound, observability_gramian, prior_deviations
from observability.reference_trajectory import ReferenceTrajectory, SensorSchedule, rows_at
from observability.system import analysed
from spinfilters.core.errors import InputError, ShapeError
from spinfilters.models.camera_landmarks import MonocularLandmark, camera_parameters
from spinfilters.models.process import ProcessNoise
from spinfilters.models.sensors.gyro import Gyro, gyro_parameters
from spinfilters.models.sensors.pose import Pose, pose_parameters
from tests.observability.analyser_samples import MOTIONS, TUMBLE, Z_SPIN
from tests.observability.bound_samples import CALIBRATION, LAYOUT, MODEL, flight_of, stereo_watch

QUIET = ProcessNoise(0.0, 0.0)
WIDE = {"t": 0.1, "a": 0.1, "v": 0.1, "w": 0.1, "c": 0.1, "s": 0.3}
STEP = 2e-3
WEIGHTS = {1: 3 / 2, 2: -3 / 10, 3: 1 / 30}
"""Of central differences of sixth order over twice the step: truncation some 1e-16, rounding 1e-12 of a unit."""


def slopes(outputs: Callable[[np.ndarray], np.ndarray], size: int) -> np.ndarray:
    """Derivatives at 0 by central differences of sixth order."""
    columns = []
    for direction in np.eye(size):
        columns.append(
            sum(
                weight * (outputs(k * STEP * direction) - outputs(-k * STEP * direction))
                for k, weight in WEIGHTS.items()
            )
            / (2 * STEP)
        )
    return np.stack(columns, axis=1)


def flown(
    reference: ReferenceTrajectory, schedule: SensorSchedule, unknowns: np.ndarray, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Whitened outputs over a flight whose start, landmarks and disturbances are moved, and the last state."""
    layout, n = LAYOUT, LAYOUT.error_dim
    x = layout.retract(reference.states[0], unknowns[:n])
    parameters = schedule.parameters.copy()
    parameters[:, :3] += unknowns[n:].reshape(-1, 3)
    found = []
    for frame in range(len(reference.time)):
        if frame:
            dt = float(reference.time[frame] - reference.time[frame - 1])
            entry = reference.process.linearise(reference.states[frame - 1], dt)[2]
            x = reference.process.step(x, dt)
            if noise.size:
                x = layout.retract(x, entry @ noise[frame - 1])
        items = schedule.seen[frame]
        found.append(schedule.model.predict(x, parameters[items]).ravel() / schedule.parameters[0, -1])
    return np.concatenate(found), x


def test_without_process_noise_the_bound_equals_finite_differences_of_the_whole_flight() -> None:
    reference, schedule = flight_of(TUMBLE, 12, 0.3, QUIET), stereo_watch(4, 12)
    size = LAYOUT.error_dim + 12
    outputs = slopes(lambda moved: flown(reference, schedule, moved, np.zeros(0))[0], size)
    gramian = observability_gramian(reference, [schedule])
    np.testing.assert_allclose(gramian, outputs.T @ outputs, atol=1e-8 * np.abs(gramian).max())
    prior = prior_deviations(LAYOUT, size, WIDE, 0.1)
    first = np.linalg.inv(outputs.T @ outputs + np.diag(prior**-2))
    last = slopes(
        lambda moved: LAYOUT.local(reference.states[-1], flown(reference, schedule, moved, np.zeros(0))[1]),
        LAYOUT.error_dim + 12,
    )
    carried = np.concatenate([last, np.eye(12, size, LAYOUT.error_dim)])
    bound = cramer_rao_bound(reference, [schedule], WIDE, 0.1)
    np.testing.assert_allclose(bound.std[-1], np.sqrt(np.diag(carried @ first @ carried.T)), rtol=1e-8)


def test_with_process_noise_the_bound_is_that_of_one_large_least_squares_problem() -> None:
    frames = 5
    reference, schedule = flight_of(TUMBLE, frames, 0.3, ProcessNoise(1e-4, 1e-3)), stereo_watch(3, frames)
    size, kicks = LAYOUT.error_dim + 9, (frames - 1, 12)

    def split(moved: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return flown(reference, schedule, moved[:size], moved[size:].reshape(kicks))

    total = size + kicks[0] * kicks[1]
    outputs = slopes(lambda moved: split(moved)[0], total)
    last = slopes(lambda moved: LAYOUT.local(reference.states[-1], split(moved)[1]), total)
    prior = np.concatenate([prior_deviations(LAYOUT, size, WIDE, 0.1), np.ones(total - size)])
    covariance = last @ np.linalg.solve(outputs.T @ outputs + np.diag(prior**-2), last.T)
    bound = cramer_rao_bound(reference, [schedule], WIDE, 0.1)
    np.testing.assert_allclose(bound.std[-1, : LAYOUT.error_dim], np.sqrt(np.diag(covariance)), rtol=1e-8)


@pytest.mark.parametrize(
    "schedule",
    [
        SensorSchedule(Gyro(LAYOUT), gyro_parameters(1, 0.01, 0.0), 0, np.ones((3, 1), dtype=bool)),
        SensorSchedule(
            Pose(LAYOUT), pose_parameters(1e-4 * np.eye(6)[np.newaxis]), 0, np.ones((3, 1), dtype=bool)
        ),
        SensorSchedule(
            MonocularLandmark(LAYOUT),
            camera_parameters(np.array([[0.05, 0.02, -0.03], [0.01, -0.04, 0.02]]), CALIBRATION[:4], 0.7),
            3,
            np.ones((3, 2), dtype=bool),
        ),
    ],
    ids=lambda schedule: schedule.model.name,
)
def test_rows_of_every_sensor_are_whitened_derivatives_of_its_innovation(schedule: SensorSchedule) -> None:
    reference = flight_of(TUMBLE, 3, 0.4, QUIET)
    n, x = LAYOUT.error_dim, reference.states[1]
    total = n + schedule.own
    exact = schedule.model.predict(x, schedule.parameters)
    whitening = schedule.model.whitening(x, schedule.parameters)

    def innovation(moved: np.ndarray) -> np.ndarray:
        parameters = schedule.parameters.copy()
        parameters[:, : schedule.unknown] += moved[n:].reshape(len(parameters), -1)
        there = schedule.model.predict(LAYOUT.retract(x, moved[:n]), parameters)
        found = schedule.model.innovations(x, schedule.parameters, there)[0]
        return np.einsum("kij,kj->ki", whitening, found).ravel()

    assert np.abs(innovation(np.zeros(total))).max() < 1e-12
    assert exact.shape == (len(schedule.parameters), schedule.model.value_dim)
    rows = rows_at(schedule, 1, x, n, total)
    np.testing.assert_allclose(rows, slopes(innovation, total), atol=1e-8 * np.abs(rows).max())


def test_estimates_scatter_by_the_bound() -> None:
    """200 runs of an iterated least-squares fit that starts at the truth."""
    frames, runs = 12, 200
    reference, schedule = flight_of(TUMBLE, frames, 0.6, QUIET), stereo_watch(6, frames, 0.5)
    generator = np.random.default_rng(4)
    tight = {**WIDE, "t": 1e-6, "a": 1e-6}
    bound = cramer_rao_bound(reference, [schedule], tight, 0.1)
    errors = np.stack([_fitted_error(reference, schedule, tight, generator) for _ in range(runs)])
    ratio = np.sqrt((errors[:, 6:] ** 2).mean(axis=0)) / bound.std[-1, 6 : LAYOUT.error_dim]
    for block in "vwcs":
        where = LAYOUT.slice(block)
        assert np.mean(ratio[where.start - 6 : where.stop - 6]) == pytest.approx(1.0, abs=0.1), block


def _fitted_error(
    reference: ReferenceTrajectory,
    schedule: SensorSchedule,
    prior: dict[str, float],
    generator: np.random.Generator,
) -> np.ndarray:
    """Error of the last state of a fit, the truth being drawn from the prior about the flight's start."""
    n, items = LAYOUT.error_dim, len(schedule.parameters)
    deviations = prior_deviations(LAYOUT, n + 3 * items, prior, 0.1)
    pixels = [
        schedule.model.predict(x, schedule.parameters[seen])
        + schedule.parameters[0, -1] * generator.standard_normal((seen.sum(), 3))
        for x, seen in zip(reference.states, schedule.seen, strict=True)
    ]
    offset = deviations * generator.standard_normal(
        n + 3 * items
    )  # where the prior's mean lies from the truth
    start, points, total = reference.states[0], schedule.parameters.copy(), np.zeros(n + 3 * items)
    for _ in range(3):
        rows, residuals, _ = _linearised(reference, schedule, (start, points), pixels)
        information = rows.T @ rows + np.diag(deviations**-2)
        step = np.linalg.solve(information, rows.T @ residuals + (offset - total) / deviations**2)
        total += step
        start = LAYOUT.retract(start, step[:n])
        points[:, :3] += step[n:].reshape(-1, 3)
    return LAYOUT.local(reference.states[-1], _linearised(reference, schedule, (start, points), pixels)[2])


def _linearised(
    reference: ReferenceTrajectory,
    schedule: SensorSchedule,
    at: tuple[np.ndarray, np.ndarray],
    pixels: list[np.ndarray],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    start, points = at
    n, total = LAYOUT.error_dim, LAYOUT.error_dim + 3 * len(points)
    x, transition, rows, residuals = start, np.eye(total), [], []
    here = SensorSchedule(MODEL, points, 3, schedule.seen)
    for frame in range(len(reference.time)):
        if frame:
            dt = float(reference.time[frame] - reference.time[frame - 1])
            x, step, _ = reference.process.linearise(x, dt)
            transition[:n] = step @ transition[:n]
        rows.append(rows_at(here, frame, x, n, total) @ transition)
        expected = schedule.model.predict(x, points[schedule.seen[frame]])
        residuals.append((pixels[frame] - expected).ravel() / points[0, -1])
    return np.concatenate(rows), np.concatenate(residuals), x


def test_more_noise_less_bound_is_impossible_and_every_epoch_adds() -> None:
    schedule = stereo_watch(4, 20)
    quiet, noisy = (
        cramer_rao_bound(flight_of(TUMBLE, 20, 0.3, noise), [schedule])
        for noise in (QUIET, ProcessNoise(1e-5, 1e-4))
    )
    assert (noisy.std[-1] > quiet.std[-1]).all()
    assert (np.diff(quiet.block("s"), axis=0) <= 1e-12).all()


def test_the_gramian_of_stereo_leaves_the_gauge_and_a_spin_leaves_more() -> None:
    for motion, missing in ((TUMBLE, 6), (Z_SPIN, 10)):
        reference, schedule = flight_of(motion, 30, 0.5, QUIET), stereo_watch(4, 30)
        gramian = observability_gramian(reference, [schedule])
        scale = 1 / np.sqrt(np.diag(gramian).clip(min=1e-12))
        values = np.linalg.eigvalsh(gramian * np.outer(scale, scale))
        assert (values < 1e-9 * values[-1]).sum() == missing


def test_the_weak_direction_of_a_spin_is_one_that_it_cannot_show() -> None:
    reference, schedule = flight_of(Z_SPIN, 30, 0.5, QUIET), stereo_watch(4, 30)
    direction, remains = cramer_rao_bound(reference, [schedule]).weak_direction
    assert remains == pytest.approx(1.0, abs=1e-3)
    constants = np.abs(np.concatenate([direction[LAYOUT.slice("c")], direction[LAYOUT.slice("s")]]))
    assert np.linalg.norm(constants) > 0.99
    _, of_tumble = cramer_rao_bound(flight_of(TUMBLE, 30, 0.5, QUIET), [schedule]).weak_direction
    assert of_tumble < 0.1


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        (lambda f, w: cramer_rao_bound(f, []), InputError, "nothing is measured"),
        (
            lambda f, w: cramer_rao_bound(f, [stereo_watch(2, 3)]),
            ShapeError,
            "stereo sees 3 frames of a flight of 4",
        ),
        (lambda f, w: cramer_rao_bound(f, [w], {"t": 1.0}), InputError, "not block a"),
        (lambda f, w: cramer_rao_bound(f, [w], {**WIDE, "v": 0.0}), InputError, "must be positive"),
        (
            lambda f, w: ReferenceTrajectory(f.process, f.time[:3], f.states),
            ShapeError,
            "a flight over 3 frames",
        ),
        (lambda f, w: ReferenceTrajectory(f.process, f.time * 0, f.states), InputError, "at ascending times"),
        (
            lambda f, w: SensorSchedule(MODEL, w.parameters[:, :5], 3, w.seen),
            ShapeError,
            "stereo takes parameters",
        ),
        (
            lambda f, w: SensorSchedule(MODEL, w.parameters, 3, w.seen & False),
            InputError,
            "measures nothing over the whole flight",
        ),
    ],
)
def test_wrong_input_is_refused(change, error: type[Exception], text: str) -> None:
    with pytest.raises(error, match=text):
        change(flight_of(MOTIONS["tumble"], 4, 0.5, QUIET), stereo_watch(2, 4))


def test_the_rig_of_samples_and_of_the_analyser_are_the_same() -> None:
    np.testing.assert_array_equal(CALIBRATION, analysed("stereo").parameters[:5])
