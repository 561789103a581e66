"""Sections 1.4.3, 6.2.4 and 7.2: comparisons that the thesis names and leaves to others, on simulated recordings.

Filters that begin after few epochs, and the smoother; an inspector that moves, and what may be done about it; a map and motion
without dynamics that are added afterwards; motions that leave parameters open; several recordings of one body in one inertia.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator, ScalarFormatter

from spinfilters.core.attitude_conversions import angle_between, inverse, rotate
from spinfilters.core.camera_trajectory import CameraTrajectory
from spinfilters.core.inertia_charts import log_ratios_of
from spinfilters.evaluation.consistency import true_states
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.fused_inertia import fuse_inertias, mass_belief
from spinfilters.evaluation.stated_errors import stated_errors
from spinfilters.evaluation.trajectory_errors import root_mean_square
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.models.body import bodies_of
from spinfilters.models.sensor import pose_samples
from spinfilters.models.state_blocks import MASS_DISTRIBUTION
from spinfilters.models.state_layout import FULL_BLOCKS, Gaussian, StateLayout
from spinfilters.models.tracks.map_building import poses_without_map
from spinfilters.plots.style import BLACK, BLUE, GREEN, RED, tidy
from spinfilters.reproduction.item import ComparedNumber, Item, ItemResult, tweddle_item
from spinfilters.run.comparison_run import compare_dataset
from spinfilters.settings.run_settings import InitialisationOptions, Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map
from spinfilters.smoother.closed_form import initial_motion, initial_state

SMALL: Final = Scenario(landmarks=600, epochs=70)
"""Of recordings with tracks: fewer landmarks and epochs than the thesis', for time."""
RECORDINGS: Final = range(3, 9)
"""Seeds of those whose errors are averaged."""
STARTS: Final = (5, 10, 20, 60)
"""Epochs after which filters are begun."""
RATIO: Final = "a ratio of two"
"""Cell of the bound of a ratio of errors or deviations."""
SHORTER: Final = replace(SMALL, epochs=12, landmarks=300)
"""Of tests."""
SMOOTHED: Final = Settings(estimators=("smoother",))
LAST: Final = 30
"""Epochs at the end over which errors are taken."""
SPINS: Final = {
    "about the major axis": (10.0, 0.0, 0.0),
    "about the intermediate axis, flipping": (0.5, 10.0, 0.5),
    "about the minor axis": (0.0, 0.0, 10.0),
    "tumbling about all": RICH_RPM,
}
AHEAD: Final = 20.0
"""s, over which states are propagated."""


def make_late_filters(recordings: Sequence[int] = RECORDINGS, starts: Sequence[int] = STARTS) -> ItemResult:
    """Filters begun after 5, 10, 20 and 60 epochs, and the smoother of the same recordings."""
    table: list[dict[str, float | int | str]] = []
    squares: dict[str, np.ndarray] = {}
    for seed in recordings:
        dataset = simulate(Scenario(kind="pose", seed=seed))
        for k, count in enumerate(starts):
            share = count / len(dataset.log.streams[0])
            options = InitialisationOptions(epochs=count, share=share)
            compared = compare_dataset(
                dataset, Settings(estimators=("mekf", "ukf", "smoother"), initialisation=options)
            )
            for evaluation in compared.evaluations:
                rms = _attitude_rms(evaluation)
                table.append(
                    {
                        "seed": seed,
                        "epochs_before": count,
                        "epochs_smoothed": evaluation.history.initialisation,
                        "estimator": evaluation.name,
                        "attitude_rms_deg": rms,
                        "largest_error_in_deviations": max(stated_errors(evaluation).values()),
                        "verdict": evaluation.history.status.verdict.value,
                    }
                )
                squares.setdefault(evaluation.name, np.zeros(len(starts)))[k] += rms**2 / len(recordings)
    courses = {name: np.sqrt(values) for name, values in squares.items()}
    smooth = courses["smoother"][-1]
    rows = [
        ComparedNumber(
            f"{name} begun after {count} epochs: attitude error of the last {LAST} over the smoother's",
            float(courses[name][list(starts).index(count)] / smooth),
            expected=(1.0, np.inf),
            bound=RATIO,
            why=f"of {len(recordings)} recordings, an estimate may lie nearer to the truth than a better one by chance",
        )
        for name in ("mekf", "ukf")
        for count in (starts[0], starts[-1])
    ]
    figure = Figure(figsize=(6.6, 4.2), layout="constrained")
    axes = figure.subplots()
    for (name, values), colour in zip(courses.items(), (BLUE, RED, GREEN), strict=False):
        axes.loglog(starts, values, "o-", color=colour, label=name)
    _tick_counts(axes, starts)
    axes.yaxis.set_major_formatter(ScalarFormatter())
    axes.yaxis.set_minor_formatter(ScalarFormatter())
    axes.set(
        xlabel="epochs before the filters begin", ylabel=f"attitude error of the last {LAST} epochs [deg]"
    )
    axes.set_title("filters begun early, compared with the smoother", loc="left", fontsize="medium")
    axes.legend(frameon=False)
    tidy(axes)
    note = (
        "Section 1.4.3 prefers a smoother because a filter throws old measurements away before it has converged; no filter is "
        "shown there. Poses of the thesis' motion, root mean squares over the recordings of "
        f"seeds {recordings[0]} to {recordings[-1]}. Where poses do not determine the motion, up to a third more are smoothed than "
        "asked for (epochs_smoothed)."
    )
    return ItemResult(rows, {"late_filters": figure}, {"late_filters": table}, note)


