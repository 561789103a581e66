"""A camera whose trajectory is known: exact data give no error, one at rest anywhere tells the same, a circling one as much."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text
from plain_comparison import plain_comparison

from spinfilters.cli.main import main
from spinfilters.core.attitude_conversions import multiply, quaternion_from_rotation_vector, rotate
from spinfilters.core.camera_trajectory import CameraTrajectory
from spinfilters.core.errors import InputError
from spinfilters.evaluation.consistency import true_states
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.stated_errors import stated_errors
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.filter import MultiplicativeFilter
from spinfilters.filters.timeline import SensorNoise, Timeline, build_timeline
from spinfilters.filters.ukf import MultiplicativeUkf
from spinfilters.inference.first_epochs import initial_samples
from spinfilters.inference.initial_estimate import SmoothingOptions, smooth_first_epochs
from spinfilters.inference.setup import camera_view
from spinfilters.io.consider_parameter import exact_calibration
from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import FULL_BLOCKS, Gaussian, StateLayout
from spinfilters.plots.figures import drawn_figure
from spinfilters.run.estimation import Comparison
from spinfilters.run.preparation import prepare
from spinfilters.run.readers import read_dataset
from spinfilters.run.run_folder import DECISIVE, figure_data_of
from spinfilters.settings.run_settings import FILTER, Settings
from spinfilters.simulation.inspector import CIRCLE_PERIOD
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map
from spinfilters.smoother.priors import FirstStatePrior
from spinfilters.smoother.problem import InitialGuess
from spinfilters.verdict.recording_tests import repeats, sparse_poses

LAYOUT = StateLayout(FULL_BLOCKS)
QUIET = TorqueFreeProcess(LAYOUT, ProcessNoise(0.0, 0.0), tolerance=1e-12)
CIRCLING = Scenario.simplified(rate_rpm=RICH_RPM, epochs=24, landmarks=80, inspector="circle", seed=1)
STATIC = replace(CIRCLING, inspector="static")
EXACT = replace(CIRCLING, epochs=12, landmarks=150, pixel_std=1e-9, noise=ProcessNoise(0.0, 0.0))
INSPECTOR_RATE = 2 * np.pi / CIRCLE_PERIOD


def compared(dataset: Dataset, *names: str) -> Comparison:
    """All estimators on a data set, with the tests of their models."""
    return plain_comparison(dataset, Settings(estimators=names or ("mekf", "ukf", "smoother")))


def estimated(dataset: Dataset, *names: str) -> Comparison:
    """The same without the tests of their models, where errors are looked at or what a recording itself shows."""
    return plain_comparison(
        dataset, Settings(estimators=names or ("mekf", "ukf", "smoother"), verdict=FILTER)
    )


def moved(dataset: Dataset, inspector: MeasurementStream | None) -> Dataset:
    """Another inspector, or none."""
    return replace(dataset, inspector=inspector)


def timeline_of(dataset: Dataset) -> Timeline:
    """Epochs of a data set with 1 px of noise."""
    return build_timeline(dataset.log, LAYOUT, SensorNoise(pixel_std=1.0), camera_view(dataset))


def true_states_of(dataset: Dataset) -> np.ndarray:
    """In i, one row per epoch."""
    assert dataset.truth is not None
    return true_states(dataset.truth, LAYOUT)


@pytest.mark.parametrize("build", [MultiplicativeEkf, MultiplicativeUkf])
@pytest.mark.parametrize(
    ("kind", "known_map"), [("stereo-tracks", False), ("stereo-tracks", True), ("mono-tracks", True)]
)
def test_exact_data_from_the_true_start_give_a_filter_no_error(
    kind: str, build: type[MultiplicativeFilter], known_map: bool
) -> None:
    dataset = simulate(replace(EXACT, kind=kind))
    states = true_states_of(dataset)
    estimator, timeline = build(QUIET), timeline_of(dataset if known_map else without_map(dataset))
    estimator.start(Gaussian(LAYOUT, states[0], 1e-7 * np.eye(LAYOUT.error_dim)))
    for k, epoch in enumerate(timeline):
        if k:
            estimator.predict(epoch.time - timeline[k - 1].time)
        for measurement in epoch.measurements:
            estimator.update(measurement)
        np.testing.assert_allclose(LAYOUT.local(estimator.belief.mean, states[k]), 0.0, atol=1e-6)


def test_exact_data_from_the_true_start_give_a_smoother_no_error() -> None:
    dataset = simulate(EXACT)
    states, known = true_states_of(dataset), dataset.known_map
    assert known is not None
    std = np.repeat([1e-6, 1.0, 1.0, 1.5], [6, 6, 3, 5])
    found = smooth_first_epochs(
        QUIET,
        timeline_of(without_map(dataset)),
        InitialGuess(states, known.ids, known.points),
        FirstStatePrior(states[0], std),
        SmoothingOptions(30),
    )
    assert found.converged
    np.testing.assert_allclose(LAYOUT.local(found.mean, states), 0.0, atol=1e-6)


@pytest.mark.parametrize("known_map", [False, True], ids=["no map", "known map"])
def test_initial_poses_are_those_of_the_body_not_of_the_inspector(known_map: bool) -> None:
    """Without a map g is another: then the body's rotation since the first epoch is compared, and it is not the inspector's."""
    dataset = simulate(replace(EXACT, pixel_std=1e-3))
    dataset = dataset if known_map else without_map(dataset)
    states = true_states_of(dataset)
    samples = initial_samples(dataset.log.streams, SensorNoise(pixel_std=1.0), camera_view(dataset))
    assert samples.attitude is not None
    true, found = states[:, LAYOUT.mean_slice("a")], samples.attitude
    if not known_map:
        difference = multiply(true[0] * [-1, -1, -1, 1], found[0])
        true = multiply(true, np.tile(difference, (len(true), 1)))
    assert np.abs(np.abs(np.sum(true * found, axis=1)) - 1).max() < 1e-6
    if known_map:
        assert samples.positions is not None
        np.testing.assert_allclose(samples.positions, states[:, LAYOUT.mean_slice("t")], atol=1e-4)


@cache
def static_comparison() -> Comparison:
    """Of an inspector that no file speaks of."""
    return estimated(without_map(simulate(STATIC)))


@cache
def circling_comparison() -> Comparison:
    """Of one that flies about the body."""
    return estimated(without_map(simulate(CIRCLING)))


def test_a_file_of_identities_gives_what_no_file_gives() -> None:
    dataset = without_map(simulate(STATIC))
    identity = np.tile([0.0, 0, 0, 0, 0, 0, 1], (2, 1))
    known = moved(dataset, MeasurementStream("pose", np.array([0.0, 100.0]), identity))
    exact = {**dataset.options.calibration, **exact_calibration(("stereo",), inspector=True)}
    here = estimated(replace(known, options=replace(known.options, calibration=exact)))
    for one, other in zip(here.evaluations, static_comparison().evaluations, strict=True):
        np.testing.assert_allclose(one.history.mean, other.history.mean, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(one.history.factor, other.history.factor, rtol=1e-6, atol=1e-9)


def rms(evaluation: Evaluation) -> np.ndarray:
    """Position m, attitude rad, velocity m/s, rate rad/s."""
    assert evaluation.errors is not None
    found = evaluation.errors.rms
    assert found.position is not None
    assert found.velocity is not None
    return np.array([found.position, found.attitude, found.velocity, found.rate])


def test_an_inspector_at_rest_elsewhere_gives_the_same_errors() -> None:
    """Frame i is turned and shifted against the camera's; nothing else changes."""
    dataset = without_map(simulate(STATIC))
    t_ic, q_ic = np.array([3.0, -2.0, 5.0]), quaternion_from_rotation_vector(np.array([0.7, -1.9, 0.4]))
    truth = dataset.truth
    assert truth is not None
    there = replace(
        truth,
        center_of_mass=rotate(q_ic, truth.center_of_mass) + t_ic,
        q_ig=multiply(np.tile(q_ic, (len(truth.time), 1)), truth.q_ig),
        velocity=rotate(q_ic, truth.velocity),
        rate_i=rotate(q_ic, truth.rate_i),
    )
    pose = np.tile(np.concatenate([t_ic, q_ic]), (2, 1))
    inspector = MeasurementStream("pose", np.array([0.0, 100.0]), pose)
    found = estimated(replace(dataset, truth=there, inspector=inspector), "mekf", "smoother").evaluations
    static_ones = {each.name: each for each in static_comparison().evaluations}
    for here, static in ((each, static_ones[each.name]) for each in found):
        np.testing.assert_allclose(rms(here), rms(static), rtol=0.02)


