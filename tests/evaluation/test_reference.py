"""A reference of its own rate, clock and axes is related to an estimate, and never ends a run."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from plain_comparison import plain_comparison

from spinfilters.core.attitude_conversions import (
    angle_between,
    continuous_quaternions,
    multiply,
    quaternion_from_axis_angle,
    quaternion_from_matrix,
    quaternion_from_rotation_vector,
    rotate,
)
from spinfilters.core.errors import InputError
from spinfilters.evaluation.continuous_motion import ContinuousMotion
from spinfilters.evaluation.reference_comparison import compare_with_reference
from spinfilters.evaluation.reference_fit import fit_reference, reference_rates
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.reference_motion import ReferenceMotion, read_reference, reference_of_truth
from spinfilters.io.truth import Truth
from spinfilters.run.comparison_run import without_unmatched_truth
from spinfilters.run.reference_output import ReferenceComparisons, chosen_reference, write_reference
from spinfilters.settings.run_settings import FILTER, Settings
from spinfilters.simulation.scenario import Scenario, simulate

LATE = 0.1


@cache
def smoothed() -> tuple[EstimateHistory, Truth]:
    """A motion that determines everything, from poses with little noise, and its truth."""
    scenario = Scenario.simplified(
        kind="pose", rate_rpm=(4.0, 9.0, 3.0), epochs=60, position_std=1e-4, rotation_std=1e-3
    )
    dataset = simulate(scenario)
    assert dataset.truth is not None
    found = plain_comparison(dataset, Settings(estimators=("smoother",), verdict=FILTER))
    return found.evaluations[0].history, dataset.truth


def moved(truth: Truth, late: float = LATE) -> tuple[ReferenceMotion, np.ndarray, np.ndarray]:
    """The truth on a late clock, in axes and a frame of its own, with a gap; the two rotations."""
    axes = quaternion_from_axis_angle(np.array([0.6, 0.0, 0.8]), np.deg2rad(10.0))
    frame = quaternion_from_axis_angle(np.array([0.0, 1.0, 0.0]), np.deg2rad(40.0))
    q = multiply(
        np.tile(frame, (len(truth.time), 1)), multiply(truth.q_ig, np.tile(axes, (len(truth.time), 1)))
    )
    position = rotate(np.tile(frame, (len(truth.time), 1)), truth.center_of_mass) + np.array([1.0, 2.0, 3.0])
    keep = (truth.time < 10.0) | (truth.time > 13.0)
    reference = ReferenceMotion(
        "moved", truth.time[keep] + late, continuous_quaternions(q[keep]), position[keep]
    )
    return reference, axes, frame


def test_clock_axes_and_frame_of_a_moved_truth_are_found() -> None:
    history, truth = smoothed()
    reference, axes, frame = moved(truth)
    fit = compare_with_reference(history, reference).fit
    assert abs(fit.clock_offset - LATE) < max(2e-3, 4 * fit.clock_std)
    assert np.rad2deg(angle_between(quaternion_from_matrix(fit.axes), axes)) < 0.1
    assert np.rad2deg(angle_between(quaternion_from_matrix(fit.frame), frame)) < 0.2


def test_the_likelier_of_two_offsets_a_turn_apart_is_taken_and_not_the_smaller() -> None:
    """Attitudes repeat nearly after a turn of 5.8 s: an offset of -0.43 s was stated to 0.01 s."""
    motion = ContinuousMotion(smoothed()[0])
    time, late = np.arange(0.0, 29.5, 0.05), 5.4
    noise = quaternion_from_rotation_vector(0.1 * np.random.default_rng(1).standard_normal((len(time), 3)))
    attitude = continuous_quaternions(multiply(motion.at(time).q_ig, noise))
    reference = ReferenceMotion("noisy", time + late, attitude=attitude, shares_frame=True)
    fit = fit_reference(motion, reference)[0]
    assert abs(fit.clock_offset - late) < 4 * fit.clock_std


def test_a_reference_a_hundred_times_as_long_is_found_in_all_of_it() -> None:
    """Offsets were tried at 1,500 places, seconds apart, and thinned rows left few within the estimate."""
    motion = ContinuousMotion(smoothed()[0])
    J, step = motion.inertia, 0.25
    rates = [motion.at(np.zeros(1)).rate[0]]
    for _ in range(12_000):
        middle = rates[-1] + step / 2 * np.linalg.solve(J, np.cross(J @ rates[-1], rates[-1]))
        # spun up behind the estimate, for a free motion would repeat itself
        grown = 1.0 if step * len(rates) < 30.0 else 1.0001
        rates.append(grown * (rates[-1] + step * np.linalg.solve(J, np.cross(J @ middle, middle))))
    time = step * np.arange(len(rates))
    fit = fit_reference(motion, ReferenceMotion("long", time - 777.3, rate=np.array(rates)))[0]
    assert abs(fit.clock_offset + 777.3) < max(4 * fit.clock_std, 0.01)


def test_differences_are_those_from_a_truth_at_equal_stamps() -> None:
    history, truth = smoothed()
    exact = replace(moved(truth)[0], time=moved(truth)[0].time - LATE)
    ours, theirs = (compare_with_reference(history, each).rms for each in (moved(truth)[0], exact))
    for name in ("position", "attitude", "velocity", "rate"):
        assert ours[name] == pytest.approx(theirs[name], rel=0.02), name


def test_a_table_has_numbers_only_where_the_reference_has_values(tmp_path: Path) -> None:
    history, truth = smoothed()
    found = compare_with_reference(history, moved(truth)[0])
    assert found.velocity is not None
    shorter = replace(
        found.velocity,
        **{name: getattr(found.velocity, name)[5:-5] for name in ("time", "estimate", "reference")},
    )
    compared = ReferenceComparisons(moved(truth)[0], {"smoother": replace(found, velocity=shorter)}, {})
    (tmp_path / "smoother").mkdir()
    write_reference(tmp_path, compared, with_figures=False)
    (path,) = (tmp_path / "smoother").glob("*.csv")
    table = np.genfromtxt(path, delimiter=",", names=True)
    within = (table["time_s"] >= shorter.time[0]) & (table["time_s"] <= shorter.time[-1])
    assert within.any()
    assert not within.all()
    np.testing.assert_array_equal(np.isfinite(table["estimate_vx"]), within)


def test_what_a_fit_takes_up_is_counted_though_no_residual_shows_it() -> None:
    motion = ContinuousMotion(smoothed()[0])
    time = np.arange(0.5, 29.0, 0.1)
    own = motion.at(time)
    reference = ReferenceMotion("own motion", time, own.q_ig, shares_frame=True)
    found = compare_with_reference(smoothed()[0], reference)
    assert found.attitude is not None
    stated = np.sqrt(3.0) * np.median(own.std_attitude)
    left = np.sqrt(np.mean(np.sum(found.attitude**2, axis=1)))
    assert left < 0.1 * stated, "the estimate itself"
    assert found.attitude_rms_with_hidden is not None
    assert 0.2 < found.attitude_rms_with_hidden / stated < 3.0


def test_energies_of_a_free_body_hold_and_a_loss_of_the_reference_is_found() -> None:
    history, truth = smoothed()
    free = moved(truth)[0]
    found = compare_with_reference(history, free).energy_changes["rotation"]
    for change, std in found.values():
        assert abs(change) < max(4.0 * std, 0.02)
    time, rate = reference_rates(free)
    slower = np.exp(-0.1 * (time - time[0]) / np.ptp(time))[
        :, None
    ]  # of a motion that loses 18 % of its energy
    lost = replace(free, time=time, attitude=None, position=None, rate=slower * rate)
    change, std = compare_with_reference(history, lost).energy_changes["rotation"]["reference"]
    assert change == pytest.approx(np.exp(-0.2) - 1.0, abs=0.02)
    assert std < 0.02


def test_quaternions_of_the_other_sense_are_read_so_and_named() -> None:
    history, truth = smoothed()
    reference = moved(truth, 0.0)[0]
    assert reference.attitude is not None
    conjugate = replace(reference, attitude=reference.attitude * np.array([-1.0, -1.0, -1.0, 1.0]))
    assert "map the frame to the body" in compare_with_reference(history, conjugate).fit.form


def test_lost_markers_are_left_out() -> None:
    history, truth = smoothed()
    reference = moved(truth)[0]
    assert reference.position is not None
    position = reference.position.copy()
    position[[7, 23]] += 2.0
    fit = compare_with_reference(history, replace(reference, position=position)).fit
    assert abs(fit.clock_offset - LATE) < max(4e-3, 4 * fit.clock_std)


def test_turning_points_of_a_reference_without_noise_are_no_jumps() -> None:
    history, truth = smoothed()
    exact = moved(truth)[0]
    every = np.arange(len(exact.time))
    assert compare_with_reference(history, exact).reference.left_out == ()
    assert exact.position is not None
    position = np.where(np.isin(every, [7, 23, 24])[:, None], exact.position + 2.0, exact.position)
    left = compare_with_reference(history, replace(exact, position=position)).reference.left_out
    assert left == ("3 rows that jump",)


def test_rates_alone_give_clock_and_axes() -> None:
    history, truth = smoothed()
    whole = reference_of_truth(truth)
    rates = ReferenceMotion("rates", whole.time + LATE, rate=whole.rate)
    found = compare_with_reference(history, rates)
    assert abs(found.fit.clock_offset - LATE) < 0.03
    assert found.position is None
    assert found.attitude is None
    assert "x angular velocity corrected" in found.statistics


def test_a_late_truth_becomes_a_reference() -> None:
    dataset = simulate(Scenario.simplified(kind="gyro", epochs=12))
    assert dataset.truth is not None
    same, nothing = without_unmatched_truth(dataset)
    assert same is dataset
    assert nothing is None
    late, reference = without_unmatched_truth(
        replace(dataset, truth=replace(dataset.truth, time=dataset.truth.time + 0.1))
    )
    assert late.truth is None
    assert reference is not None
    assert len(reference.time) == 12


def test_files_of_others_are_read_with_gaps(tmp_path: Path) -> None:
    tum = tmp_path / "capture.tum"
    rows = [f"{0.1 * k} {k} 0 0 0 0 0 1" for k in range(6)]
    rows[3] = "0.3 nan nan nan nan nan nan nan"
    tum.write_text("\n".join(rows))
    read = read_reference(tum)
    assert len(read.time) == 5
    assert "1 rows without numbers" in read.left_out
    motive = tmp_path / "take.csv"
    head = [
        "Format Version,1.23,Rotation Type,Quaternion,Length Units,Millimeters",
        ",Type,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body",
        ",Name,B,B,B,B,B,B,B",
        ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position",
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z",
    ]
    body = [f"{k},{0.01 * k},0,0,0,1,{1000 * k},0,0" for k in range(6)]
    body[2] = "2,0.02,,,,,,,"
    motive.write_text("\n".join([*head, *body]))
    read = read_reference(motive)
    assert read.position is not None
    assert np.allclose(read.position[:, 0], [0, 1, 3, 4, 5])


@pytest.mark.parametrize(
    ("header", "row", "rate"),
    [
        ("time_s,wx,wy,wz", "{s},0.1,0,0", 0.1),
        ("timestamp_ns,omega_x,omega_y,omega_z", "{ns},0.1,0,0", 0.1),
        ("time (ms),gyro_x (deg/s),gyro_y (deg/s),gyro_z (deg/s)", "{ms},10,0,0", np.deg2rad(10)),
    ],
)
def test_rates_of_a_table_are_read_in_the_units_of_its_header(
    tmp_path: Path, header: str, row: str, rate: float
) -> None:
    path = tmp_path / "rates.csv"
    rows = [row.format(s=k, ms=1000 * k, ns=1_000_000_000 * k) for k in range(6)]
    path.write_text("\n".join([header, *rows]))
    read = read_reference(path)
    assert read.rate is not None
    np.testing.assert_allclose(read.time, np.arange(6))
    np.testing.assert_allclose(read.rate[:, 0], rate)


def test_dates_are_a_clock_and_refused_rows_are_counted(tmp_path: Path) -> None:
    head, row = "time,x,y,z,qx,qy,qz,qw", "1,2,3,0,0,0,1"
    dated = tmp_path / "dated.csv"
    dated.write_text("\n".join([head, *(f"2026-11-26T12:00:{k:02d}.5Z,{row}" for k in range(6))]))
    reference = read_reference(dated)
    np.testing.assert_allclose(np.diff(reference.time), 1.0)
    assert reference.time[0] == pytest.approx(1795694400.5)
    wrong = tmp_path / "wrong.csv"
    wrong.write_text("\n".join([head, *(f"{k},1,2,3,0,0,0,2" for k in range(6))]))
    with pytest.raises(InputError, match=r"6 rows whose quaternion is not of norm one.*correct them"):
        read_reference(wrong)


def test_any_recording_of_the_motion_is_a_reference(tmp_path: Path) -> None:
    dataset = simulate(Scenario.simplified(kind="pose", epochs=12))
    poses = dataset.log.streams[0]
    table = np.column_stack([poses.time, poses.values])
    header = "time x y z qx qy qz qw"
    np.savetxt(tmp_path / "poses.log", table, header=header, comments="")
    for given in (dataset, str(tmp_path / "poses.log")):
        found = chosen_reference(given, None, ("frame",))
        assert found.shares_frame
        assert found.position is not None
        np.testing.assert_allclose(found.position, poses.values[:, :3])
    rates = chosen_reference(simulate(Scenario.simplified(kind="gyro", epochs=12)), None, ())
    assert rates.attitude is None
    assert rates.rate is not None
    with pytest.raises(InputError, match="a reference has poses, attitudes or rates"):
        chosen_reference(simulate(Scenario.simplified(kind="mono-tracks", epochs=12)), None, ())


def test_biases_beside_poses_are_no_rates(tmp_path: Path) -> None:
    """As the ground truth of EuRoC holds them; its clock is in nanoseconds and does not say so."""
    path = tmp_path / "truth.csv"
    groups = [("p_RS_R", "xyz", "m"), ("q_RS", "wxyz", ""), ("v_RS_R", "xyz", "m s^-1")]
    groups += [("b_w_RS_S", "xyz", "rad s^-1"), ("b_a_RS_S", "xyz", "m s^-2")]
    names = [f" {stem}_{axis} [{unit}]" for stem, axes, unit in groups for axis in axes]
    rows = [f"{10**9 * k},{k},0,0,1,0,0,0,0,0,0,9,9,9,8,8,8" for k in range(6)]
    path.write_text("\n".join([",".join(["#timestamp", *names]), *rows]))
    read = read_reference(path)
    assert read.rate is None
    assert read.position is not None
    np.testing.assert_allclose(read.time, np.arange(6))
    np.testing.assert_allclose(read.position[:, 0], np.arange(6))
    assert read.attitude is not None
    np.testing.assert_allclose(np.abs(read.attitude), np.tile([0, 0, 0, 1.0], (6, 1)))


def test_a_table_without_a_time_is_refused_with_the_cure(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    path.write_text("qx,qy,qz,qw\n" + "0,0,0,1\n" * 6)
    with pytest.raises(InputError, match="no column of the time"):
        read_reference(path)
