"""Figures 6-3 to 6-14: courses of the metrology of target and inspector, their energies and their relative motion (section 6.2).

The recordings are lost. A target at rest is spun up between 40 and 75 s to the commanded rate and then loses energy; the inspector
keeps its place within a dead band. Both are seen by a metrology with the errors of section 6.2.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

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
from spinfilters.core.conventions import RPM
from spinfilters.core.torque_free import torque_free_motion
from spinfilters.evaluation.estimated_motion import EnergyCourse, quadratic_energy
from spinfilters.evaluation.reference_fit import reference_rates
from spinfilters.io.reference_motion import ReferenceMotion, relative_reference
from spinfilters.plots.style import (
    AXIS_COLOURS,
    BLACK,
    BLUE,
    GREY,
    SIGMAS,
    fill_band,
    legend_below,
    plot_truth,
    tidy,
    truth_handle,
)
from spinfilters.reproduction.item import ComparedNumber, Item, ItemResult, tweddle_item
from spinfilters.reproduction.tweddle.metrology_comparison import (
    ACCURATE,
    GYRO,
    REPEATABLE,
    SPEED,
    STEP,
    TABLE_1,
)
from spinfilters.reproduction.tweddle.reference_inertia import ESLINGER, RATE, principal_axes
from spinfilters.simulation.inspector import dead_band

BEGIN, SPUN, END = 40.0, 75.0, 132.5
"""Spin-up begins and ends, as the text says; the recording ends 57.5 s, 115 stereo pairs, later; s."""
LOSS: Final = 0.078
"""Of the rotational energy while it moves freely (Figure 6-7)."""
MASS: Final = 4.487
"""kg (section 6.2.2)."""
DRIFT: Final = np.array([0.002, -0.0015, 0.001])
"""Velocity of the target, m/s; not printed."""
PLACE: Final = np.array([0.0, 0.0, 0.6])
"""Of the target before the inspector at the begin, m."""
NOTE: Final = (
    "The recordings are lost: target, inspector and metrology are simulated with what section 6.2 states, repeatable to 2 mm and "
    "1 deg about constant errors of 10 mm and 3 deg in drawn directions, spin-up from 40 to 75 s to (0.5, 10, 0.5) rpm. Its "
    "rate and the noise of gyros and velocities are not printed: 5 Hz, "
    "0.5 deg/s and 1 mm/s are taken. The printed curves are not compared, only what the text says of them."
)


@dataclass(frozen=True)
class Metrology:
    """Metrology of one body, with its true motion.

    Attributes
    ----------
    measured, shifted, true : ReferenceMotion
        Poses, rates about the body's axes and velocities: as measured, with the constant errors alone, and without any.
    """

    measured: ReferenceMotion
    shifted: ReferenceMotion
    true: ReferenceMotion


def _spin(time: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Share of the commanded rate, and its integral, s: a ramp, then the decay of a torque along the momentum."""
    decay = -math.log(1.0 - LOSS) / 2 / (END - SPUN)
    ramp = np.clip((time - BEGIN) / (SPUN - BEGIN), 0.0, 1.0)
    free = np.maximum(time - SPUN, 0.0)
    share = ramp * np.exp(-decay * free)
    turned = (SPUN - BEGIN) * ramp**2 / 2 + (1.0 - np.exp(-decay * free)) / decay
    return share, turned


@cache
def target(end: float = END) -> Metrology:
    """The target: torques along its momentum change how fast it runs through a torque-free motion, and nothing else.

    Parameters
    ----------
    end : float
        Of the recording, s.
    """
    time = np.arange(0.0, end + STEP / 2, STEP)
    moments, R = principal_axes(ESLINGER)
    share, turned = _spin(time)
    q = quaternion_from_matrix(R)
    motion = torque_free_motion(moments, R.T @ (RATE * RPM), turned, q)
    attitude = multiply(motion.attitude, np.tile(inverse(q), (len(time), 1)))
    rate = share[:, None] * rotate(np.tile(q, (len(time), 1)), motion.rate)
    position = PLACE + time[:, None] * DRIFT
    return measured_motion("target", time, attitude, position, rate, np.tile(DRIFT, (len(time), 1)), 61)


