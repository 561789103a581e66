"""The compiled steps of an epoch compute what their NumPy reference computes."""

import numpy as np
import pytest

from spinfilters.filters.compiled_steps import ROWS_BESIDE_MODES, CompiledSteps, steps_of
from spinfilters.filters.landmark_map import HeldMap, LandmarkMap
from spinfilters.filters.landmark_observations import Spread
from spinfilters.filters.landmark_steps import SLOTS, Closing, MapObservations, NumpySteps
from spinfilters.filters.measurement_prediction import SigmaPointOptions, sigma_points
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.models.gauge import GAUGE_DIM
from spinfilters.models.state_blocks import BLOCKS
from tests.filters.landmark_samples import LAYOUT, recording

RANK, COUNT, POSE, LANDMARKS = 5, 23, 6, 60
SIZE = 20 + RANK + 6
KNOWN = 2
COLUMNS = np.r_[0:POSE, 20 : 20 + RANK]
PRECISIONS = pytest.mark.parametrize("precision", ["float64", "float32"])
EITHER = NumpySteps | CompiledSteps


def sample(precision: str) -> tuple[np.random.Generator, LandmarkMap]:
    generator = np.random.default_rng(4)
    landmarks = LandmarkMap(RANK, precision)
    roots = np.tril(generator.standard_normal((LANDMARKS, 3, 3)))
    modes = generator.standard_normal((LANDMARKS, 3, RANK))
    landmarks.append(np.arange(LANDMARKS), generator.standard_normal((LANDMARKS, 3)), modes, roots)
    return generator, landmarks


def both(precision: str) -> tuple[NumpySteps, CompiledSteps]:
    steps = steps_of(RANK, precision)
    if not isinstance(steps, CompiledSteps):
        pytest.skip("no compiler")
    return NumpySteps(), steps


def assert_alike(found: np.ndarray, expected: np.ndarray, rtol: float) -> None:
    np.testing.assert_allclose(found, expected, rtol=rtol, atol=rtol * np.abs(expected).max(initial=1e-300))


def squares(roots: np.ndarray) -> np.ndarray:
    return roots.astype(float) @ np.swapaxes(roots.astype(float), -1, -2)


@PRECISIONS
@pytest.mark.parametrize("count", [COUNT, 0])
def test_epochs_of_observations(precision, count):
    tolerance = 1e-8 if precision == "float64" else 1e-4
    made = [epochs(steps, precision, count) for steps in both(precision)]
    for name, expected in made[0].items():
        assert_alike(made[1][name], expected, tolerance)


def epochs(steps: EITHER, precision: str, count: int) -> dict[str, np.ndarray]:
    """Everything after epochs of so many observations that does not depend on the signs of modes and of the factor's columns."""
    generator, landmarks = sample(precision)
    landmarks.steps = steps
    factor, found, shared = np.tril(generator.standard_normal((SIZE, SIZE))), {}, np.zeros((RANK, 20))
    for epoch in range(2 * SLOTS):
        seen = generator.permutation(LANDMARKS)[:count]
        steps.refresh(landmarks, seen)
        linear, weights = generator.standard_normal((count, 3, POSE + 4)), generator.uniform(0.1, 2.0, count)
        white = steps.whitened(landmarks, seen, linear, weights)
        levers = steps.lever_squares(landmarks, seen, white) if count else np.zeros(3)
        correction = steps.corrected(white, factor, COLUMNS, 0.5)
        y = correction.coordinates
        found |= {
            f"likelihood {epoch}": np.array([white.log_noise, correction.nis, correction.log_likelihood]),
            f"levers {epoch}": levers,
            f"rows {epoch}": squares(np.delete(white.rows, COLUMNS[POSE:] - 20 + POSE, 2).swapaxes(1, 2)),
            f"length {epoch}": np.array([np.linalg.norm(y), correction.length(y)]),
            f"errors {epoch}": np.r_[correction.error[:20], correction.error[20 + RANK :]],
        }
        by_pose, own = generator.standard_normal((4, 3, POSE)), np.tril(generator.standard_normal((4, 3, 3)))
        closing = Closing(
            seen,
            white,
            correction,
            COLUMNS,
            np.eye(20) + np.pad(0.1 * generator.standard_normal((3, 3)), (3, 14)),
            by_pose,
            own + 3 * np.eye(3),
            np.ones(RANK),
            landmarks.take_turn(),
        )
        modes, dependence, roots, after = steps.close(landmarks, closing)
        shared = modes.rows @ correction.factor[:20].T
        factor = 1.2 * correction.factor
        factor[20 : 20 + RANK] = modes.rows
        found |= {
            f"explained {epoch}": modes.explained,
            f"modes {epoch}": shared.T @ shared,
            f"kept {epoch}": modes.kept[:POSE] @ shared,
            f"dropped {epoch}": squares(modes.dropped[:POSE]),
            f"new {epoch}": dependence.astype(float) @ shared,
            f"new roots {epoch}": squares(roots),
            f"state {epoch}": after[:20] @ after[:20].T,
            f"move {epoch}": after[20 + RANK :] @ after[:20].T,
        }
    landmarks.refresh(np.arange(LANDMARKS))
    known = landmarks.snapshot()
    counted = {name: known[f"map.{name}"] for name in ("epoch", "hits", "wrong", "last")}
    own = {"points": known["map.points"], "roots": squares(known["map.roots"])}
    return found | counted | own | {"dependence": known["map.modes"].astype(float) @ shared}


