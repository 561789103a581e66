"""Every figure of a run shows its data, with units on its axes and nothing that is not finite."""

from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3D, Line3DCollection

from spinfilters.core.camera_trajectory import CameraTrajectory
from spinfilters.core.errors import InputError
from spinfilters.evaluation.estimated_motion import BodyRates, count_flips, estimated_rates, true_rates
from spinfilters.evaluation.estimator_evaluation import evaluate
from spinfilters.io.camera import PinholeCamera, StereoRig
from spinfilters.plots import summary
from spinfilters.plots.scene import DrawnCamera, estimated_polhode_figure, scene_figure
from spinfilters.plots.style import estimator_lines, extremes, save_figure
from spinfilters.plots.summary import headline, inertia_figure, summary_figure
from spinfilters.plots.time_courses import (
    consistency_figure,
    energy_figure,
    error_bands_figure,
    rates_figure,
    rotational_energy,
)
from spinfilters.simulation.inspector import circle
from tests.plots.run_samples import (
    FRAMES,
    INITIALISATION_EPOCHS,
    INTERVAL,
    MOMENTS,
    START_END,
    SampleRuns,
    full_runs,
    nearly_spherical,
    rotation_runs,
)

FULL, ROTATIONS = full_runs(), rotation_runs()
RIG = StereoRig(PinholeCamera(fx=466.7, fy=466.7, cx=320.0, cy=240.0, width=640, height=480), baseline_m=0.09)
POINTS = np.random.default_rng(0).standard_normal((300, 3)) * 0.05
TIME = INTERVAL * np.arange(FRAMES)
CIRCLE = CameraTrajectory(TIME, circle(np.array([0.0, 0.0, 0.6]))(TIME))
CONDITIONS = ("Map unknown, seed 3.", "Noise: pixels 1 px; disturbances: torque 1e-06 (rad/s^2)^2/Hz.")
Maker = Callable[[SampleRuns], Figure]


def estimates(runs: SampleRuns) -> list[BodyRates]:
    return [estimated_rates(evaluation.history) for evaluation in runs.with_truth]


MAKERS: dict[str, Maker] = {
    "error bands": lambda runs: error_bands_figure(runs.with_truth[0]),
    "estimate bands": lambda runs: error_bands_figure(runs.without_truth[0]),
    "rates": lambda runs: rates_figure(
        estimates(runs), true_rates(runs.truth), end_of_initialisation=START_END
    ),
    "inertia": lambda runs: inertia_figure(runs.with_truth, MOMENTS),
    "consistency": lambda runs: consistency_figure(runs.with_truth),
    "energy": lambda runs: energy_figure(runs.with_truth, runs.truth),
    "summary": lambda runs: summary_figure(runs.with_truth, true_rates(runs.truth), MOMENTS, CONDITIONS),
    "summary without truth": lambda runs: summary_figure(runs.without_truth),
    "polhode": lambda runs: estimated_polhode_figure(
        estimates(runs)[0], runs.with_truth[0].body, INITIALISATION_EPOCHS
    ),
    "scene": lambda runs: scene_figure(
        runs.with_truth[0].trajectory,
        runs.with_truth[0].body,
        DrawnCamera(RIG),
        POINTS,
        INITIALISATION_EPOCHS,
    ),
    "scene of a moving inspector": lambda runs: scene_figure(
        runs.with_truth[0].trajectory, runs.with_truth[0].body, DrawnCamera(RIG, CIRCLE), POINTS
    ),
}


def rendered_size(figure: Figure) -> int:
    """Bytes of the figure as PNG; drawing it raises what is wrong with it."""
    target = BytesIO()
    figure.savefig(target, dpi=40)
    return len(target.getvalue())


def data_axes(figure: Figure) -> list[Axes]:
    """Panels with lines in them (a colour bar has none)."""
    return [axes for axes in figure.axes if axes.lines]


@pytest.mark.parametrize("runs", [FULL, ROTATIONS], ids=["full state", "rotations"])
@pytest.mark.parametrize("name", MAKERS)
def test_every_figure_is_drawn_with_finite_data_and_units(name: str, runs: SampleRuns) -> None:
    figure = MAKERS[name](runs)
    assert rendered_size(figure) > 4000
    assert data_axes(figure)
    for axes in data_axes(figure):
        for line in axes.lines:
            assert np.isfinite(np.asarray(line.get_xydata(), dtype=float)).all()
    labels = [label for axes in figure.axes for label in (axes.get_xlabel(), axes.get_ylabel()) if label]
    assert labels
    assert all("[" in label for label in labels)


@pytest.mark.parametrize("name", ["error bands", "rates", "inertia", "consistency", "summary"])
def test_the_initialisation_is_shaded_from_the_first_epoch_to_its_last(name: str) -> None:
    spans = [patch for patch in MAKERS[name](FULL).axes[0].patches if isinstance(patch, Rectangle)]
    assert any(
        span.get_x() == pytest.approx(0.0) and span.get_width() == pytest.approx(START_END) for span in spans
    )


