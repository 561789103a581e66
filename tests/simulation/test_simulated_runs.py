"""Recordings made together are those made one by one."""

import numpy as np
import pytest

from spinfilters.simulation.scenario import RICH_RPM, Scenario, measured, motion_in_view
from spinfilters.simulation.simulated_runs import simulate_runs

RUNS, ROUNDING = 9, 1e-12
"""As many as go through vector instructions, and one more; of values of about 1."""


@pytest.mark.parametrize("kind", ["pose", "attitude"])
def test_recordings_made_together_are_those_made_one_by_one(kind: str) -> None:
    scenario = Scenario(kind=kind, epochs=20, rate_rpm=RICH_RPM, beside=(("gyro", 0.5),))
    together = simulate_runs(
        scenario,
        [np.random.default_rng([k, 0]) for k in range(RUNS)],
        [np.random.default_rng([k, 1]) for k in range(RUNS)],
    )
    for k in range(RUNS):
        motion = motion_in_view(scenario, np.random.default_rng([k, 0]))
        single = measured(scenario, motion, np.random.default_rng([k, 1]))
        assert single.truth is not None
        rows = slice(k * together.epochs, (k + 1) * together.epochs)
        np.testing.assert_allclose(together.truth.rate_i[rows], single.truth.rate_i, atol=ROUNDING)
        np.testing.assert_allclose(
            together.truth.center_of_mass[rows], single.truth.center_of_mass, atol=ROUNDING
        )
        for every, own in zip(together.log.streams, single.log.streams, strict=True):
            rows = slice(k * len(own.time), (k + 1) * len(own.time))
            np.testing.assert_allclose(every.values[rows], own.values, atol=ROUNDING)
            np.testing.assert_allclose(every.time[rows], own.time + k * together.period)


@pytest.mark.parametrize("block", [[4], [8, 0, 5]])
def test_a_recording_has_the_same_bits_whatever_recordings_are_made_with_it(block: list[int]) -> None:
    scenario = Scenario(kind="pose", epochs=20, rate_rpm=RICH_RPM)
    every, some = (
        simulate_runs(
            scenario,
            [np.random.default_rng([k, 0]) for k in runs],
            [np.random.default_rng([k, 1]) for k in runs],
        )
        for runs in (list(range(RUNS)), block)
    )
    for place, run in enumerate(block):
        rows, own = (slice(k * every.epochs, (k + 1) * every.epochs) for k in (run, place))
        np.testing.assert_array_equal(every.truth.q_ig[rows], some.truth.q_ig[own])
        np.testing.assert_array_equal(every.log.streams[0].values[rows], some.log.streams[0].values[own])
