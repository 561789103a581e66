"""Clock and axes of a reference that is late, turned, and has gaps: errors of the fit beside its stated deviations.

    python -m experiments.reference_clock [--seeds 20] [--first 0] [-o FILE]

The smoother estimates the bundled motion from tracks of unknown landmarks. Its truth at 17 Hz, 0.1 s late, turned by 10 deg and
with three gaps of 3 s is the reference: once in the estimate's own inertial frame, once in a frame of its own. That motion spins
almost steadily, so that an offset of the clock and a rotation about the spin are nearly the same, and an error of the estimate's
first pose, which defines its frame g, leaves no residual. ``-o`` keeps a line of JSON for each fit.

The root mean square errors that the reference shows are compared with those against the truth itself at the reference's own rows,
whose clock and frames are known: what is fitted takes a part of the errors away, and an error of the clock adds one.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from experiments.command_line import rows_of_seeds, run_study
from spinfilters.core.attitude_conversions import (
    angle_between,
    continuous_quaternions,
    inverse,
    multiply,
    quaternion_from_matrix,
    quaternion_from_rotation_vector,
    rotate,
    rotation_vector_from_quaternion,
)
from spinfilters.core.camera_trajectory import CameraTrajectory
from spinfilters.core.linear_algebra import at_times
from spinfilters.evaluation.continuous_motion import ContinuousMotion
from spinfilters.evaluation.reference_comparison import ReferenceComparison, compare_with_reference
from spinfilters.evaluation.trajectory_errors import root_mean_square
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.reference_motion import ReferenceMotion
from spinfilters.io.truth import Truth
from spinfilters.run.comparison_run import compare_dataset
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate, without_map

RATE: Final = 17.0
"""Rows of the reference a second."""
LATE, TURN = 0.1, np.deg2rad(10.0)
"""s and rad."""
SHIFT: Final = np.array([1.0, -2.0, 0.5])
"""Of a frame of its own, m."""
GAPS, GAP = 3, 3.0
"""How many, and of how many s."""
CLOCK, AXES = 2e-3, np.deg2rad(0.1)
"""Errors that are small enough whatever is stated, s and rad."""
ERRORS: Final = 0.02
"""Relative difference of two root mean square errors that is small enough."""


def rows_of(seed: int) -> Iterator[dict[str, Any]]:
    """A row for the fit with the frame shared, and one without."""
    whole = simulate(Scenario(seed=seed, beside=(("gyro", 1.0 / RATE),)))
    truth = whole.truth
    assert truth is not None
    streams = tuple(stream for stream in whole.log.streams if stream.sensor == whole.sensor)
    stamps = np.isin(np.round(truth.time, 6), np.round(np.unique(streams[0].time), 6))
    seen = replace(whole, log=MeasurementLog(streams), truth=truth_at(truth, stamps))
    found = compare_dataset(without_map(seen), Settings(estimators=("smoother",), verdict="filter"))
    evaluation = found.evaluations[0]
    errors = evaluation.errors
    fitted = None if errors is None else errors.frame
    for shared in (True, False):
        reference, axes = moved(truth, np.random.default_rng(seed), shared)
        comparison = compare_with_reference(evaluation.history, reference)
        fit = comparison.fit
        if fitted is not None:  # the frame g of the estimate in that of the truth
            axes = multiply(inverse(fitted), axes)
        exact = true_errors(ContinuousMotion(evaluation.history), truth, comparison, fitted)
        yield {
            **{f"{name}_error": comparison.rms[name] for name in exact},
            "attitude_with_hidden": comparison.attitude_rms_with_hidden,
            **{f"{name}_true_error": value for name, value in exact.items()},
            "seed": seed,
            "shared": shared,
            "clock": fit.clock_offset - LATE,
            "clock_std": fit.clock_std,
            "correlation": fit.clock_correlation,
            "axes": float(angle_between(quaternion_from_matrix(fit.axes), axes)),
            "axes_std": float(np.linalg.norm(fit.axes_std)),
        }


def true_errors(
    motion: ContinuousMotion, truth: Truth, comparison: ReferenceComparison, frame: np.ndarray | None
) -> dict[str, float]:
    """Root mean square errors against the truth at the stamps of a comparison: m, rad, m/s, rad/s."""
    assert comparison.position is not None
    assert comparison.velocity is not None
    times = {
        "position": comparison.position.time,
        "attitude": comparison.position.time,
        "velocity": comparison.velocity.time,
        "rate": comparison.rate_after.time,
    }
    late = comparison.fit.clock_offset - LATE
    at = {name: np.clip(time + late, truth.time[0], truth.time[-1]) for name, time in times.items()}
    own = {name: motion.at(time) for name, time in at.items()}
    poses = CameraTrajectory(truth.time, np.hstack([truth.center_of_mass, truth.q_ig]))
    q = poses.at(at["attitude"])[:, 3:]
    q = q if frame is None else multiply(q, np.tile(frame, (len(q), 1)))
    return {
        "position": root_mean_square(own["position"].position - poses.at(at["position"])[:, :3]),
        "attitude": root_mean_square(
            rotation_vector_from_quaternion(multiply(inverse(q), own["attitude"].q_ig))
        ),
        "velocity": root_mean_square(
            own["velocity"].velocity - at_times(at["velocity"], truth.time, truth.velocity)
        ),
        "rate": root_mean_square(
            rotate(own["rate"].q_ig, own["rate"].rate) - at_times(at["rate"], truth.time, truth.rate_i)
        ),
    }


def truth_at(truth: Truth, rows: np.ndarray) -> Truth:
    """Some rows of a truth."""
    return replace(
        truth,
        time=truth.time[rows],
        center_of_mass=truth.center_of_mass[rows],
        q_ig=truth.q_ig[rows],
        velocity=truth.velocity[rows],
        rate_i=truth.rate_i[rows],
    )


def moved(truth: Truth, generator: np.random.Generator, shared: bool) -> tuple[ReferenceMotion, np.ndarray]:
    """The truth as the reference tells it, and its axes in g."""
    axes = quaternion_from_rotation_vector(TURN * direction(generator))
    frame = quaternion_from_rotation_vector((0.0 if shared else TURN) * direction(generator))
    kept = np.abs(truth.time * RATE - np.round(truth.time * RATE)) < 1e-6
    for begin in generator.uniform(5.0, truth.time[-1] - 8.0, GAPS):
        kept &= ~((truth.time > begin) & (truth.time < begin + GAP))
    count = int(np.count_nonzero(kept))
    turned = np.tile(frame, (count, 1))
    q = multiply(turned, multiply(truth.q_ig[kept], np.tile(axes, (count, 1))))
    place = rotate(turned, truth.center_of_mass[kept]) + (0.0 if shared else 1.0) * SHIFT
    reference = ReferenceMotion(
        "reference",
        truth.time[kept] + LATE,
        continuous_quaternions(q),
        place,
        shares_frame=shared,
        shares_origin=True,
    )
    return reference, axes


def direction(generator: np.random.Generator) -> np.ndarray:
    """A unit vector."""
    drawn = generator.normal(size=3)
    return drawn / np.linalg.norm(drawn)


def lines_of(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Lines of the report."""
    for shared in (True, False):
        own = [row for row in rows if row["shared"] is shared]
        clock, clock_std, axes, axes_std = (
            np.abs([row[key] for row in own]) for key in ("clock", "clock_std", "axes", "axes_std")
        )
        yield (
            f"frame {'shared' if shared else 'fitted'}, {len(own)} fits: clock rms {1e3 * np.sqrt(np.mean(clock**2)):.2f} ms, "
            f"{np.sqrt(np.mean((clock / clock_std) ** 2)):.2f} of its deviation, largest {np.max(clock / clock_std):.1f}; within "
            f"2 ms or one deviation {np.count_nonzero((clock < CLOCK) | (clock < clock_std))}, or three "
            f"{np.count_nonzero((clock < CLOCK) | (clock < 3 * clock_std))}; median correlation "
            f"{np.median([row['correlation'] for row in own]):.3f}"
        )
        yield (
            f"  axes rms {np.rad2deg(np.sqrt(np.mean(axes**2))):.3f} deg, {np.sqrt(np.mean((axes / axes_std) ** 2)):.2f} of the "
            f"deviation; within 0.1 deg {np.count_nonzero(axes < AXES)}, or three deviations "
            f"{np.count_nonzero((axes < AXES) | (axes < 3 * axes_std))}"
        )
        for name in ("position", "attitude", "velocity", "rate"):
            ratio = np.array([row[f"{name}_error"] / row[f"{name}_true_error"] for row in own])
            yield (
                f"  {name} error over that against the truth: median {np.median(ratio):.3f}, {np.min(ratio):.3f} to "
                f"{np.max(ratio):.3f}; within {100 * ERRORS:.0f} % {np.count_nonzero(np.abs(ratio - 1) < ERRORS)}"
            )
        whole, true = (
            np.sqrt(np.mean(np.square([row[f"attitude_{kind}"] for row in own])))
            for kind in ("with_hidden", "true_error")
        )
        yield f"  attitude error with what the fit takes up, over that against the truth, all fits together: {whole / true:.3f}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, default=None)
    options = parser.parse_args(arguments)
    rows = rows_of_seeds(rows_of, range(options.first, options.first + options.seeds), options.output)
    for line in lines_of(rows):
        print(line)


if __name__ == "__main__":
    run_study(main)
