"""Ten canonical motions as exact numbers in every chart, and landmarks."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import singledispatch

import numpy as np

from observability.coordinates import Chart, FilterChart, PrincipalChart, TensorChart
from observability.exact_numbers import Rationals, rational, rationals, unit_quaternion
from observability.system import AXES_OF_G
from spinfilters.core.errors import InputError
from spinfilters.models.state_blocks import BLOCKS

DIGITS = 6
"""Decimals of logarithms of ratios of moments, which make the body of a chart of logarithms: equal moments stay exactly equal."""
ATTITUDE_IB = unit_quaternion([0.2, -0.4, 0.3, 0.8])
ATTITUDE_GB = tuple(Fraction(part, 9) for part in (-4, 2, 5, 6))
"""Of exactly unit norm, and short fractions: directions in g along the axes b are exact as floats, too (`System.torque_axes`)."""
PLACE, VELOCITY = rationals((0.02, -0.03, 0.6)), rationals((0.002, 0.001, -0.001))
CENTRE = rationals((0.02, -0.015, 0.01))
BODY_RADIUS = 0.11
"""Of the ball that landmarks lie in, m."""


@dataclass(frozen=True)
class CanonicalMotion:
    """A free rotation.

    Attributes
    ----------
    name : str
        In words.
    rate : Rationals
        About the principal axes x, y, z, rad/s.
    moments : Rationals
        About them, any scale.
    steady : bool
        Whether the rate stays constant, that is, whether it is along a principal axis or zero.
    """

    name: str
    rate: Rationals
    moments: Rationals

    @property
    def steady(self) -> bool:
        """J w x w = 0, exactly."""
        (x, y, z), (a, b, c) = self.rate, self.moments
        return (b - c) * y * z == (c - a) * z * x == (a - b) * x * y == 0


def motion(
    name: str, rate: Sequence[float | str | Fraction], moments: Sequence[float | str | Fraction]
) -> CanonicalMotion:
    """A motion, from floats or strings.

    Raises
    ------
    InputError
        When the moments are not those of a rigid body.
    """
    exact = rationals(moments)
    if len(rate) != 3 or len(exact) != 3 or not sum(exact) > 2 * max(exact) or not min(exact) > 0:
        raise InputError(
            f"rate {list(rate)} and moments {list(moments)} are no motion; give three rates, and three positive moments of which "
            "none reaches the sum of the others"
        )
    return CanonicalMotion(name, rationals(rate), exact)


UNEQUAL, AXISYMMETRIC, EQUAL = (1.2, 1.0, 0.85), (1.1, 1.1, 0.8), (1.0, 1.0, 1.0)
CANONICAL_MOTIONS: tuple[CanonicalMotion, ...] = (
    motion("tumble", (0.3, 0.7, -0.5), UNEQUAL),
    motion("spin about the major axis", (0.9, 0.0, 0.0), UNEQUAL),
    motion("spin about the intermediate axis", (0.0, 0.9, 0.0), UNEQUAL),
    motion("spin about the minor axis", (0.0, 0.0, 0.9), UNEQUAL),
    motion("rate in a principal plane", (0.3, 0.0, 0.7), UNEQUAL),
    motion("axisymmetric, nutating", (0.3, 0.4, 0.7), AXISYMMETRIC),
    motion("axisymmetric, about its axis", (0.0, 0.0, 0.9), AXISYMMETRIC),
    motion("axisymmetric, transverse", (0.6, 0.5, 0.0), AXISYMMETRIC),
    motion("equal moments", (0.3, 0.7, -0.5), EQUAL),
    motion("no rotation", (0.0, 0.0, 0.0), UNEQUAL),
)


def equal_moments(of: CanonicalMotion, first: int, second: int) -> bool:
    """Whether two moments are equal in the logarithmic charts, to `DIGITS` decimals of their log ratio."""
    return _log_ratio(of.moments[first], of.moments[second]) == 0


def point_of(chart: Chart, of: CanonicalMotion) -> Rationals:
    """The motion's exact point in a chart, before a camera at 0.6 m.

    Raises
    ------
    InputError
        For a chart that is none of `observability.charts`.
    """
    blocks = blocks_of(chart, of)
    return chart.point({block.name: blocks[block.name] for block in chart.blocks})


def principal_axes(chart: Chart) -> tuple[Rationals, ...]:
    """Directions in g of the principal axes x, y, z at the point of any canonical motion (`point_of`)."""
    if not chart.has_turned_axes:
        return AXES_OF_G
    R = exact_matrix(ATTITUDE_GB)
    return tuple(tuple(R[row][column] for row in range(3)) for column in range(3))


def landmarks(count: int, seed: int = 0) -> tuple[Rationals, ...]:
    """Points in frame g, in general position, m to a tenth of a millimetre."""
    generator = np.random.default_rng(seed)
    points = np.round(BODY_RADIUS * generator.uniform(-1, 1, (count, 3)) / math.sqrt(3), 4)
    return tuple(rationals(point) for point in points)


@singledispatch
def blocks_of(chart: Chart, of: CanonicalMotion) -> dict[str, Rationals]:
    """Exact numbers of a motion's blocks in a chart.

    Some that the chart may lack are among them; each kind of chart registers its own.

    Raises
    ------
    InputError
        For a chart without an entry.
    """
    raise InputError(
        f"no motion is given in the chart {chart.name}; use Chart.point with numbers of your own"
    )


@blocks_of.register
def _principal(chart: PrincipalChart, of: CanonicalMotion) -> dict[str, Rationals]:
    return {
        "r": PLACE,
        "v": VELOCITY,
        "q_ib": ATTITUDE_IB,
        "w": of.rate,
        "k": (_log_ratio(of.moments[0], of.moments[1]), _log_ratio(of.moments[1], of.moments[2])),
        "J": of.moments,
        "q_gb": ATTITUDE_GB,
        "c": CENTRE,
    }


@blocks_of.register
def _tensor(chart: TensorChart, of: CanonicalMotion) -> dict[str, Rationals]:
    """The same in g axes: R_gb w and R_gb J R_gb', in fractions."""
    R = exact_matrix(ATTITUDE_GB)
    w = tuple(sum((R[i][k] * of.rate[k] for k in range(3)), Fraction(0)) for i in range(3))
    J = [
        [sum((R[i][k] * of.moments[k] * R[j][k] for k in range(3)), Fraction(0)) for j in range(3)]
        for i in range(3)
    ]
    tensor = (J[0][0], J[1][1], J[2][2], J[0][1], J[0][2], J[1][2])
    return {"t": PLACE, "q": ATTITUDE_IB, "v": VELOCITY, "w": w, "c": CENTRE, "J": tensor}