def test_a_circling_inspector_tells_as_much_as_one_at_rest() -> None:
    """Of few epochs of one recording, whose noise differs; `experiments.moving_inspector` compares many."""
    for here, static in zip(circling_comparison().evaluations, static_comparison().evaluations, strict=True):
        assert not here.history.has_failed
        assert here.nees is not None
        assert 0.3 < here.nees.mean < 2.5
        assert (rms(here) < 2.5 * rms(static)).all(), here.name


def test_without_its_trajectory_a_circling_inspector_is_taken_for_a_rotation_of_the_body() -> None:
    dataset = without_map(simulate(CIRCLING))
    told, (untold,) = (
        circling_comparison().evaluations[0],
        estimated(moved(dataset, None), "mekf").evaluations,
    )
    assert rms(told)[3] < 0.1 * INSPECTOR_RATE
    assert rms(untold)[3] > 0.5 * INSPECTOR_RATE


def test_one_circling_camera_tells_the_motion_before_a_known_map() -> None:
    scenario = replace(CIRCLING, kind="mono-tracks", landmarks=200, epochs=40, pixel_std=0.5)
    for evaluation in estimated(simulate(scenario), "mekf", "smoother").evaluations:
        assert not evaluation.history.has_failed
        assert evaluation.nees is not None
        assert 0.4 < evaluation.nees.mean < 2.0