@pytest.mark.parametrize("name", ["rates", "inertia", "consistency", "energy"])
def test_the_legend_names_every_estimator(name: str) -> None:
    legend = MAKERS[name](FULL).legends[0]
    names = {text.get_text() for text in legend.get_texts()}
    assert {"MEKF", "UKF", "initialisation (smoothed)"} <= names


def test_error_panels_hold_the_errors_of_their_axis_in_the_unit_of_the_label() -> None:
    evaluation = FULL.with_truth[0]
    figure = error_bands_figure(evaluation)
    assert len(figure.axes) == 12
    errors = evaluation.errors
    assert errors is not None
    assert errors.position is not None
    np.testing.assert_allclose(np.asarray(figure.axes[1].lines[0].get_ydata()), 1e3 * errors.position[:, 1])
    np.testing.assert_allclose(
        np.asarray(figure.axes[5].lines[0].get_ydata()), np.rad2deg(errors.attitude[:, 2])
    )
    assert figure.axes[3].get_ylabel() == "attitude [deg]"


def test_a_run_of_rotations_has_no_panels_of_position() -> None:
    assert len(error_bands_figure(ROTATIONS.with_truth[0]).axes) == 6
    assert len(error_bands_figure(ROTATIONS.without_truth[0]).axes) == 6


def test_rates_are_those_of_the_estimators_in_degrees_per_second() -> None:
    axes = rates_figure(estimates(FULL), true_rates(FULL.truth)).axes[2]
    truth, first, second = axes.lines[:3]
    np.testing.assert_allclose(np.asarray(truth.get_ydata()), np.rad2deg(true_rates(FULL.truth).rate[:, 1]))
    for line, estimate in zip((first, second), estimates(FULL), strict=True):
        np.testing.assert_allclose(np.asarray(line.get_ydata()), np.rad2deg(estimate.rate[:, 1]))


def test_true_ratios_are_inside_the_panels_of_the_inertia() -> None:
    values = inertia_figure(FULL.with_truth, 3 * MOMENTS[::-1]).axes[::2]
    for axes, ratio in zip(values, (0.6, 0.85), strict=True):
        assert any(np.allclose(np.asarray(line.get_ydata(), dtype=float), ratio) for line in axes.lines)
        low, high = axes.get_ylim()
        assert low < ratio < high


def test_estimators_that_coincide_are_drawn_as_differences_of_their_inertia() -> None:
    first, second = (each.body.principal_moments[:2] for each in FULL.with_truth)
    beside = inertia_figure(FULL.with_truth).axes[1::2]
    for index, axes in enumerate(beside):
        assert axes.lines[0].get_ydata()[-1] == pytest.approx(first[index] - second[index], abs=1e-12)  # pyright: ignore[reportIndexIssue]


def test_the_energy_of_a_true_estimate_is_within_its_band() -> None:
    course = rotational_energy(FULL.with_truth[0])
    rate = true_rates(FULL.truth).rate
    assert FULL.truth.principal_axes_g is not None
    true = (rate @ FULL.truth.principal_axes_g.T) ** 2 @ (MOMENTS / MOMENTS.max()) / 2
    assert np.mean(np.abs(course.energy - true) <= 4.0 * course.std) > 0.9


def test_a_body_of_which_nothing_is_known_is_drawn_too() -> None:
    sphere = nearly_spherical(FULL.with_truth[0])
    assert rendered_size(inertia_figure([sphere])) > 4000
    assert rendered_size(estimated_polhode_figure(estimated_rates(sphere.history), sphere.body)) > 4000
    assert rendered_size(summary_figure([sphere])) > 4000


def test_the_summary_says_the_map_the_noise_and_the_seed_and_calls_itself_by_what_was_used() -> None:
    assert MAKERS["summary"](FULL).get_supxlabel().splitlines() == [
        "Estimators on the same recording, each on the observations that it used",
        " ".join(CONDITIONS),
    ]


def test_the_summary_shows_what_each_used_of_the_observations_after_the_initialisation() -> None:
    (axes,) = (a for a in MAKERS["summary"](FULL).axes if a.get_xlabel() == "[1/epoch]")
    widths = [patch.get_width() for patch in axes.patches if isinstance(patch, Rectangle)]
    assert widths == [5.0, 5.0, 3.0, 3.0]  # what was measured, then what both used
    assert {text.get_text() for text in axes.texts} == {"3 of 5 (60 %)"}


def test_the_share_inside_the_bands_is_of_the_estimators_own_epochs() -> None:
    evaluation = FULL.with_truth[0]
    mean = evaluation.history.mean.copy()
    mean[:INITIALISATION_EPOCHS] = mean[0]
    spoilt = evaluate(replace(evaluation.history, mean=mean), FULL.truth)
    titles = [error_bands_figure(each).get_suptitle() for each in (evaluation, spoilt)]
    assert titles[0] == titles[1]
    assert f"in its own {len(evaluation.history.time) - INITIALISATION_EPOCHS} epochs" in titles[0]