def _tick_counts(axes: Axes, counts: Sequence[int]) -> None:
    """Whole numbers at a logarithmic axis, rather than powers of ten."""
    axes.set_xticks(counts, [str(count) for count in counts])
    axes.xaxis.set_minor_locator(NullLocator())


def _attitude_rms(evaluation: Evaluation) -> float:
    """Of the last epochs, deg."""
    assert evaluation.errors is not None
    return float(np.rad2deg(root_mean_square(evaluation.errors.attitude[-LAST:])))


def make_inspector_treatments(scenario: Scenario = SMALL, settings: Settings = SMOOTHED) -> ItemResult:
    """An inspector that rests, dead-bands or circles, under the options of section 6.2.4."""
    table: list[dict[str, float | str]] = []
    turned: dict[str, float] = {}
    depth = math.nan
    for inspector in ("static", "dead-band", "circle"):
        recorded = without_map(simulate(replace(scenario, inspector=inspector)))
        turned[inspector] = _turned(recorded)
        depth = _depth_of_pixel(recorded, scenario.range_m)
        treatments = {
            "1, images stabilised": stabilised(recorded),
            "2, taken as static": replace(recorded, inspector=None),
            "3, in the inertial frame": recorded,
        }
        if inspector == "static":
            del treatments["1, images stabilised"], treatments["2, taken as static"]
        for treatment, dataset in treatments.items():
            evaluation = compare_dataset(dataset, settings).evaluations[0]
            rms = None if evaluation.errors is None else evaluation.errors.rms
            position, attitude = (None, None) if rms is None else (rms.position, rms.attitude)
            table.append(
                {
                    "inspector": inspector,
                    "treatment": treatment,
                    "position_rms_mm": math.nan if position is None else 1e3 * position,
                    "attitude_rms_deg": math.nan if attitude is None else math.degrees(attitude),
                    "verdict": evaluation.history.status.verdict.value,
                }
            )
    by_case = {(row["inspector"], str(row["treatment"])[0]): row for row in table}
    still = float(by_case["static", "3"]["position_rms_mm"])
    rows = []
    for inspector in ("dead-band", "circle"):
        for number, words in (
            ("1", "images stabilised"),
            ("2", "taken as static"),
            ("3", "in the inertial frame"),
        ):
            ours = float(by_case[inspector, number]["position_rms_mm"]) / still
            better = number != "2"
            rows.append(
                ComparedNumber(
                    f"{inspector}, {words}: position error over that of a static inspector",
                    ours,
                    expected=(0.0, 3.0) if better else (1.0, np.inf),
                    bound=RATIO,
                    why="noise of the depth becomes noise across in a view turned far, which a stabilised image does not "
                    "show: 1 px is "
                    f"{1e3 * depth:.2g} mm of depth, and the view turns by "
                    f"{turned[inspector]:.0f} deg",
                )
            )
    figure = Figure(figsize=(7.4, 4.2), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(table))[::-1]
    for place, row in zip(places, table, strict=True):
        colour = GREEN if row["verdict"] == "ok" else RED
        axes.barh(place, float(row["position_rms_mm"]), color=colour, height=0.6)
    axes.set_yticks(places, [f"{row['inspector']}: {row['treatment']}" for row in table])
    axes.set_xscale("log")
    axes.set_xlabel("position error, rms [mm] (green: verdict ok)")
    axes.set_title("a moving inspector and what is done about it", loc="left", fontsize="medium")
    tidy(axes)
    note = (
        "Options of section 6.2.4; the thesis took the second. Stabilised images are simulated by moving each measured point to "
        "where the camera of the first epoch would see it. The fourth, poses of the inspector as unknowns, is not offered: stated "
        "errors of its poses are counted in every deviation instead. A static inspector is the same under all."
    )
    return ItemResult(rows, {"inspector": figure}, {"inspector": table}, note)


