"""Sensitivities of smoothed motions to their calibration: what scales exactly, and what solving anew says."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import matrix_from_quaternion
from spinfilters.core.camera_trajectory import MINUTE
from spinfilters.filters.timeline import LogTimeline, times_of
from spinfilters.inference.setup import Setup
from spinfilters.io.consider_parameter import ConsideredDeviation, consider_parameters
from spinfilters.models.process import ProcessNoise
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate, without_map
from spinfilters.verdict.calibration_errors import (
    calibration_moments,
    smoothed_sensitivity,
    with_error,
)
from spinfilters.verdict.model_errors.hypotheses import solved_near
from spinfilters.verdict.model_errors.linear_rows import Sensitivity
from spinfilters.verdict.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.verdict.model_tests import landmarks_placed, linear_problem

PARAMETERS = consider_parameters()
KINDS = {
    "stereo-tracks": ("focal_std", "center_std", "baseline_std"),
    "gyro": ("gyro_scale_std",),
    "pose": ("length_scale_std",),
    "inspector": (
        "inspector_position_std",
        "inspector_rotation_std",
        "inspector_clock_std",
        "inspector_lever_std",
    ),
}
"""Parameters of kinds of data sets, and of tracks of a camera that moves."""
EXACT = Scenario.simplified(
    principal_moments=(1.0, 0.8, 0.55),
    rate_rpm=(4.0, 9.0, 3.0),
    epochs=20,
    landmarks=60,
    pixel_std=1e-6,
    position_std=1e-9,
    rotation_std=1e-9,
    gyro_std=1e-9,
    noise=ProcessNoise(0.0, 0.0),
)
STATED = {
    "pixel_std": 1.0,
    "pose_position_std": 0.005,
    "pose_rotation_std": 0.01,
    "gyro_noise_std": 0.002,
}


@cache
def prepared(kind: str) -> Setup:
    """Measurements without noise, of which noise is stated; the whole recording is smoothed."""
    settings = Settings(
        process={"force_psd": 4e-8, "torque_psd": 1e-6, "gravity": False},  # pyright: ignore[reportArgumentType]
        sensors=STATED,  # pyright: ignore[reportArgumentType]
        initialisation={"share": 1.0},  # pyright: ignore[reportArgumentType]
    )
    own = replace(EXACT, inspector="sway") if kind == "inspector" else replace(EXACT, kind=kind)
    return prepare(without_map(simulate(own)), settings)


def solved(setup: Setup, timeline: LogTimeline) -> SmoothedMotion:
    """About the most probable motion near the setup's."""
    problem = linear_problem(setup, timeline)
    trajectory = setup.initial.mean
    rows = solved_near(problem, trajectory, landmarks_placed(problem, trajectory))
    assert rows is not None
    return SmoothedMotion(times_of(timeline), rows)


@cache
def smoothed(kind: str) -> SmoothedMotion:
    """About the true motion."""
    timeline = prepared(kind).timeline
    assert isinstance(timeline, LogTimeline)
    return solved(prepared(kind), timeline)


@cache
def sensitivity(kind: str, name: str, std: float = 1.0) -> Sensitivity:
    """Of one parameter."""
    return smoothed_sensitivity(smoothed(kind), [ConsideredDeviation(PARAMETERS[name], std, "stated")])


def block(kind: str, name: str, states: np.ndarray) -> np.ndarray:
    """Components of a block."""
    return states[:, prepared(kind).process.layout.slice(name)]


def test_a_baseline_scales_the_whole_scene_and_neither_rates_nor_inertia() -> None:
    kind, found = "stereo-tracks", sensitivity("stereo-tracks", "baseline_std")
    states, motion = found.states[:, :, 0], smoothed(kind)
    t, R = motion.block("t"), matrix_from_quaternion(motion.block("a"))
    back = R[0].T @ t[0]  # the first pose defines frame g
    expected = {
        "t": t - R @ back,
        "v": motion.block("v"),
        "c": motion.block("c") + back,
    }
    for name, value in expected.items():
        np.testing.assert_allclose(block(kind, name, states), value, atol=1e-3 * np.abs(t).max())
    for name in ("a", "w", "s"):
        np.testing.assert_allclose(block(kind, name, states), 0, atol=2e-3)
    fit = motion.rows.normal.eliminated
    assert fit is not None
    told = fit.is_constrained
    assert told.mean() > 0.9
    points = motion.rows.here.points + back
    np.testing.assert_allclose(found.landmarks[told, :, 0], points[told], atol=1e-3)


