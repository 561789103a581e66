"""Errors of the models are named in the verdict and refitted; gravity is taken into the state by itself."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plain_comparison import plain_comparison

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_blocks import ACCELERATION, TORQUE, StateBlock
from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
from spinfilters.run.conditions import conditions_of
from spinfilters.run.estimation import Comparison
from spinfilters.run.optional_outputs import explanations
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.model_faults import faulty_recording, model_faults
from spinfilters.simulation.scenario import (
    RICH_RPM,
    Motion,
    Scenario,
    first_state,
    measured,
    simulate_motion,
    without_noise,
)
from spinfilters.verdict import model_tests as model_errors
from spinfilters.verdict.tested_models import model_findings

GRAVITY = np.array([0.0, 9.81, 0.0])
SMOOTHER = Settings(estimators=("smoother",))
DISTURBED = Scenario.simplified(
    principal_moments=(1.0, 0.8, 0.55),
    rate_rpm=RICH_RPM,
    epochs=60,
    interval=0.4,
    noise=ProcessNoise(1e-6, 4e-8),
)


def recording(block: StateBlock | None, value: np.ndarray, interval: float, seed: int = 0) -> Dataset:
    """Poses of a motion with a constant acceleration or torque."""
    scenario = Scenario.simplified(
        kind="pose",
        principal_moments=(1.0, 0.8, 0.55),
        rate_rpm=tuple(np.multiply(RICH_RPM, 0.4 / interval)),
        epochs=60,
        interval=interval,
        position_std=0.001,
        rotation_std=0.003,
        noise=ProcessNoise(1e-8, 1e-8),
        seed=seed,
    )
    full, generator = StateLayout(FULL_BLOCKS), np.random.default_rng(seed)
    layout = full if block is None else full.joined(block)
    start = np.zeros(layout.mean_dim)
    start[: full.mean_dim] = first_state(scenario, full)
    if block is not None:
        start[layout.mean_slice(block.name)] = value
    time = interval * np.arange(scenario.epochs)
    states = simulate_motion(TorqueFreeProcess(layout, scenario.noise), start, time, generator)
    return measured(scenario, Motion(full, time, states[:, : full.mean_dim]), generator)


def compared(dataset: Dataset, settings: Settings = SMOOTHER) -> Comparison:
    """In memory."""
    return plain_comparison(dataset, settings)


def test_a_throw_finds_gravity_by_itself() -> None:
    (evaluation,) = compared(recording(ACCELERATION, GRAVITY, 0.02)).evaluations
    found = evaluation.constants[ACCELERATION.name]
    assert np.linalg.norm(found.value) == pytest.approx(9.81, rel=0.03)
    assert np.abs((found.value - GRAVITY) / found.std).max() < 4
    assert evaluation.history.status.verdict == "ok", evaluation.history.status.reasons


def test_a_free_flight_gets_no_acceleration_and_no_doubt() -> None:
    (evaluation,) = compared(recording(None, np.zeros(3), 0.4)).evaluations
    assert ACCELERATION.name not in evaluation.history.layout.blocks
    assert evaluation.history.status.verdict == "ok", evaluation.history.status.reasons


def test_gravity_that_is_switched_off_is_not_in_the_state() -> None:
    settings = replace(SMOOTHER, process=replace(SMOOTHER.process, gravity=False))
    assert (
        ACCELERATION.name
        not in prepare(recording(ACCELERATION, GRAVITY, 0.02), settings).process.layout.blocks
    )


def test_gravity_is_true_false_or_auto() -> None:
    with pytest.raises(InputError, match=r"process\.gravity is"):
        Settings(process={"gravity": "down"})  # pyright: ignore[reportArgumentType]


def test_a_constant_torque_is_named_with_its_cure_and_its_refit_is_right() -> None:
    torque = np.array([2e-3, -3e-3, 2e-3])
    comparison = compared(recording(TORQUE, torque, 0.4))
    (evaluation,) = comparison.evaluations
    status = evaluation.history.status
    assert status.verdict == "degraded"
    (reason,) = (each for each in status.reasons if "residuals are most like" in each)
    assert "a constant body torque" in reason
    assert "process.body_torque = true" in reason
    _, refits = explanations(comparison, SMOOTHER)
    (refit,) = (each for each in refits if each.alternative.name == "torque")
    assert refit.evaluation is not None
    assert refit.evaluation.history.status.verdict == "ok", refit.evaluation.history.status.reasons
    found = refit.evaluation.constants[TORQUE.name]
    assert np.abs((found.value - torque) / found.std).max() < 4
    assert refit.document["status"] == "ok"
    assert "body torque (" in refit.sentence


def test_tests_that_cannot_be_made_are_a_reason_for_doubt(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("no factor")

    monkeypatch.setattr(model_errors, "score_tests", broken)
    comparison = compared(recording(None, np.zeros(3), 0.4))
    (evaluation,) = comparison.evaluations
    status = evaluation.history.status
    assert status.verdict == "degraded"
    assert any("could not be tested (no factor" in each for each in status.reasons)
    assert comparison.models.names == ()


def test_settings_in_the_place_of_rows_covariances_are_what_the_run_tells() -> None:
    dataset = recording(None, np.zeros(3), 0.4)
    (stream,) = dataset.log.streams
    rows = replace(stream, covariance=np.tile(1e-4 * np.eye(6), (len(stream.time), 1, 1)))
    options = replace(dataset.options, pose_position_std=None, pose_rotation_std=None)
    told = replace(dataset, log=MeasurementLog((rows,)), options=options)
    with_rows = prepare(told, SMOOTHER)
    assert {"pose_position_std", "pose_rotation_std"} <= model_errors.stated_levels(with_rows)
    settings = replace(SMOOTHER, sensors=replace(SMOOTHER.sensors, pose_position_std=0.001))
    setup = prepare(told, settings)
    stated = model_errors.stated_levels(setup)
    assert "pose_position_std" in stated
    assert "pose_rotation_std" not in stated
    position, _ = conditions_of(setup).sensors
    assert (position.source, position.value) == ("stated", 0.001)


def test_epochs_that_gates_refuse_in_a_row_are_tested_and_no_outliers() -> None:
    scenario = Scenario.simplified(
        kind="gyro", principal_moments=(1.0, 0.8, 0.55), rate_rpm=RICH_RPM, epochs=40, interval=0.4
    )
    seeds = tuple(np.random.SeedSequence(3).spawn(3))
    dataset = faulty_recording(scenario, model_faults()["contact-at-end"], 0.06, seeds)
    comparison = compared(dataset)
    assert "contact-at-end" in comparison.models.names[:2]


def test_a_contact_that_makes_the_noise_of_a_gyro_look_large_is_named() -> None:
    scenario = Scenario.simplified(
        kind="gyro", principal_moments=(1.0, 0.8, 0.55), rate_rpm=RICH_RPM, epochs=80, interval=0.4
    )
    seeds = tuple(np.random.SeedSequence(3).spawn(3))
    dataset = without_noise(faulty_recording(scenario, model_faults()["contact-at-end"], 0.2, seeds))
    comparison = compared(dataset, replace(SMOOTHER, estimators=("mekf",)))
    noise = comparison.setup.gyro_noise
    assert noise is not None
    assert not noise.is_of_flight
    assert comparison.models.names[0] == "contact-at-end"


def slow_gyro(noise: ProcessNoise, fault: str, size: float) -> Dataset:
    """Rates at 2.5 Hz of a body with a fault, without their noise."""
    scenario = Scenario.simplified(
        kind="gyro",
        principal_moments=(1.0, 0.8, 0.55),
        rate_rpm=RICH_RPM,
        epochs=80,
        interval=0.4,
        noise=noise,
    )
    seeds = tuple(np.random.SeedSequence(0, spawn_key=(3,)).spawn(3))
    return without_noise(faulty_recording(scenario, model_faults()[fault], size, seeds))


@pytest.mark.parametrize(("name", "size"), [("gyro-bias", 0.03), ("gyro-scale", 0.5)])
def test_what_passes_for_correlated_noise_of_a_gyro_is_named(name: str, size: float) -> None:
    dataset = slow_gyro(ProcessNoise(1e-6, 4e-8), name, size)
    comparison = compared(dataset)
    assert comparison.setup.gyro_noise is not None  # whose level is three times the white noise
    assert name in comparison.models.names[0].split("/")


def test_an_error_that_contradicts_correlated_noise_of_a_gyro_is_named() -> None:
    models = compared(slow_gyro(ProcessNoise(4e-8, 1e-6), "rotor", 0.1)).models
    assert models.contradicted
    assert "rotor" in models.names[:2]


def test_drag_that_identified_noise_takes_in_is_named() -> None:
    scenario = replace(DISTURBED, kind="gyro")
    seeds = tuple(np.random.SeedSequence(3).spawn(3))
    comparison = compared(without_noise(faulty_recording(scenario, model_faults()["drag"], 0.01, seeds)))
    drag = comparison.models.named[0]
    assert drag.error.name == "drag"
    assert comparison.models.std is not None
    assert drag.effect(comparison.models.std).largest < 1  # it is in the torque's density


def test_a_drift_of_the_clock_that_the_densities_take_in_is_named_at_smaller_ones() -> None:
    scenario = replace(DISTURBED, kind="pose")
    seeds = tuple(np.random.SeedSequence(1).spawn(3))
    dataset = without_noise(faulty_recording(scenario, model_faults()["clock-drift"], 0.09, seeds))
    named = compared(dataset, replace(SMOOTHER, process=replace(SMOOTHER.process, gravity=False))).models
    assert named.names == ("clock-drift",)  # a drag that looks alike would drive the body


def test_a_wrong_unit_is_named_first() -> None:
    dataset = recording(None, np.zeros(3), 0.4)
    (stream,) = dataset.log.streams
    millimetres = replace(stream, values=stream.values * [1e3, 1e3, 1e3, 1, 1, 1, 1])
    setup = prepare(replace(dataset, log=MeasurementLog((millimetres,))), SMOOTHER)
    models = model_errors.tested_models(setup, None)
    assert models.names == ("length-unit",)
    assert "in m, not in mm" in model_findings(models, None)[0].reason


def toss(path: Path) -> Dataset:
    """The flight of a tossed cube: epochs before the acceleration leaves that of gravity."""
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    vertical = np.gradient(rows[:, 10], rows[:, 0])
    touched = np.flatnonzero(np.abs(vertical + 9.81) > 3)
    count = int(touched[touched > 2][0]) - 1
    values = np.concatenate([rows[:, 1:4], rows[:, [5, 6, 7, 4]]], axis=1)[:count]
    return Dataset(kind="pose", log=MeasurementLog((MeasurementStream("pose", rows[:count, 0], values),)))


@pytest.mark.parametrize("number", ["070"])
def test_a_cube_tossed_before_motion_capture_falls_with_gravity(
    shared_data: Callable[[str], Path], number: str
) -> None:
    dataset = toss(shared_data("contactnets_cube_tosses") / f"toss_{number}.csv")
    (evaluation,) = compared(dataset).evaluations
    found = evaluation.constants[ACCELERATION.name].value
    assert np.linalg.norm(found) == pytest.approx(9.81, rel=0.03)
    assert evaluation.history.status.verdict == "degraded"
    assert any("moments of inertia are not determined" in each for each in evaluation.history.status.reasons)
