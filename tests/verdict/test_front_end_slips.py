"""A front end that takes one face of a body for another is named, before contact."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plain_comparison import plain_comparison

from spinfilters.core.attitude_conversions import multiply, quaternion_from_rotation_vector
from spinfilters.models.process import ProcessNoise
from spinfilters.run.estimation import Comparison
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.model_faults import faulty_recording, model_faults
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.verdict import recording_tests as slips
from spinfilters.verdict.recording_tests import front_end_slips, slipped_steps

COUNT = 40
TIME = 0.4 * np.arange(COUNT)
SETTINGS = Settings(estimators=("smoother",), process={"gravity": False})  # pyright: ignore[reportArgumentType]
AXIS = np.array([0.6, 0.0, 0.8])


def attitudes(slipped: slice, angle: float = np.pi, noise: float = 0.02) -> np.ndarray:
    """Of a body that turns at 0.5 rad/s, with a rotation by an angle about an axis of g in some epochs."""
    q = quaternion_from_rotation_vector(0.5 * TIME[:, None] * np.array([0.0, 1.0, 0.0]))
    q = multiply(q, quaternion_from_rotation_vector(noise * np.random.default_rng(0).normal(size=(COUNT, 3))))
    turned = q.copy()
    turned[slipped] = multiply(q[slipped], quaternion_from_rotation_vector(angle * AXIS))
    return turned


@pytest.mark.parametrize(
    ("slipped", "angle", "steps"),
    [
        (slice(0, 0), np.pi, []),
        (slice(15, None), np.pi, [14]),
        (slice(15, 25), np.pi, [14, 24]),
        (slice(15, None), np.pi / 2, [14]),
        (slice(15, 16), np.pi, []),
        (slice(15, None), 0.3, []),
    ],
)
def test_a_large_jump_of_the_attitude_that_lasts_is_a_slip_and_a_gross_error_is_none(
    slipped: slice, angle: float, steps: list[int]
) -> None:
    found, angles = slipped_steps(TIME, attitudes(slipped, angle))
    assert found.tolist() == steps
    np.testing.assert_allclose(angles, angle, atol=0.15)


def test_attitudes_that_say_nothing_of_each_other_do_not_slip() -> None:
    q = quaternion_from_rotation_vector(np.random.default_rng(1).normal(size=(COUNT, 3)) * 3)
    assert slipped_steps(TIME, q)[0].size == 0


@pytest.mark.parametrize(("kind", "counts"), [("lidar-points", [0, 1]), ("pose", [1, 1])])
def test_attitudes_that_have_to_be_fitted_are_looked_at_only_where_asked(
    kind: str, counts: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset = simulate(Scenario(kind=kind, epochs=3))
    setup: Any = SimpleNamespace(log=dataset.log, noise=None, dataset=dataset)
    looked: list[str] = []
    sensor = SimpleNamespace(initial_motion=lambda *_: None)
    monkeypatch.setattr(slips, "sensor_of", lambda name: looked.append(name) or sensor)
    for with_fits, count in zip((False, True), counts, strict=True):
        looked.clear()
        front_end_slips(setup, with_fits)
        assert len(looked) == count


def test_attitudes_that_are_not_finite_do_not_slip() -> None:
    q = attitudes(slice(15, None))
    q[20] = np.nan
    assert slipped_steps(TIME, q)[0].size == 0


@cache
def compared(size: float) -> Comparison:
    """Poses of a tracker that slips by an angle, rad."""
    scenario = Scenario.simplified(
        kind="pose",
        principal_moments=(1.0, 0.8, 0.55),
        rate_rpm=RICH_RPM,
        epochs=COUNT,
        interval=0.4,
        noise=ProcessNoise(1e-8, 1e-8),
    )
    seeds = tuple(np.random.SeedSequence(3).spawn(3))
    return plain_comparison(faulty_recording(scenario, model_faults()["slip"], size, seeds), SETTINGS)


def test_a_tracker_that_takes_one_face_for_another_is_named_with_its_time_and_nothing_else_is() -> None:
    comparison = compared(np.pi)
    (evaluation,) = comparison.evaluations
    assert comparison.models.names == ("slip",)
    (reason,) = (each for each in evaluation.history.status.reasons if "slip of the front end" in each)
    assert f"t = {comparison.models.slips[0].time:.4g} s" in reason
    assert "180 deg" in reason
    assert not any("contact" in each for each in evaluation.history.status.reasons)
    assert evaluation.history.status.reasons[0] == reason


def test_a_tracker_that_does_not_slip_is_not_doubted() -> None:
    comparison = compared(1e-12)
    assert comparison.models.names == ()
    assert comparison.evaluations[0].history.status.verdict == "ok"