def test_lengths_of_poses_scale_places_and_velocities_alone() -> None:
    kind, motion = "pose", smoothed("pose")
    states = sensitivity(kind, "length_scale_std").states[:, :, 0]
    for name in ("t", "v", "c"):
        value = motion.block(name)
        np.testing.assert_allclose(block(kind, name, states), -value, atol=2e-3 * np.abs(value).max())
    for name in ("a", "w", "s"):
        np.testing.assert_allclose(block(kind, name, states), 0, atol=2e-3)


def test_a_clock_scales_velocities_and_rates_alone() -> None:
    kind, motion = "pose", smoothed("pose")
    states = sensitivity(kind, "clock_scale_std").states[:, :, 0]
    for name in ("v", "w"):
        value = motion.block(name)
        np.testing.assert_allclose(block(kind, name, states), -value, atol=2e-3 * np.abs(value).max())
    for name in ("t", "a", "c", "s"):
        np.testing.assert_allclose(block(kind, name, states), 0, atol=2e-3)


def test_a_gyro_and_a_clock_that_are_wrong_alike_scale_rates_alone() -> None:
    kind, motion = "gyro", smoothed("gyro")
    states = (sensitivity(kind, "gyro_scale_std").states + sensitivity(kind, "clock_scale_std").states)[
        :, :, 0
    ]
    rates = motion.block("w")
    np.testing.assert_allclose(block(kind, "w", states), -rates, atol=2e-3 * np.abs(rates).max())
    for name in ("a", "s"):
        np.testing.assert_allclose(block(kind, name, states), 0, atol=2e-3)


@pytest.mark.parametrize(
    ("kind", "name"), [(k, n) for k, own in KINDS.items() for n in (*own, "clock_scale_std")]
)
def test_a_sensitivity_is_what_solving_with_another_calibration_says(kind: str, name: str) -> None:
    setup, motion, parameter = prepared(kind), smoothed(kind), PARAMETERS[name]
    timeline = setup.timeline
    assert isinstance(timeline, LogTimeline)
    small = {"px": 1e-3, "s": 1e-4, "m": 1e-6, "m/min": 1e-5, "rad/min": 1e-5}.get(parameter.unit, 1e-6)
    considered = ConsideredDeviation(parameter, small, "stated")
    for number, error in enumerate(small * np.eye(parameter.size)):
        moved = solved(setup, with_error(timeline, considered, error))
        away = setup.process.layout.local(motion.rows.here.trajectory, moved.rows.here.trajectory) / small
        states = sensitivity(kind, name).states[:, :, number]
        np.testing.assert_allclose(away, states, atol=0.01 * np.abs(states).max())


def test_positions_of_an_inspector_that_drift_are_a_velocity_of_the_body() -> None:
    found = sensitivity("inspector", "inspector_position_std").states
    np.testing.assert_allclose(block("inspector", "v", found[..., 0])[:, 0], 1 / MINUTE, rtol=0.02)
    considered = [ConsideredDeviation(PARAMETERS["inspector_position_std"], 0.01, "stated")]
    moments = calibration_moments(smoothed("inspector"), considered)  # the residuals say nothing of them
    assert moments == pytest.approx(np.eye(3), abs=1e-6)


def test_residuals_tell_the_delay_of_an_inspector_that_sways() -> None:
    considered = [ConsideredDeviation(PARAMETERS["inspector_clock_std"], 1.0, "stated")]
    ((moment,),) = calibration_moments(smoothed("inspector"), considered)
    assert 0.001 < np.sqrt(moment) < 0.3


def test_what_residuals_say_of_a_wrong_inspector_is_in_the_moments_of_its_errors() -> None:
    """Estimates are of no delay, so that they err by the one that is told, and by what is left of the deviation."""
    setup, parameter = prepared("inspector"), PARAMETERS["inspector_clock_std"]
    timeline, considered = setup.timeline, ConsideredDeviation(parameter, 0.05, "stated")
    assert isinstance(timeline, LogTimeline)
    late = solved(setup, with_error(timeline, considered, np.array([0.1])))  # of two deviations
    ((moment,),) = calibration_moments(late, [considered])
    ((left,),) = calibration_moments(
        smoothed("inspector"), [considered]
    )  # of the deviation, where nothing is late
    assert 0 < left < 1
    assert moment == pytest.approx(left + (2.0 * (1 - left)) ** 2, rel=0.05)