def test_a_sensor_of_another_shape_goes_through_numpy():
    generator, landmarks = sample("float64")
    at, linear = np.arange(7), generator.standard_normal((7, 2, POSE + 4))
    factor = np.tril(generator.standard_normal((SIZE, SIZE)))
    found = []
    for steps in both("float64"):
        white = steps.whitened(landmarks, at, linear, np.ones(7))
        found.append(steps.corrected(white, factor, COLUMNS, 0.0))
    np.testing.assert_array_equal(found[0].error, found[1].error)


def seen(precision: str = "float64") -> tuple[np.random.Generator, MapObservations]:
    """The first epoch of a recording, of a map whose errors are drawn."""
    recorded, held = recording(), HeldMap.empty(LandmarkOptions(modes=RANK, precision=precision))
    measured, generator = recorded.timeline[0].measurements[0], np.random.default_rng(5)
    count = len(measured.values)
    held.landmarks.append(
        np.arange(count),
        measured.parameters[:, :3],
        0.001 * generator.standard_normal((count, 3, RANK)),
        0.001 * np.tril(generator.standard_normal((count, 3, 3))),
    )
    return generator, held.observations(LAYOUT, measured, np.arange(count), 1.3)


@pytest.mark.parametrize("limit", [1e9, 1e-9])
def test_a_correction_at_once_is_that_of_its_steps_or_none(limit):
    reference, native = both("float64")
    generator, observations = seen()
    x, held, count = recording().states[0], observations.landmarks, len(observations.at)
    factor = 0.01 * np.tril(generator.standard_normal((SIZE, SIZE)))
    linear = observations.rows_at(x)
    log_noise = float(linear.log_noise.sum())
    white = reference.whitened(held, observations.at, linear.rows, np.full(count, 1 / 1.3))
    expected = reference.corrected(white, factor, observations.columns, log_noise)
    assert reference.solved(observations, x, factor, limit) is None
    assert reference.solved_rows(observations, linear.rows, log_noise, factor, limit) is None
    for found in (
        native.solved(observations, x, factor, limit),
        native.solved_rows(observations, linear.rows, log_noise, factor, limit),
    ):
        if limit < 1:
            assert found is None
            continue
        assert found is not None
        correction, rows = found
        assert_alike(rows.rows[..., -1] ** 2, white.rows[..., -1] ** 2, 1e-6)
        assert_alike(correction.error, expected.error, 1e-8)
        assert_alike(squares(correction.factor), squares(expected.factor), 1e-8)
        assert_alike(
            np.array([correction.nis, correction.log_likelihood]),
            np.array([expected.nis, expected.log_likelihood]),
            1e-9,
        )


def regressions(precision: str) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Rows of the reference and of the compiled step, of landmarks of which one lies behind the camera; `KNOWN` has no error."""
    generator, observations = seen(precision)
    observations.landmarks.modes[KNOWN], observations.landmarks.roots[KNOWN] = 0, 0
    observations.landmarks.points[:2] = [[300, 200, 100], [-300, -200, -100]]
    pose, modes = np.tril(generator.standard_normal((POSE, POSE))), generator.standard_normal((RANK, POSE))
    error = 0.003 * pose + 0.01 * np.eye(POSE)
    points = sigma_points(POSE + 3, SigmaPointOptions())
    along = points.offsets[:, :POSE] @ np.concatenate([error.T, np.zeros((POSE, 14))], axis=1)
    late = np.tril(generator.standard_normal((RANK, RANK)))
    spread = Spread(LAYOUT.retract(recording().states[0], along), error, 0.1 * modes, late)
    found = both(precision)[1].regressed(observations, spread, points)
    assert found is not None
    return spread.regressed(observations, points), found


@PRECISIONS
def test_a_regression_is_that_of_its_reference(precision):
    (rows, valid, log_noise), (found, good, determinants) = regressions(precision)
    np.testing.assert_array_equal(good, valid)
    assert 0 < np.count_nonzero(~valid) < len(valid)
    assert_alike(found[valid], rows[valid], 1e-9)
    assert_alike(determinants[valid], log_noise[valid], 1e-9)
    assert valid[KNOWN]
    np.testing.assert_array_equal(found[KNOWN, :, POSE:-1], 0)


def test_there_is_room_for_every_state():
    assert sum(block.dimension for block in BLOCKS.values()) + GAUGE_DIM <= ROWS_BESIDE_MODES