def _depth_of_pixel(dataset: Dataset, distance_m: float) -> float:
    """What a pixel of the disparity is of depth at a distance, m: z^2 / (f b)."""
    assert dataset.rig is not None
    return distance_m**2 / float(dataset.rig.calibration[0] * dataset.rig.calibration[4])


def _turned(dataset: Dataset) -> float:
    """Largest rotation of the inspector from its first attitude, deg."""
    trajectory = CameraTrajectory.of(dataset.inspector)
    if trajectory is None:
        return 0.0
    attitude = trajectory.at(dataset.log.stream("stereo").time)[:, 3:]
    return float(np.rad2deg(angle_between(attitude, np.broadcast_to(attitude[0], attitude.shape)).max()))


def stabilised(dataset: Dataset) -> Dataset:
    """Tracks as the camera of the first epoch would see them, without an inspector.

    Parameters
    ----------
    dataset : Dataset
        Stereo tracks with known poses of the inspector, or without.
    """
    if dataset.inspector is None:
        return dataset
    stream, rig = dataset.log.stream("stereo"), dataset.rig
    assert rig is not None
    trajectory = CameraTrajectory.of(dataset.inspector)
    assert trajectory is not None
    fx, fy, cx, cy, baseline = rig.calibration[:5]
    left, row, right = stream.values.T
    depth = fx * baseline / np.maximum(left - right, 1e-3)
    points = np.column_stack([(left - cx) * depth / fx, (row - cy) * depth / fy, depth])
    poses = trajectory.at(stream.time)
    begin = trajectory.at(stream.time[:1])[0]
    inertial = rotate(poses[:, 3:], points) + poses[:, :3]
    seen = rotate(np.broadcast_to(inverse(begin[3:]), (len(inertial), 4)), inertial - begin[:3])
    u, v = fx * seen[:, 0] / seen[:, 2] + cx, fy * seen[:, 1] / seen[:, 2] + cy
    values = np.column_stack([u, v, u - fx * baseline / seen[:, 2]])
    return replace(dataset, inspector=None, log=MeasurementLog((replace(stream, values=values),)))


def make_dynamics_afterwards(scenario: Scenario = SMALL, count: int = 3) -> ItemResult:
    """Section 7.2: poses and map without dynamics, inertia from them afterwards, compared with the smoother."""
    table: list[dict[str, float | int]] = []
    true = log_ratios_of(Scenario.principal_moments)
    for seed in range(count):
        dataset = without_map(simulate(replace(scenario, seed=seed, rate_rpm=RICH_RPM)))
        assert dataset.rig is not None
        layout = StateLayout(FULL_BLOCKS)
        poses, _, _ = poses_without_map(
            dataset.log.stream("stereo"), dataset.rig.calibration, scenario.pixel_std
        )
        state, _ = initial_state(layout, initial_motion(pose_samples(poses), scenario.epochs))
        flat = Gaussian(layout, state, 1e-6 * np.eye(layout.error_dim))
        afterwards = np.abs(_ratios_of(flat) - true)
        evaluation = compare_dataset(dataset, Settings(estimators=("smoother",))).evaluations[0]
        joint = np.abs(evaluation.bodies.log_ratios[-1] - true)
        table.append(
            {
                "seed": seed,
                "afterwards_k1": float(afterwards[0]),
                "afterwards_k2": float(afterwards[1]),
                "smoother_k1": float(joint[0]),
                "smoother_k2": float(joint[1]),
            }
        )
    rms = {
        key: float(np.sqrt(np.mean([row[key] ** 2 for row in table]))) for key in table[0] if key != "seed"
    }
    rows = [
        ComparedNumber(
            f"{ratio}: error of dynamics added afterwards over the smoother's, {len(table)} recordings",
            rms[f"afterwards_{ratio}"] / rms[f"smoother_{ratio}"],
            expected=(1.0, np.inf),
            bound=RATIO,
            why=f"of {len(table)} recordings the order may be turned by chance",
        )
        for ratio in ("k1", "k2")
    ]
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    for k, ratio in enumerate(("k1", "k2")):
        for name, colour in (("afterwards", RED), ("smoother", BLUE)):
            values = [row[f"{name}_{ratio}"] for row in table]
            axes.semilogy(
                np.full(len(values), k + (0.1 if name == "smoother" else -0.1)),
                *(values, "o"),
                color=colour,
                label=("dynamics afterwards" if name == "afterwards" else name) if not k else None,
            )
    axes.set_xticks([0, 1], ["k1", "k2"])
    axes.set_ylabel("error of the ratio [-]")
    axes.set_title("inertia from poses afterwards, and estimated jointly", loc="left", fontsize="medium")
    axes.legend(frameon=False)
    tidy(axes)
    note = (
        "Section 7.2 expects that a map and motion without dynamics, inverted afterwards, are less accurate. Here poses are fitted "
        "epoch by epoch to a common map, and conserved angular momentum gives the inertia (closed form); rich motion, 70 epochs."
    )
    return ItemResult(rows, {"afterwards": figure}, {"afterwards": table}, note)