@blocks_of.register
def _filter_state(chart: FilterChart, of: CanonicalMotion) -> dict[str, Rationals]:
    """With g along the principal axes: s holds half logarithms of the second moments (`spinfilters.core.mass_distribution`).

    Blocks that a motion does not determine, such as the bias of a gyro, are at their origin.
    """
    half = sum(of.moments, Fraction(0)) / 2
    x, y, z = (half - moment for moment in of.moments)
    first, second = _log_ratio(x, y), _log_ratio(y, z)
    s = ((2 * first + second) / 6, (second - first) / 6, Fraction(0), Fraction(0), Fraction(0))
    others = {block.symbol: rationals(block.origin) for block in BLOCKS.values()}
    return others | {
        "t": PLACE,
        "q": ATTITUDE_IB,
        "v": VELOCITY,
        "w": of.rate,
        "c": CENTRE,
        "s": s,
        "n": (Fraction(0),),
    }


def exact_matrix(q: Rationals) -> list[list[Fraction]]:
    """R of a unit quaternion in fractions; `spinfilters.core.attitude_conversions.matrix_from_quaternion` in floats."""
    x, y, z, w = q
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]


def _log_ratio(a: Fraction, b: Fraction) -> Fraction:
    """ln(a / b) to `DIGITS` decimals, exactly 0 where a = b."""
    return rational(f"{math.log(a / b):.{DIGITS}f}")