def test_an_inspector_is_read_back_bit_for_bit(tmp_path: Path) -> None:
    dataset = simulate(CIRCLING)
    assert dataset.inspector is not None
    write_dataset(dataset, tmp_path)
    read = read_dataset(tmp_path).inspector
    assert read is not None
    np.testing.assert_array_equal(read.time, dataset.inspector.time)
    np.testing.assert_array_equal(read.values, dataset.inspector.values)
    with pytest.raises(InputError, match=r"inspector\.tum: is not of the data set"):
        write_dataset(simulate(STATIC), tmp_path)


def test_another_trajectory_of_the_inspector_is_another_run() -> None:
    assert "inspector" in DECISIVE


def test_the_command_simulates_a_circling_inspector(tmp_path: Path) -> None:
    assert main(["simulate", "-o", str(tmp_path / "data"), "--inspector", "circle", "--frames", "5"]) == 0
    assert (tmp_path / "data" / "inspector.tum").read_text().count("\n") == 6


def test_a_run_draws_the_path_of_its_inspector() -> None:
    figure = drawn_figure(figure_data_of(circling_comparison()), "scene")
    texts = [text.get_text() for text in figure.findobj(Text)]
    assert "path of the inspector" in texts


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--inspector", "spiral"], "use one of static, circle, sway, dead-band"),
        (["--inspector", "sway", "--inspector-error", "late", "soon"], "give its size as a number"),
        (["--inspector", "sway", "--inspector-error", "late", "1", "2"], "give one number"),
        (["--inspector", "sway", "--inspector-error", "late"], "give a size of 1e-06 to 10"),
        (["--inspector", "circle", "--kind", "gyro"], "a gyro"),
    ],
)
def test_an_inspector_that_cannot_be_simulated_is_refused_in_one_line(
    options: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", "-o", str(tmp_path / "data"), *options]) == 2
    said = capsys.readouterr().err
    assert says in said
    assert len(said.strip().splitlines()) == 1


def swaying(seed: int = 2, **changes: object) -> Dataset:
    """Tracks of an inspector that sways, without a map."""
    scenario = replace(CIRCLING, inspector="sway", epochs=60, seed=seed)
    return without_map(simulate(replace(scenario, **changes)))  # pyright: ignore[reportArgumentType]


def test_late_poses_of_an_inspector_are_named_with_their_delay() -> None:
    comparison = compared(swaying(inspector_errors=(("late", 0.5),)), "smoother")
    assert "inspector-delay" in comparison.models.names[0]
    assert comparison.evaluations[0].history.status.verdict == "degraded"


def test_sparse_poses_are_told_with_the_cure_and_dense_ones_are_not() -> None:
    (sparse,) = estimated(swaying(inspector_errors=(("sparse", 4.0),)), "mekf").evaluations
    (reason,) = (each for each in sparse.history.status.reasons if "too sparse" in each)
    assert "4 s apart" in reason
    assert "inspector.tum" in reason
    (dense,) = estimated(swaying(), "mekf").evaluations
    assert not any("too sparse" in each for each in dense.history.status.reasons)


def test_a_path_whose_attitude_is_constant_to_rounding_is_said_to_turn_by_nothing() -> None:
    setup = prepare(swaying(inspector_errors=(("sparse", 4.0),)), Settings(estimators=("mekf",)))
    inspector = setup.dataset.inspector
    assert inspector is not None
    values = inspector.values.copy()
    values[:, 3:] = np.array([0.6, 0.0, 0.0, 0.8]) + 1e-13 * np.random.default_rng(0).normal(
        size=(len(values), 4)
    )
    still = replace(inspector, values=values)
    (found,) = sparse_poses(replace(setup, dataset=moved(setup.dataset, still)))
    assert " mm and 0 rad, which is" in found.sentence


def test_what_no_residual_shows_of_an_inspector_is_in_the_deviations() -> None:
    """Positions that drift evenly are a velocity; stated as exact they are not in it."""
    drifting = swaying(inspector_errors=(("drifting", 0.02),))
    names = ("position", "rotation", "clock", "lever")
    exact = {f"inspector_{name}_std": 0.0 for name in names}
    found = {}
    for name, calibration in (("assumed", {}), ("exact", exact)):
        settings = Settings(estimators=("mekf", "smoother"), calibration=calibration, verdict=FILTER)  # pyright: ignore[reportArgumentType]
        for each in plain_comparison(drifting, settings).evaluations:
            velocity = each.history.layout.slice("v")
            found[name, each.name] = np.linalg.norm(each.history.factor[-1, velocity], axis=1)
    for name in ("mekf", "smoother"):
        added = np.sqrt(found["assumed", name] ** 2 - found["exact", name] ** 2)
        assert added.min() > 0.8 * 0.01 / 60.0  # of the default, m in a minute


def test_of_poses_of_another_point_than_the_camera_positions_hold_or_are_doubted() -> None:
    """As of a spacecraft's navigation: 5 cm before a circling camera passed as right, 15 deviations off."""
    levered = without_map(simulate(replace(CIRCLING, epochs=40, inspector_errors=(("lever", 0.07),))))
    assert levered.truth is not None
    for each in compared(levered, "mekf", "smoother").evaluations:
        errors = stated_errors(each)
        assert each.history.status.verdict == "degraded" or max(errors.values()) < 4.0


def test_poses_that_repeat_while_the_camera_moves_are_told_with_their_time() -> None:
    right = swaying()
    assert right.inspector is not None
    values = right.inspector.values.copy()
    values[40:] = values[40]
    frozen = moved(right, replace(right.inspector, values=values))
    for each in estimated(frozen, "mekf").evaluations:
        (reason,) = (each for each in each.history.status.reasons if "repeats its pose" in each)
        assert f"t = {right.inspector.time[40]:.3f} s to {right.inspector.time[-1]:.3f} s" in reason


def test_an_inspector_that_brakes_and_rests_does_not_repeat_its_pose() -> None:
    time = np.arange(30.0)
    poses = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (30, 1))
    poses[:, 0] = 1e-3 * np.maximum(15.0 - time, 0.0) ** 2
    assert list(repeats(CameraTrajectory(time, poses))) == []
    poses[:, 0] = 1e-3 * np.maximum(15.0 - time, 0.0)
    assert list(repeats(CameraTrajectory(time, poses))) == [(15.0, 29.0)]
    assert list(repeats(CameraTrajectory(time, np.tile(poses[0], (30, 1))))) == []


def test_a_circling_camera_without_poses_is_among_the_first_two_reasons() -> None:
    forgotten = moved(without_map(simulate(replace(CIRCLING, epochs=46))), None)
    for each in compared(forgotten, "mekf", "smoother").evaluations:
        assert each.history.status.verdict != "ok"
        assert any("inspector.tum" in reason for reason in each.history.status.reasons[:2])