def make_unobservable_motions(spins: Mapping[str, tuple[float, float, float]] = SPINS) -> ItemResult:
    """Section 7.2: motions that leave parameters open, and what that does to the propagated state."""
    table: list[dict[str, float | str]] = []
    for name, rate in spins.items():
        dataset = simulate(Scenario(kind="pose", seed=1, rate_rpm=rate))
        compared = compare_dataset(dataset, Settings(estimators=("smoother",)))
        evaluation, process = compared.evaluations[0], compared.setup.process
        history = evaluation.history
        truth = evaluation.truth_in_own_frames
        assert truth is not None
        layout = history.layout
        true = true_states(truth, layout)[-1]
        ahead = [process.step(state, AHEAD) for state in (history.mean[-1], true)]
        error = layout.local(ahead[0], ahead[1])[layout.slice("a")]
        std = evaluation.bodies.log_ratios_std[-1]
        table.append(
            {
                "spin": name,
                "std_k1": float(std[0]),
                "std_k2": float(std[1]),
                "error_k1_in_deviations": float(
                    abs(evaluation.bodies.log_ratios[-1, 0] - log_ratios_of(Scenario.principal_moments)[0])
                    / std[0]
                ),
                "attitude_after_20_s_deg": float(np.rad2deg(np.linalg.norm(error))),
                "std_rate_deg_s": float(np.rad2deg(np.linalg.norm(evaluation.trajectory.std_rate[-1]))),
                "verdict": history.status.verdict.value,
            }
        )
    rows = [
        ComparedNumber(
            f"{row['spin']}: attitude error after {AHEAD:g} s of propagation",
            float(row["attitude_after_20_s_deg"]),
            expected=(0.0, 10.0),
            unit="deg",
            bound=_predicted(row),
            why=f"the rate's own stated error, {float(row['std_rate_deg_s']):.2g} deg/s, grows over {AHEAD:g} s, whatever "
            "the inertia",
        )
        for row in table
    ]
    rows += [
        ComparedNumber(
            f"deviation of k1 {row['spin']} over that of the tumbling motion",
            float(row["std_k1"]) / float(table[-1]["std_k1"]),
            expected=(1.0, np.inf),
            bound=RATIO,
            why=f"this motion determines this ratio to {float(row['std_k1']):.2g}, and the tumbling one to "
            f"{float(table[-1]['std_k1']):.2g}",
        )
        for row in table[:-1]
    ]
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    for axes, keys, title, unit in zip(
        figure.subplots(1, 2),
        (("std_k1", "std_k2"), ("attitude_after_20_s_deg",)),
        ("deviations of the ratios", f"attitude error after {AHEAD:g} s"),
        ("[-]", "[deg]"),
        strict=True,
    ):
        places = np.arange(len(table))[::-1]
        for key, colour in zip(keys, (BLUE, RED), strict=False):
            axes.plot(
                [float(row[key]) for row in table], places, "o", color=colour, label=key.replace("std_", "")
            )
        axes.set_yticks(
            places, [str(row["spin"]) for row in table] if axes is figure.axes[0] else [""] * len(table)
        )
        axes.set_xlabel(unit)
        if len(keys) > 1:
            axes.set_xscale("log")
        else:
            axes.set_xlim(left=0.0)
        axes.set_title(title, loc="left", fontsize="medium")
        tidy(axes)
    figure.axes[0].legend(frameon=False)
    note = (
        "Section 7.2 anticipates that parameters which a motion does not show hardly matter for propagation; poses, seed 1. The "
        "deviations of the ratios say which they are."
    )
    return ItemResult(rows, {"motions": figure}, {"motions": table}, note)