@cache
def inspector() -> Metrology:
    """The inspector in its dead band."""
    time = np.arange(0.0, END + STEP / 2, STEP)
    path = dead_band(PLACE, 6)
    poses, before, after = path(time), path(time - 0.01), path(time + 0.01)
    velocity = (after[:, :3] - before[:, :3]) / 0.02
    rate = rotation_vector_from_quaternion(multiply(inverse(before[:, 3:]), after[:, 3:])) / 0.02
    return measured_motion("inspector", time, poses[:, 3:], poses[:, :3], rate, velocity, 62)


def measured_motion(
    name: str,
    time: np.ndarray,
    attitude: np.ndarray,
    position: np.ndarray,
    rate: np.ndarray,
    velocity: np.ndarray,
    seed: int,
) -> Metrology:
    """Metrology of a true motion with both kinds of errors.

    Parameters
    ----------
    name : str
        Of the body.
    time : (n,) float array
        s.
    attitude, position, rate, velocity : (n, 4), (n, 3), (n, 3), (n, 3) float array
        True: of the geometric axes, m, about these axes in rad/s, m/s.
    seed : int
        Of the errors.
    """
    generator = np.random.default_rng(seed)
    drawn = generator.normal(size=(4, len(time), 3))
    direction = generator.normal(size=(2, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    off = quaternion_from_rotation_vector(ACCURATE[1] * direction[0])
    turned = multiply(np.broadcast_to(off, attitude.shape), attitude)
    moved = position + ACCURATE[0] * direction[1]
    measured = ReferenceMotion(
        f"metrology of the {name}",
        time,
        continuous_quaternions(multiply(turned, quaternion_from_rotation_vector(REPEATABLE[1] * drawn[0]))),
        moved + REPEATABLE[0] * drawn[1],
        rate + GYRO * drawn[2],
        velocity + SPEED * drawn[3],
    )
    shifted = ReferenceMotion(
        f"the {name}, displaced", time, continuous_quaternions(turned), moved, rate, velocity
    )
    true = ReferenceMotion(f"the {name}", time, continuous_quaternions(attitude), position, rate, velocity)
    return Metrology(measured, shifted, true)


def _repeatable(name: str, ours: float, printed: float, unit: str, count: int) -> ComparedNumber:
    """A repeatability: 5 % holds four deviations of an estimate from 600 rows of three axes."""
    return ComparedNumber(
        f"{name}, scatter of a row about the course with the constant error, one axis",
        ours,
        printed=printed,
        unit=unit,
        tolerance=0.05 * printed,
        why=f"the scatter of {count} rows of three axes is known to {100 / math.sqrt(6 * count):.1g} %",
        given=True,
    )


def _accurate(name: str, ours: float, printed: float, unit: str, chance: float) -> ComparedNumber:
    """A constant error: its mean over the rows, within four deviations of that."""
    return ComparedNumber(
        f"{name}, length of the mean error",
        ours,
        printed=printed,
        unit=unit,
        tolerance=4.0 * chance,
        why=f"the mean is known to {chance:.2g} {unit}, and this is more than four times that",
        given=True,
    )


def _position(motion: Metrology, words: str) -> ItemResult:
    measured, true = _blocks(motion, "position")
    shifted = motion.shifted.position
    assert shifted is not None
    count, scatter = len(measured), 1e3 * REPEATABLE[0]
    rows = [
        _repeatable("positions", 1e3 * float(np.std(measured - shifted)), scatter, "mm", count),
        _accurate(
            "positions",
            1e3 * float(np.linalg.norm(np.mean(measured - true, axis=0))),
            1e3 * ACCURATE[0],
            "mm",
            scatter / math.sqrt(count),
        ),
    ]
    figure = _courses(motion, measured, true, 1e3, "position [mm]", f"{words}: position")
    return ItemResult(rows, {"position": figure}, note=NOTE)


def _velocity(motion: Metrology, words: str) -> ItemResult:
    measured, true = _blocks(motion, "velocity")
    time = motion.measured.time
    place = _blocks(motion, "position")[0]
    moved = (place[-1] - place[0]) / (time[-1] - time[0])
    off = 1e3 * np.linalg.norm(np.mean(measured, axis=0) - moved)
    limit = 4e3 * math.sqrt(3.0) * (SPEED / math.sqrt(len(time)) + 1.5 * REPEATABLE[0] / (time[-1] - time[0]))
    rows = [
        ComparedNumber(
            "mean velocity apart from that of the positions; as four deviations of both allow",
            float(off),
            expected=(0.0, limit),
            unit="mm/s",
            why=f"four deviations are {limit:.2g} mm/s, which chance exceeds once in 16000 draws",
        )
    ]
    figure = _courses(motion, measured, true, 1e3, "velocity [mm/s]", f"{words}: velocity")
    return ItemResult(rows, {"velocity": figure}, note=NOTE)


def _attitude(motion: Metrology, words: str) -> ItemResult:
    measured, true = _blocks(motion, "attitude")
    shifted = motion.shifted.attitude
    assert shifted is not None
    count, scatter = len(measured), math.degrees(REPEATABLE[1])
    off = math.degrees(float(np.sqrt(np.mean(angle_between(measured, shifted) ** 2) / 3)))
    mean = np.mean(rotation_vector_from_quaternion(multiply(measured, inverse(true))), axis=0)
    rows = [
        _repeatable("attitudes", off, scatter, "deg", count),
        _accurate(
            "attitudes",
            math.degrees(float(np.linalg.norm(mean))),
            math.degrees(ACCURATE[1]),
            "deg",
            scatter / math.sqrt(count),
        ),
    ]
    figure = _courses(motion, measured, true, 1.0, "quaternion", f"{words}: attitude")
    return ItemResult(rows, {"attitude": figure}, note=NOTE)


def _blocks(motion: Metrology, name: str) -> tuple[np.ndarray, np.ndarray]:
    measured, true = getattr(motion.measured, name), getattr(motion.true, name)
    assert measured is not None
    assert true is not None
    return measured, true


def make_target_position() -> ItemResult:
    """Figure 6-3."""
    return _position(target(), "Target")


def make_target_velocity() -> ItemResult:
    """Figure 6-4."""
    return _velocity(target(), "Target")


def make_target_attitude() -> ItemResult:
    """Figure 6-5."""
    return _attitude(target(), "Target")


def make_target_rate() -> ItemResult:
    """Figure 6-6: begin and end of the spin-up as a ramp that is fitted to the measured rate, and the rate then."""
    motion = target()
    measured, true = _blocks(motion, "rate")
    time = motion.measured.time
    begin, end = _ramp(time, measured[:, 1])
    after = (time > SPUN) & (time < SPUN + 5.0)
    rows = [
        *(
            ComparedNumber(
                f"spin-up {word}",
                ours,
                printed=printed,
                unit="s",
                tolerance=0.5,
                why=f"a rate is measured to {math.degrees(GYRO):g} deg/s every {STEP:g} s",
                given=True,
            )
            for word, ours, printed in (("begins", begin, BEGIN), ("ends", end, SPUN))
        ),
        ComparedNumber(
            "rate about y in the first 5 s of free motion",
            float(np.mean(measured[after, 1])) / RPM,
            printed=float(RATE[1]),
            unit="rpm",
            tolerance=0.1,
            why=f"the body's own motion takes it from {RATE[1]:g} rpm within the first 5 s",
            given=True,
        ),
    ]
    figure = _courses(motion, measured, true, math.degrees(1.0), "rate [deg/s]", "Target: angular velocity")
    return ItemResult(rows, {"rate": figure}, note=NOTE)


def _ramp(time: Float[np.ndarray, " n"], rate: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """Begin and end, s, of the ramp: a straight line through the rates between a tenth and nine tenths of the level."""
    level = float(np.median(rate[(time > SPUN) & (time < SPUN + 5.0)]))
    inside = (time > 20.0) & (time < SPUN) & (rate > 0.1 * level) & (rate < 0.9 * level)
    slope, offset = np.polyfit(time[inside], rate[inside], 1)
    return float(-offset / slope), float((level - offset) / slope)


def make_inspector_position() -> ItemResult:
    """Figure 6-9."""
    return _position(inspector(), "Inspector")


def make_inspector_velocity() -> ItemResult:
    """Figure 6-10."""
    return _velocity(inspector(), "Inspector")


def make_inspector_attitude() -> ItemResult:
    """Figure 6-11."""
    return _attitude(inspector(), "Inspector")


def make_inspector_rate() -> ItemResult:
    """Figure 6-12: a dead band has no mean rate."""
    motion = inspector()
    measured, true = _blocks(motion, "rate")
    mean = math.degrees(float(np.linalg.norm(np.mean(measured, axis=0))))
    rows = [
        ComparedNumber(
            "mean rate of the inspector, which holds its attitude",
            mean,
            expected=(0.0, 0.1),
            unit="deg/s",
            why=f"the mean of {len(measured)} rows is known to {math.degrees(GYRO) / math.sqrt(len(measured)):.1g} deg/s an axis",
        )
    ]
    figure = _courses(
        motion, measured, true, math.degrees(1.0), "rate [deg/s]", "Inspector: angular velocity"
    )
    return ItemResult(rows, {"rate": figure}, note=NOTE)


def rotational_energy() -> EnergyCourse:
    """Of the measured rates, with Eslinger's inertia."""
    measured = _blocks(target(), "rate")[0]
    covariance = np.tile(GYRO**2 * np.eye(3), (len(measured), 1, 1))
    return quadratic_energy(target().measured.time, measured, covariance, ESLINGER)


def make_rotational_energy() -> ItemResult:
    """Figure 6-7: energy with its band, and what is lost in free motion."""
    course = rotational_energy()
    true = _blocks(target(), "rate")[1]
    held = np.einsum("ki,ij,kj->k", true, ESLINGER, true) / 2
    change, std = course.change(SPUN, END)
    rows = [
        ComparedNumber(
            "change of the rotational energy in free motion",
            100 * change,
            printed=-100 * LOSS,
            unit="%",
            tolerance=max(0.05, 300 * std),
            bound=100 * _loss_bound(),
            why=f"its deviation is {100 * std:.2g} %, and this is more than three times that",
            given=True,
        ),
        _count_inside_band(course, held),
    ]
    figure = _energy_figure(course, held, 1e3, "energy [mJ]", "Rotational kinetic energy of the target")
    return ItemResult(rows, {"energy": figure}, {"energy": _energy_table(course)}, note=NOTE)


def _loss_bound() -> float:
    """Bound of the share of energy that is lost in free motion, whose course is known up to its rate at first and its decay."""
    time, true = target().true.time, _blocks(target(), "rate")[1]
    free = time >= SPUN
    # w(t) = s exp(-d (t - SPUN)) times a known course: derivatives by the logarithm of s and by d
    slopes = np.stack([true[free], -(time[free] - SPUN)[:, np.newaxis] * true[free]], axis=-1).reshape(-1, 2)
    covariance = GYRO**2 * np.linalg.inv(slopes.T @ slopes)
    # the share is 1 - exp(-2 d T)
    return 2.0 * (END - SPUN) * (1.0 - LOSS) * float(np.sqrt(covariance[1, 1]))


def make_translational_energy() -> ItemResult:
    """Figure 6-8."""
    measured, true = _blocks(target(), "velocity")
    covariance = np.tile(SPEED**2 * np.eye(3), (len(measured), 1, 1))
    course = quadratic_energy(target().measured.time, measured, covariance, MASS * np.eye(3))
    held = MASS * np.sum(true**2, axis=1) / 2
    rows = [_count_inside_band(course, held)]
    figure = _energy_figure(course, held, 1e6, "energy [uJ]", "Translational kinetic energy of the target")
    return ItemResult(rows, {"energy": figure}, {"energy": _energy_table(course)}, note=NOTE)


def _count_inside_band(course: EnergyCourse, true: Float[np.ndarray, " k"]) -> ComparedNumber:
    """Share of the rows whose band holds the true energy; small energies are not Gaussian, hence the lower end."""
    inside = np.abs(course.energy - true) <= SIGMAS * course.std
    return ComparedNumber(
        f"rows whose band of {SIGMAS:g} deviations holds the true energy",
        100 * float(np.mean(inside)),
        expected=(97.0, 100.0),
        unit="%",
        why=f"of a normal distribution 99.7 % lie within {SIGMAS:g} deviations; energies near zero are squares",
    )


@cache
def relative() -> Metrology:
    """The target as the inspector's axes see it (Eqs 6.10 to 6.12)."""
    return Metrology(
        relative_reference(target().measured, inspector().measured),
        relative_reference(target().shifted, inspector().shifted),
        relative_reference(target().true, inspector().true),
    )


def make_relative_motion() -> ItemResult:
    """Figure 6-13: the relative reference, whose errors are those of both bodies, the inspector's attitude turning the place."""
    motion = relative()
    measured, true = _blocks(motion, "position")
    distance = float(np.mean(np.linalg.norm(true, axis=1)))
    expected = math.sqrt(2 * REPEATABLE[0] ** 2 + (distance * REPEATABLE[1]) ** 2 * 2 / 3)
    shifted, attitude = motion.shifted.position, motion.shifted.attitude
    assert shifted is not None
    assert attitude is not None
    ours = float(np.std(measured - shifted))
    attitudes = _blocks(motion, "attitude")
    angle = angle_between(attitudes[0], attitude)
    means = 10.0 * float(np.linalg.norm([TABLE_1[f"{axis} position"][0] for axis in "xyz"]))
    largest = 1e3 * (2 * ACCURATE[0] + 1.2 * distance * ACCURATE[1])
    off = 1e3 * float(np.linalg.norm(np.mean(measured - true, axis=0)))
    why = f"the scatter of {len(measured)} rows of three axes is known to {100 / math.sqrt(6 * len(measured)):.1g} %"
    rows = [
        ComparedNumber(
            "relative positions, length of the mean error: within what the accuracy of both bodies allows",
            off,
            expected=(0.0, largest),
            unit="mm",
            why=f"two places off by 10 mm and an attitude off by 3 deg at {distance:.2g} m are {largest:.2g} mm at most",
        ),
        ComparedNumber(
            "the same, less than the means of Table 6.1, which the text ascribes to the inspector's attitude",
            off,
            expected=(0.0, means),
            unit="mm",
            why=f"the means of Table 6.1 are {means:.3g} mm long, of directions that chance chose",
        ),
        ComparedNumber(
            "relative positions, scatter of an axis over what the errors of both bodies give",
            ours / expected,
            expected=(0.95, 1.05),
            why=why,
        ),
        ComparedNumber(
            "relative attitudes, scatter of an axis over what the errors of both bodies give",
            float(np.sqrt(np.mean(angle**2) / 3)) / (math.sqrt(2.0) * REPEATABLE[1]),
            expected=(0.95, 1.05),
            why=why,
        ),
    ]
    figure = Figure(figsize=(7.0, 6.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    _draw(upper, motion.measured.time, measured, true, 1.0, "relative position [m]")
    _draw(lower, motion.measured.time, *attitudes, 1.0, "relative quaternion")
    lower.set_xlabel("time [s]")
    figure.suptitle("The target in the axes of the inspector")
    return ItemResult(rows, {"relative": figure}, note=NOTE)


def make_difference_rate() -> ItemResult:
    """Figure 6-14: rates from differences of the quaternions (Eq. 6.13) compared with those of the gyros."""
    motion = target()
    poses = ReferenceMotion("attitudes alone", motion.measured.time, motion.measured.attitude)
    time, rate = reference_rates(poses)
    gyro = _blocks(motion, "rate")[0]
    own = np.stack([np.interp(time, motion.measured.time, gyro[:, k]) for k in range(3)], axis=1)
    scatter = float(np.sqrt(np.mean((rate - own) ** 2)))
    expected = math.sqrt(2 * (REPEATABLE[1] / STEP) ** 2 + GYRO**2 / 2)
    rows = [
        ComparedNumber(
            "differenced rates about those of the gyros, over what the noise of both gives",
            scatter / expected,
            expected=(0.93, 1.07),
            why=f"the scatter of {len(rate)} rows of three axes, whose neighbours share an attitude, is known to "
            f"{100 / math.sqrt(4 * len(rate)):.1g} %",
        )
    ]
    figure = Figure(figsize=(7.0, 6.0), layout="constrained")
    for k, axes in enumerate(figure.subplots(3, 1, sharex=True)):
        axes.plot(time, np.rad2deg(rate[:, k]), color=GREY, linestyle="none", marker=".", markersize=2.5)
        axes.plot(time, np.rad2deg(own[:, k]), color=AXIS_COLOURS[k], linewidth=1.1)
        axes.set_ylabel(f"{'xyz'[k]} rate [deg/s]")
        tidy(axes)
    figure.axes[-1].set_xlabel("time [s]")
    figure.suptitle("Rates from differences of quaternions (grey) and of the gyros")
    return ItemResult(rows, {"difference-rate": figure}, note=NOTE)


def _courses(
    motion: Metrology, measured: np.ndarray, true: np.ndarray, scale: float, label: str, title: str
) -> Figure:
    figure = Figure(figsize=(7.0, 3.6), layout="constrained")
    axes = figure.subplots()
    _draw(axes, motion.measured.time, measured, true, scale, label)
    axes.set_xlabel("time [s]")
    axes.set_title(f"{title}; dots metrology, lines true", loc="left", fontsize="medium")
    return figure


def _draw(
    axes: Axes, time: np.ndarray, measured: np.ndarray, true: np.ndarray, scale: float, label: str
) -> None:
    names: Sequence[str] = ("x", "y", "z", "w")
    colours = (*AXIS_COLOURS, BLACK)
    for k in range(measured.shape[1]):
        axes.plot(
            time, scale * measured[:, k], color=colours[k], linestyle="none", marker=".", markersize=2.0
        )
        axes.plot(time, scale * true[:, k], color=colours[k], linewidth=1.2, label=names[k])
    axes.set_ylabel(label)
    axes.legend(frameon=False, ncols=4, fontsize="small")
    tidy(axes)


def _energy_figure(
    course: EnergyCourse, true: Float[np.ndarray, " k"], scale: float, label: str, title: str
) -> Figure:
    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    fill_band(axes, course.time, scale * course.energy, SIGMAS * scale * course.std, BLUE)
    axes.plot(course.time, scale * course.energy, color=BLUE, linewidth=1.0)
    plot_truth(axes, course.time, scale * true)
    axes.set_xlabel("time [s]")
    axes.set_ylabel(label)
    axes.set_title(title, loc="left", fontsize="medium")
    tidy(axes)
    band = Patch(color=BLUE, alpha=0.3, label=f"±{SIGMAS:g} σ")
    legend_below(figure, [Line2D([], [], color=BLUE, label="metrology"), band, truth_handle()])
    return figure


def _energy_table(course: EnergyCourse) -> list[dict[str, float]]:
    return [
        {"time_s": float(t), "energy_J": float(value), "std_J": float(std)}
        for t, value, std in zip(course.time, course.energy, course.std, strict=True)
    ]


def _item(number: str, title: str, make: Callable[[], ItemResult]) -> Item:
    return tweddle_item(f"Figure {number}", "section 6.2", title, make)


METROLOGY_COURSES: Final = (
    _item("6-3", "Position of the target by its metrology", make_target_position),
    _item("6-4", "Velocity of the target by its metrology", make_target_velocity),
    _item("6-5", "Attitude of the target by its metrology", make_target_attitude),
    _item("6-6", "Angular velocity of the target by its metrology", make_target_rate),
    _item("6-7", "Rotational kinetic energy of the target", make_rotational_energy),
    _item("6-8", "Translational kinetic energy of the target", make_translational_energy),
    _item("6-9", "Position of the inspector in its dead band", make_inspector_position),
    _item("6-10", "Velocity of the inspector in its dead band", make_inspector_velocity),
    _item("6-11", "Attitude of the inspector in its dead band", make_inspector_attitude),
    _item("6-12", "Angular velocity of the inspector in its dead band", make_inspector_rate),
    _item("6-13", "Target in the axes of the inspector, with Eqs 6.10 to 6.12", make_relative_motion),
    _item("6-14", "Rates from differences of quaternions, with Eq. 6.13", make_difference_rate),
)