def test_the_headline_counts_the_flips_of_the_intermediate_axis() -> None:
    flips = count_flips(true_rates(FULL.truth).rate)
    assert flips > 0
    assert f" {flips} flip{'s' * (flips > 1)} about the intermediate axis in " in headline(
        FULL.with_truth[:1]
    )


@pytest.mark.parametrize("count", [1, 2, 5])
def test_the_legend_of_the_inertia_hides_no_error_bar(count: int) -> None:
    evaluations = [
        replace(FULL.with_truth[0], history=replace(FULL.with_truth[0].history, name=f"filterpy-ekf{k}"))
        for k in range(count)
    ]
    figure = summary_figure(evaluations, true_rates(FULL.truth), MOMENTS, CONDITIONS)
    rendered_size(figure)
    (axes,) = [axes for axes in figure.axes if axes.get_title("left").startswith("inertia")]
    legend = axes.get_legend()
    assert legend is not None
    box = legend.get_window_extent()
    others = [each.get_window_extent() for each in figure.axes if each is not axes]
    ticks = [label.get_window_extent() for label in axes.get_xticklabels()]
    assert not any(box.overlaps(each) for each in (axes.get_window_extent(), *others, *ticks))


def test_no_sentence_below_the_summary_runs_out_of_the_picture() -> None:
    long = [*CONDITIONS, "A sentence that tells what is wrong with the truth. " * 3]
    figure = summary_figure(FULL.with_truth, true_rates(FULL.truth), MOMENTS, long)
    rendered_size(figure)
    footer = next(text for text in figure.texts if "A sentence that tells" in text.get_text())
    assert footer.get_window_extent().x1 < figure.bbox.x1


def test_many_innovations_are_grouped_without_losing_any() -> None:
    evaluation = FULL.without_truth[0]
    line = consistency_figure([evaluation]).axes[0].lines[0]
    history = evaluation.history
    used = history.dof > 0
    assert np.asarray(line.get_ydata()).sum() == pytest.approx((history.nis[used] / history.dof[used]).sum())


def test_estimators_differ_in_colour_and_dashes_whatever_their_names() -> None:
    lines = estimator_lines(["mekf", "ukf", "smoother", "other"])
    assert len({line.color for line in lines}) == 4
    assert len({line.dashes for line in lines}) == 4


def test_a_figure_is_saved_as_a_complete_png_or_not_at_all(tmp_path: Path) -> None:
    figure = MAKERS["consistency"](FULL)
    save_figure(figure, tmp_path / "figure.png")
    data = (tmp_path / "figure.png").read_bytes()
    assert data.startswith(b"\x89PNG")
    assert b"IEND" in data[-12:]
    with pytest.raises(InputError, match="cannot be written"):
        save_figure(figure, tmp_path / "nowhere" / "figure.png")


def test_the_scene_shows_the_path_of_a_moving_inspector_and_its_view_from_the_end() -> None:
    evaluation = FULL.with_truth[0]
    figure = scene_figure(evaluation.trajectory, evaluation.body, DrawnCamera(RIG, CIRCLE), POINTS)
    (axes,) = (each for each in figure.axes if isinstance(each, Axes3D))
    to_view = [0, 2, 1] * np.ones(3, dtype=int)
    expected = CIRCLE.poses[:, to_view] * [1, 1, -1]
    lines = (np.array(line.get_data_3d()) for line in axes.lines if isinstance(line, Line3D))
    paths = [line.T for line in lines if line.shape[1] == FRAMES]
    assert any(np.allclose(path, expected) for path in paths)
    (frustum,) = (each for each in axes.collections if isinstance(each, Line3DCollection))
    corner = np.array(frustum._segments3d)[0, 0]
    np.testing.assert_allclose(corner, expected[-1], atol=1e-12)


def test_the_longest_headline_stays_within_its_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    sentence = "Spins at 39.3 rpm, 2 flips about the intermediate axis in 5.78 s, moments of inertia "
    monkeypatch.setattr(
        summary, "headline", lambda _: f"{sentence}0.3726 ± 0.0030 : 0.7312 ± 0.0018 : 1 (SMOOTHER, degraded)"
    )
    figure = summary_figure(FULL.without_truth)
    rendered_size(figure)
    (title,) = (each for each in figure.texts if each.get_text().startswith("Spins"))
    extent = title.get_window_extent()
    assert extent.x0 > 0
    assert extent.x1 < figure.bbox.x1


def test_a_gap_in_a_curve_hides_no_peak() -> None:
    curve = np.sin(np.arange(100_000) / 1e4)
    curve[50_010], curve[50_001], curve[:20_000] = 50.0, np.nan, np.nan
    drawn = extremes(curve)
    assert isinstance(drawn, np.ndarray)
    assert 50_010 in drawn
