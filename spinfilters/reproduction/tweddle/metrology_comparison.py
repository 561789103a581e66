"""Tables 6.1 and 6.2 with Figures 6-16 to 6-21: the smoother against a metrology of its own axes and errors (section 6.5.1).

The recordings are lost. A target as in chapter 6 is simulated, with tracks of unknown landmarks for the smoother, and a metrology
with the errors of section 6.2: repeatable to 2 mm and 1 deg, accurate to 10 mm and 3 deg.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from spinfilters.core.attitude_conversions import (
    continuous_quaternions,
    inverse,
    matrix_from_quaternion,
    multiply,
    quaternion_from_axis_angle,
    quaternion_from_matrix,
    quaternion_from_rotation_vector,
    rotate,
)
from spinfilters.evaluation.estimated_motion import estimated_rates, trajectory_of
from spinfilters.evaluation.recording_bound import cramer_rao_bound
from spinfilters.evaluation.reference_comparison import ReferenceComparison, compare_with_reference
from spinfilters.filters.history import EstimateHistory
from spinfilters.io.dataset import Dataset
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.reference_motion import ReferenceMotion
from spinfilters.io.truth import Truth
from spinfilters.plots.reference_figures import (
    place_courses_figure,
    reference_differences_figure,
    reference_values_figure,
    turn_courses_figure,
)
from spinfilters.reproduction.item import ComparedNumber, ItemResult, tweddle_item
from spinfilters.reproduction.tweddle.replaced_recordings import FULL, NO_BOUND, SHORT
from spinfilters.run.comparison_run import compare_dataset
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate, without_map

Drawing = Callable[[ReferenceComparison], Figure]
"""Makes the figure of a comparison."""
Table = Mapping[str, tuple[float, float]]
"""Mean and standard deviation of each quantity."""

STEP: Final = 0.2
"""Between rows of the metrology, s; not stated by the source."""
REPEATABLE: Final = (0.002, np.deg2rad(1.0))
"""m and rad, every row (section 6.2)."""
ACCURATE: Final = (0.010, np.deg2rad(3.0))
"""m and rad, constant: place, and attitude of the inspector."""
GYRO, SPEED = np.deg2rad(0.5), 0.001
"""rad/s and m/s, every row; not stated by the source."""
TURN: Final = np.deg2rad(9.094)
"""From the principal to the geometric axes, about y (Eq. 6.25)."""

TABLE_1: Final[Table] = {
    "x position": (1.59, 0.920),
    "y position": (-6.27, 3.13),
    "z position": (4.91, 1.36),
    "x velocity": (-0.00369, 0.134),
    "y velocity": (0.0828, 0.229),
    "z velocity": (-0.236, 0.158),
    "closest angle": (17.69, 3.59),
    "x angular velocity": (-3.16, 1.80),
    "y angular velocity": (-1.29, 0.930),
    "z angular velocity": (-5.44, 2.20),
}
"""Table 6.1: mean and standard deviation, cm, cm/s, deg and deg/s."""
TABLE_2: Final[Table] = {
    "closest angle": (13.48, 2.91),
    "x angular velocity": (-0.30, 1.50),
    "y angular velocity": (-1.29, 0.930),
    "z angular velocity": (-0.25, 0.868),
}
PLACE_ROWS: Final = ("position", "x velocity", "y velocity", "z velocity")
TURN_ROWS: Final = ("closest angle", "angular velocity")
"""Parts of names of the rows that belong to places and to rotations."""
CHANCE: Final = 2.0
"""Standard errors within which two means agree."""
SIMULATED: Final = (
    "The metrology is simulated. Its rate and the noise of its gyros and velocities are not printed: 5 Hz, 0.5 deg/s and 1 mm/s "
    "are taken, and deviations of rates and velocities are mostly these. What is better than printed here says that such a "
    "metrology and this smoother would have agreed better, not that the thesis' own data would."
)


@dataclass(frozen=True, eq=False)
class MetrologyTest:
    """The smoother against a simulated metrology.

    Attributes
    ----------
    comparison : ReferenceComparison
        As `spinfilters compare --reference` makes it.
    shifts : mapping
        By the name of a row, what the metrology's constant errors add to its mean, SI units.
    bounds : mapping
        By the name of a row, the least root mean square of the difference, of the smoother's bound over the epochs and the
        metrology's noise, SI units. Empty without a bound.
    """

    comparison: ReferenceComparison
    shifts: Mapping[str, float]
    bounds: Mapping[str, float]


@cache
def compared(scenario: Scenario = FULL) -> MetrologyTest:
    """The smoother against the simulated metrology.

    Parameters
    ----------
    scenario : Scenario
        Of the tracks; rows of the metrology are added.
    """
    dataset = simulate(replace(scenario, beside=(("gyro", STEP),)))
    truth = dataset.truth
    assert truth is not None
    seen = without_map(_without_gyro(dataset))
    found = compare_dataset(seen, Settings(estimators=("smoother",)))
    metrology, shifts = _metrology(truth)
    evaluation = found.evaluations[0]
    bound = cramer_rao_bound(found.setup, truth, evaluation)
    return MetrologyTest(
        compare_with_reference(evaluation.history, metrology),
        shifts,
        {} if bound is None else _least_deviations(bound, truth),
    )


def _least_deviations(bound: EstimateHistory, truth: Truth) -> dict[str, float]:
    """By row, root mean square over the epochs of the smoother's bound and the metrology's noise."""
    motion = trajectory_of(bound)
    rates = estimated_rates(bound).in_axes(matrix_from_quaternion(_geometric_axes(truth)).T).std
    assert rates is not None
    found = {}
    for name, std, noise in (
        ("position", motion.std_position, REPEATABLE[0]),
        ("velocity", motion.std_velocity, SPEED),
        ("angular velocity", rates, GYRO),
    ):
        for axis, square in zip("xyz", np.mean(np.square(std[1:]), axis=0), strict=True):
            found[f"{axis} {name}"] = float(np.sqrt(square + noise**2))
    attitude = np.mean(np.sum(np.square(motion.std_attitude[1:]), axis=1))
    return found | {"closest angle": float(np.sqrt(attitude + 3.0 * REPEATABLE[1] ** 2))}


def _without_gyro(dataset: Dataset) -> Dataset:
    streams = tuple(stream for stream in dataset.log.streams if stream.sensor == dataset.sensor)
    return replace(dataset, log=MeasurementLog(streams))


def _geometric_axes(truth: Truth) -> Float[np.ndarray, "4"]:
    """Quaternion of the geometric axes in g."""
    assert truth.principal_axes_g is not None
    return multiply(
        quaternion_from_matrix(truth.principal_axes_g.T),
        quaternion_from_axis_angle(np.array([0.0, 1.0, 0.0]), -TURN),
    )


def _metrology(truth: Truth) -> tuple[ReferenceMotion, dict[str, float]]:
    """Relative poses with both kinds of errors, rates of the target's gyros about its geometric axes, and shifts of the means."""
    generator = np.random.default_rng(38)
    rows = np.flatnonzero(np.abs(truth.time / STEP - np.round(truth.time / STEP)) < 1e-6)
    count = len(rows)
    direction = generator.normal(size=(2, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    off = quaternion_from_rotation_vector(ACCURATE[1] * direction[0])
    drawn = generator.normal(size=(4, count, 3))
    turned = np.broadcast_to(off, (count, 4))
    axes = np.broadcast_to(_geometric_axes(truth), (count, 4))
    q = multiply(multiply(turned, truth.q_ig[rows]), axes)
    q = multiply(q, quaternion_from_rotation_vector(REPEATABLE[1] * drawn[0]))
    place = rotate(turned, truth.center_of_mass[rows]) + ACCURATE[0] * direction[1]
    velocity = rotate(turned, truth.velocity[rows])
    rate_g = rotate(inverse(truth.q_ig[rows]), truth.rate_i[rows])
    shifts = {}
    for name, own, true in (
        ("position", place, truth.center_of_mass[rows]),
        ("velocity", velocity, truth.velocity[rows]),
    ):
        for axis, shift in zip("xyz", np.mean(true - own, axis=0), strict=True):
            shifts[f"{axis} {name}"] = float(shift)
    measured = ReferenceMotion(
        "simulated metrology",
        truth.time[rows],
        continuous_quaternions(q),
        place + REPEATABLE[0] * drawn[1],
        rotate(inverse(axes), rate_g) + GYRO * drawn[2],
        velocity + SPEED * drawn[3],
        shares_frame=True,
        shares_origin=True,
    )
    return measured, shifts


def make_raw(scenario: Scenario = FULL) -> ItemResult:
    """Table 6.1, and the courses of Figures 6-16 and 6-18."""
    test = compared(scenario)
    return ItemResult(
        _rows(test, TABLE_1, ""),
        {"values": reference_values_figure(test.comparison)},
        {"table": _table(test, TABLE_1, "")},
        f"{SIMULATED} Means have the sign of smoother minus metrology; those of places follow the drawn directions.",
    )


def make_corrected(scenario: Scenario = FULL) -> ItemResult:
    """Table 6.2, and the differences of Figures 6-17, 6-19 and 6-21."""
    test = compared(scenario)
    return ItemResult(
        _rows(test, TABLE_2, " corrected"),
        {"differences": reference_differences_figure(test.comparison)},
        {"table": _table(test, TABLE_2, " corrected")},
        f"{SIMULATED} {'. '.join(test.comparison.sentences)}. Printed: turned by 9.094 deg about y.",
    )


COURSES: Final[tuple[tuple[str, str, Table, tuple[str, ...], Drawing], ...]] = (
    (
        "6-16",
        "Position and velocity, smoother and metrology",
        TABLE_1,
        PLACE_ROWS,
        lambda found: place_courses_figure(found, False),
    ),
    (
        "6-17",
        "Differences of position and velocity",
        TABLE_1,
        PLACE_ROWS,
        lambda found: place_courses_figure(found, True),
    ),
    (
        "6-18",
        "Attitude and angular velocity, smoother and metrology, axes flipped",
        TABLE_1,
        TURN_ROWS,
        lambda found: turn_courses_figure(found, False, False),
    ),
    (
        "6-19",
        "Differences of attitude and angular velocity, axes flipped",
        TABLE_1,
        TURN_ROWS,
        lambda found: turn_courses_figure(found, False, True),
    ),
    (
        "6-20",
        "Attitude and angular velocity, smoother and metrology, axes corrected",
        TABLE_2,
        TURN_ROWS,
        lambda found: turn_courses_figure(found, True, False),
    ),
    (
        "6-21",
        "Differences of attitude and angular velocity, axes corrected",
        TABLE_2,
        TURN_ROWS,
        lambda found: turn_courses_figure(found, True, True),
    ),
)
"""Figures: number, title, table that their means and deviations are in, parts of the names of its rows, drawing."""


def _make_courses(
    title: str, table: Table, words: tuple[str, ...], draw: Drawing, scenario: Scenario = FULL
) -> ItemResult:
    """Rows of a table whose names hold one of the words, with the figure of their courses."""
    test = compared(scenario)
    chosen = {name: values for name, values in table.items() if any(word in name for word in words)}
    note = f"{SIMULATED} The printed curves are not compared, only their means and standard deviations."
    rows = _rows(test, chosen, " corrected" if table is TABLE_2 else "")
    figure = draw(test.comparison)
    figure.suptitle(title, fontsize="large")
    return ItemResult(rows, {"courses": figure}, note=note)


def _table(test: MetrologyTest, table: Table, suffix: str) -> list[dict[str, float | int | str]]:
    """The table as printed, with ours and the bound beside."""
    rows = []
    for name, (mean, std) in table.items():
        scale, unit = _unit(name)
        our_mean, our_std = (scale * value for value in test.comparison.statistics[name + suffix])
        bound = scale * test.bounds.get(name, float("nan"))
        rows.append(
            {
                "quantity": name,
                "unit": unit,
                "printed_mean": mean,
                "mean": our_mean,
                "printed_std": std,
                "std": our_std,
                "bound_rms": bound,
            }
        )
    return rows


def _rows(test: MetrologyTest, table: Table, suffix: str) -> list[ComparedNumber]:
    """A row for the mean and one for the deviation of each quantity; both means have the standard error of as many rows."""
    found, rows = test.comparison, []
    count = len(found.rate_after.time)
    for name, (mean, std) in table.items():
        scale, unit = _unit(name)
        our_mean, our_std = (scale * value for value in found.statistics[name + suffix])
        chance = CHANCE * float(np.hypot(std, our_std)) / np.sqrt(count)
        for word, ours, printed, least, bound in (
            ("mean", our_mean, mean, chance, _mean_bound(test, name, scale, unit)),
            ("standard deviation", our_std, std, 0.0, _std_bound(test, name, scale, unit)),
        ):
            rows.append(
                ComparedNumber(
                    f"{name}, {word}",
                    ours,
                    printed=printed,
                    unit=unit,
                    tolerance=max(0.05 * abs(printed), least),
                    bound=bound,
                    smaller_is_better=True,
                    why=_why(test, name),
                )
            )
    return rows


def _mean_bound(test: MetrologyTest, name: str, scale: float, unit: str) -> float | str:
    """Bound of a mean: by the metrology's noise alone, or the constant error that stands in it."""
    if name in test.shifts:
        return f"constant error of the metrology: {scale * test.shifts[name]:+.3g} {unit}"
    if name == "closest angle":
        return _std_bound(test, name, scale, unit)
    return scale * GYRO / float(np.sqrt(len(test.comparison.rate_after.time)))


def _std_bound(test: MetrologyTest, name: str, scale: float, unit: str) -> str:
    """Bound of the root mean square: an error of the smoother that is alike over time stands in the mean."""
    if name not in test.bounds:
        return NO_BOUND
    return f"{scale * test.bounds[name]:.3g} {unit} of mean and deviation together"


def _why(test: MetrologyTest, name: str) -> str:
    """Why a row differs: with axes that are only flipped, differences follow the motion, which is lost."""
    found = test.comparison
    about_z = np.rad2deg(found.rate_after.reference[:, 2])
    if name == "x angular velocity":
        means, stds = ((TABLE_1[name][k], TABLE_2[name][k]) for k in (0, 1))
        mean = abs(means[0] - means[1]) / np.sin(TURN)
        std = np.sqrt(stds[0] ** 2 - stds[1] ** 2) / np.sin(TURN)
        return (
            f"axes turned by 9.1 deg about y show a part of the rate about z, {abs(about_z.mean()):.1f} +- {about_z.std():.1f} "
            f"deg/s in the simulated motion; Tables 6.1 and 6.2 mean {mean:.1f} +- {std:.1f} deg/s in the lost one"
        )
    if name == "closest angle" and found.attitude_before is not None:
        angle = np.rad2deg(found.attitude_before.angle)
        return (
            f"with axes off by 9.1 deg the angle follows the motion, from {angle.min():.1f} to {angle.max():.1f} deg in the "
            "simulated one; that of the test is lost"
        )
    scale, unit = _unit(name)
    if name in test.shifts:
        return (
            f"the drawn constant errors of the metrology, 10 mm and 3 deg, add {scale * test.shifts[name]:+.3g} {unit} to "
            "the mean; "
            "those of the lost one are not known"
        )
    return f"the lost gyros' noise is not printed; {np.rad2deg(GYRO):g} deg/s are taken"


def _unit(name: str) -> tuple[float, str]:
    if "angular" in name:
        return 180.0 / np.pi, "deg/s"
    if "angle" in name:
        return 180.0 / np.pi, "deg"
    return 100.0, "cm/s" if "velocity" in name else "cm"


METROLOGY_COMPARISON: Final = (
    *(
        tweddle_item(number, "section 6.5.1", title, make, seconds, partial(make, SHORT))
        for number, title, make, seconds in (
            ("Table 6.1", "Smoother against metrology, axes only flipped", make_raw, 10.0),
            ("Table 6.2", "Smoother against metrology, axes corrected", make_corrected, 3.0),
        )
    ),
    *(
        tweddle_item(
            f"Figure {number}",
            "section 6.5.1",
            title,
            partial(_make_courses, title, table, words, draw),
            3.0,
            partial(_make_courses, title, table, words, draw, SHORT),
        )
        for number, title, table, words, draw in COURSES
    ),
)
