"""Motions in view: what is skipped could not have stayed in view, and paths are those of the integrated motion."""

from dataclasses import replace

import numpy as np

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.models.feature_tracks import could_stay_in_view, stays_in_view
from spinfilters.models.process import THESIS_NOISE, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.simulation.scenario import (
    Motion,
    Scenario,
    _path,
    first_state,
    motion_in_view,
    simulate_motion,
)

LAYOUT = StateLayout(FULL_BLOCKS)
SCENARIO = replace(Scenario.common_workload(), epochs=60)


def test_the_motion_stays_in_view_and_comes_again_from_its_seed() -> None:
    motion, again = (motion_in_view(SCENARIO, np.random.default_rng(3)) for _ in range(2))
    assert stays_in_view(motion, SCENARIO.radius_m)
    np.testing.assert_array_equal(motion.states, again.states)
    np.testing.assert_allclose(np.linalg.norm(motion.block("a"), axis=1), 1.0, atol=1e-14)


def test_the_path_of_the_centre_of_mass_is_that_of_the_integrated_motion() -> None:
    generator = np.random.default_rng(0)
    normal = generator.standard_normal((30, 10, 2, 6))
    process = TorqueFreeProcess(LAYOUT, THESIS_NOISE)
    states = process.disturbed_path(first_state(SCENARIO, LAYOUT), SCENARIO.interval, normal)
    motion = Motion(LAYOUT, np.arange(31.0), states)
    centre = motion.block("t") + motion.rotations @ np.array(SCENARIO.center_of_mass_g)
    np.testing.assert_allclose(centre[1:], _path(SCENARIO, normal[..., 3:]), atol=1e-9)


def test_a_path_is_that_of_its_steps_one_by_one() -> None:
    normal = np.random.default_rng(1).standard_normal((20, 10, 2, 6))
    process, x = TorqueFreeProcess(LAYOUT, THESIS_NOISE), first_state(SCENARIO, LAYOUT)
    path = process.disturbed_path(x, 0.5, normal)
    q = LAYOUT.mean_slice("a")
    for here, kicks in zip(path[1:], normal, strict=True):
        x = process.disturbed_steps(x, 0.05, kicks)
        x[q] /= np.linalg.norm(x[q])
        np.testing.assert_allclose(here, x, atol=1e-12)


def test_no_motion_that_stays_in_view_is_skipped() -> None:
    generator = np.random.default_rng(2)
    process, time = TorqueFreeProcess(LAYOUT, THESIS_NOISE), 0.5 * np.arange(80)
    starts = np.tile(first_state(SCENARIO, LAYOUT), (200, 1))
    states = simulate_motion(process, starts, time, generator)
    depth, offset = float(starts[0, 2]), float(np.linalg.norm(SCENARIO.center_of_mass_g))
    kept = skipped = 0
    for k in range(200):
        motion = Motion(LAYOUT, time, states[:, k])
        rotations = matrix_from_quaternion(motion.block("a"))
        centre = motion.block("t") + rotations @ np.array(SCENARIO.center_of_mass_g)
        could = could_stay_in_view(centre[1:], depth, SCENARIO.radius_m, offset)
        stays = stays_in_view(motion, SCENARIO.radius_m)
        assert could or not stays
        kept, skipped = kept + stays, skipped + (not could)
    assert kept > 5
    assert skipped > 5


def test_tracks_have_every_landmark_that_is_in_view_one_by_one() -> None:
    """The ball test that spares the projection of all landmarks gives what projecting them gives."""
    from spinfilters.models import feature_tracks as tracks
    from spinfilters.simulation.scenario import measured

    motion = motion_in_view(SCENARIO, np.random.default_rng(3))
    spared = measured(SCENARIO, motion, np.random.default_rng(4)).log.streams[0]
    original = tracks._all_in_view
    tracks._all_in_view = lambda *_: False
    try:
        projected = measured(SCENARIO, motion, np.random.default_rng(4)).log.streams[0]
    finally:
        tracks._all_in_view = original
    np.testing.assert_array_equal(spared.values, projected.values)
