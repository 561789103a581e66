"""A flywheel inside a body is named where it is strong, and a state that holds it tells its momentum."""

from dataclasses import replace
from functools import cache

import numpy as np
from plain_comparison import plain_comparison
from smoothed_motions import motion_near

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.mass_distribution import inertia_matrix
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_blocks import ROTOR
from spinfilters.models.state_layout import ROTATION_BLOCKS, StateLayout
from spinfilters.run.estimation import Comparison
from spinfilters.settings.run_settings import ProcessSettings, Settings
from spinfilters.simulation.model_faults import AXIS, faulty_recording, model_faults
from spinfilters.simulation.scenario import RICH_RPM, Scenario
from spinfilters.verdict.tested_models import model_findings

SETTINGS = Settings(estimators=("smoother",), process={"gravity": False})  # pyright: ignore[reportArgumentType]
SCENARIO = Scenario.simplified(
    kind="gyro",
    principal_moments=(1.0, 0.8, 0.55),
    rate_rpm=RICH_RPM,
    epochs=60,
    interval=0.2,
    noise=ProcessNoise(1e-8, 1e-8),
)


@cache
def compared(size: float, rotor: bool) -> Comparison:
    """Rates of a body with a flywheel of a size, whose state has one or not."""
    seeds = tuple(np.random.SeedSequence(1).spawn(3))
    dataset = faulty_recording(SCENARIO, model_faults()["rotor"], size, seeds)
    return plain_comparison(
        dataset, replace(SETTINGS, process=replace(SETTINGS.process, rotor=rotor, gravity=False))
    )


def test_the_momentum_of_body_and_flywheel_together_is_conserved() -> None:
    layout = StateLayout(ROTATION_BLOCKS).joined(ROTOR)
    x = layout.origin()
    x[layout.mean_slice("w")] = 0.4, 0.9, 0.3
    x[layout.mean_slice("s")] = 0.3, -0.2, 0.1, 0.2, 0.1
    x[layout.mean_slice("h")] = 0.2, -0.5, 0.3
    process, J = TorqueFreeProcess(layout, ProcessNoise(0.0, 0.0)), inertia_matrix(x[layout.mean_slice("s")])
    before, momenta = x, []
    for _ in range(20):
        R = matrix_from_quaternion(before[layout.mean_slice("a")])
        momenta.append(R @ (J @ before[layout.mean_slice("w")] + before[layout.mean_slice("h")]))
        before = process.step(before, 0.3)
    np.testing.assert_allclose(momenta, np.tile(momenta[0], (20, 1)), atol=1e-7)


def test_a_strong_flywheel_is_named_first_with_its_momentum() -> None:
    models = compared(0.6, rotor=False).models
    assert models.names[0].split("/")[0] == "rotor"
    test = models.named[0]
    np.testing.assert_allclose(test.size, 0.6 * AXIS, atol=0.03)
    (reason,) = (each.reason for each in model_findings(models, None) if "most like" in each.sentence)
    assert "a flywheel turning inside" in reason
    assert "process.rotor = true" in reason


def test_a_state_with_a_flywheel_is_ok_and_tells_its_momentum() -> None:
    (evaluation,) = compared(0.6, rotor=True).evaluations
    assert evaluation.history.status.verdict == "ok", evaluation.history.status.reasons
    found = evaluation.constants[ROTOR.name]
    assert np.abs((found.value - 0.6 * AXIS) / found.std).max() < 4
    assert np.abs(evaluation.body.principal_moments[:2] - [0.55, 0.8]).max() < 0.02


def test_a_body_without_a_flywheel_gets_none() -> None:
    comparison = compared(1e-12, rotor=False)
    assert comparison.models.names == ()
    assert ProcessSettings().rotor is False


def test_the_rates_of_a_smoothed_motion_change_as_a_flywheel_turns_them() -> None:
    comparison = compared(0.6, rotor=True)
    setup, trajectory = comparison.setup, comparison.evaluations[0].history.mean
    motion = motion_near(setup, trajectory)
    slope = np.gradient(motion.rates, motion.time, axis=0)[1:-1]
    np.testing.assert_allclose(motion.rate_change[1:-1], slope, atol=0.1 * np.abs(slope).max())