def make_fused_recordings(count: int = 6) -> ItemResult:
    """Section 7.2: several recordings of one body in one inertia."""
    beliefs, true = [], np.empty(0)
    generator = np.random.default_rng(72)
    for seed in range(count):
        rate = generator.normal(size=3)
        rate *= 8.0 / np.linalg.norm(rate)
        dataset = simulate(Scenario(kind="pose", seed=seed, rate_rpm=tuple(rate.tolist()), epochs=60))
        evaluation = compare_dataset(dataset, Settings(estimators=("smoother",))).evaluations[0]
        layout, truth = evaluation.history.layout, evaluation.truth_in_own_frames
        assert truth is not None
        true = true_states(truth, layout)[-1, layout.mean_slice(MASS_DISTRIBUTION.name)]
        beliefs.append(mass_belief(evaluation.history.belief(-1)))
    counts, std, nees = [*range(1, count + 1)], [], []
    for each in counts:
        fused = fuse_inertias(beliefs[:each], MASS_DISTRIBUTION.prior_std).belief
        off = fused.whitened(fused.layout.local(fused.mean, true)[:, np.newaxis])[:, 0]
        std.append(float(np.sqrt(np.mean(np.sum(fused.factor**2, axis=1)))))
        nees.append(float(off @ off))
    rows = [
        ComparedNumber(
            "deviation of all recordings over that of the first",
            std[-1] / std[0],
            expected=(0.0, 0.6),
            bound=RATIO,
        ),
        ComparedNumber(
            "NEES of the fused mass distribution, 5 degrees of freedom",
            nees[-1],
            expected=(0.41, 16.7),
            bound="NEES: 5 on average",
            why="outside the central 99 %: a recording is over-confident",
        ),
    ]
    figure = Figure(figsize=(6.2, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.loglog(counts, std, "o-", color=BLUE, label="fused")
    axes.loglog(counts, std[0] / np.sqrt(counts), color=BLACK, linestyle=":", label="1 / sqrt(recordings)")
    _tick_counts(axes, counts)
    axes.set(xlabel="recordings", ylabel="deviation of the mass distribution, rms [-]")
    axes.set_title("one inertia from several recordings of one body", loc="left", fontsize="medium")
    axes.legend(frameon=False)
    tidy(axes)
    table = [
        {"recordings": n, "std_rms": s, "nees": float(e)} for n, s, e in zip(counts, std, nees, strict=True)
    ]
    note = (
        "Section 7.2 wishes for several datasets of one satellite. Six recordings of poses, each tumbling about a drawn direction "
        "at 8 rpm for 30 s: mass distributions in one frame g, weighed by their inverse covariances, as ``spinfilters fuse`` does."
    )
    return ItemResult(rows, {"fused": figure}, {"fused": table}, note)


def _predicted(row: Mapping[str, float | str]) -> str:
    """The error of the propagated attitude that the stated error of the rate alone gives."""
    return f"{AHEAD * float(row['std_rate_deg_s']):.2g} deg by the stated rate"


def _ratios_of(belief: Gaussian) -> Float[np.ndarray, "2"]:
    body = bodies_of(belief.layout, np.zeros(1), belief.mean[np.newaxis], belief.factor[np.newaxis])
    return body.log_ratios[0]


COMPARATIVE_STUDIES: Final[tuple[Item, ...]] = (
    tweddle_item(
        "Section 1.4.3",
        "with 7.2",
        "Filters begun after few epochs",
        make_late_filters,
        45.0,
        partial(make_late_filters, range(3, 4), (60,)),
    ),
    tweddle_item(
        "Section 6.2.4",
        "with 6.2.3",
        "A moving inspector and its treatments",
        make_inspector_treatments,
        45.0,
        partial(make_inspector_treatments, SHORTER, Settings(estimators=("smoother",), verdict="filter")),
    ),
    tweddle_item(
        "Section 7.2 a",
        "future work",
        "Dynamics added after a map without them",
        make_dynamics_afterwards,
        10.0,
        partial(make_dynamics_afterwards, SHORTER, 1),
    ),
    tweddle_item(
        "Section 7.2 b",
        "future work",
        "Motions that leave parameters open",
        make_unobservable_motions,
        10.0,
        partial(make_unobservable_motions, dict(list(SPINS.items())[3:])),
    ),
    tweddle_item(
        "Section 7.2 c",
        "future work",
        "Several recordings in one inertia",
        make_fused_recordings,
        5.0,
        partial(make_fused_recordings, 2),
    ),
)
