"""Trajectories from conserved angular momentum."""

import numpy as np

from spinfilters.models.process import ProcessNoise
from spinfilters.simulation.model_faults import LAYOUT, Physics, faulty_motion, motion_at
from spinfilters.simulation.scenario import RICH_RPM, Scenario
from spinfilters.smoother.restarts import trajectory_from_momentum


def test_a_pose_that_contradicts_the_others_tells_no_rate() -> None:
    scenario = Scenario.simplified(
        kind="pose", rate_rpm=RICH_RPM, epochs=40, noise=ProcessNoise(1e-12, 1e-12)
    )
    times = scenario.interval * np.arange(scenario.epochs)
    true = motion_at(faulty_motion(scenario, Physics(), np.random.default_rng(0)), times)
    given = true.states.copy()
    given[20, LAYOUT.mean_slice("a")] = given[0, LAYOUT.mean_slice("a")]
    found = trajectory_from_momentum(LAYOUT, given, times)
    assert found is not None
    np.testing.assert_array_equal(found[:, LAYOUT.mean_slice("a")], given[:, LAYOUT.mean_slice("a")])
    np.testing.assert_allclose(found[:, LAYOUT.mean_slice("w")], true.block("w"), atol=0.02)
