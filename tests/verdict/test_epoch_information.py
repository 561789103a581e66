"""Information on errors of single epochs: what is formed without long columns is H'M H."""

import numpy as np
import pytest
from jaxtyping import Float
from smoothed_motions import motion_near

from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map
from spinfilters.verdict.model_errors.error_columns import clock_jitter
from spinfilters.verdict.model_errors.linear_rows import Columns
from spinfilters.verdict.model_errors.noise_components import information_by_epoch
from spinfilters.verdict.model_errors.smoothed_motion import SmoothedMotion

CHOSEN = np.array([0, 3, 4, 11])


def smoothed(kind: str, known_map: bool = False) -> SmoothedMotion:
    """About the initialisation of a short recording; tracks without their map, unless it is known."""
    scenario = Scenario.simplified(kind=kind, rate_rpm=RICH_RPM, epochs=16, landmarks=40)
    dataset = simulate(scenario)
    dataset = without_map(dataset) if dataset.known_map is not None and not known_map else dataset
    settings = Settings(process={"gravity": False}, initialisation={"share": 1.0})  # pyright: ignore[reportArgumentType]
    setup = prepare(dataset, settings)
    return motion_near(setup, setup.initial.mean)


def of_one_epoch(motion: SmoothedMotion, columns: Columns, epoch: int) -> Columns:
    """Columns that are zero at all other epochs."""
    problem, nothing = motion.rows.problem, motion.rows.nothing(columns.count)
    pairs = zip(problem.motion.sensors, columns.formed.sensors, strict=True)
    sensors = tuple(np.where((s.epoch == epoch)[:, None, None], part, 0.0) for s, part in pairs)
    seen = columns.observations
    if seen is not None and problem.observations is not None:
        seen = np.where((problem.observations.epoch == epoch)[:, None, None], seen, 0.0)
    return Columns(sensors, nothing.steps, seen, nothing.prior)


def projected(motion: SmoothedMotion, columns: Columns) -> Float[np.ndarray, "n n"]:
    """H'M H by the residual of every column."""
    every = Columns.joined([of_one_epoch(motion, columns, epoch) for epoch in CHOSEN])
    return every.gram(motion.rows.residual(every))


@pytest.mark.parametrize("kind", ["pose", "gyro", "stereo-tracks"])
def test_the_information_is_that_of_the_projected_columns(kind: str) -> None:
    motion = smoothed(kind)
    columns = clock_jitter(motion)
    assert columns is not None
    both = Columns.joined([columns, columns.times(np.array([[0.3]]))])
    generator = np.random.default_rng(0)
    sensors = tuple(part * generator.uniform(0.5, 2, part.shape) for part in both.formed.sensors)
    seen = (
        None
        if both.observations is None
        else both.observations * generator.uniform(0.5, 2, both.observations.shape)
    )
    mixed = Columns(sensors, both.steps, seen, both.prior)
    expected = projected(motion, mixed)
    found = information_by_epoch(motion.rows, mixed, CHOSEN)
    np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("kind", "known_map"),
    [("pose", False), ("gyro", False), ("stereo-tracks", False), ("stereo-tracks", True)],
)
def test_errors_that_sensors_see_have_the_products_of_their_rows(kind: str, known_map: bool) -> None:
    motion = smoothed(kind, known_map)
    seen = clock_jitter(motion)
    assert seen is not None
    scale = 1 / np.sqrt(seen.squares[0])
    seen = seen.times(np.array([[scale, -0.5 * scale]]))
    rows = motion.rows
    np.testing.assert_allclose(seen.squares, seen.formed.squares, rtol=1e-12)
    np.testing.assert_allclose(rows.score(seen), rows.score(seen.formed), atol=1e-9)
    for one, other in zip(rows.residual(seen).parts, rows.residual(seen.formed).parts, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)
    found, expected = (information_by_epoch(rows, each, CHOSEN) for each in (seen, seen.formed))
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
